//! The stranger: a machine that sends altered copies of the pair's frames, at random instants.

use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use machine::ethernet::{EthernetHeader, Mac};
use machine::{Attempt, Duration, Instant, Port, Source, StreamChange, StreamId, StreamRequest, Transmit};
use rand_core::SeedableRng;

use super::{Choices, MS, Random, STRANGER_MAC, SentFrame};

/// TCP connections that the stranger holds at a time.
const STREAMS: usize = 24;
/// Frames that the stranger sends each millisecond.
const FRAMES_PER_MS: usize = 20;
/// RegisterSession of EtherNet/IP: its reply names the session that later messages carry in bytes 4 to 7.
const REGISTER_SESSION: [u8; 2] = [0x65, 0];

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
    /// Creates a stranger that alters the frames `heard` and sends during `time`, from start to end, to stations with these
    /// addresses. It connects to `listen` over TCP, if that is given.
    #[must_use]
    pub fn new(
        seed: u64,
        heard: &[SentFrame],
        targets: [(Mac, Ipv4Addr); 2],
        listen: Option<SocketAddrV4>,
        time: (Instant, Instant),
    ) -> Self {
        Self::choosing(Random::seed_from_u64(seed), heard, targets, listen, time)
    }
}

impl<C: Choices> Stranger<C> {
    /// Creates a stranger like [`new`](Stranger::new) with other choices.
    #[must_use]
    pub fn choosing(
        choices: C,
        heard: &[SentFrame],
        targets: [(Mac, Ipv4Addr); 2],
        listen: Option<SocketAddrV4>,
        (start, end): (Instant, Instant),
    ) -> Self {
        let port = |sent: &SentFrame| match (sent.port, sent.to) {
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
                // Most frames keep their header: a wrong length would only make the rest of the stream unreadable.
                let from = if self.below(8) == 0 { 0 } else { 24.min(frame.len()) };
                self.alter(&mut frame, from);
                (Port::Stream(stream), None)
            }
        };
        buf.get_mut(..frame.len())?.copy_from_slice(&frame);
        Some(Transmit { port, to, len: frame.len() })
    }

    /// Requests another TCP connection, and may close one.
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

    pub(super) fn handle_frame(&mut self, from: Source, frame: &[u8]) {
        let Port::Stream(stream) = from.port else { return };
        if frame.starts_with(&REGISTER_SESSION)
            && let (Some((_, session)), Some(own)) =
                (self.streams.iter_mut().find(|(id, _)| *id == stream), frame.get(4..8))
            && let Ok(own) = own.try_into()
        {
            *session = own;
        }
    }

    pub(super) fn handle_stream(&mut self, stream: StreamId, change: StreamChange) {
        match change {
            StreamChange::Connected(_) => self.streams.push((stream, [0; 4])),
            StreamChange::Closed => self.streams.retain(|(id, _)| *id != stream),
            StreamChange::Accepted(_) | StreamChange::NotConnected(_) => {}
        }
    }

    pub(super) fn poll_stream(&mut self) -> Option<StreamRequest> {
        self.requests.pop_front()
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        self.left = FRAMES_PER_MS;
        // At instants of its own, between the frames of the pair and together with them.
        let wait = Duration::from_nanos(self.below(2_000_000) as u64);
        self.next = now + wait.max(MS / 8);
        self.change_streams();
    }

    pub(super) fn poll_transmit(&mut self, buf: &mut [u8]) -> Option<Transmit> {
        while self.left > 0 && !self.choices.is_over() {
            self.left -= 1;
            if let Some(transmit) = self.send(buf) {
                return Some(transmit);
            }
        }
        None
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let sends = self.next < self.end && !self.choices.is_over();
        sends.then_some(self.next)
    }
}
