//! A node as its process runs it: what every node has in common, whichever its bus and its work.

use std::fmt::{self, Debug};
use std::net::{Ipv4Addr, SocketAddr};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

use machine::{Counters, Down, DownCause, LinkEvent};
use machine::{Instant, Lateness, Machine};
use rustix::io::Errno;

use crate::trace_file::{self, TraceError, TraceRing, TraceWriter};
use crate::{Commands, ControlPort, Inbox, Input, ShortText};
use protocol_linux::{
    CyclicThread, Driver, DriverError, Interface, InterfaceError, Notifier, Outbox, PortError, RingFull,
    StartError, Statistics, StopSignal, StopSignals, Task, allocation,
};

/// How long the peer may take to answer the end of a connection, before the process ends without that answer.
const FAREWELL: Duration = Duration::from_millis(300);

/// A machine that is a whole node: a PLC or a robot on its bus.
pub trait Node: Machine<Event: Send + Debug> + Send + 'static {
    /// What its owner may want of it, besides what every node does.
    type Order: Send + Debug + 'static;
    /// What it answers to that.
    type Answer: Send + Debug + 'static;
    /// What it does in one cycle, for records.
    type Sample: Copy + Send + Debug + 'static;

    /// The news of the connection in an event, if it is one.
    fn link_event(event: &Self::Event) -> Option<LinkEvent>;

    /// Does what the owner wants; the answer, if there is one, goes back at once.
    fn order(&mut self, now: Instant, order: Self::Order) -> Option<Self::Answer>;

    /// `address_set` of its bus.
    fn address_set(&mut self, now: Instant, done: bool);

    /// `explain` of its bus.
    fn explain(&self, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// Ends the connection as its standard wants it.
    fn disconnect(&mut self, now: Instant);

    /// Lateness of its own cycle.
    fn lateness(&self) -> &Lateness;

    /// Frames of its bus.
    fn counters(&self) -> Counters;

    /// Changes with each of its cycles.
    fn cycle_number(&self) -> u64;

    /// What it did in its last cycle, at `now` or before.
    fn sample(&self, now: Instant) -> Self::Sample;

    /// Appends a sample as one line: when, in ns of this clock, then the columns of a trace from the third on.
    fn write_sample(sample: &Self::Sample, line: &mut String);
}

/// What the process wants of the cyclic thread.
#[derive(Debug)]
pub enum Command<O> {
    /// A [`News::Snapshot`] of how it goes.
    Report,
    /// An orderly end.
    Stop,
    /// Record each cycle from now on, or no more.
    Record(bool),
    /// Something that only this node knows.
    Order(O),
}

/// What the cyclic thread tells the process.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a box would be an allocation on the cyclic thread")]
pub enum News<E, A> {
    /// An event of the node.
    Event(E),
    /// Why the peer refused the connection and what it has instead; the event that says so is next.
    Explanation(ShortText),
    /// An answer to an order.
    Answer(A),
    /// The interface did not take the address that the bus wanted it to have.
    NoAddress(Ipv4Addr, InterfaceError),
    /// How it goes.
    Snapshot(Snapshot),
}

/// How a node does, at one moment.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Lateness of the node's own cycle.
    pub cycle: Lateness,
    /// Lateness of the thread, at any deadline of the machine.
    pub wake: Lateness,
    /// Frames of its bus.
    pub bus: Counters,
    /// Allocations of the cyclic thread until the connection was up first, and since; none where nobody counts.
    pub allocations: Option<(u64, u64)>,
    /// Frames that the kernel did not take.
    pub send_errors: u64,
    /// What the kernel said last when it did not take a frame.
    pub last_send_error: Option<Errno>,
}

impl Snapshot {
    fn of<N: Node>(node: &N, statistics: &Statistics, allocations: Option<u64>, at_up: Option<u64>) -> Self {
        Self {
            cycle: node.lateness().clone(),
            wake: statistics.lateness.clone(),
            bus: node.counters(),
            allocations: allocations.map(|all| {
                let connecting = at_up.unwrap_or(all);
                (connecting, all.saturating_sub(connecting))
            }),
            send_errors: statistics.send_errors,
            last_send_error: statistics.last_send_error,
        }
    }
}

