//! A station of the pair, with a record of what it sends and of what the stranger costs it.

use alloc::collections::BTreeSet;
use alloc::vec::Vec;
use core::net::SocketAddrV4;

use machine::{Instant, Machine, Port, Source, StreamChange, StreamId, StreamRequest, Transmit};

use super::{STRANGER, STRANGER_MAC};

/// A frame that one station of the pair sent.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SentFrame {
    /// Instant at which it was sent.
    pub at: Instant,
    /// The port that it was sent by.
    pub port: Port,
    /// The receiver of a datagram.
    pub to: Option<SocketAddrV4>,
    /// The bytes.
    pub frame: Vec<u8>,
}

/// A station of the pair, watched.
#[derive(Debug)]
pub struct RecordedStation<M> {
    /// The station.
    pub machine: M,
    /// What it sent to the other station, or to all.
    pub sent: Vec<SentFrame>,
    /// Heap allocations while it handled frames of the stranger.
    pub allocations: u64,
    /// Frames and changes of TCP connections that came from the stranger.
    pub foreign: u64,
    count: fn() -> u64,
    streams: BTreeSet<StreamId>,
    /// When it was polled last.
    polled_at: Instant,
}

impl<M: Machine> RecordedStation<M> {
    /// Watches a station. `count` returns the heap allocations so far.
    pub const fn new(machine: M, count: fn() -> u64) -> Self {
        Self {
            machine,
            sent: Vec::new(),
            allocations: 0,
            foreign: 0,
            count,
            streams: BTreeSet::new(),
            polled_at: Instant::ZERO,
        }
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

    pub(super) fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        let is_foreign = self.is_foreign(from, frame);
        self.measured(is_foreign, |machine| machine.handle_frame(now, from, frame));
    }

    pub(super) fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        if matches!(change, StreamChange::Accepted(peer) if *peer.ip() == STRANGER) {
            self.streams.insert(stream);
        }
        let is_foreign = self.streams.contains(&stream);
        self.measured(is_foreign, |machine| machine.handle_stream(now, stream, change));
    }

    /// Polls the station for a frame.
    ///
    /// # Panics
    /// It has one although it says that it has none; so have the other polls.
    pub(super) fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.polled_at = now;
        let is_pending = self.machine.pending(now).frame;
        let transmit = self.machine.poll_transmit(now, buf)?;
        assert!(is_pending, "a station that says that it has no frame has {transmit:?}");
        let frame = buf.get(..transmit.len).unwrap_or_default();
        let to_stranger = match (transmit.port, transmit.to) {
            (Port::Stream(stream), _) => self.streams.contains(&stream),
            (_, Some(to)) => *to.ip() == STRANGER,
            _ => frame.get(..6) == Some(&STRANGER_MAC.0[..]),
        };
        if !to_stranger {
            // The number of a TCP connection belongs to the network and is not sent.
            let port =
                if let Port::Stream(_) = transmit.port { Port::Stream(StreamId(0)) } else { transmit.port };
            self.sent.push(SentFrame { at: now, port, to: transmit.to, frame: frame.to_vec() });
        }
        Some(transmit)
    }

    pub(super) fn poll_stream(&mut self) -> Option<StreamRequest> {
        let is_pending = self.machine.pending(self.polled_at).request;
        let request = self.machine.poll_stream()?;
        assert!(is_pending, "a station that says that it has no request has {request:?}");
        Some(request)
    }

    pub(super) fn poll_event(&mut self) -> Option<M::Event> {
        let is_pending = self.machine.pending(self.polled_at).event;
        let event = self.machine.poll_event()?;
        assert!(is_pending, "a station that says that it has no event has one");
        Some(event)
    }
}
