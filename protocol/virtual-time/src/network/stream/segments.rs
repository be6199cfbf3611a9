//! The TCP segments of a stream, as the tap is shown them where they are sent and where they arrive.

use super::{Network, RETRANSMISSION, Stream};
use crate::link::{LinkEffect, SentPiece};
use crate::network::ids::CableId;
use crate::network::in_flight::{Part, Role};
use crate::network::tap::{Carrier, Label, Segment};
use crate::side::Side;
use machine::{Instant, Multihomed, Port, StreamId};

impl Stream {
    /// Returns the headers around a segment that `from` sends.
    pub(super) fn carrier(&self, from: Role, segment: Segment) -> Option<Carrier> {
        let (source, to) = self.between?;
        Some(match from {
            Role::Connector => Carrier::Tcp { source, to, segment },
            Role::Acceptor => Carrier::Tcp { source: to, to: source, segment },
        })
    }
}

impl<M: Multihomed> Network<M> {
    /// Shows the tap a segment without faults where it is sent and, if there is a switch, on both sides of it; after the
    /// delays of the cable and the switch, without jitter.
    pub(super) fn tap_stream(&mut self, at: Instant, from: Role, id: StreamId, segment: Segment) {
        let Some(label) = self.label(from, id, segment) else { return };
        let Some(way) = self.way(id, from) else { return };
        self.tap_departure(at, way.first, label, &[]);
        if let Some((switch, cable)) = way.second {
            let ((first, side), passage) = (way.first, self.switches.get(switch.0));
            let passage = passage.map(|switch| switch.passage_of_segment(0)).unwrap_or_default();
            let arrives = at + self.delay(way.first);
            self.tap_arrival(arrives, (first, side.other()), label, &[]);
            self.tap_departure(arrives + passage, cable, label, &[]);
        }
    }

    fn label(&self, from: Role, id: StreamId, segment: Segment) -> Option<Label> {
        let carrier = self.streams.find(id)?.carrier(from, segment)?;
        Some(Label { carrier, dscp: self.dscp_of(from, id), effect: LinkEffect::default() })
    }

    /// Returns the DSCP of what an end of a stream sends.
    pub(super) fn dscp_of(&self, from: Role, id: StreamId) -> u8 {
        let end = self.streams.find(id).and_then(|stream| stream.end(from));
        let of = end.and_then(|end| Some((self.nics.get(end.nic.0)?.node, end.on)));
        of.map_or(0, |(node, on)| self.dscp(node, on, Port::Stream(id)))
    }

    /// Shows the tap a part of a stream where it is put into a cable, once for each time that it is lost and once as it passes.
    pub(super) fn tap_passed(
        &mut self,
        (from, id): (Role, StreamId),
        part: &Part,
        cable: (CableId, Side),
        at: Instant,
        passed: Option<SentPiece>,
    ) {
        let Some(segment) = self.segment(from, id, part) else { return };
        let Some(label) = self.label(from, id, segment) else { return };
        for loss in 0..passed.map_or(1, |passed| passed.losses) {
            let effect =
                LinkEffect { lost: passed.is_some(), cut: passed.is_none(), ..LinkEffect::default() };
            self.tap_departure(at + RETRANSMISSION * loss, cable, Label { effect, ..label }, bytes(part));
        }
        if let Some(SentPiece { losses, flipped_bit, .. }) = passed {
            let effect = LinkEffect { flipped_bit, ..LinkEffect::default() };
            self.tap_departure(at + RETRANSMISSION * losses, cable, Label { effect, ..label }, bytes(part));
        }
    }

    /// Shows the tap a part of a stream where it arrives at a switch.
    pub(super) fn tap_at_switch(
        &mut self,
        (from, id): (Role, StreamId),
        part: &Part,
        (cable, side): (CableId, Side),
        at: Instant,
    ) {
        let Some(segment) = self.segment(from, id, part) else { return };
        let Some(label) = self.label(from, id, segment) else { return };
        self.tap_arrival(at, (cable, side.other()), label, bytes(part));
    }

    /// Shows the tap a segment without bytes where it arrives.
    pub(super) fn tap_stream_arrival(&mut self, end: Role, id: StreamId, segment: Segment) {
        let Some(label) = self.label(end.other(), id, segment) else { return };
        let cable = self.streams.find(id).and_then(|stream| self.nics.get(stream.end(end)?.nic.0)?.cable);
        if let Some(cable) = cable {
            self.tap_arrival(self.now, cable, label, &[]);
        }
    }

    /// Returns the segment of a part, except for the answer to a connection request, which is sent when the
    /// request arrives.
    fn segment(&mut self, from: Role, id: StreamId, part: &Part) -> Option<Segment> {
        let stream = self.streams.get(id)?;
        stream.between?;
        match part {
            Part::Bytes { label: Label { carrier: Carrier::Tcp { segment, .. }, .. }, .. } => Some(*segment),
            Part::Opened(..) => (from == Role::Connector).then_some(Segment::Connect),
            // A refusal, unless the end has closed an open connection.
            Part::Closed => (*stream.ended(from)).then(|| Segment::Close { offset: *stream.sent(from) }),
            Part::Bytes { .. } => None,
        }
    }

    /// Shows the end of a stream as it arrives, or the refusal to open it.
    pub(super) fn tap_end(&mut self, to: Role, id: StreamId) {
        let from = to.other();
        let Some(stream) = self.streams.get(id) else { return };
        if *stream.ended(from) {
            let offset = *stream.sent(from);
            self.tap_stream_arrival(to, id, Segment::Close { offset });
        } else if stream.between.is_some() {
            self.tap_stream_arrival(from, id, Segment::Connect);
            self.tap_stream(self.now, from, id, Segment::Refuse);
            self.tap_stream_arrival(to, id, Segment::Refuse);
        }
    }
}

fn bytes(part: &Part) -> &[u8] {
    match part {
        Part::Bytes { buf, len, .. } => buf.get(..*len).unwrap_or_default(),
        _ => &[],
    }
}
