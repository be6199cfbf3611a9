//! Any number of machines on one switch, in virtual time, for tests with more stations than the two of a
//! [`Pair`](crate::Pair). All have the same clock, and every frame arrives after the same delay.
//!
//! Each station has a host with a table of neighbours, which never ages: the host answers ARP for its address, and sends a
//! datagram to the MAC address that the table has, or first asks who has the IP address and takes the first answer.

use alloc::collections::{BTreeMap, VecDeque};
use alloc::vec;
use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use machine::arp::{ArpPacket, Operation};
use machine::ethernet::{EthernetHeader, Mac};
use machine::wire::FRAME_CAPACITY;
use machine::{
    Attempt, Duration, Instant, Machine, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest,
    Transmit,
};

use crate::pair::hosts;

/// The port that a station connects from over TCP; the stream's number tells connections apart.
const EPHEMERAL_PORT: u16 = 50_000;

/// A station of a [`Network`].
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct StationId(usize);

#[derive(Debug)]
struct Station<M> {
    machine: M,
    mac: Mac,
    address: Option<Ipv4Addr>,
    /// MAC addresses that the host knows.
    neighbours: BTreeMap<Ipv4Addr, Mac>,
    is_unplugged: bool,
    /// Whether the driver may correct them, as a process with `CAP_NET_ADMIN` may.
    may_correct: bool,
    timeout: Option<Instant>,
}

/// A TCP connection: who asked for it, and who accepted it.
#[derive(Clone, Copy, Debug)]
struct Stream {
    id: StreamId,
    ends: [StationId; 2],
}

/// What arrives at a station.
#[derive(Debug)]
enum Arrival {
    Frame { from: Source, to_all: bool, frame: Vec<u8> },
    Stream(StreamId, StreamChange),
}

/// Machines on one switch.
#[derive(Debug)]
pub struct Network<M: Machine> {
    now: Instant,
    delay: Duration,
    stations: Vec<Station<M>>,
    /// In the order of arrival, since every frame takes as long.
    in_flight: VecDeque<(Instant, StationId, Arrival)>,
    streams: Vec<Stream>,
    next_stream: u32,
    events: VecDeque<(StationId, M::Event)>,
    buf: Vec<u8>,
}

impl<M: Machine> Network<M> {
    /// Creates a switch without stations, on which every frame arrives after `delay`.
    #[must_use]
    pub fn new(delay: Duration) -> Self {
        Self {
            now: Instant::ZERO,
            delay,
            stations: Vec::new(),
            in_flight: VecDeque::new(),
            streams: Vec::new(),
            next_stream: 1,
            events: VecDeque::new(),
            buf: vec![0; FRAME_CAPACITY],
        }
    }

    /// Connects a station.
    pub fn add(&mut self, machine: M, mac: Mac, address: Option<Ipv4Addr>) -> StationId {
        let id = StationId(self.stations.len());
        self.stations.push(Station {
            machine,
            mac,
            address,
            neighbours: BTreeMap::new(),
            is_unplugged: false,
            may_correct: true,
            timeout: None,
        });
        self.poll_machine(id);
        id
    }

    /// Returns the time, which all stations' clocks show.
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// Returns a station's machine; `None` for a station of another network.
    #[must_use]
    pub fn machine(&self, id: StationId) -> Option<&M> {
        self.stations.get(id.0).map(|station| &station.machine)
    }

    /// Gives a command to a station's machine.
    pub fn command<R>(&mut self, id: StationId, command: impl FnOnce(&mut M, Instant) -> R) -> Option<R> {
        let now = self.now;
        let result = command(&mut self.stations.get_mut(id.0)?.machine, now);
        self.poll_machine(id);
        Some(result)
    }

    /// Gives a station an IP address, as its operating system would.
    pub fn set_address(&mut self, id: StationId, address: Option<Ipv4Addr>) {
        if let Some(station) = self.stations.get_mut(id.0) {
            station.address = address;
        }
    }

    /// Sets whether a station's driver may correct its host's table of neighbours. It may at the start.
    pub fn set_may_correct(&mut self, id: StationId, may_correct: bool) {
        if let Some(station) = self.stations.get_mut(id.0) {
            station.may_correct = may_correct;
        }
    }

    /// Removes a station from the switch: it neither receives nor sends any more. Its machine stays as it was.
    pub fn unplug(&mut self, id: StationId) {
        if let Some(station) = self.stations.get_mut(id.0) {
            station.is_unplugged = true;
            station.timeout = None;
        }
    }

