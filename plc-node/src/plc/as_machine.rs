//! The PLC as a machine: program and bus by time and frames.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Instant, Machine, Source, StreamChange, StreamId, Transmit};
use protocol::fieldbus::Fieldbus;

use super::PlcNode;
use crate::PlcEvent;

impl<B: Fieldbus> Machine for PlcNode<B> {
    type Event = PlcEvent;

    machine::forward_ports!(bus);

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_frame(now, from, frame);
        self.after_bus(now);
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_broadcast(now, from, frame);
        self.after_bus(now);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.bus.handle_stream(now, stream, change);
        self.drain_bus();
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        self.bus.handle_wrong_neighbour(now, address, found);
        self.drain_bus();
    }

    /// The program comes before the bus: outputs that are written at the instant of a bus cycle leave with it.
    fn handle_timeout(&mut self, now: Instant) {
        self.write_outputs(now);
        if self.scan.begin(now).is_some() {
            self.scan(now);
            self.write_outputs(now);
        }
        if self.bus.poll_timeout().is_some_and(|due| due <= now) {
            self.bus.handle_timeout(now);
            self.after_bus(now);
        } else {
            self.drain_bus();
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<PlcEvent> {
        self.events.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let scan = self.scan.poll_timeout();
        Some(self.bus.poll_timeout().map_or(scan, |bus| bus.min(scan)))
    }
}
