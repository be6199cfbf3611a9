//! One end of a bus that looks at the other: a machine with a cycle of its own, which exchanges images that command nothing.

use machine::{Cycle, Instant, LinkEvent, Machine, Source, StreamChange, StreamId, Transmit};

use crate::verbs::doctor::finding::Finding;

/// Watches the foreign end of a bus.
pub(super) trait PeerWatch<B: Machine> {
    /// Returns what an event of the bus says of the foreign end.
    fn link_event(&self, event: B::Event) -> Option<LinkEvent>;

    /// Takes note of an event of the connection.
    fn note(&mut self, now: Instant, bus: &B, event: LinkEvent);

    /// Reads a frame before the bus does.
    fn overhear(&mut self, _frame: &[u8]) {}

    /// Reads the present image and writes the own one, once a cycle.
    fn scan(&mut self, now: Instant, bus: &mut B);

    /// Returns whether nothing more can be found out.
    fn is_complete(&self, now: Instant) -> bool;

    /// Ends the connection as its standard demands.
    fn disconnect(&self, now: Instant, bus: &mut B);

    /// Reports to the bus whether the address that it asked for was set.
    fn address_set(&self, now: Instant, bus: &mut B, done: bool);

    /// Returns what was found of each step.
    fn findings(&self, bus: &B) -> Vec<Finding>;
}

/// An endpoint of a bus with a watch of the foreign end.
#[derive(Debug)]
pub(super) struct Look<B, W> {
    bus: B,
    watch: W,
    cycle: Cycle,
    now: Instant,
}

impl<B: Machine, W: PeerWatch<B>> Look<B, W> {
    pub(super) const fn new(bus: B, watch: W, cycle: Cycle, now: Instant) -> Self {
        Self { bus, watch, cycle, now }
    }

    /// Returns whether nothing more can be found out.
    pub(super) fn is_complete(&self, now: Instant) -> bool {
        self.watch.is_complete(now)
    }

    /// Ends the connection.
    pub(super) fn disconnect(&mut self, now: Instant) {
        self.watch.disconnect(now, &mut self.bus);
    }

    /// Reports whether the address of [`LinkEvent::SetAddress`] was set.
    pub(super) fn address_set(&mut self, now: Instant, done: bool) {
        self.watch.address_set(now, &mut self.bus, done);
    }

    /// Returns what was found of each step.
    pub(super) fn findings(&self) -> Vec<Finding> {
        self.watch.findings(&self.bus)
    }
}

impl<B: Machine, W: PeerWatch<B>> Machine for Look<B, W> {
    type Event = LinkEvent;

    machine::forward_ports!(bus);

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.now = now;
        self.watch.overhear(frame);
        self.bus.handle_frame(now, from, frame);
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.now = now;
        self.bus.handle_broadcast(now, from, frame);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.now = now;
        self.bus.handle_stream(now, stream, change);
    }

    fn handle_wrong_neighbour(
        &mut self,
        now: Instant,
        address: std::net::Ipv4Addr,
        found: machine::ethernet::Mac,
    ) {
        self.now = now;
        self.bus.handle_wrong_neighbour(now, address, found);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.now = now;
        if self.bus.poll_timeout().is_some_and(|due| due <= now) {
            self.bus.handle_timeout(now);
        }
        if self.cycle.tick(now).is_some() {
            self.watch.scan(now, &mut self.bus);
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        loop {
            let event = self.bus.poll_event()?;
            if let Some(event) = self.watch.link_event(event) {
                self.watch.note(self.now, &self.bus, event);
                return Some(event);
            }
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let next = self.cycle.next();
        Some(self.bus.poll_timeout().map_or(next, |bus| bus.min(next)))
    }
}