    /// Runs until a machine has an event, or to `until`, whichever is first.
    pub fn next_event(&mut self, until: Instant) -> Option<(StationId, M::Event)> {
        loop {
            if let Some(event) = self.events.pop_front() {
                return Some(event);
            }
            if !self.step(until) {
                self.now = self.now.max(until);
                return None;
            }
        }
    }

    /// Does what happens next, unless that is after `until`. Returns whether something happened.
    fn step(&mut self, until: Instant) -> bool {
        let arrives = self.in_flight.front().map(|(arrives, ..)| *arrives);
        let numbered = self.stations.iter().enumerate();
        let due = numbered.filter_map(|(index, station)| Some((station.timeout?, StationId(index)))).min();
        match (arrives, due) {
            (Some(arrives), due) if arrives <= until && due.is_none_or(|(at, _)| arrives <= at) => {
                self.now = self.now.max(arrives);
                if let Some((_, to, arrival)) = self.in_flight.pop_front() {
                    self.deliver(to, arrival);
                }
                true
            }
            (_, Some((at, id))) if at <= until => {
                self.now = self.now.max(at);
                let now = self.now;
                self.command(id, |machine, _| machine.handle_timeout(now));
                true
            }
            _ => false,
        }
    }

    fn deliver(&mut self, to: StationId, arrival: Arrival) {
        if let Arrival::Frame { from: Source { port: Port::Ethernet, .. }, frame, .. } = &arrival {
            self.handle_arp(to, frame);
            let Some(station) = self.stations.get(to.0) else { return };
            if !hosts::takes_arp(station.machine.ports(), frame) {
                return;
            }
        }
        if self.stations.get(to.0).is_none_or(|station| station.is_unplugged) {
            return;
        }
        self.command(to, |machine, now| match &arrival {
            Arrival::Frame { from, to_all: false, frame } => machine.handle_frame(now, *from, frame),
            Arrival::Frame { from, to_all: true, frame } => machine.handle_broadcast(now, *from, frame),
            Arrival::Stream(id, change) => machine.handle_stream(now, *id, *change),
        });
    }

    /// Follows the contract after a change: drains frames, requests and events, then reads the timeout.
    fn poll_machine(&mut self, id: StationId) {
        let now = self.now;
        if self.stations.get(id.0).is_none_or(|station| station.is_unplugged) {
            return;
        }
        loop {
            let Some(station) = self.stations.get_mut(id.0) else { return };
            let Some(transmit) = station.machine.poll_transmit(now, &mut self.buf) else { break };
            self.send(id, transmit);
        }
        while let Some(request) =
            self.stations.get_mut(id.0).and_then(|station| station.machine.poll_stream())
        {
            match request {
                StreamRequest::Connect { to, attempt } => self.connect(id, to, attempt),
                StreamRequest::Close(stream) => self.close(id, stream),
            }
        }
        if let Some(station) = self.stations.get_mut(id.0) {
            while let Some(event) = station.machine.poll_event() {
                self.events.push_back((id, event));
            }
            station.timeout = station.machine.poll_timeout();
        }
    }

    /// Does what a station's host does with ARP: answers a question for its address, and keeps its table up to date, as the
    /// Linux kernel does. A packet changes an entry that exists; a question for the host's own address makes one.
    fn handle_arp(&mut self, id: StationId, frame: &[u8]) {
        let Some(station) = self.stations.get_mut(id.0).filter(|station| !station.is_unplugged) else {
            return;
        };
        let Some(Ok(packet)) = ArpPacket::from_frame(frame) else { return };
        let asks = packet.operation == Operation::Request && station.address == Some(packet.target_address);
        let sender = packet.sender_address;
        if !packet.is_probe() && (asks || station.neighbours.contains_key(&sender)) {
            station.neighbours.insert(sender, packet.sender_mac);
        }
        let mut answer = [0; 64];
        let Ok(len) = packet.answer(station.mac).emit_frame(&mut answer) else { return };
        let asker = self.stations.iter().position(|station| station.mac == packet.sender_mac);
        if let Some(asker) = asker.filter(|_| asks) {
            let frame = answer.get(..len).unwrap_or_default().to_vec();
            let from = Source { port: Port::Ethernet, peer: None };
            self.push(StationId(asker), Arrival::Frame { from, to_all: false, frame });
        }
    }

