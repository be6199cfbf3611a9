//! A node in its process: what all nodes have in common, whatever their bus and their work.

use std::fmt::{self, Debug};
use std::net::Ipv4Addr;
use std::path::PathBuf;

use machine::{Counters, Down, DownCause, LinkEvent, LinkStatus};
use machine::{Instant, InterfaceId, Lateness, Multihomed};
use protocol::fieldbus::ToStore;
use protocol::image::Checks;
use rustix::io::Errno;

use crate::carrier_report::CarrierReport;
use crate::station_file::StationRecord;
use crate::trace_file::{self, TraceWriter};
use crate::trace_row::TraceSample;
use crate::{Commands, ControlPort, CyclicTask, Inbox, Input, NodeError, ShortText};
use protocol_linux::handover::Received;
use protocol_linux::{
    CyclicThread, Driver, Interface, InterfaceError, Notifier, RingFull, StartError, Statistics, StopSignals,
};

/// A machine that is a complete node: a PLC or a robot on its bus.
pub trait Node: Multihomed<Event: Send + Debug> + Send + 'static {
    /// Commands of only this kind of node.
    type Order: Send + Debug + 'static;
    /// The node's answers to orders.
    type Answer: Send + Debug + 'static;
    /// What the node did in one cycle, for records.
    type Sample: TraceSample;

    /// Returns the link event that an event contains, if any.
    fn link_event(event: &Self::Event) -> Option<LinkEvent>;

    /// Returns the interface whose bus a link event is of.
    fn link_interface(_event: &Self::Event) -> InterfaceId {
        InterfaceId::FIRST
    }

    /// Returns the index of the station that an event is about; `None` where it is about the whole node.
    fn station(_event: &Self::Event) -> Option<usize> {
        None
    }

    /// Returns the number of stations, each with a connection of its own.
    fn stations(&self) -> usize {
        1
    }

    /// Returns what the node waits for, if an event says that.
    fn waiting(_event: &Self::Event) -> Option<Waiting> {
        None
    }

    /// Carries out an order and returns the answer, if there is one.
    fn order(&mut self, now: Instant, order: Self::Order) -> Option<Self::Answer>;

    /// Reports to the bus of an interface whether the address was set: `address_set` of the bus.
    fn address_set(&mut self, now: Instant, on: InterfaceId, done: bool);

    /// Returns what the bus set permanently of its own station: `to_store` of the bus.
    fn to_store(&self) -> ToStore<'_> {
        ToStore::default()
    }

    /// Reports to the bus whether that was stored: `stored` of the bus.
    fn stored(&mut self, _now: Instant, _done: bool) {}

    /// Returns whether its bus reports state and counters of the interface: `wants_link` of the bus. It never changes.
    fn wants_link(&self) -> bool {
        false
    }

    /// Sets state and counters of its first interface: `set_link` of the bus.
    fn set_link(&mut self, _status: &LinkStatus) {}

    /// Returns the interface whose carrier the node must know at once: that of a port at which it passes frames on. It never
    /// changes.
    fn carrier_interface(&self) -> Option<InterfaceId> {
        None
    }

    /// Sets whether that interface has a carrier. Before the first call it is unknown.
    fn set_carrier(&mut self, _now: Instant, _is_up: bool) {}

    /// Writes why the connection of an event is down: `explain` of its bus.
    fn explain(&self, _event: &Self::Event, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// Returns whether the bus may explain an event.
    fn may_explain(event: &Self::Event) -> bool {
        matches!(Self::link_event(event), Some(LinkEvent::Down(Down { cause: DownCause::Refused, .. })))
    }

    /// Writes what is remarkable about the connection of an event: `remark` of its bus.
    fn remark(&self, _event: &Self::Event, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// Returns whether a remark may follow from an event.
    fn may_remark(event: &Self::Event) -> bool {
        matches!(Self::link_event(event), Some(LinkEvent::Up))
    }

    /// Writes what the device at the other end of the connection of an event says of itself: `write_identity` of its bus.
    fn write_identity(&self, _event: &Self::Event, _words: &mut dyn fmt::Write) -> fmt::Result {
        Ok(())
    }

    /// Closes the connection as its standard demands.
    fn disconnect(&mut self, now: Instant);

    /// Returns the lateness of the node's own cycle.
    fn lateness(&self) -> &Lateness;

    /// Returns the frame counters of its buses.
    fn counters(&self) -> Counters;

    /// Returns what the checks of the received images said.
    fn checks(&self) -> Checks;

    /// Returns a number that changes with each cycle.
    fn cycle_number(&self) -> u64;

    /// Returns the time of the node's last cycle, at `now` or before, and what the node did in it for the station of this index.
    fn sample(&self, station: usize, now: Instant) -> (Instant, Self::Sample);
}

/// What a node waits for.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Waiting {
    /// Time without progress, in s.
    pub seconds: u32,
    /// What it waits for, as text.
    pub for_what: String,
    /// Whether it waits for the connection: then the last reason of the bus says more.
    pub is_for_connection: bool,
    /// Whether somebody owes progress. Without this, it may last as long as it likes, as at an override of 0 %.
    pub is_owed: bool,
}

