//! The PLC as a machine: program and buses by time and frames, each bus on an interface of its own.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{
    Instant, InterfaceId, Machine, Multihomed, Pending, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};
use protocol::fieldbus::ControllerBus;

use super::PlcNode;
use crate::{PlcProgram, PlcReport};

impl<B: ControllerBus, P: PlcProgram> PlcNode<B, P> {
    fn on(&self, InterfaceId(number): InterfaceId) -> Option<&B> {
        self.buses.get(usize::from(number))
    }

    /// Returns a bus, to call it at this instant.
    fn on_mut(&mut self, now: Instant, InterfaceId(number): InterfaceId) -> Option<&mut B> {
        self.write_overdue(now);
        self.call(usize::from(number))
    }
}

impl<B: ControllerBus, P: PlcProgram> Multihomed for PlcNode<B, P> {
    type Event = PlcReport;

    fn interfaces(&self) -> u8 {
        u8::try_from(self.buses.len()).unwrap_or(u8::MAX)
    }

    fn handle_frame(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        if let Some(bus) = self.on_mut(now, on) {
            bus.handle_frame(now, from, frame);
        }
        self.after_bus(now, usize::from(on.0));
    }

    fn handle_broadcast(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        if let Some(bus) = self.on_mut(now, on) {
            bus.handle_broadcast(now, from, frame);
        }
        self.after_bus(now, usize::from(on.0));
    }

    fn handle_stream(&mut self, now: Instant, on: InterfaceId, stream: StreamId, change: StreamChange) {
        if let Some(bus) = self.on_mut(now, on) {
            bus.handle_stream(now, stream, change);
        }
        self.drain_bus(usize::from(on.0));
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, on: InterfaceId, address: Ipv4Addr, found: Mac) {
        if let Some(bus) = self.on_mut(now, on) {
            bus.handle_wrong_neighbour(now, address, found);
        }
        self.drain_bus(usize::from(on.0));
    }

    fn ports(&self, on: InterfaceId) -> &[PortRequest] {
        self.on(on).map_or(&[], Machine::ports)
    }

    fn listen_port(&self, on: InterfaceId) -> Option<u16> {
        self.on(on)?.listen_port()
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        self.next_stream()
    }

    fn dscp(&self, on: InterfaceId, port: Port) -> u8 {
        self.on(on).map_or(0, |bus| bus.dscp(port))
    }

    fn group(&self, on: InterfaceId, port: Port, index: usize) -> Option<Ipv4Addr> {
        self.on(on)?.group(port, index)
    }

    fn neighbour(&self, on: InterfaceId, address: Ipv4Addr) -> Option<Mac> {
        self.on(on)?.neighbour(address)
    }

    /// The program comes before the buses: outputs that are written at the instant of a bus cycle leave with it.
    fn handle_timeout(&mut self, now: Instant) {
        self.write_outputs(now);
        if self.scan.begin(now).is_some() {
            self.scan(now);
            self.write_outputs(now);
        }
        for bus in 0..self.buses.len() {
            if self.timeout_of(bus).is_some_and(|due| due <= now) {
                let Some(due) = self.call(bus) else { return };
                due.handle_timeout(now);
                self.after_bus(now, bus);
            } else {
                self.drain_bus(bus);
            }
        }
    }

    fn pending(&self, _now: Instant) -> Pending {
        self.all_pending()
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        self.next_frame(now, buf)
    }

    fn poll_event(&mut self) -> Option<PlcReport> {
        self.events.pop()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let scan = self.scan.poll_timeout();
        Some((0..self.buses.len()).filter_map(|bus| self.timeout_of(bus)).fold(scan, Instant::min))
    }
}
