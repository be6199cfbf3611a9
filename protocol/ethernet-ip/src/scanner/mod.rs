//! The scanner: one station with many connections, one for each adapter (or more) that it exchanges data with.
//!
//! ```text
//! UDP 2222 ── cyclic data ───────────── the connection with that number, to the sender
//! TCP ─────── answers ───────────────── the connection whose TCP connection it is
//! ```
//!
//! A connection connects over TCP, registers a session, reads who the adapter is, opens itself, and exchanges cyclic
//! frames.

mod config;
mod conflict;
mod connection;
mod roster;

pub use config::{ConnectionConfig, ScannerConfig};
pub use connection::{
    Connection, ExplicitAnswer, ExplicitError, Owner, Refusal, RequestedAssembly, RequestedConnection,
};

use alloc::collections::VecDeque;
use core::net::Ipv4Addr;

use machine::arp::ArpPacket;
use machine::ethernet::Mac;
use machine::{
    Attempt, Counters, Instant, LinkEvent, Machine, Pending, Port, PortRequest, Source, StreamChange,
    StreamId, StreamRequest, Transmit,
};

use self::conflict::{Asker, Conflict};
use self::connection::Numbers;
use self::roster::Roster;
use super::class1::Frame;
use super::connection::{Priority, Triad};
use super::objects::Qos;
use super::own_address::{Change, OwnAddress};
use super::{IO_PORT, PORTS, PORTS_WITH_ARP};

/// A connection of a [`Scanner`], as long as it is not removed.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct ConnectionId(u16);

/// Error: a scanner has no number left for another connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("a scanner has 65,535 connections at most: remove one first")]
pub struct TooManyConnections;

/// An EtherNet/IP scanner.
#[derive(Debug)]
pub struct Scanner {
    connections: Roster,
    numbers: Numbers,
    /// TCP connections to close.
    to_close: VecDeque<StreamId>,
    /// Frames that belong to no connection.
    counters: Counters,
    /// Its own address, and by what it asks for those of adapters, where conflicts are detected.
    own: Option<(OwnAddress, Asker)>,
}

impl Scanner {
    /// Creates a scanner without connections.
    #[must_use]
    pub fn new(config: ScannerConfig) -> Self {
        let triad = Triad {
            connection_serial: config.first_id as u16,
            vendor: config.vendor,
            originator_serial: config.serial_number,
        };
        Self {
            connections: Roster::default(),
            numbers: Numbers { triad, t_o_id: config.first_id },
            to_close: VecDeque::with_capacity(8),
            counters: Counters::default(),
            own: None,
        }
    }

    /// Detects address conflicts: of this scanner's own address, and of those of its adapters in this subnet. Call it before
    /// [`connect`](Self::connect). It needs raw Ethernet.
    #[must_use]
    pub fn with_conflict_detection(
        mut self,
        mac: Mac,
        address: Ipv4Addr,
        mask: Ipv4Addr,
        start: Instant,
    ) -> Self {
        self.own = Some((OwnAddress::new(mac, address, start), Asker { mac, address, mask }));
        self
    }

    /// Detects no address conflicts, as a scanner without raw Ethernet. Call it before the scanner runs.
    pub fn stop_conflict_detection(&mut self) {
        self.own = None;
        self.connections.serve_all(Connection::stop_conflict_detection);
    }

    /// Adds a connection that begins to connect at `start`.
    pub fn connect(
        &mut self,
        config: ConnectionConfig,
        start: Instant,
    ) -> Result<ConnectionId, TooManyConnections> {
        let number = self.connections.next_number()?;
        let own = self.own.as_ref().map(|own| own.1);
        let connection = Connection::new(config, Attempt(number), self.numbers, start, own);
        self.connections.add(number, connection);
        Ok(ConnectionId(number))
    }

    /// Returns a connection; `None` once it was removed.
    #[must_use]
    pub fn connection(&self, id: ConnectionId) -> Option<&Connection> {
        self.connections.get(id.0)
    }

    /// Returns a connection, for commands; none once it was removed. Poll the scanner afterwards.
    pub fn connection_mut(&mut self, id: ConnectionId) -> Option<&mut Connection> {
        self.connections.get_mut(id.0)
    }

    /// Returns the data of a connection's O→T assembly, to be changed in place; `None` once it was removed. Data alone change nothing that
    /// the scanner is polled for, so it need not be polled afterwards.
    pub fn output_mut(&mut self, id: ConnectionId) -> Option<&mut [u8]> {
        self.connections.output_mut(id.0)
    }

    /// Returns every connection that was not removed.
    pub fn connections(&self) -> impl Iterator<Item = (ConnectionId, &Connection)> {
        self.connections.iter().map(|(number, connection)| (ConnectionId(number), connection))
    }

    /// Removes a connection at once. An adapter that is still connected notices this by its watchdog:
    /// [`Connection::disconnect`] first, and wait for [`LinkEvent::Down`].
    pub fn remove(&mut self, id: ConnectionId) -> Option<Connection> {
        let removed = self.connections.remove(id.0)?;
        self.to_close.extend(removed.stream());
        Some(removed)
    }

    /// Returns the next connection whose cyclic data have arrived since it was last returned here.
    pub fn poll_received(&mut self) -> Option<ConnectionId> {
        self.connections.poll_received().map(ConnectionId)
    }