/// Commands of the process to the cyclic thread.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a command is in a ring of fixed size, without allocation")]
pub enum Command<O> {
    /// Send a [`Notice::Snapshot`].
    Report,
    /// Close the connection in order and end.
    Stop,
    /// Start or stop recording each cycle.
    Record(bool),
    /// Report to the bus whether the station was stored.
    Stored(bool),
    /// Set state and counters of the interface.
    Link(LinkStatus),
    /// Set whether the interface that the node asks about has a carrier.
    Carrier(bool),
    /// A command of only this kind of node.
    Order(O),
}

/// What the cyclic thread sends to the process.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a box would be an allocation on the cyclic thread")]
pub enum Notice<E, A> {
    /// An event of the node.
    Event(E),
    /// Why the peer refused the connection and what it offers instead; the next notice is the event itself.
    Explanation(ShortText),
    /// What is remarkable about the connection to the station of this index; an empty text if nothing is.
    Remark(usize, ShortText),
    /// Identity that the device at the other end of the connection to the station of this index reports.
    Identity(usize, ShortText),
    /// An answer to an order.
    Answer(A),
    /// The interface refused the address that the bus set.
    NoAddress(Ipv4Addr, InterfaceError),
    /// What the bus set of the station is to be stored permanently; [`Command::Stored`] is the answer.
    Store(StationRecord),
    /// The node's figures so far.
    Snapshot(Snapshot),
}

/// Figures of a node at one moment.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Lateness of the node's own cycle.
    pub cycle: Lateness,
    /// Lateness of the thread at all deadlines of the machine.
    pub wake: Lateness,
    /// Frame counters of its bus.
    pub bus: Counters,
    /// What the checks of the received images said.
    pub checks: Checks,
    /// Allocations of the cyclic thread before and after all connections were first up; `None` if they are not counted.
    pub allocations: Option<(u64, u64)>,
    /// Frames that the kernel refused.
    pub send_errors: u64,
    /// The kernel's last error on sending a frame.
    pub last_send_error: Option<Errno>,
}

impl Snapshot {
    pub(crate) fn of<N: Node>(
        node: &N,
        statistics: &Statistics,
        allocations: Option<u64>,
        at_up: Option<u64>,
    ) -> Self {
        Self {
            cycle: node.lateness().clone(),
            wake: statistics.lateness.clone(),
            bus: node.counters(),
            checks: node.checks(),
            allocations: allocations.map(|all| {
                let connecting = at_up.unwrap_or(all);
                (connecting, all.saturating_sub(connecting))
            }),
            send_errors: statistics.send_errors,
            last_send_error: statistics.last_send_error,
        }
    }
}

/// A running node: its cyclic thread, and the inputs of the thread beside it.
#[derive(Debug)]
pub struct NodeProcess<N: Node> {
    thread: CyclicThread<N, CyclicTask<N::Sample>>,
    trace: Option<TraceWriter>,
    inbox: Inbox,
    ended: bool,
}

