//! TCP connections between two nodes: bytes in order, in pieces of random sizes.

mod open;
mod segments;

use core::net::{Ipv4Addr, SocketAddrV4};

use super::Network;
use super::ids::{CableId, NicId, NodeId, Plug, SwitchId};
use super::in_flight::{FrameArrival, InFlight, Part, Role, holding};
use super::tap::{Label, Segment};
use crate::link::{LinkEffect, SentPiece, flip};
use crate::side::Side;
use machine::{
    Attempt, Duration, Instant, InterfaceId, Multihomed, Port, Source, StreamChange, StreamId, StreamRequest,
};
pub(super) use open::Streams;
use open::{Stream, StreamEnd};

/// Additional delay of a piece for each time that it is lost: the smallest retransmission timeout of Linux.
const RETRANSMISSION: Duration = Duration::from_millis(200);

/// How long bytes wait for a cut cable before both ends give up the stream.
const TIMEOUT: Duration = Duration::from_secs(3);

/// First ephemeral port of the connecting side; further connections take the next ones (RFC 6335, section 6).
const EPHEMERAL_PORT: u16 = 50_000;
const EPHEMERAL_PORTS: u32 = 10_000;

/// The way of a stream's segments in one direction: the sender's cable, and the one behind the switch if there is one.
#[derive(Clone, Copy, Debug)]
struct StreamWay {
    first: (CableId, Side),
    second: Option<(SwitchId, (CableId, Side))>,
    receiver: NodeId,
}

impl<M: Multihomed> Network<M> {
    pub(super) fn request_stream(&mut self, node: NodeId, on: InterfaceId, request: StreamRequest) {
        let Some(nic) = self.nodes.get(node.0).and_then(|node| node.nic(on)) else { return };
        match request {
            StreamRequest::Connect { to, attempt } => self.connect_stream(StreamEnd { nic, on }, to, attempt),
            StreamRequest::Close(id) => {
                let Some(from) = self.streams.role(id, nic) else { return };
                if let Some(stream) = self.streams.get(id) {
                    *stream.ended(from) = true;
                    self.push_stream(from, id, Part::Closed);
                }
            }
        }
    }

    fn connect_stream(&mut self, from: StreamEnd, to: SocketAddrV4, attempt: Attempt) {
        let source = self.nics.get(from.nic.0).and_then(|nic| nic.address);
        let (asked, listens) = self.asked(from.nic, to);
        let answers = asked.is_some_and(|asked| self.has_address(asked.nic, *to.ip()));
        let id = self.streams.open(from, asked, attempt);
        let Some(source) = source.filter(|_| answers) else {
            // No host is there to refuse it, so the attempt times out.
            let closed = FrameArrival::Part { stream: id, to: Role::Connector, part: Part::Closed };
            return self.in_flight.push(self.now + TIMEOUT, closed);
        };
        let peer = self.name_stream(id, source, to);
        if listens {
            self.push_stream(Role::Connector, id, Part::Opened(peer));
            // The request takes one delay to the peer, and the answer one delay back.
            if let Some(stream) = self.streams.get(id) {
                *stream.last_arrival(Role::Connector) = *stream.last_arrival(Role::Acceptor);
            }
            self.push_stream(Role::Acceptor, id, Part::Opened(to));
        } else {
            self.tap_stream(self.now, Role::Connector, id, Segment::Connect);
            self.push_stream(Role::Acceptor, id, Part::Closed);
        }
    }

    /// Returns which end a request for a connection reaches, and whether a machine listens there.
    fn asked(&self, from: NicId, to: SocketAddrV4) -> (Option<StreamEnd>, bool) {
        let listener = |id: NicId| {
            let nic = self.nics.get(id.0)?;
            let machine = &self.nodes.get(nic.node.0)?.machine;
            nic.serves.iter().copied().find(|on| machine.listen_port(*on) == Some(to.port()))
        };
        let first = |id: NicId| self.nics.get(id.0)?.serves.first().copied();
        let Some((cable, side)) = self.nics.get(from.0).and_then(|nic| nic.cable) else {
            return (None, false);
        };
        let peer = match self.plug(cable, side.other()) {
            Some(Plug::Nic(peer)) => Some(peer),
            _ => {
                let with_address = || self.others(from).filter(|(_, nic)| nic.address == Some(*to.ip()));
                let listens = with_address().find(|(id, _)| listener(*id).is_some());
                listens.or_else(|| with_address().next()).map(|(id, _)| id)
            }
        };
        let end = peer.and_then(|nic| Some(StreamEnd { nic, on: listener(nic).or_else(|| first(nic))? }));
        (end, peer.is_some_and(|peer| listener(peer).is_some()))
    }

    fn has_address(&self, NicId(nic): NicId, address: Ipv4Addr) -> bool {
        self.nics.get(nic).is_some_and(|nic| nic.address == Some(address))
    }

