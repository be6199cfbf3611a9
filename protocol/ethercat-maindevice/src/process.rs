//! What the cyclic exchange shares with its machine: process data, the state of the connection, events.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::fmt;

use machine::{Counters, Down, DownCause, Duration, Instant, LinkEvent};

use crate::commissioning::Commissioning;
use crate::lend::Place;
use crate::problem::{FoundDevice, Problem};
use crate::slot::Slot;

/// Largest number of events that wait for the owner, who takes them after each call.
const EVENTS: usize = 4;

/// Time without an answer, or with errors of any other kind than a refusal, after which the MainDevice reports this: a device
/// may be switched on later than the MainDevice.
const REPORTED_FAILURE: Duration = Duration::from_secs(1);

thread_local! {
    /// The process data of the machine that runs at the moment.
    pub(crate) static PROCESS: RefCell<Process> = const { RefCell::new(Process::none()) };
}

/// Static place of the process data.
pub(crate) const PLACE: &Place<Process> = &PROCESS;

/// Process data and connection.
#[derive(Debug)]
pub(crate) struct Process {
    /// The place of the device among those of a MainDevice that drives each on its own.
    slot: Option<Slot>,
    /// Data for the devices, in their order.
    pub(crate) outputs: Vec<u8>,
    /// Data of the devices, in their order.
    pub(crate) inputs: Vec<u8>,
    pub(crate) counters: Counters,
    /// Whether all devices are in OP and were so in the last exchange.
    up: bool,
    /// Whether the owner wants to end the connection.
    pub(crate) leaving: bool,
    /// Wishes of a tool for commissioning. They are elsewhere, since a process is moved in each cycle.
    commissioning: Option<Box<Commissioning>>,
    /// The first device as its EEPROM describes it, since the last start.
    device: Option<Box<FoundDevice>>,
    events: VecDeque<LinkEvent>,
    /// Last problem that was reported since the connection was up.
    reported: Option<Problem>,
    /// Since when the attempts to connect fail.
    failing_since: Option<Instant>,
}

impl Process {
    /// Creates a store without room: a thread has this one while no machine runs.
    const fn none() -> Self {
        Self {
            slot: None,
            outputs: Vec::new(),
            inputs: Vec::new(),
            counters: Counters {
                sent: 0,
                received: 0,
                skipped: 0,
                lost: 0,
                late: 0,
                malformed: 0,
                foreign: 0,
            },
            up: false,
            leaving: false,
            commissioning: None,
            device: None,
            events: VecDeque::new(),
            reported: None,
            failing_since: None,
        }
    }

    pub(crate) fn new(slot: Option<Slot>, output_bytes: usize, input_bytes: usize) -> Self {
        Self {
            slot,
            outputs: vec![0; output_bytes],
            inputs: vec![0; input_bytes],
            events: VecDeque::with_capacity(EVENTS),
            ..Self::none()
        }
    }

    /// Notes how the first device describes itself.
    pub(crate) fn describe(&mut self, device: Option<FoundDevice>) {
        self.device = device.map(Box::new);
    }

    /// Returns how the first device describes itself; `None` before it was found.
    pub(crate) fn device(&self) -> Option<&FoundDevice> {
        self.device.as_deref()
    }

    /// Returns the wishes of a tool for commissioning.
    pub(crate) fn commissioning(&mut self) -> &mut Commissioning {
        self.commissioning.get_or_insert_default()
    }

    /// Returns whether a tool holds the device in SAFE-OP.
    pub(crate) fn holds_safe_op(&self) -> bool {
        self.commissioning.as_ref().is_some_and(|wishes| wishes.holds_safe_op)
    }

    /// Returns where the device's mailbox is, if it is to be read: start and length in bytes.
    pub(crate) fn mailbox(&self) -> Option<(u16, u16)> {
        self.commissioning.as_ref()?.mailbox
    }

    pub(crate) const fn is_up(&self) -> bool {
        self.up
    }

    /// Notes a good exchange.
    pub(crate) fn good(&mut self) {
        self.counters.received += 1;
        if !self.up {
            self.up = true;
            (self.reported, self.failing_since) = (None, None);
            self.push(LinkEvent::Up);
        }
    }

    /// Notes why there is no connection, or no longer one. Reports the reason unless it was the last one reported.
    pub(crate) fn fail(&mut self, now: Instant, problem: Problem) {
        let was_up = std::mem::take(&mut self.up);
        self.end_request();
        let down = problem.down(self.slot);
        if !was_up {
            let is_known = self.reported.as_ref() == Some(&problem);
            let is_more_of_it = problem.is_silence() && self.reported.is_some();
            let since = *self.failing_since.get_or_insert(now);
            if is_known || is_more_of_it || problem.may_pass() && now.since(since) < REPORTED_FAILURE {
                return;
            }
        }
        self.reported = Some(problem);
        self.push(LinkEvent::Down(down));
    }

    /// Notes that the owner ended the connection.
    pub(crate) fn closed(&mut self) {
        self.up = false;
        self.end_request();
        self.push(LinkEvent::Down(Down { cause: DownCause::ClosedHere, code: 0, text: "" }));
    }

    fn end_request(&mut self) {
        if let Some(wishes) = &mut self.commissioning {
            wishes.end_request();
        }
    }

    pub(crate) fn poll_event(&mut self) -> Option<LinkEvent> {
        self.events.pop_front()
    }

    pub(crate) fn has_event(&self) -> bool {
        !self.events.is_empty()
    }

    pub(crate) fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.reported.as_ref().map_or(Ok(()), |problem| problem.explain(self.slot, words))
    }

    /// Returns whether the last problem that was reported is a device that is not there.
    pub(crate) fn is_missing(&self) -> bool {
        self.reported == Some(Problem::NoDevice)
    }

    fn push(&mut self, event: LinkEvent) {
        if self.events.len() < EVENTS {
            self.events.push_back(event);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ethercrab::error::Error;

    #[test]
    fn an_error_that_lasts_a_second_is_reported_once_also_after_another_reason_and_silence_is_not() {
        let other = || Problem::Other(Error::StateTransition);
        for (problem, expected) in [(Problem::Silence, vec![]), (other(), vec![DownCause::Refused])] {
            let mut process = Process::new(None, 0, 0);
            process.good();
            process.fail(Instant::ZERO, Problem::Watchdog);
            process.events.clear();
            for ms in [10, 500, 1_100, 1_200] {
                process.fail(Instant::from_millis(ms), problem.clone());
            }
            let causes: Vec<_> = std::iter::from_fn(|| process.poll_event())
                .map(|event| match event {
                    LinkEvent::Down(down) => down.cause,
                    other => panic!("{other:?}"),
                })
                .collect();
            assert_eq!(causes, expected, "{problem:?}");
        }
    }
}