/// The node's owner on the cyclic thread.
#[derive(Debug)]
pub struct CyclicTask<S> {
    interface: Interface,
    trace: Option<TraceRing<S>>,
    connected: bool,
    /// [`allocation::count`] when the connection came up first.
    at_up: Option<u64>,
    /// The end of the farewell.
    stopping: Option<Instant>,
}

impl<N: Node> Task<N> for CyclicTask<N::Sample> {
    type Command = Command<N::Order>;
    type News = News<N::Event, N::Answer>;

    fn command(
        &mut self,
        now: Instant,
        node: &mut N,
        statistics: &Statistics,
        command: Self::Command,
        news: &mut Outbox<Self::News>,
    ) -> ControlFlow<()> {
        match command {
            Command::Report => {
                let allocations = allocation::is_armed().then(allocation::count);
                news.tell(News::Snapshot(Snapshot::of(node, statistics, allocations, self.at_up)));
            }
            Command::Stop => {
                node.disconnect(now);
                if !self.connected {
                    return ControlFlow::Break(());
                }
                self.stopping = Some(now + FAREWELL);
            }
            Command::Record(on) => {
                if let Some(trace) = &mut self.trace {
                    trace.record(on);
                }
            }
            Command::Order(order) => {
                if let Some(answer) = node.order(now, order) {
                    news.tell(News::Answer(answer));
                }
            }
        }
        ControlFlow::Continue(())
    }

    fn event(
        &mut self,
        now: Instant,
        node: &mut N,
        event: N::Event,
        news: &mut Outbox<Self::News>,
    ) -> ControlFlow<()> {
        let link = N::link_event(&event);
        if let Some(LinkEvent::Down(Down { cause: DownCause::Refused, .. })) = link {
            let mut words = ShortText::default();
            // ShortText that do not fit are cut off.
            let _ = node.explain(&mut words);
            if !words.as_str().is_empty() {
                news.tell(News::Explanation(words));
            }
        }
        news.tell(News::Event(event));
        match link {
            Some(LinkEvent::Up) => {
                self.connected = true;
                self.at_up.get_or_insert_with(allocation::count);
            }
            Some(LinkEvent::Down(_)) => {
                self.connected = false;
                if self.stopping.is_some() {
                    return ControlFlow::Break(());
                }
            }
            Some(LinkEvent::SetAddress { address, mask, gateway: _ }) => {
                let done = self.interface.set_address(address, mask);
                node.address_set(now, done.is_ok());
                if let Err(error) = done {
                    news.tell(News::NoAddress(address, error));
                }
            }
            None => {}
        }
        ControlFlow::Continue(())
    }

    fn look(&mut self, now: Instant, node: &N) {
        if let Some(trace) = &mut self.trace {
            trace.look(node.cycle_number(), || node.sample(now));
        }
    }

    fn expired(&mut self, _now: Instant, _node: &mut N) -> ControlFlow<()> {
        ControlFlow::Break(())
    }

    fn deadline(&self) -> Option<Instant> {
        self.stopping
    }
}

/// A node that runs: its cyclic thread, and the ear of the thread beside it.
#[derive(Debug)]
pub struct NodeProcess<N: Node> {
    thread: CyclicThread<N, CyclicTask<N::Sample>>,
    trace: Option<TraceWriter>,
    inbox: Inbox,
    ended: bool,
}

/// Something happened that the process has to act on.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "taken apart at once, never kept")]
pub enum ProcessEvent<E, A> {
    /// The cyclic thread tells something.
    News(News<E, A>),
    /// A line of whoever gives the commands.
    Line(String),
    /// A controller came to the control port.
    Attached(SocketAddr),
    /// The controller went, or was sent away.
    Detached {
        /// The controller.
        peer: SocketAddr,
        /// Why.
        reason: String,
    },
    /// Standard input ended: whoever gave the commands is gone.
    Closed,
    /// A signal asks to stop.
    Signal(StopSignal),
    /// The cyclic thread ended; nothing more will happen.
    Ended,
}

