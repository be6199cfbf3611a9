//! The nodes of a network: their machines, clocks and timeouts.

use alloc::string::String;
use alloc::vec::Vec;

use machine::{Instant, InterfaceId, Multihomed, Pending};

use super::Network;
use super::ids::{NicId, NodeId};
use crate::clock::{Clock, ClockReader};

/// How often a machine may be polled at one instant. A machine that answers everything has a reason for some hundred times.
const MOST_POLLS: u32 = 100_000;

#[derive(Debug)]
pub(super) struct Node<M> {
    name: String,
    pub(super) machine: M,
    clock: ClockReader,
    /// The machine's next timeout by its own clock.
    local_timeout: Option<Instant>,
    pub(super) is_alive: bool,
    /// The host's interface of each interface of the machine.
    nics: Vec<Option<NicId>>,
    /// The instant of true time at which the machine was last polled, and how often by then.
    polled: (Instant, u32),
}

impl<M> Node<M> {
    pub(super) fn new(name: String, machine: M, clock: Clock) -> Self {
        Self {
            name,
            machine,
            clock: ClockReader::new(clock),
            local_timeout: None,
            is_alive: true,
            nics: Vec::new(),
            polled: (Instant::ZERO, 0),
        }
    }

    pub(super) fn attach(&mut self, serves: &[InterfaceId], nic: NicId) {
        for InterfaceId(number) in serves {
            let number = usize::from(*number);
            if number >= self.nics.len() {
                self.nics.resize(number + 1, None);
            }
            if let Some(place) = self.nics.get_mut(number) {
                *place = Some(nic);
            }
        }
    }

    pub(super) fn nic(&self, on: InterfaceId) -> Option<NicId> {
        self.nics.get(usize::from(on.0)).copied().flatten()
    }

    pub(super) fn nics(&self) -> impl Iterator<Item = NicId> + '_ {
        self.nics.iter().copied().flatten()
    }

    /// Counts so many polls at an instant. Returns whether they are too many.
    fn count_polls(&mut self, now: Instant, polls: u32) -> bool {
        let (at, before) = self.polled;
        let before = if at == now { before } else { 0 };
        self.polled = (now, before + polls);
        before + polls > MOST_POLLS
    }
}

impl<M: Multihomed> Network<M> {
    /// Returns a node's machine; `None` for a node of another network.
    #[must_use]
    pub fn machine(&self, id: NodeId) -> Option<&M> {
        self.nodes.get(id.0).map(|node| &node.machine)
    }

    /// Returns what a node's clock shows now.
    #[must_use]
    pub fn local_time(&self, id: NodeId) -> Instant {
        self.nodes.get(id.0).map_or(self.now, |node| node.clock.clock().local_time(self.now))
    }

    /// Reads a node's clock like [`local_time`](Self::local_time), once for each step.
    pub(super) fn read_clock(&mut self, id: NodeId) -> Instant {
        let now = self.now;
        self.nodes.get_mut(id.0).map_or(now, |node| node.clock.local_time(now))
    }

    /// Kills a node: it neither receives nor sends any more. Its machine stays as it was.
    pub fn kill(&mut self, id: NodeId) {
        if let Some(node) = self.nodes.get_mut(id.0) {
            node.is_alive = false;
            self.deadlines.set(id.0, None);
        }
    }

    /// Starts another machine in place of one that was killed. Its TCP connections are closed.
    pub fn restart(&mut self, id: NodeId, machine: M) {
        self.switch_on();
        let Some(node) = self.nodes.get_mut(id.0) else { return };
        node.machine = machine;
        self.close_streams_of(id);
        let Some(node) = self.nodes.get_mut(id.0) else { return };
        node.is_alive = true;
        node.local_timeout = None;
        for NicId(nic) in node.nics() {
            if let Some(nic) = self.nics.get_mut(nic) {
                nic.forget();
            }
        }
        let local = self.read_clock(id);
        self.deadlines.set(id.0, None);
        self.poll_machine(id, local);
    }

    pub(super) fn is_alive(&self, id: NodeId) -> bool {
        self.nodes.get(id.0).is_some_and(|node| node.is_alive)
    }

    /// Starts the nodes that were added since, which otherwise start with the next event or command.
    pub fn switch_on(&mut self) {
        while self.started < self.nodes.len() {
            let id = NodeId(self.started);
            self.started += 1;
            let local = self.read_clock(id);
            self.poll_machine(id, local);
        }
    }

    pub(super) fn handle_timeout(&mut self, id: NodeId) {
        let local = self.read_clock(id);
        if let Some(node) = self.nodes.get_mut(id.0) {
            node.machine.handle_timeout(local);
        }
        self.poll_machine(id, local);
    }

    /// Fulfils the contract after a change: drains frames, requests and events, then reads the timeout. `local` is what the
    /// node's clock shows now.
    ///
    /// # Panics
    ///
    /// The machine is polled too often at one instant.
    pub(super) fn poll_machine(&mut self, id: NodeId, local: Instant) {
        if !self.is_alive(id) {
            return;
        }
        let mut polls = 1;
        let mut pending = self.pending(id, local);
        // Each poll may change what else there is.
        while pending.frame {
            let Some(node) = self.nodes.get_mut(id.0) else { return };
            let frame = node.machine.poll_transmit(local, &mut self.buf);
            if let Some((on, transmit)) = frame {
                polls += 1;
                self.watch_endless(id, polls);
                self.send(id, on, transmit);
            }
            pending = self.pending(id, local);
            pending.frame &= frame.is_some();
        }
        while pending.request {
            let Some(node) = self.nodes.get_mut(id.0) else { return };
            let request = node.machine.poll_stream();
            if let Some((on, request)) = request {
                polls += 1;
                self.watch_endless(id, polls);
                self.request_stream(id, on, request);
            }
            pending = self.pending(id, local);
            pending.request &= request.is_some();
        }
        let Some(node) = self.nodes.get_mut(id.0) else { return };
        while pending.event
            && let Some(event) = node.machine.poll_event()
        {
            polls += 1;
            if polls > MOST_POLLS {
                break;
            }
            self.events.push_back((id, event));
        }
        let timeout = node.machine.poll_timeout();
        // Most events leave the timeout unchanged, and converting a time between clocks is slow.
        if timeout != node.local_timeout {
            node.local_timeout = timeout;
            let due = timeout.map(|due| node.clock.true_time(due));
            self.deadlines.set(id.0, due);
        }
        if node.count_polls(self.now, polls) {
            self.time_stands(id);
        }
    }

    /// Returns what a node's machine may have.
    fn pending(&self, id: NodeId, local: Instant) -> Pending {
        self.nodes.get(id.0).map_or(Pending::ANYTHING, |node| node.machine.pending(local))
    }

    fn watch_endless(&self, id: NodeId, polls: u32) {
        if polls > MOST_POLLS {
            self.time_stands(id);
        }
    }

    /// Ends a run that would never end.
    #[expect(
        clippy::panic,
        reason = "a machine that breaks its contract; without the panic the run would hang"
    )]
    #[cold]
    fn time_stands(&self, id: NodeId) -> ! {
        let Some(Node { name, local_timeout, .. }) = self.nodes.get(id.0) else {
            panic!("time does not move")
        };
        let now = self.local_time(id);
        match local_timeout {
            Some(due) if *due <= now => panic!(
                "time does not move: {name} asks at {now:?} again and again for a timeout at {due:?}; it must ask for a later one"
            ),
            _ => panic!(
                "time does not move: {name} was polled over {MOST_POLLS} times at {now:?}; look for frames or timeouts without \
                 any delay"
            ),
        }
    }
}
