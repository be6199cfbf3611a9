//! The TCP segments of a stream, as the tap is shown them where they are sent and where they arrive.

use super::Stream;
use crate::link::LinkEffect;
use crate::pair::Pair;
use crate::pair::in_flight::Delivery;
use crate::pair::tap::{Carrier, Label, Segment};
use crate::side::Side;
use machine::{Instant, Machine, Port, StreamId};

impl Stream {
    /// Returns the headers around a segment that `from` sends.
    pub(super) fn carrier(&self, from: Side, segment: Segment) -> Option<Carrier> {
        let (connector, source, to) = self.between?;
        Some(match from == connector {
            true => Carrier::Tcp { source, to, segment },
            false => Carrier::Tcp { source: to, to: source, segment },
        })
    }
}

impl<A: Machine, B: Machine> Pair<A, B> {
    /// Shows the tap a segment where it is sent.
    pub(super) fn tap_stream(
        &mut self,
        at: Instant,
        from: Side,
        id: StreamId,
        segment: Segment,
        effect: LinkEffect,
        bytes: &[u8],
    ) {
        let Some(carrier) = self.streams.get(id).and_then(|stream| stream.carrier(from, segment)) else {
            return;
        };
        let label = Label { carrier, dscp: self.dscp(from, Port::Stream(id)), effect };
        self.tap_departure(at, from, label, bytes);
    }

    /// Shows the tap a segment without bytes where it arrives.
    pub(super) fn tap_stream_arrival(&mut self, end: Side, id: StreamId, segment: Segment) {
        let from = end.other();
        let Some(carrier) = self.streams.get(id).and_then(|stream| stream.carrier(from, segment)) else {
            return;
        };
        let dscp = self.dscp(from, Port::Stream(id));
        self.tap_arrival(end, Label { carrier, dscp, effect: LinkEffect::default() }, &[]);
    }

    /// Returns the segment of a delivery, except for the answer to a connection request, which is sent when the
    /// request arrives.
    pub(super) fn segment(&mut self, from: Side, id: StreamId, delivery: &Delivery) -> Option<Segment> {
        let stream = self.streams.get(id)?;
        let (connector, ..) = stream.between?;
        match delivery {
            Delivery::Frame { label: Label { carrier: Carrier::Tcp { segment, .. }, .. }, .. } => {
                Some(*segment)
            }
            Delivery::Opened(..) => (from == connector).then_some(Segment::Connect),
            // A refusal, unless the side has closed an open connection.
            Delivery::Closed(_) => {
                (*stream.ended(from)).then(|| Segment::Close { offset: *stream.sent(from) })
            }
            Delivery::Frame { .. } | Delivery::StreamTimeout(_) => None,
        }
    }

    /// Shows the end of a stream as it arrives, or the refusal to open it.
    pub(super) fn tap_end(&mut self, side: Side, id: StreamId) {
        let from = side.other();
        let Some(stream) = self.streams.get(id) else { return };
        if *stream.ended(from) {
            let offset = *stream.sent(from);
            self.tap_stream_arrival(side, id, Segment::Close { offset });
        } else if stream.between.is_some() {
            self.tap_stream_arrival(from, id, Segment::Connect);
            self.tap_stream(self.now, from, id, Segment::Refuse, LinkEffect::default(), &[]);
            self.tap_stream_arrival(side, id, Segment::Refuse);
        }
    }
}