    /// Returns the MAC address to which a station's host sends a datagram; `None` if it sends nothing.
    fn next_hop(&mut self, from: StationId, to: Ipv4Addr) -> Option<Mac> {
        let others = self.stations.iter().enumerate();
        let mut others = others.filter(|(index, other)| *index != from.0 && !other.is_unplugged);
        let first = others.find(|(_, other)| other.address == Some(to)).map(|(_, other)| other.mac);
        let station = self.stations.get_mut(from.0)?;
        let known = station.neighbours.get(&to).copied().or(first);
        let hop = match (station.machine.neighbour(to), known) {
            (Some(wanted), Some(found)) if wanted != found && !station.may_correct => {
                let now = self.now;
                station.machine.handle_wrong_neighbour(now, to, found);
                return None;
            }
            (Some(wanted), _) => wanted,
            (None, known) => known?,
        };
        station.neighbours.insert(to, hop);
        Some(hop)
    }

    fn push(&mut self, to: StationId, arrival: Arrival) {
        self.in_flight.push_back((self.now + self.delay, to, arrival));
    }

    fn send(&mut self, from: StationId, Transmit { port, to, len }: Transmit) {
        let frame = self.buf.get(..len).unwrap_or_default().to_vec();
        if let Port::Stream(stream) = port {
            if let Some(peer) = self.peer(from, stream) {
                let from = Source { port, peer: None };
                self.push(peer, Arrival::Frame { from, to_all: false, frame });
            }
            return;
        }
        let source = self.stations.get(from.0).and_then(|sender| sender.address);
        let (receivers, from, to_all) = match (port, to) {
            (Port::Udp(local), Some(to)) => {
                let Some(source) = source else { return };
                let is_one = !to.ip().is_broadcast() && !to.ip().is_multicast();
                let hop = if is_one { self.next_hop(from, *to.ip()) } else { None };
                let is_meant = |station: &Station<M>| {
                    let port = Port::Udp(to.port());
                    let mut groups = (0..).map_while(|index| station.machine.group(port, index));
                    if is_one {
                        station.address == Some(*to.ip()) && hop == Some(station.mac)
                    } else {
                        groups.any(|group| group == *to.ip())
                    }
                };
                let peer = Some(SocketAddrV4::new(source, local));
                let to_all = to.ip().is_broadcast();
                let receivers = self.others(from, |station| to_all || is_meant(station));
                (receivers, Source { port: Port::Udp(to.port()), peer }, to_all)
            }
            _ => {
                let Ok((header, _)) = EthernetHeader::parse(&frame) else { return };
                let takes_any = |station: &Station<M>| {
                    station.machine.ports().iter().any(
                        |request| matches!(request, PortRequest::AnyEthernet { ether_type } if *ether_type == header.ether_type),
                    )
                };
                let is_meant = |station: &Station<M>| {
                    header.destination.is_group() || station.mac == header.destination || takes_any(station)
                };
                (self.others(from, is_meant), Source { port, peer: None }, false)
            }
        };
        for receiver in receivers {
            self.push(receiver, Arrival::Frame { from, to_all, frame: frame.clone() });
        }
    }

    fn others(&self, from: StationId, is_meant: impl Fn(&Station<M>) -> bool) -> Vec<StationId> {
        let numbered = self.stations.iter().enumerate();
        let meant = numbered
            .filter(|(index, station)| *index != from.0 && !station.is_unplugged && is_meant(station));
        meant.map(|(index, _)| StationId(index)).collect()
    }

    fn connect(&mut self, from: StationId, to: SocketAddrV4, attempt: Attempt) {
        let id = StreamId(self.next_stream);
        self.next_stream = self.next_stream.wrapping_add(1);
        let source = self.stations.get(from.0).and_then(|station| station.address);
        let listens = |station: &Station<M>| {
            station.address == Some(*to.ip()) && station.machine.listen_port() == Some(to.port())
        };
        let acceptor = self.others(from, listens).first().copied();
        if let (Some(source), Some(acceptor)) = (source, acceptor) {
            self.streams.push(Stream { id, ends: [from, acceptor] });
            let peer = SocketAddrV4::new(source, EPHEMERAL_PORT);
            self.push(acceptor, Arrival::Stream(id, StreamChange::Accepted(peer)));
            self.push(from, Arrival::Stream(id, StreamChange::Connected(attempt)));
        } else {
            self.push(from, Arrival::Stream(id, StreamChange::NotConnected(attempt)));
        }
    }

    fn close(&mut self, by: StationId, id: StreamId) {
        if let Some(peer) = self.peer(by, id) {
            self.streams.retain(|stream| stream.id != id);
            self.push(peer, Arrival::Stream(id, StreamChange::Closed));
        }
    }

    fn peer(&self, station: StationId, id: StreamId) -> Option<StationId> {
        let Stream { ends: [a, b], .. } = self.streams.iter().find(|stream| stream.id == id)?;
        Some(if *a == station { *b } else { *a })
    }
}