/// Why a node's process does not go on.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// It could not start.
    #[error(transparent)]
    Start(#[from] StartError),
    /// A port of its bus cannot be opened.
    #[error(transparent)]
    Port(#[from] PortError),
    /// Its cycles cannot be recorded.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The process could not listen to what happens.
    #[error("waiting for commands and news: {reason}")]
    Inbox {
        /// What the kernel said.
        reason: std::io::Error,
    },
    /// The cyclic thread gave up.
    #[error(transparent)]
    Driver(#[from] DriverError),
    /// The cyclic thread panicked; what it said is on standard error.
    #[error(
        "the cyclic thread broke down; this is a fault of the program, please report what it printed above"
    )]
    Panic,
}

impl<N: Node> NodeProcess<N> {
    /// Starts the node on a cyclic thread. It listens to `commands`; cycles are recorded into `trace` while that is
    /// asked for.
    ///
    /// `signals` has to be there before any thread is, so the caller brings it.
    pub fn start(
        node: N,
        interface: Interface,
        signals: StopSignals,
        commands: Commands,
        trace: Option<&Path>,
    ) -> Result<Self, NodeError> {
        let (ring, trace) = match trace {
            Some(path) => {
                let (ring, writer) = trace_file::start(path, N::write_sample)?;
                (Some(ring), Some(writer))
            }
            None => (None, None),
        };
        let keeper = CyclicTask { interface, trace: ring, connected: false, at_up: None, stopping: None };
        let (waker, reader) =
            (Notifier::new().map_err(StartError::from)?, Notifier::new().map_err(StartError::from)?);
        let inbox = Inbox::new(signals, reader.clone(), commands);
        let driver = Driver::new(node, keeper.interface.clone(), waker.clone())?;
        let thread = CyclicThread::start(driver, keeper, waker, reader)?;
        Ok(Self { thread, trace, inbox, ended: false })
    }

    /// What the host did not grant, in words.
    pub fn warning(&self) -> Option<&str> {
        self.thread.warning()
    }

    /// Tells the cyclic thread to do something.
    pub fn send(&mut self, command: Command<N::Order>) -> Result<(), RingFull> {
        self.thread.send(command)
    }

    /// The control port, where the node has one.
    pub(crate) const fn control(&mut self) -> Option<&mut ControlPort> {
        self.inbox.control()
    }

    /// Waits for what happens next.
    pub fn next_happening(&mut self) -> Result<ProcessEvent<N::Event, N::Answer>, NodeError> {
        loop {
            // Asked before the ring is looked at: what was told before the end is still in it.
            let ended = self.thread.has_ended();
            if let Some(news) = self.thread.news() {
                return Ok(ProcessEvent::News(news));
            }
            if ended && !self.ended {
                self.ended = true;
                return Ok(ProcessEvent::Ended);
            }
            match self.inbox.wait().map_err(|reason| NodeError::Inbox { reason })? {
                Input::News => {}
                Input::Line(line) => return Ok(ProcessEvent::Line(line)),
                Input::Attached(peer) => return Ok(ProcessEvent::Attached(peer)),
                Input::Detached { peer, reason } => return Ok(ProcessEvent::Detached { peer, reason }),
                Input::Closed => return Ok(ProcessEvent::Closed),
                Input::Stop(signal) => return Ok(ProcessEvent::Signal(signal)),
            }
        }
    }

    /// Waits for the thread's end and says how the node did, unless the thread broke down, and how it ended.
    pub fn finish(self) -> (Option<Snapshot>, Result<(), NodeError>) {
        let Ok(mut finished) = self.thread.join() else {
            return (None, Err(NodeError::Panic));
        };
        // The writer ends when nobody holds the other end of its ring.
        drop(finished.task.trace.take());
        let traced = self.trace.map_or(Ok(()), TraceWriter::finish);
        let (node, statistics) = (finished.driver.machine(), finished.driver.statistics());
        let snapshot = Snapshot::of(node, statistics, statistics.allocations, finished.task.at_up);
        (Some(snapshot), finished.result.map_err(NodeError::from).and(traced.map_err(NodeError::from)))
    }
}
