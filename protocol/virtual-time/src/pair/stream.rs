//! TCP connections between the two sides: bytes in order, in pieces of random sizes.

mod segments;

use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::Pair;
use super::frames::holding;
use super::in_flight::{Delivery, InFlight};
use super::tap::{Label, Segment};
use crate::link::{LinkEffect, SentPiece, flip};
use crate::side::Side;
use machine::{Attempt, Duration, Instant, Machine, Port, StreamChange, StreamId, StreamRequest};

/// Additional delay of a piece for each time that it is lost: the smallest retransmission timeout of Linux.
const RETRANSMISSION: Duration = Duration::from_millis(200);

/// How long bytes wait for a cut cable before both ends give up the stream.
const TIMEOUT: Duration = Duration::from_secs(3);

/// First ephemeral port of the connecting side; further connections take the next ones (RFC 6335, section 6).
const EPHEMERAL_PORT: u16 = 50_000;
const EPHEMERAL_PORTS: u32 = 10_000;

#[derive(Debug)]
struct Stream {
    id: StreamId,
    /// The side that connects, and what for.
    asked: (Side, Attempt),
    /// Whether that side knows that it is connected.
    connected: bool,
    /// The connecting side, its address and its peer's; `None` if nobody could answer.
    between: Option<(Side, SocketAddrV4, SocketAddrV4)>,
    /// Bytes sent by A and by B.
    sent: [u32; 2],
    /// Arrival of the last piece towards A and towards B: no piece overtakes it.
    last_arrival: [Instant; 2],
    /// Pieces that wait until the cable is mended, with the side that they go to.
    held: Vec<(Side, Delivery)>,
    /// When the first of them began to wait.
    held_since: Instant,
    /// The sides that closed it; they get no more of it.
    ended: [bool; 2],
}

impl Stream {
    const fn new(id: StreamId, asked: (Side, Attempt)) -> Self {
        let never = Instant::ZERO;
        Self {
            id,
            asked,
            connected: false,
            between: None,
            sent: [0; 2],
            last_arrival: [never; 2],
            held: Vec::new(),
            held_since: never,
            ended: [false; 2],
        }
    }

    const fn last_arrival(&mut self, to: Side) -> &mut Instant {
        let [a, b] = &mut self.last_arrival;
        match to {
            Side::A => a,
            Side::B => b,
        }
    }

    const fn sent(&mut self, by: Side) -> &mut u32 {
        let [a, b] = &mut self.sent;
        match by {
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

    /// Draws how many of `left` bytes the next piece has: one byte, a segment or all of them.
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
            StreamRequest::Connect { to, attempt } => self.connect(from, to, attempt),
            StreamRequest::Close(id) => {
                if let Some(stream) = self.streams.get(id) {
                    *stream.ended(from) = true;
                    self.push_stream(from, id, Delivery::Closed(id));
                }
            }
        }
    }

    fn connect(&mut self, from: Side, to: SocketAddrV4, attempt: Attempt) {
        let id = StreamId(self.streams.next_id);
        self.streams.next_id = self.streams.next_id.wrapping_add(1);
        let listens = match from {
            Side::A => self.b.listen_port(),
            Side::B => self.a.listen_port(),
        };
        let source = self.station(from).address;
        let answers = self.station(from.other()).address == Some(*to.ip());
        self.streams.open.push(Stream::new(id, (from, attempt)));
        let Some(source) = source.filter(|_| answers) else {
            // No host is there to refuse it, so the attempt times out.
            return self.in_flight.push(self.now + TIMEOUT, from, Delivery::Closed(id));
        };
        if listens == Some(to.port()) {
            let peer = self.name_stream(from, id, source, to);
            self.push_stream(from, id, Delivery::Opened(id, peer));
            // The request takes one delay to the peer, and the answer one delay back.
            if let Some(stream) = self.streams.get(id) {
                *stream.last_arrival(from) = *stream.last_arrival(from.other());
            }
            self.push_stream(from.other(), id, Delivery::Opened(id, to));
        } else {
            self.name_stream(from, id, source, to);
            self.tap_stream(self.now, from, id, Segment::Connect, LinkEffect::default(), &[]);
            self.push_stream(from.other(), id, Delivery::Closed(id));
        }
    }

    /// Records the addresses of a connection, and returns the one that the connecting side uses.
    fn name_stream(&mut self, from: Side, id: StreamId, source: Ipv4Addr, to: SocketAddrV4) -> SocketAddrV4 {
        let peer = SocketAddrV4::new(source, EPHEMERAL_PORT + (id.0 % EPHEMERAL_PORTS) as u16);
        if let Some(stream) = self.streams.get(id) {
            stream.between = Some((from, peer, to));
        }
        peer
    }

    pub(super) fn send_stream(&mut self, from: Side, id: StreamId, len: usize) {
        if !self.wants(from, Port::Stream(id)) {
            return;
        }
        let mut start = 0;
        while start < len {
            let end = start + self.streams.piece(len - start);
            let dscp = self.dscp(from, Port::Stream(id));
            let Some(stream) = self.streams.get(id) else { return };
            let offset = *stream.sent(from);
            *stream.sent(from) = offset.wrapping_add((end - start) as u32);
            let Some(carrier) = stream.carrier(from, Segment::Data { offset }) else { return };
            let label = Label { carrier, dscp, effect: LinkEffect::default() };
            let (buf, len) = (holding(self.spare_bufs.pop(), self.buf.get(start..end)), end - start);
            let delivery = Delivery::Frame { port: Port::Stream(id), peer: None, label, buf, len };
            self.push_stream(from, id, delivery);
            start = end;
        }
    }

