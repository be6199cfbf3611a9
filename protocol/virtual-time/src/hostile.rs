//! A pair of stations and a stranger on one switch: what does the stranger change?
//!
//! The stranger sends altered copies of the pair's own frames, from addresses of its own, to both. A run with it is
//! compared with one without it: the pair must send each other the same bytes at the same instants. What it sends is
//! chosen by a seeded random stream, or by the bytes of a fuzzer.

mod pair_run;

pub use pair_run::{PairRun, Phases, Place, Record, Reported, StationPair};

use alloc::collections::{BTreeSet, VecDeque};
use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use machine::ethernet::{EthernetHeader, Mac};
use machine::{
    Attempt, Duration, Instant, Machine, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest,
    Transmit,
};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// The stranger's MAC address.
pub const STRANGER_MAC: Mac = Mac([2, 0, 0, 0, 0, 0x66]);
/// The stranger's IP address.
pub const STRANGER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 66);

/// TCP connections that the stranger holds at a time.
const STREAMS: usize = 24;
/// Frames that the stranger sends each millisecond.
const FRAMES_PER_MS: usize = 20;
const MS: Duration = Duration::from_millis(1);
/// RegisterSession of EtherNet/IP: its reply names the session that later messages carry in bytes 4 to 7.
const REGISTER_SESSION: [u8; 2] = [0x65, 0];

/// Where a stranger's choices come from.
pub trait Choices {
    /// Returns a number below `limit`, or 0 if that is 0.
    fn below(&mut self, limit: usize) -> usize;

    /// Returns whether there are no more choices: the stranger falls silent.
    fn is_over(&self) -> bool {
        false
    }
}

/// Choices of a seeded random stream.
pub type Random = Pcg64Mcg;

impl Choices for Random {
    fn below(&mut self, limit: usize) -> usize {
        usize::try_from(self.next_u64() % limit.max(1) as u64).unwrap_or(0)
    }
}

/// Choices read from bytes, such as a fuzzer's: each takes as many bytes as its limit has.
#[derive(Clone, Debug)]
pub struct Script(VecDeque<u8>);

impl Script {
    /// Takes all choices from these bytes.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Self {
        Self(bytes.iter().copied().collect())
    }

    /// Takes so many bytes as they are, or what is left.
    pub fn take(&mut self, len: usize) -> Vec<u8> {
        self.0.drain(..len.min(self.0.len())).collect()
    }
}

impl Choices for Script {
    fn below(&mut self, limit: usize) -> usize {
        let (mut value, mut most) = (0_usize, 0_usize);
        while most < limit.saturating_sub(1) {
            value = value << 8 | usize::from(self.0.pop_front().unwrap_or(0));
            most = most << 8 | 0xFF;
        }
        value % limit.max(1)
    }

    fn is_over(&self) -> bool {
        self.0.is_empty()
    }
}

/// A frame that one station of the pair sent.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Sent {
    /// When.
    pub at: Instant,
    /// By which port, and to whom.
    pub port: Port,
    /// The receiver of a datagram.
    pub to: Option<SocketAddrV4>,
    /// The bytes.
    pub frame: Vec<u8>,
}

/// A station of the pair, watched.
#[derive(Debug)]
pub struct Watched<M> {
    /// The station.
    pub machine: M,
    /// What it sent to the other station, or to all.
    pub sent: Vec<Sent>,
    /// Heap allocations while it took frames of the stranger.
    pub allocations: u64,
    /// Frames and changes of TCP connections that came from the stranger.
    pub foreign: u64,
    count: fn() -> u64,
    streams: BTreeSet<StreamId>,
}

impl<M: Machine> Watched<M> {
    /// Watches a station. `count` returns the heap allocations so far.
    pub const fn new(machine: M, count: fn() -> u64) -> Self {
        Self { machine, sent: Vec::new(), allocations: 0, foreign: 0, count, streams: BTreeSet::new() }
    }

    fn measured(&mut self, is_foreign: bool, handle: impl FnOnce(&mut M)) {
        let before = (self.count)();
        handle(&mut self.machine);
        if is_foreign {
            self.foreign += 1;
            self.allocations += (self.count)() - before;
        }
    }

    fn is_foreign(&self, from: Source, frame: &[u8]) -> bool {
        match (from.port, from.peer) {
            (Port::Stream(stream), _) => self.streams.contains(&stream),
            (_, Some(peer)) => *peer.ip() == STRANGER,
            _ => frame.get(6..12) == Some(&STRANGER_MAC.0[..]),
        }
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        let is_foreign = self.is_foreign(from, frame);
        self.measured(is_foreign, |machine| machine.handle_frame(now, from, frame));
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        if matches!(change, StreamChange::Accepted(peer) if *peer.ip() == STRANGER) {
            self.streams.insert(stream);
        }
        let is_foreign = self.streams.contains(&stream);
        self.measured(is_foreign, |machine| machine.handle_stream(now, stream, change));
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let transmit = self.machine.poll_transmit(now, buf)?;
        let frame = buf.get(..transmit.len).unwrap_or_default();
        let to_stranger = match (transmit.port, transmit.to) {
            (Port::Stream(stream), _) => self.streams.contains(&stream),
            (_, Some(to)) => *to.ip() == STRANGER,
            _ => frame.get(..6) == Some(&STRANGER_MAC.0[..]),
        };
        if !to_stranger {
            // The number of a TCP connection is the network's, and no byte on the wire.
            let port =
                if let Port::Stream(_) = transmit.port { Port::Stream(StreamId(0)) } else { transmit.port };
            self.sent.push(Sent { at: now, port, to: transmit.to, frame: frame.to_vec() });
        }
        Some(transmit)
    }
}

