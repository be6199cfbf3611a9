//! Nodes of two types in one network.

use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{
    Instant, InterfaceId, Multihomed, Pending, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};

/// An event of a machine of one of two types.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Event<A, B> {
    /// An event of a machine of the first type.
    A(A),
    /// An event of a machine of the second type.
    B(B),
}

/// A machine of one of two types.
#[derive(Debug)]
pub enum Either<A, B> {
    /// A machine of the first type.
    A(A),
    /// A machine of the second type.
    B(B),
}

/// Calls a method of whichever machine it is.
macro_rules! either {
    ($self:ident, $machine:ident => $call:expr) => {
        match $self {
            Either::A($machine) => $call,
            Either::B($machine) => $call,
        }
    };
}

impl<A: Multihomed, B: Multihomed> Multihomed for Either<A, B> {
    type Event = Event<A::Event, B::Event>;

    fn interfaces(&self) -> u8 {
        either!(self, machine => machine.interfaces())
    }

    fn handle_frame(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        either!(self, machine => machine.handle_frame(now, on, from, frame));
    }

    fn handle_broadcast(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        either!(self, machine => machine.handle_broadcast(now, on, from, frame));
    }

    fn handle_stream(&mut self, now: Instant, on: InterfaceId, stream: StreamId, change: StreamChange) {
        either!(self, machine => machine.handle_stream(now, on, stream, change));
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, on: InterfaceId, address: Ipv4Addr, found: Mac) {
        either!(self, machine => machine.handle_wrong_neighbour(now, on, address, found));
    }

    fn ports(&self, on: InterfaceId) -> &[PortRequest] {
        either!(self, machine => machine.ports(on))
    }

    fn listen_port(&self, on: InterfaceId) -> Option<u16> {
        either!(self, machine => machine.listen_port(on))
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        either!(self, machine => machine.poll_stream())
    }

    fn dscp(&self, on: InterfaceId, port: Port) -> u8 {
        either!(self, machine => machine.dscp(on, port))
    }

    fn group(&self, on: InterfaceId, port: Port, index: usize) -> Option<Ipv4Addr> {
        either!(self, machine => machine.group(on, port, index))
    }

    fn neighbour(&self, on: InterfaceId, address: Ipv4Addr) -> Option<Mac> {
        either!(self, machine => machine.neighbour(on, address))
    }

    fn handle_timeout(&mut self, now: Instant) {
        either!(self, machine => machine.handle_timeout(now));
    }

    fn pending(&self, now: Instant) -> Pending {
        either!(self, machine => machine.pending(now))
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        either!(self, machine => machine.poll_transmit(now, buf))
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        match self {
            Self::A(machine) => machine.poll_event().map(Event::A),
            Self::B(machine) => machine.poll_event().map(Event::B),
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        either!(self, machine => machine.poll_timeout())
    }
}