/// An event that the process has to handle.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "taken apart at once, never kept")]
pub enum ProcessEvent<E, A> {
    /// A notice of the cyclic thread.
    Notice(Notice<E, A>),
    /// An input of the process.
    Input(Input),
    /// The cyclic thread ended; no event follows.
    Ended,
}

impl<N: Node> NodeProcess<N> {
    /// Starts the node on a cyclic thread, with its interfaces in the order of their [`InterfaceId`]s. It takes instructions
    /// from `commands` and records cycles into `traces`, a file for each station or none at all, when instructed to.
    ///
    /// The caller provides `signals`, because they must be blocked before any thread starts.
    pub fn start(
        node: N,
        interfaces: Vec<Interface>,
        signals: StopSignals,
        commands: Commands,
        traces: &[PathBuf],
    ) -> Result<Self, NodeError> {
        let (ring, trace) = if traces.is_empty() {
            (None, None)
        } else {
            let (ring, writer) = trace_file::start(traces)?;
            (Some(ring), Some(writer))
        };
        let task = CyclicTask::new(interfaces, ring, node.stations());
        let (waker, reader) =
            (Notifier::new().map_err(StartError::from)?, Notifier::new().map_err(StartError::from)?);
        let mut inbox = Inbox::new(signals, reader.clone(), commands);
        if node.wants_link() {
            inbox.report_link_of(task.interfaces.first().cloned());
        }
        if let Some(InterfaceId(on)) = node.carrier_interface()
            && let Some(interface) = task.interfaces.get(usize::from(on))
        {
            let report = CarrierReport::of(interface.clone());
            inbox.report_carrier_by(report.map_err(|reason| NodeError::Inbox { reason })?);
        }
        let driver = Driver::new(node, task.interfaces.clone(), waker.clone())?;
        let thread = CyclicThread::start(driver, task, waker, reader)?;
        Ok(Self { thread, trace, inbox, ended: false })
    }

    /// Returns what the host refused the cyclic thread and how to allow it.
    pub fn warning(&self) -> Option<&str> {
        self.thread.warning()
    }

    /// Sends the cyclic thread a command.
    pub fn send(&mut self, command: Command<N::Order>) -> Result<(), RingFull> {
        self.thread.send(command)
    }

    /// Returns the control port, if the node has one.
    pub(crate) fn control(&mut self) -> Option<&mut ControlPort> {
        self.inbox.control()
    }

    /// Waits for the next event.
    pub fn next_event(&mut self) -> Result<ProcessEvent<N::Event, N::Answer>, NodeError> {
        loop {
            match self.thread.next_notice() {
                Received::Item(notice) => return Ok(ProcessEvent::Notice(notice)),
                Received::Ended if !self.ended => {
                    self.ended = true;
                    return Ok(ProcessEvent::Ended);
                }
                Received::Nothing | Received::Ended => {}
            }
            match self.inbox.wait().map_err(|reason| NodeError::Inbox { reason })? {
                // A full ring takes the next one.
                Some(Input::Link(status)) => drop(self.thread.send(Command::Link(status))),
                Some(Input::Carrier(is_up)) => {
                    let is_taken = self.thread.send(Command::Carrier(is_up)).is_ok();
                    if !is_taken {
                        self.inbox.repeat_carrier();
                    }
                }
                Some(input) => return Ok(ProcessEvent::Input(input)),
                None => {}
            }
        }
    }

    /// Waits for the thread's end. Returns the node's final figures, unless the thread panicked, and its result.
    pub fn finish(self) -> (Option<Snapshot>, Result<(), NodeError>) {
        let Ok(mut finished) = self.thread.join() else {
            return (None, Err(NodeError::Panic));
        };
        // The writer ends when the other end of its ring is dropped.
        drop(finished.task.trace.take());
        let traced = self.trace.map_or(Ok(()), TraceWriter::finish);
        let (node, statistics) = (finished.driver.machine(), finished.driver.statistics());
        let snapshot = Snapshot::of(node, statistics, statistics.allocations, finished.task.at_up);
        (Some(snapshot), finished.result.map_err(NodeError::from).and(traced.map_err(NodeError::from)))
    }
}