    /// Sends a piece of a stream, behind all earlier ones.
    fn push_stream(&mut self, from: Side, id: StreamId, delivery: Delivery) {
        let (now, to) = (self.now, from.other());
        let alive = self.station(to).alive;
        let mut delivery = delivery;
        let len = if let Delivery::Frame { len, .. } = &delivery { *len } else { 0 };
        let passed = self.station(from).link.pass_stream(now, len, RETRANSMISSION);
        if let Some(segment) = self.segment(from, id, &delivery) {
            let bytes = match &delivery {
                Delivery::Frame { buf, len, .. } => buf.get(..*len).unwrap_or_default(),
                _ => &[],
            };
            for loss in 0..passed.map_or(1, |passed| passed.losses) {
                let effect =
                    LinkEffect { lost: passed.is_some(), cut: passed.is_none(), ..LinkEffect::default() };
                self.tap_stream(now + RETRANSMISSION * loss, from, id, segment, effect, bytes);
            }
            if let Some(SentPiece { losses, flipped_bit, .. }) = passed {
                let effect = LinkEffect { flipped_bit, ..LinkEffect::default() };
                self.tap_stream(now + RETRANSMISSION * losses, from, id, segment, effect, bytes);
            }
        }
        if let (Delivery::Frame { buf, .. }, Some(bit)) =
            (&mut delivery, passed.and_then(|passed| passed.flipped_bit))
        {
            flip(buf, bit);
        }
        let arrival = passed.map(|passed| passed.arrival).filter(|_| alive);
        let Some(stream) = self.streams.get(id) else { return };
        match arrival {
            Some(arrival) if stream.held.iter().all(|(side, _)| *side != to) => {
                let last = stream.last_arrival(to);
                *last = arrival.max(*last);
                self.in_flight.push(*last, to, delivery);
            }
            _ => {
                let first = stream.held.is_empty();
                stream.held.push((to, delivery));
                if first {
                    stream.held_since = now;
                    self.in_flight.push(now + TIMEOUT, to, Delivery::StreamTimeout(id));
                }
            }
        }
    }

    /// Handles a cut: datagrams are lost, pieces of streams wait.
    pub(super) fn hold_streams(&mut self) {
        for InFlight { arrives, to, delivery } in self.in_flight.take() {
            match &delivery {
                Delivery::Frame { port: Port::Stream(id), .. }
                | Delivery::Opened(id, _)
                | Delivery::Closed(id) => self.push_stream(to.other(), *id, delivery),
                Delivery::Frame { .. } => self.station(to.other()).link.lose_in_flight(),
                Delivery::StreamTimeout(_) => self.in_flight.push(arrives, to, delivery),
            }
        }
    }

    /// Handles the mended cable: sends the waiting pieces.
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

    /// Closes all connections of a side whose machine is another one now.
    pub(super) fn close_streams_of(&mut self, side: Side) {
        let open: Vec<_> = self.streams.open.iter().map(|stream| stream.id).collect();
        for id in open {
            if let Some(stream) = self.streams.get(id) {
                *stream.ended(side) = true;
            }
            self.push_stream(side, id, Delivery::Closed(id));
        }
    }

    /// Returns whether `side` still receives frames of `port`.
    pub(super) fn wants(&mut self, side: Side, port: Port) -> bool {
        match port {
            Port::Stream(id) => self.streams.get(id).is_some_and(|stream| !*stream.ended(side)),
            _ => true,
        }
    }

    pub(super) fn deliver_stream(&mut self, side: Side, delivery: Delivery) {
        match delivery {
            Delivery::Frame { .. } => {}
            Delivery::Opened(id, peer) => {
                let Some(stream) = self.streams.get(id) else { return };
                let (connector, attempt) = stream.asked;
                if connector == side {
                    stream.connected = true;
                    self.tap_stream_arrival(side, id, Segment::Accept);
                    self.change_stream(side, id, StreamChange::Connected(attempt));
                } else {
                    self.tap_stream_arrival(side, id, Segment::Connect);
                    self.tap_stream(self.now, side, id, Segment::Accept, LinkEffect::default(), &[]);
                    self.change_stream(side, id, StreamChange::Accepted(peer));
                }
            }
            Delivery::Closed(id) => {
                self.tap_end(side, id);
                self.change_stream(side, id, self.end_of(side, id));
                self.streams.open.retain(|stream| stream.id != id);
            }
            Delivery::StreamTimeout(id) => {
                let waited = |stream: &mut Stream| stream.held_since + TIMEOUT;
                let due = self.streams.get(id).filter(|stream| !stream.held.is_empty()).map(waited);
                if due.is_some_and(|due| due <= self.now) {
                    for side in [Side::A, Side::B] {
                        self.change_stream(side, id, self.end_of(side, id));
                    }
                    self.streams.open.retain(|stream| stream.id != id);
                }
            }
        }
    }

    /// Returns how this side sees the end of a stream.
    fn end_of(&self, side: Side, id: StreamId) -> StreamChange {
        match self.streams.open.iter().find(|stream| stream.id == id) {
            Some(Stream { asked: (connector, attempt), connected: false, .. }) if *connector == side => {
                StreamChange::NotConnected(*attempt)
            }
            _ => StreamChange::Closed,
        }
    }

    fn change_stream(&mut self, side: Side, id: StreamId, change: StreamChange) {
        if !self.station(side).alive || !self.wants(side, Port::Stream(id)) {
            return;
        }
        let is_end = matches!(change, StreamChange::Closed | StreamChange::NotConnected(_));
        let local = self.local_time(side);
        match side {
            Side::A => self.a.handle_stream(local, id, change),
            Side::B => self.b.handle_stream(local, id, change),
        }
        // Bytes of a machine for a connection that is gone are dropped.
        if let Some(stream) = self.streams.get(id).filter(|_| is_end) {
            *stream.ended(side) = true;
        }
        self.poll_machine(side, local);
    }
}
