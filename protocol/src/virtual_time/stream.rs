//! TCP connections between the two sides: bytes in order, in pieces of random sizes.

use alloc::vec::Vec;
use core::cmp::Reverse;
use core::net::SocketAddrV4;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{Delivery, InFlight, Pair, Side};
use crate::{Duration, Instant, Machine, Port, StreamChange, StreamId, StreamRequest};

/// How much later a piece arrives for each time that it is lost: the smallest timeout that Linux uses.
const RETRANSMISSION: Duration = Duration::from_millis(200);

/// How long bytes may wait for a cut cable before both ends give the stream up.
const TIMEOUT: Duration = Duration::from_secs(3);

/// A port that the side that connects leaves from.
const EPHEMERAL_PORT: u16 = 50_000;

#[derive(Debug)]
struct Stream {
    id: StreamId,
    /// When the last piece towards A, and towards B, arrives: nothing overtakes it.
    last_arrival: [Instant; 2],
    /// Pieces that wait for the cable to be mended, with the side that they go to.
    held: Vec<(Side, Delivery)>,
    /// Since when the first of them waits.
    held_since: Instant,
    /// The sides that ended it, and so hear no more of it.
    ended: [bool; 2],
}

impl Stream {
    const fn new(id: StreamId) -> Self {
        let never = Instant::ZERO;
        Self { id, last_arrival: [never; 2], held: Vec::new(), held_since: never, ended: [false; 2] }
    }

    const fn last_arrival(&mut self, to: Side) -> &mut Instant {
        let [a, b] = &mut self.last_arrival;
        match to {
            Side::A => a,
            Side::B => b,
        }
    }

    const fn ended(&mut self, by: Side) -> &mut bool {
        let [a, b] = &mut self.ended;
        match by {
            Side::A => a,
            Side::B => b,
        }
    }
}

/// All connections that are open or being opened.
#[derive(Debug)]
pub(super) struct Streams {
    open: Vec<Stream>,
    next_id: u32,
    random: Pcg64Mcg,
}

impl Streams {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            open: Vec::new(),
            next_id: 1,
            random: Pcg64Mcg::seed_from_u64(seed.rotate_left(31) ^ 0x7CB0_57EA),
        }
    }

    fn get(&mut self, id: StreamId) -> Option<&mut Stream> {
        self.open.iter_mut().find(|stream| stream.id == id)
    }

    /// How many of `left` bytes the next piece has: now a byte, now a segment, now all of it.
    fn piece(&mut self, left: usize) -> usize {
        let limit = match self.random.next_u32() % 4 {
            0 => 1,
            1 => 24,
            2 => 200,
            _ => 1448,
        };
        1 + self.random.next_u32() as usize % limit.min(left)
    }
}

impl<A: Machine, B: Machine> Pair<A, B> {
    pub(super) fn request_stream(&mut self, from: Side, request: StreamRequest) {
        match request {
            StreamRequest::Connect { to } => self.connect(from, to),
            StreamRequest::Close(id) => {
                if let Some(stream) = self.streams.get(id) {
                    *stream.ended(from) = true;
                    self.push_stream(from, id, Delivery::Closed(id));
                }
            }
        }
    }

    fn connect(&mut self, from: Side, to: SocketAddrV4) {
        let id = StreamId(self.streams.next_id);
        self.streams.next_id = self.streams.next_id.wrapping_add(1);
        let listens = match from {
            Side::A => self.b.listen_port(),
            Side::B => self.a.listen_port(),
        };
        let source = self.station(from).address;
        let answers = self.station(from.other()).address == Some(*to.ip());
        self.streams.open.push(Stream::new(id));
        let Some(source) = source.filter(|_| answers) else {
            // Nobody is there to refuse: the attempt runs into its timeout.
            return self.push(from, self.now + TIMEOUT, Delivery::Closed(id));
        };
        if listens == Some(to.port()) {
            let peer = SocketAddrV4::new(source, EPHEMERAL_PORT);
            self.push_stream(from, id, Delivery::Opened(id, peer));
            // The answer to the connection request takes the way back after the request took the way there.
            if let Some(stream) = self.streams.get(id) {
                *stream.last_arrival(from) = *stream.last_arrival(from.other());
            }
            self.push_stream(from.other(), id, Delivery::Opened(id, to));
        } else {
            self.push_stream(from.other(), id, Delivery::Closed(id));
        }
    }