    /// Records the addresses of a connection, and returns the one that the connecting side uses.
    fn name_stream(&mut self, id: StreamId, source: Ipv4Addr, to: SocketAddrV4) -> SocketAddrV4 {
        let peer = SocketAddrV4::new(source, EPHEMERAL_PORT + (id.0 % EPHEMERAL_PORTS) as u16);
        if let Some(stream) = self.streams.get(id) {
            stream.between = Some((peer, to));
        }
        peer
    }

    pub(super) fn send_stream(&mut self, nic: NicId, id: StreamId, len: usize) {
        let Some(from) = self.streams.role(id, nic).filter(|from| self.wants(*from, id)) else { return };
        let mut start = 0;
        while start < len {
            let Some(piece) = self.streams.piece(id, len - start) else { return };
            let end = start + piece;
            let dscp = self.dscp_of(from, id);
            let Some(stream) = self.streams.get(id) else { return };
            let offset = *stream.sent(from);
            *stream.sent(from) = offset.wrapping_add((end - start) as u32);
            let Some(carrier) = stream.carrier(from, Segment::Data { offset }) else { return };
            let label = Label { carrier, dscp, effect: LinkEffect::default() };
            let (buf, len) = (holding(self.spare_bufs.pop(), self.buf.get(start..end)), end - start);
            self.push_stream(from, id, Part::Bytes { label, buf, len });
            start = end;
        }
    }

    /// Returns the way of what an end of a stream sends; `None` if nobody is at the other one.
    fn way(&self, id: StreamId, from: Role) -> Option<StreamWay> {
        let [sender, receiver] = self.streams.find(id)?.ends_from(from);
        let (first, last) = (self.nics.get(sender?.nic.0)?.cable?, self.nics.get(receiver?.nic.0)?);
        let (cable, side) = last.cable?;
        let second = match self.plug(first.0, first.1.other())? {
            Plug::Switch(switch) => Some((switch, (cable, side.other()))),
            Plug::Nic(_) => None,
        };
        Some(StreamWay { first, second, receiver: last.node })
    }

    fn pass_stream(&mut self, (cable, from): (CableId, Side), at: Instant, len: usize) -> Option<SentPiece> {
        self.cables.get_mut(cable.0)?.link(from).pass_stream(at, len, RETRANSMISSION)
    }

    /// Sends a part of a stream, behind all earlier ones.
    fn push_stream(&mut self, from: Role, id: StreamId, mut part: Part) {
        let (now, to) = (self.now, from.other());
        let Some(way) = self.way(id, from) else {
            // The host that would receive it does not exist.
            return self.streams.remove(id);
        };
        let is_alive = self.is_alive(way.receiver);
        let len = if let Part::Bytes { len, .. } = &part { *len } else { 0 };
        let mut passed = self.pass_stream(way.first, now, len);
        self.tap_passed((from, id), &part, way.first, now, passed);
        if let (Some((switch, cable)), Some(first)) = (way.second, passed) {
            let passage = self.switches.get(switch.0).map(|switch| switch.passage_of_segment(len));
            let leaves = first.arrival + passage.unwrap_or_default();
            self.tap_at_switch((from, id), &part, way.first, first.arrival);
            flip_bit(&mut part, first.flipped_bit);
            passed = self.pass_stream(cable, leaves, len);
            self.tap_passed((from, id), &part, cable, leaves, passed);
        }
        flip_bit(&mut part, passed.and_then(|passed| passed.flipped_bit));
        let arrival = passed.map(|passed| passed.arrival).filter(|_| is_alive);
        let Some(stream) = self.streams.get(id) else { return };
        match arrival {
            Some(arrival) if stream.held.iter().all(|(held_for, _)| *held_for != to) => {
                let last = stream.last_arrival(to);
                *last = arrival.max(*last);
                self.in_flight.push(*last, FrameArrival::Part { stream: id, to, part });
            }
            _ => {
                let first = stream.held.is_empty();
                stream.held.push((to, part));
                if first {
                    stream.held_since = now;
                    self.in_flight.push(now + TIMEOUT, FrameArrival::StreamTimeout(id));
                }
            }
        }
    }

    /// Handles the cut of a cable: datagrams on it are lost, parts of streams over it wait.
    pub(super) fn hold_streams(&mut self, cut: CableId) {
        for InFlight { arrives, arrival } in self.in_flight.take() {
            match arrival {
                FrameArrival::Frame { cable, to, frame } if cable == cut => {
                    self.lose_in_flight(cable, to.other());
                    self.spare_bufs.push(frame.buf);
                }
                FrameArrival::Part { stream, to, part } if self.is_by(stream, to.other(), cut) => {
                    self.push_stream(to.other(), stream, part);
                }
                arrival => self.in_flight.push(arrives, arrival),
            }
        }
    }

    /// Returns whether what an end of a stream sends passes a cable.
    fn is_by(&self, id: StreamId, from: Role, cable: CableId) -> bool {
        let Some(StreamWay { first, second, .. }) = self.way(id, from) else { return false };
        first.0 == cable || second.is_some_and(|(_, second)| second.0 == cable)
    }

