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

pub use config::{ConnectionConfig, ScannerConfig};
pub use connection::{Connection, Owner, Refusal, RequestedConnection};

use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::net::Ipv4Addr;

use machine::arp::ArpPacket;
use machine::ethernet::Mac;
use machine::{
    Attempt, Counters, Instant, LinkEvent, Machine, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};

use self::conflict::{Asker, Conflict};
use self::connection::Numbers;
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
    connections: Vec<Option<Connection>>,
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
            connections: Vec::new(),
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
        self.connections.iter_mut().flatten().for_each(Connection::stop_conflict_detection);
    }

    /// Adds a connection that begins to connect at `start`.
    pub fn connect(
        &mut self,
        config: ConnectionConfig,
        start: Instant,
    ) -> Result<ConnectionId, TooManyConnections> {
        let free = self.connections.iter().position(Option::is_none).unwrap_or(self.connections.len());
        let number = u16::try_from(free).map_err(|_| TooManyConnections)?;
        let connection =
            Connection::new(config, Attempt(number), self.numbers, start, self.own.as_ref().map(|own| own.1));
        match self.connections.get_mut(free) {
            Some(place) => *place = Some(connection),
            None => self.connections.push(Some(connection)),
        }
        Ok(ConnectionId(number))
    }

    /// Returns a connection; `None` once it was removed.
    #[must_use]
    pub fn connection(&self, id: ConnectionId) -> Option<&Connection> {
        self.connections.get(usize::from(id.0))?.as_ref()
    }

    /// Returns a connection, for commands; none once it was removed. Poll the scanner afterwards.
    pub fn connection_mut(&mut self, id: ConnectionId) -> Option<&mut Connection> {
        self.connections.get_mut(usize::from(id.0))?.as_mut()
    }

    /// Returns every connection that was not removed.
    pub fn connections(&self) -> impl Iterator<Item = (ConnectionId, &Connection)> {
        let numbered = self.connections.iter().zip(0..);
        numbered.filter_map(|(connection, number)| Some((ConnectionId(number), connection.as_ref()?)))
    }

    /// Removes a connection at once. An adapter that is still connected notices this by its watchdog:
    /// [`Connection::disconnect`] first, and wait for [`LinkEvent::Down`].
    pub fn remove(&mut self, id: ConnectionId) -> Option<Connection> {
        let removed = self.connections.get_mut(usize::from(id.0))?.take()?;
        self.to_close.extend(removed.stream());
        Some(removed)
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
        // Several connections to one adapter may take part in one multicast: they have one connection number.
        let mut is_known = false;
        for connection in self.connections.iter_mut().flatten() {
            if connection.consumes(peer, frame.connection) {
                connection.handle_io(now, &frame);
                is_known = true;
            }
        }
        if !is_known {
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
        self.connections.iter_mut().flatten().for_each(|connection| connection.handle_arp(now, &packet));
    }

    /// Follows what became of the own address. Nothing connects from an address that another station has.
    fn follow(&mut self, now: Instant, change: Option<Change>) {
        let Some((own, _)) = &self.own else { return };
        let mut connections = self.connections.iter_mut().flatten();
        match change {
            Some(Change::Taken(other)) => {
                let conflict = Conflict::Own { mac: own.mac, other };
                connections.for_each(|connection| connection.refuse(now, conflict));
            }
            Some(Change::Conflict(other)) => {
                if let Some(connection) = connections.next() {
                    connection.report(other);
                }
            }
            Some(Change::Free) | None => {}
        }
    }

    fn attempt(&mut self, Attempt(number): Attempt) -> Option<&mut Connection> {
        self.connection_mut(ConnectionId(number))
    }
}

impl Machine for Scanner {
    type Event = (ConnectionId, LinkEvent);

    fn ports(&self) -> &[PortRequest] {
        if self.own.is_some() { PORTS_WITH_ARP } else { PORTS }
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match from.port {
            Port::Ethernet => self.handle_arp(now, frame),
            Port::Udp(IO_PORT) => self.handle_io(now, from.peer.map(|peer| *peer.ip()), frame),
            Port::Stream(stream) => {
                let mut connections = self.connections.iter_mut().flatten();
                match connections.find(|connection| connection.has(stream)) {
                    Some(connection) => connection.handle_bytes(now, frame, &mut self.numbers),
                    None => self.counters.foreign += 1,
                }
            }
            _ => self.counters.foreign += 1,
        }
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        match change {
            StreamChange::Connected(attempt) => {
                let connection = self.attempt(attempt);
                if !connection.is_some_and(|connection| connection.handle_connected(now, stream)) {
                    self.to_close.push_back(stream);
                }
            }
            StreamChange::NotConnected(attempt) => {
                if let Some(connection) = self.attempt(attempt) {
                    connection.handle_not_connected(now);
                }
            }
            StreamChange::Accepted(_) => self.to_close.push_back(stream),
            StreamChange::Closed => {
                let mut connections = self.connections.iter_mut().flatten();
                if let Some(connection) = connections.find(|connection| connection.has(stream)) {
                    connection.handle_closed(now);
                }
            }
        }
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        if let Some(stream) = self.to_close.pop_front() {
            return Some(StreamRequest::Close(stream));
        }
        self.connections.iter_mut().flatten().find_map(Connection::poll_stream)
    }

    /// Returns the DSCP that a device's QoS object has by default; a scanner has no such object.
    fn dscp(&self, port: Port) -> u8 {
        match port {
            Port::Udp(IO_PORT) => Qos::default().cyclic(Priority::Scheduled),
            _ => Qos::default().explicit(),
        }
    }

    fn group(&self, port: Port, index: usize) -> Option<Ipv4Addr> {
        let mut groups = self.connections.iter().flatten().filter_map(Connection::group);
        groups.nth(index).filter(|_| port == Port::Udp(IO_PORT))
    }

    /// Returns the station that had the adapter's address when the connection was made.
    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        self.connections.iter().flatten().find_map(|connection| connection.neighbour(address))
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        let mut connections = self.connections.iter_mut().flatten();
        if let Some(connection) = connections.find(|connection| connection.neighbour(address).is_some()) {
            connection.handle_wrong_neighbour(now, address, found);
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        let change = self.own.as_mut().and_then(|(own, _)| own.handle_timeout(now));
        self.follow(now, change);
        self.connections.iter_mut().flatten().for_each(|connection| connection.handle_timeout(now));
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let mut connections = self.connections.iter_mut().flatten();
        // The cyclic frames of all connections go before all other frames.
        if let Some(cyclic) = connections.find_map(|connection| connection.poll_io(now, buf)) {
            return Some(cyclic);
        }
        if let Some(len) = self.own.as_mut().and_then(|(own, _)| own.poll_frame(now, buf)) {
            return Some(Transmit { port: Port::Ethernet, to: None, len });
        }
        self.connections.iter_mut().flatten().find_map(|connection| connection.poll_message(now, buf))
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        let mut numbered = self.connections.iter_mut().zip(0..);
        numbered
            .find_map(|(connection, number)| Some((ConnectionId(number), connection.as_mut()?.poll_event()?)))
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let timeouts = self.connections.iter().flatten().map(Connection::poll_timeout);
        let claim = self.own.as_ref().and_then(|(own, _)| own.poll_timeout());
        timeouts.fold(claim, Instant::earlier)
    }
}