    pub(super) fn send_stream(&mut self, from: Side, id: StreamId, len: usize) {
        if !self.wants(from, Port::Stream(id)) {
            return;
        }
        let mut start = 0;
        while start < len {
            let end = start + self.streams.piece(len - start);
            let mut frame = self.spare_frames.pop().unwrap_or_default();
            frame.clear();
            frame.extend_from_slice(self.buf.get(start..end).unwrap_or_default());
            self.push_stream(from, id, Delivery::Frame { port: Port::Stream(id), peer: None, frame });
            start = end;
        }
    }

    /// Puts a piece of a stream on its way, behind all that went before it.
    fn push_stream(&mut self, from: Side, id: StreamId, delivery: Delivery) {
        let (now, to) = (self.now, from.other());
        let alive = self.station(to).alive;
        let arrival = self.station(from).link.pass_stream(now, RETRANSMISSION).filter(|_| alive);
        let Some(stream) = self.streams.get(id) else { return };
        match arrival {
            Some(arrival) if stream.held.iter().all(|(side, _)| *side != to) => {
                let last = stream.last_arrival(to);
                *last = arrival.max(*last);
                let arrives = *last;
                self.push(to, arrives, delivery);
            }
            _ => {
                let first = stream.held.is_empty();
                stream.held.push((to, delivery));
                if first {
                    stream.held_since = now;
                    self.push(to, now + TIMEOUT, Delivery::StreamTimeout(id));
                }
            }
        }
    }

    fn push(&mut self, to: Side, arrives: Instant, delivery: Delivery) {
        self.next_number += 1;
        let (number, to) = (self.next_number, to.index() as u8);
        self.in_flight.push(Reverse(InFlight { arrives, number, to, delivery }));
    }

    /// The cable is cut: datagrams are lost, pieces of streams wait.
    pub(super) fn hold_streams(&mut self) {
        let mut in_flight = core::mem::take(&mut self.in_flight).into_sorted_vec();
        in_flight.reverse();
        for Reverse(InFlight { arrives, number, to, delivery }) in in_flight {
            let side = if to == 0 { Side::A } else { Side::B };
            match &delivery {
                Delivery::Frame { port: Port::Stream(id), .. }
                | Delivery::Opened(id, _)
                | Delivery::Closed(id) => self.push_stream(side.other(), *id, delivery),
                Delivery::Frame { .. } => {}
                Delivery::StreamTimeout(_) => {
                    self.in_flight.push(Reverse(InFlight { arrives, number, to, delivery }));
                }
            }
        }
    }

    /// The cable is mended: what waited goes on its way.
    pub(super) fn resume_streams(&mut self) {
        let held: Vec<_> = self
            .streams
            .open
            .iter_mut()
            .map(|stream| (stream.id, core::mem::take(&mut stream.held)))
            .collect();
        for (id, pieces) in held {
            for (to, delivery) in pieces {
                self.push_stream(to.other(), id, delivery);
            }
        }
    }

    /// Whether `side` still wants frames of `port`.
    pub(super) fn wants(&mut self, side: Side, port: Port) -> bool {
        match port {
            Port::Stream(id) => self.streams.get(id).is_some_and(|stream| !*stream.ended(side)),
            _ => true,
        }
    }

    pub(super) fn deliver_stream(&mut self, side: Side, delivery: Delivery) {
        match delivery {
            Delivery::Frame { .. } => {}
            Delivery::Opened(id, peer) => self.change_stream(side, id, StreamChange::Opened(peer)),
            Delivery::Closed(id) => {
                self.change_stream(side, id, StreamChange::Closed);
                self.streams.open.retain(|stream| stream.id != id);
            }
            Delivery::StreamTimeout(id) => {
                let waited = |stream: &mut Stream| stream.held_since + TIMEOUT;
                let due = self.streams.get(id).filter(|stream| !stream.held.is_empty()).map(waited);
                if due.is_some_and(|due| due <= self.now) {
                    self.change_stream(Side::A, id, StreamChange::Closed);
                    self.change_stream(Side::B, id, StreamChange::Closed);
                    self.streams.open.retain(|stream| stream.id != id);
                }
            }
        }
    }

    fn change_stream(&mut self, side: Side, id: StreamId, change: StreamChange) {
        if !self.station(side).alive || !self.wants(side, Port::Stream(id)) {
            return;
        }
        let local = self.local_time(side);
        match side {
            Side::A => self.a.handle_stream(local, id, change),
            Side::B => self.b.handle_stream(local, id, change),
        }
        // What the machine still says to a connection that is gone, goes nowhere.
        if let Some(stream) = self.streams.get(id).filter(|_| change == StreamChange::Closed) {
            *stream.ended(side) = true;
        }
        self.settle(side, local);
    }
}