    /// Returns the numbers of frames that belong to no connection, since the start.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    fn handle_io(&mut self, now: Instant, peer: Option<Ipv4Addr>, datagram: &[u8]) {
        let Ok(frame) = Frame::parse(datagram) else {
            self.counters.malformed += 1;
            return;
        };
        let Some(peer) = peer else {
            self.counters.foreign += 1;
            return;
        };
        let handle = |connection: &mut Connection| connection.handle_io(now, &frame);
        if !self.connections.serve_frames(peer, frame.connection, handle) {
            self.counters.foreign += 1;
        }
    }

    fn handle_arp(&mut self, now: Instant, frame: &[u8]) {
        let Some(Ok(packet)) = ArpPacket::from_frame(frame) else {
            self.counters.malformed += 1;
            return;
        };
        let change = self.own.as_mut().and_then(|(own, _)| own.handle(now, &packet));
        self.follow(now, change);
        self.connections
            .serve_target(packet.sender_address, |connection| connection.handle_arp(now, &packet));
    }

    /// Follows what became of the own address. Nothing connects from an address that another station has.
    fn follow(&mut self, now: Instant, change: Option<Change>) {
        let Some((own, _)) = &self.own else { return };
        match change {
            Some(Change::Taken(other)) => {
                let conflict = Conflict::Own { mac: own.mac, other };
                self.connections.serve_all(|connection| connection.refuse(now, conflict));
            }
            Some(Change::Conflict(other)) => {
                if let Some(first) = self.connections.first() {
                    self.connections.serve(first, |connection| connection.report(other));
                }
            }
            Some(Change::Free) | None => {}
        }
    }
}

impl Machine for Scanner {
    type Event = (ConnectionId, LinkEvent);

    fn ports(&self) -> &[PortRequest] {
        if self.own.is_some() { PORTS_WITH_ARP } else { PORTS }
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.connections.settle();
        match from.port {
            Port::Ethernet => self.handle_arp(now, frame),
            Port::Udp(IO_PORT) => self.handle_io(now, from.peer.map(|peer| *peer.ip()), frame),
            Port::Stream(stream) => {
                let Some(number) = self.connections.with_stream(stream) else {
                    self.counters.foreign += 1;
                    return;
                };
                let numbers = &mut self.numbers;
                self.connections.serve(number, |connection| connection.handle_bytes(now, frame, numbers));
            }
            _ => self.counters.foreign += 1,
        }
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.connections.settle();
        match change {
            StreamChange::Connected(Attempt(number)) => {
                let handle = |connection: &mut Connection| connection.handle_connected(now, stream);
                if self.connections.serve(number, handle) != Some(true) {
                    self.to_close.push_back(stream);
                }
            }
            StreamChange::NotConnected(Attempt(number)) => {
                self.connections.serve(number, |connection| connection.handle_not_connected(now));
            }
            StreamChange::Accepted(_) => self.to_close.push_back(stream),
            StreamChange::Closed => {
                if let Some(number) = self.connections.with_stream(stream) {
                    self.connections.serve(number, |connection| connection.handle_closed(now));
                }
            }
        }
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        if let Some(stream) = self.to_close.pop_front() {
            return Some(StreamRequest::Close(stream));
        }
        self.connections.settle();
        self.connections.poll_stream()
    }

    /// Returns the DSCP that a device's QoS object has by default; a scanner has no such object.
    fn dscp(&self, port: Port) -> u8 {
        match port {
            Port::Udp(IO_PORT) => Qos::default().cyclic(Priority::Scheduled),
            _ => Qos::default().explicit(),
        }
    }

    fn group(&self, port: Port, index: usize) -> Option<Ipv4Addr> {
        self.connections.group(index).filter(|_| port == Port::Udp(IO_PORT))
    }

    /// Returns the station that had the adapter's address when the connection was made.
    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        self.connections.with_target(address).find_map(|(_, connection)| connection.neighbour(address))
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        self.connections.settle();
        let its = self.connections.with_target(address);
        let its = its.filter(|(_, connection)| connection.neighbour(address).is_some());
        let first = its.map(|(number, _)| number).next();
        if let Some(number) = first {
            let handle = |connection: &mut Connection| connection.handle_wrong_neighbour(now, address, found);
            self.connections.serve(number, handle);
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        let change = self.own.as_mut().and_then(|(own, _)| own.handle_timeout(now));
        self.follow(now, change);
        self.connections.settle();
        self.connections.handle_timeout(now);
    }

    fn pending(&self, now: Instant) -> Pending {
        let is_own = self.own.as_ref().is_some_and(|(own, _)| own.may_send());
        let Pending { frame, request, event } = self.connections.pending(now);
        Pending { frame: frame || is_own, request: request || !self.to_close.is_empty(), event }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.connections.settle();
        // The cyclic frames of all connections go before all other frames.
        if let Some(cyclic) = self.connections.poll_cyclic(now, buf) {
            return Some(cyclic);
        }
        if let Some(len) = self.own.as_mut().and_then(|(own, _)| own.poll_frame(now, buf)) {
            return Some(Transmit { port: Port::Ethernet, to: None, len });
        }
        self.connections.poll_message(now, buf)
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        self.connections.settle();
        self.connections.poll_event().map(|(number, event)| (ConnectionId(number), event))
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let claim = self.own.as_ref().and_then(|(own, _)| own.poll_timeout());
        Instant::earlier(claim, self.connections.poll_timeout())
    }
}
