//! Inputs of the thread beside the cyclic one: instructions, signals, and notices of the cyclic thread.

use std::collections::VecDeque;
use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::ControlPort;
use crate::carrier_report::CarrierReport;
use crate::input::{Input, Lines};
use protocol_linux::{Interface, Notifier, StopSignals};

/// Source of a node's instructions.
#[derive(Debug)]
pub enum Commands {
    /// None: the node works without instructions.
    None,
    /// Standard input, from the process that started the node.
    Stdin,
    /// A controller that connects over TCP.
    Control(Box<ControlPort>),
}

/// Waits for all inputs at once.
#[derive(Debug)]
pub struct Inbox {
    signals: StopSignals,
    notices: Notifier,
    commands: Commands,
    lines: Lines,
    waiting: VecDeque<Input>,
    /// Whether the cyclic thread has notified since the last input.
    has_notices: bool,
    /// The interface whose state is an input once a second, and when it is the next one.
    link: Option<(Interface, Instant)>,
    /// The interface whose carrier is an input when it changes.
    carrier: Option<CarrierReport>,
}

/// Time between two reports of the interface's state.
const LINK_EVERY: Duration = Duration::from_secs(1);

impl Inbox {
    /// Creates an inbox for signals, `notices` and the instructions' source.
    #[must_use]
    pub fn new(signals: StopSignals, notices: Notifier, commands: Commands) -> Self {
        Self {
            signals,
            notices,
            commands,
            lines: Lines::default(),
            waiting: VecDeque::new(),
            has_notices: false,
            link: None,
            carrier: None,
        }
    }

    /// Makes the state of an interface an input, now and once a second.
    pub(crate) fn report_link_of(&mut self, interface: Option<Interface>) {
        self.link = interface.map(|interface| (interface, Instant::now()));
    }

    /// Makes the carrier of an interface an input, now and whenever it changes.
    pub(crate) fn report_carrier_by(&mut self, report: CarrierReport) {
        self.carrier = Some(report);
    }

    /// Makes the carrier an input once more.
    pub(crate) fn repeat_carrier(&mut self) {
        self.carrier.iter_mut().for_each(CarrierReport::repeat);
    }

    /// Waits for the next input; `None` if the cyclic thread has sent a notice, or ended.
    pub fn wait(&mut self) -> std::io::Result<Option<Input>> {
        loop {
            if core::mem::take(&mut self.has_notices) {
                return Ok(None);
            }
            if let Some(input) = self.waiting.pop_front() {
                return Ok(Some(input));
            }
            if let Commands::Control(port) = &mut self.commands
                && let Some(input) = port.next()
            {
                return Ok(Some(input));
            }
            if let Some(is_up) = self.carrier.as_mut().and_then(CarrierReport::take) {
                return Ok(Some(Input::Carrier(is_up)));
            }
            if let Some((interface, at)) = &mut self.link
                && Instant::now() >= *at
            {
                *at = Instant::now() + LINK_EVERY;
                return Ok(Some(Input::Link(interface.link_status())));
            }
            self.poll()?;
        }
    }

    /// Returns the control port, if the instructions come from one.
    pub(crate) fn control(&mut self) -> Option<&mut ControlPort> {
        match &mut self.commands {
            Commands::Control(port) => Some(port),
            Commands::None | Commands::Stdin => None,
        }
    }

    fn poll(&mut self) -> std::io::Result<()> {
        let stdin = std::io::stdin();
        let mut time_left = self.link.as_ref().map(|(_, at)| at.saturating_duration_since(Instant::now()));
        let [notices, stop, carrier, commands, is_timeout] = {
            let notices = PollFd::new(&self.notices, PollFlags::IN);
            let stop = PollFd::new(&self.signals, PollFlags::IN);
            let commands = match &self.commands {
                Commands::None => Vec::new(),
                Commands::Stdin => vec![PollFd::from_borrowed_fd(stdin.as_fd(), PollFlags::IN)],
                Commands::Control(port) => {
                    time_left = [time_left, port.time_left()].into_iter().flatten().min();
                    port.poll_fds()
                }
            };
            let carrier = self.carrier.as_ref().map(|carrier| PollFd::new(carrier, PollFlags::IN));
            let before_commands = 2 + usize::from(carrier.is_some());
            let mut waits: Vec<_> = [notices, stop].into_iter().chain(carrier).chain(commands).collect();
            let time_left = time_left.and_then(|time| Timespec::try_from(time).ok());
            let ready = match poll(&mut waits, time_left.as_ref()) {
                Ok(ready) => ready,
                Err(Errno::INTR) => return Ok(()),
                Err(error) => return Err(error.into()),
            };
            let is_ready = |wait: &PollFd<'_>| !wait.revents().is_empty();
            let [notices, stop] = [0, 1].map(|index| waits.get(index).is_some_and(is_ready));
            let carrier = before_commands > 2 && waits.get(2).is_some_and(is_ready);
            let is_any = waits.iter().skip(before_commands).any(is_ready);
            [notices, stop, carrier, is_any, ready == 0]
        };
        // Notices from before a stop are returned before the stop.
        if notices {
            self.notices.clear();
            self.has_notices = true;
        }
        if stop && let Some(signal) = self.signals.take() {
            self.waiting.push_back(Input::Stop(signal));
        }
        if carrier {
            self.carrier.iter_mut().for_each(CarrierReport::note_change);
        }
        match &mut self.commands {
            // Reading after a timeout would wait for a line, and hold back all events until it comes.
            Commands::Stdin if commands => self.read_stdin(&stdin)?,
            Commands::Control(port) if commands || is_timeout => port.handle(),
            _ => {}
        }
        Ok(())
    }

    fn read_stdin(&mut self, stdin: &std::io::Stdin) -> std::io::Result<()> {
        let mut bytes = [0; 4096];
        let len = match rustix::io::read(stdin.as_fd(), &mut bytes) {
            Ok(len) => len,
            Err(Errno::INTR | Errno::AGAIN) => return Ok(()),
            Err(error) => return Err(error.into()),
        };
        let read = bytes.get(..len).unwrap_or_default();
        let lines = self.lines.take(read).ok().filter(|_| !read.is_empty());
        let Some(lines) = lines else {
            self.commands = Commands::None;
            self.waiting.push_back(Input::Closed);
            return Ok(());
        };
        self.waiting.extend(lines.into_iter().map(Input::Line));
        Ok(())
    }
}