/// The stranger.
#[derive(Debug)]
pub struct Stranger<C = Random> {
    choices: C,
    /// The MAC address that it sends from.
    mac: Mac,
    /// Frames to alter: port of the receiver and bytes.
    pool: Vec<(Port, Vec<u8>)>,
    targets: [(Mac, Ipv4Addr); 2],
    next: Instant,
    end: Instant,
    left: usize,
    streams: Vec<(StreamId, [u8; 4])>,
    requests: VecDeque<StreamRequest>,
    listen: Option<SocketAddrV4>,
}

impl Stranger {
    /// Creates a stranger that has heard `heard` and sends from `start` to `end` to stations with these addresses. It
    /// connects to `listen` over TCP, if that is given.
    #[must_use]
    pub fn new(
        seed: u64,
        heard: &[Sent],
        targets: [(Mac, Ipv4Addr); 2],
        listen: Option<SocketAddrV4>,
        time: (Instant, Instant),
    ) -> Self {
        Self::choosing(Random::seed_from_u64(seed), heard, targets, listen, time)
    }
}

impl<C: Choices> Stranger<C> {
    /// A stranger as [`new`](Stranger::new) makes it, whose choices come from elsewhere.
    #[must_use]
    pub fn choosing(
        choices: C,
        heard: &[Sent],
        targets: [(Mac, Ipv4Addr); 2],
        listen: Option<SocketAddrV4>,
        (start, end): (Instant, Instant),
    ) -> Self {
        let port = |sent: &Sent| match (sent.port, sent.to) {
            (Port::Udp(_), Some(to)) => Port::Udp(to.port()),
            (port, _) => port,
        };
        // There are many cyclic frames of one kind, so a few of each kind are enough.
        let mut pool: Vec<(Port, Vec<u8>)> = Vec::new();
        for sent in heard {
            let alike = |(other, frame): &&(Port, Vec<u8>)| {
                *other == port(sent)
                    && frame.len() == sent.frame.len()
                    && frame.get(..24) == sent.frame.get(..24)
            };
            if pool.iter().filter(alike).count() < 3 {
                pool.push((port(sent), sent.frame.clone()));
            }
        }
        Self {
            choices,
            mac: STRANGER_MAC,
            pool,
            targets,
            next: start,
            end,
            left: 0,
            streams: Vec::new(),
            requests: VecDeque::new(),
            listen,
        }
    }

    /// Makes it send from another MAC address: that of one of the pair.
    #[must_use]
    pub const fn forging(mut self, mac: Mac) -> Self {
        self.mac = mac;
        self
    }

    fn below(&mut self, limit: usize) -> usize {
        self.choices.below(limit)
    }

    /// Changes some bits or bytes of a frame, or its length, or leaves it unchanged.
    fn alter(&mut self, frame: &mut Vec<u8>, from: usize) {
        for _ in 0..self.below(4) {
            let span = frame.len().saturating_sub(from);
            let place = from + self.below(span);
            // A run of bytes reaches numbers that no single byte does.
            let (kind, run) = (self.below(5), if self.below(4) == 0 { 4 } else { 1 });
            for place in place..place + run {
                let value = match kind {
                    0 => 0,
                    1 => 0xFF,
                    2 | 3 => self.below(256) as u8,
                    _ => frame.get(place).copied().unwrap_or(0) ^ 1 << self.below(8),
                };
                if let Some(byte) = frame.get_mut(place) {
                    *byte = value;
                }
            }
        }
        match self.below(16) {
            0 => {
                let len = from + self.below(frame.len().saturating_sub(from) + 1);
                frame.truncate(len);
            }
            1 => frame.extend([0; 12]),
            _ => {}
        }
    }

    fn send(&mut self, buf: &mut [u8]) -> Option<Transmit> {
        let index = self.below(self.pool.len());
        let (port, mut frame) = self.pool.get(index)?.clone();
        let side = self.below(2);
        let (mac, address) = self.targets.get(side).copied()?;
        let (port, to) = match port {
            Port::Ethernet => {
                let (header, _) = EthernetHeader::parse(&frame).ok()?;
                self.alter(&mut frame, 12);
                let destination = if header.destination.is_group() { header.destination } else { mac };
                frame.get_mut(..6)?.copy_from_slice(&destination.0);
                frame.get_mut(6..12)?.copy_from_slice(&self.mac.0);
                (Port::Ethernet, None)
            }
            Port::Udp(port) => {
                self.alter(&mut frame, 0);
                (Port::Udp(port), Some(SocketAddrV4::new(address, port)))
            }
            Port::Stream(_) => {
                if self.below(20) == 0 {
                    self.change_streams();
                }
                let index = self.below(self.streams.len());
                let (stream, session) = self.streams.get(index).copied()?;
                if let Some(place) = frame.get_mut(4..8)
                    && session != [0; 4]
                {
                    place.copy_from_slice(&session);
                }
                // The head stays most of the time: a wrong length only leaves the stream out of step.
                let from = if self.below(8) == 0 { 0 } else { 24.min(frame.len()) };
                self.alter(&mut frame, from);
                (Port::Stream(stream), None)
            }
        };
        buf.get_mut(..frame.len())?.copy_from_slice(&frame);
        Some(Transmit { port, to, len: frame.len() })
    }