    /// Handles a mended cable: sends the waiting parts of the streams over it.
    pub(super) fn resume_streams(&mut self, mended: CableId) {
        for id in self.streams.ids() {
            if !self.is_by(id, Role::Connector, mended) {
                continue;
            }
            let held = self.streams.get(id).map(|stream| core::mem::take(&mut stream.held));
            for (to, part) in held.unwrap_or_default() {
                self.push_stream(to.other(), id, part);
            }
        }
    }

    /// Closes all connections of a node whose machine is another one now.
    pub(super) fn close_streams_of(&mut self, node: NodeId) {
        for id in self.streams.ids() {
            for role in [Role::Connector, Role::Acceptor] {
                let end = self.streams.find(id).and_then(|stream| stream.end(role));
                let is_of = end.and_then(|end| self.nics.get(end.nic.0)).is_some_and(|nic| nic.node == node);
                if is_of {
                    if let Some(stream) = self.streams.get(id) {
                        *stream.ended(role) = true;
                    }
                    self.push_stream(role, id, Part::Closed);
                }
            }
        }
    }

    /// Returns whether an end still receives what comes by a stream.
    fn wants(&mut self, role: Role, id: StreamId) -> bool {
        self.streams.get(id).is_some_and(|stream| !*stream.ended(role))
    }

    pub(super) fn deliver_part(&mut self, id: StreamId, to: Role, part: Part) {
        match part {
            Part::Bytes { label, buf, len } => {
                self.receive_piece(id, to, label, buf.get(..len).unwrap_or_default());
                self.spare_bufs.push(buf);
            }
            Part::Opened(peer) => {
                let Some(stream) = self.streams.get(id) else { return };
                let attempt = stream.attempt;
                if to == Role::Connector {
                    stream.connected = true;
                    self.tap_stream_arrival(to, id, Segment::Accept);
                    self.change_stream(to, id, StreamChange::Connected(attempt));
                } else {
                    self.tap_stream_arrival(to, id, Segment::Connect);
                    self.tap_stream(self.now, to, id, Segment::Accept);
                    self.change_stream(to, id, StreamChange::Accepted(peer));
                }
            }
            Part::Closed => {
                self.tap_end(to, id);
                self.change_stream(to, id, self.end_of(to, id));
                self.streams.remove(id);
            }
        }
    }

    fn receive_piece(&mut self, id: StreamId, to: Role, label: Label, bytes: &[u8]) {
        let Some(end) = self.streams.find(id).and_then(|stream| stream.end(to)) else { return };
        let Some(nic) = self.nics.get(end.nic.0) else { return };
        let (node, cable) = (nic.node, nic.cable);
        if let Some(cable) = cable {
            self.tap_arrival(self.now, cable, label, bytes);
        }
        if self.is_alive(node) && self.wants(to, id) {
            let local = self.read_clock(node);
            if let Some(node) = self.nodes.get_mut(node.0) {
                let from = Source { port: Port::Stream(id), peer: None };
                node.machine.handle_frame(local, end.on, from, bytes);
            }
            self.poll_machine(node, local);
        }
    }

    /// Ends a stream whose parts have waited too long for a cut cable.
    pub(super) fn give_up_stream(&mut self, id: StreamId) {
        let waited = |stream: &mut Stream| stream.held_since + TIMEOUT;
        let due = self.streams.get(id).filter(|stream| !stream.held.is_empty()).map(waited);
        if due.is_some_and(|due| due <= self.now) {
            let roles = self.streams.find(id).map(Stream::roles_by_age).unwrap_or_default();
            for role in roles {
                self.change_stream(role, id, self.end_of(role, id));
            }
            self.streams.remove(id);
        }
    }

    /// Returns how an end sees the end of a stream.
    fn end_of(&self, role: Role, id: StreamId) -> StreamChange {
        match self.streams.find(id) {
            Some(Stream { attempt, connected: false, .. }) if role == Role::Connector => {
                StreamChange::NotConnected(*attempt)
            }
            _ => StreamChange::Closed,
        }
    }

    fn change_stream(&mut self, role: Role, id: StreamId, change: StreamChange) {
        let end = self.streams.find(id).and_then(|stream| stream.end(role));
        let Some(StreamEnd { nic, on }) = end else { return };
        let Some(id_of_node) = self.nics.get(nic.0).map(|nic| nic.node) else { return };
        if !self.is_alive(id_of_node) || !self.wants(role, id) {
            return;
        }
        let is_end = matches!(change, StreamChange::Closed | StreamChange::NotConnected(_));
        let local = self.read_clock(id_of_node);
        if let Some(node) = self.nodes.get_mut(id_of_node.0) {
            node.machine.handle_stream(local, on, id, change);
        }
        // Bytes of a machine for a connection that is gone are dropped.
        if let Some(stream) = self.streams.get(id).filter(|_| is_end) {
            *stream.ended(role) = true;
        }
        self.poll_machine(id_of_node, local);
    }
}

fn flip_bit(part: &mut Part, bit: Option<u32>) {
    if let (Part::Bytes { buf, .. }, Some(bit)) = (part, bit) {
        flip(buf, bit);
    }
}
