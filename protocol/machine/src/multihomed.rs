//! Machines on several interfaces.

use core::net::Ipv4Addr;

use crate::ethernet::Mac;
use crate::{
    Instant, Machine, Pending, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest, Transmit,
};

/// An interface of a multihomed machine: its number from 0, in the order in which the driver was given the interfaces.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default, Debug)]
pub struct InterfaceId(pub u8);

impl InterfaceId {
    /// The only interface of a [`Machine`].
    pub const FIRST: Self = Self(0);
}

/// A machine on one interface or several, as a PLC with several buses.
///
/// Every [`Machine`] is one with one interface. The contract is that of [`Machine`]; here every port, address and connection
/// belongs to an interface. Two interfaces of a machine may be the same interface of the host: each has its own ports there.
pub trait Multihomed {
    /// What the machine reports to its owner.
    type Event;

    /// Returns the number of interfaces, at least 1. It never changes.
    fn interfaces(&self) -> u8;

    /// Handles a received frame, as [`Machine::handle_frame`].
    fn handle_frame(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]);

    /// Handles a datagram to every station of the network, as [`Machine::handle_broadcast`].
    fn handle_broadcast(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]);

    /// Handles the opening or closing of a TCP connection, as [`Machine::handle_stream`]. The driver numbers the connections
    /// of all interfaces together.
    fn handle_stream(&mut self, now: Instant, on: InterfaceId, stream: StreamId, change: StreamChange);

    /// Handles that a datagram was not sent, as [`Machine::handle_wrong_neighbour`].
    fn handle_wrong_neighbour(&mut self, now: Instant, on: InterfaceId, address: Ipv4Addr, found: Mac);

    /// Returns the ports that the driver opens on an interface, as [`Machine::ports`].
    fn ports(&self, on: InterfaceId) -> &[PortRequest];

    /// Returns the TCP port on which the driver accepts connections on an interface, as [`Machine::listen_port`].
    fn listen_port(&self, on: InterfaceId) -> Option<u16>;

    /// Returns the next connection to make or to close, as [`Machine::poll_stream`].
    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)>;

    /// Returns the DSCP of packets that leave by this port, as [`Machine::dscp`].
    fn dscp(&self, on: InterfaceId, port: Port) -> u8;

    /// Returns a multicast group of a port, as [`Machine::group`].
    fn group(&self, on: InterfaceId, port: Port, index: usize) -> Option<Ipv4Addr>;

    /// Returns the MAC address at which datagrams to this address must arrive, as [`Machine::neighbour`].
    fn neighbour(&self, on: InterfaceId, address: Ipv4Addr) -> Option<Mac>;

    /// Handles the timeout, as [`Machine::handle_timeout`].
    fn handle_timeout(&mut self, now: Instant);

    /// Returns what the machine may have for the polls below, as [`Machine::pending`].
    fn pending(&self, _now: Instant) -> Pending {
        Pending::ANYTHING
    }

    /// Writes the next frame to send into `buf`, as [`Machine::poll_transmit`].
    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)>;

    /// Returns the next event for the owner.
    fn poll_event(&mut self) -> Option<Self::Event>;

    /// Returns when to call [`handle_timeout`](Self::handle_timeout) next.
    fn poll_timeout(&self) -> Option<Instant>;
}

impl<M: Machine> Multihomed for M {
    type Event = M::Event;

    fn interfaces(&self) -> u8 {
        1
    }

    fn handle_frame(&mut self, now: Instant, _on: InterfaceId, from: Source, frame: &[u8]) {
        Machine::handle_frame(self, now, from, frame);
    }

    fn handle_broadcast(&mut self, now: Instant, _on: InterfaceId, from: Source, frame: &[u8]) {
        Machine::handle_broadcast(self, now, from, frame);
    }

    fn handle_stream(&mut self, now: Instant, _on: InterfaceId, stream: StreamId, change: StreamChange) {
        Machine::handle_stream(self, now, stream, change);
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, _on: InterfaceId, address: Ipv4Addr, found: Mac) {
        Machine::handle_wrong_neighbour(self, now, address, found);
    }

    fn ports(&self, on: InterfaceId) -> &[PortRequest] {
        if on == InterfaceId::FIRST { Machine::ports(self) } else { &[] }
    }

    fn listen_port(&self, on: InterfaceId) -> Option<u16> {
        if on == InterfaceId::FIRST { Machine::listen_port(self) } else { None }
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        Machine::poll_stream(self).map(|request| (InterfaceId::FIRST, request))
    }

    fn dscp(&self, _on: InterfaceId, port: Port) -> u8 {
        Machine::dscp(self, port)
    }

    fn group(&self, _on: InterfaceId, port: Port, index: usize) -> Option<Ipv4Addr> {
        Machine::group(self, port, index)
    }

    fn neighbour(&self, _on: InterfaceId, address: Ipv4Addr) -> Option<Mac> {
        Machine::neighbour(self, address)
    }

    fn handle_timeout(&mut self, now: Instant) {
        Machine::handle_timeout(self, now);
    }

    fn pending(&self, now: Instant) -> Pending {
        Machine::pending(self, now)
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        Machine::poll_transmit(self, now, buf).map(|transmit| (InterfaceId::FIRST, transmit))
    }

    fn poll_event(&mut self) -> Option<M::Event> {
        Machine::poll_event(self)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Machine::poll_timeout(self)
    }
}