    /// Asks for another TCP connection, or closes one.
    fn change_streams(&mut self) {
        let Some(to) = self.listen else { return };
        if self.streams.len() >= STREAMS || self.below(8) == 0 {
            let index = self.below(self.streams.len());
            if index < self.streams.len() {
                let (stream, _) = self.streams.swap_remove(index);
                self.requests.push_back(StreamRequest::Close(stream));
            }
        }
        self.requests.push_back(StreamRequest::Connect { to, attempt: Attempt(0) });
    }

    fn receive(&mut self, from: Source, frame: &[u8]) {
        let Port::Stream(stream) = from.port else { return };
        if frame.starts_with(&REGISTER_SESSION)
            && let (Some((_, session)), Some(own)) =
                (self.streams.iter_mut().find(|(id, _)| *id == stream), frame.get(4..8))
            && let Ok(own) = own.try_into()
        {
            *session = own;
        }
    }
}

/// A station of the network: one of the pair, or the stranger.
#[derive(Debug)]
pub enum Member<A, B, C = Random> {
    /// The first of the pair.
    A(Watched<A>),
    /// The second of the pair.
    B(Watched<B>),
    /// The stranger.
    Stranger(Stranger<C>),
}

/// An event of one of the pair.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum MemberEvent<A, B> {
    /// Of the first.
    A(A),
    /// Of the second.
    B(B),
}

impl<A: Machine, B: Machine, C: Choices> Machine for Member<A, B, C> {
    type Event = MemberEvent<A::Event, B::Event>;

    fn ports(&self) -> &[PortRequest] {
        &[]
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match self {
            Self::A(watched) => watched.handle_frame(now, from, frame),
            Self::B(watched) => watched.handle_frame(now, from, frame),
            Self::Stranger(stranger) => stranger.receive(from, frame),
        }
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        match self {
            Self::A(watched) => watched.handle_stream(now, stream, change),
            Self::B(watched) => watched.handle_stream(now, stream, change),
            Self::Stranger(stranger) => match change {
                StreamChange::Connected(_) => stranger.streams.push((stream, [0; 4])),
                StreamChange::Closed => stranger.streams.retain(|(id, _)| *id != stream),
                StreamChange::Accepted(_) | StreamChange::NotConnected(_) => {}
            },
        }
    }

    fn listen_port(&self) -> Option<u16> {
        match self {
            Self::A(watched) => watched.machine.listen_port(),
            Self::B(watched) => watched.machine.listen_port(),
            Self::Stranger(_) => None,
        }
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        match self {
            Self::A(watched) => watched.machine.poll_stream(),
            Self::B(watched) => watched.machine.poll_stream(),
            Self::Stranger(stranger) => stranger.requests.pop_front(),
        }
    }

    fn group(&self, port: Port, index: usize) -> Option<Ipv4Addr> {
        match self {
            Self::A(watched) => watched.machine.group(port, index),
            Self::B(watched) => watched.machine.group(port, index),
            Self::Stranger(_) => None,
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        match self {
            Self::A(watched) => watched.machine.handle_timeout(now),
            Self::B(watched) => watched.machine.handle_timeout(now),
            Self::Stranger(stranger) => {
                stranger.left = FRAMES_PER_MS;
                // At instants of its own, between the frames of the pair and together with them.
                let wait = Duration::from_nanos(stranger.below(2_000_000) as u64);
                stranger.next = now + wait.max(MS / 8);
                stranger.change_streams();
            }
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        match self {
            Self::A(watched) => watched.poll_transmit(now, buf),
            Self::B(watched) => watched.poll_transmit(now, buf),
            Self::Stranger(stranger) => {
                while stranger.left > 0 && !stranger.choices.is_over() {
                    stranger.left -= 1;
                    if let Some(transmit) = stranger.send(buf) {
                        return Some(transmit);
                    }
                }
                None
            }
        }
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        match self {
            Self::A(watched) => watched.machine.poll_event().map(MemberEvent::A),
            Self::B(watched) => watched.machine.poll_event().map(MemberEvent::B),
            Self::Stranger(_) => None,
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::A(watched) => watched.machine.poll_timeout(),
            Self::B(watched) => watched.machine.poll_timeout(),
            Self::Stranger(stranger) => {
                let sends = stranger.next < stranger.end && !stranger.choices.is_over();
                sends.then_some(stranger.next)
            }
        }
    }
}
