//! Who listens in: what passes each end of the cable, with all that a capture needs to write a real packet.

use alloc::boxed::Box;
use core::fmt;
use core::net::SocketAddrV4;

use super::{Fate, Pair, Side};
use machine::{Instant, Machine, Port};

/// What a network wraps around a frame of a machine.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Carrier {
    /// Nothing: the frame begins with its destination's MAC address.
    Ethernet,
    /// The frame is the payload of a datagram.
    Udp {
        /// Who sent it.
        source: SocketAddrV4,
        /// Whom it is for.
        to: SocketAddrV4,
    },
    /// The frame, which may be empty, is the payload of a segment.
    Tcp {
        /// Who sent it.
        source: SocketAddrV4,
        /// Whom it is for.
        to: SocketAddrV4,
        /// What the segment is for.
        segment: Segment,
    },
}

/// What a TCP segment is for (RFC 9293, section 3.5). Acknowledgements without payload are not among them.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Segment {
    /// SYN: a connection is wanted.
    Connect,
    /// SYN and ACK: it is accepted.
    Accept,
    /// RST: it is not.
    Refuse,
    /// Bytes of the stream.
    Data {
        /// How many bytes the sender sent on this connection before.
        offset: u32,
    },
    /// FIN: the sender has no more to say.
    Close {
        /// How many bytes the sender sent on this connection.
        offset: u32,
    },
}

/// What passes one end of the cable, as a [`Pair::set_tap`] sees it.
#[derive(Clone, Copy, Debug)]
pub struct Tapped<'a> {
    /// When, in true time. A segment that has to be sent again is announced at once, with the later time.
    pub at: Instant,
    /// At whose end of the cable.
    pub end: Side,
    /// Who sent it; at the other end it has arrived.
    pub from: Side,
    /// What is around the frame.
    pub carrier: Carrier,
    /// The DSCP of its packet, 0 to 63.
    pub dscp: u8,
    /// What the cable does to it on its way.
    pub fate: Fate,
    /// The frame, at the receiver's end as it arrived.
    pub frame: &'a [u8],
}

/// What of a [`Tapped`] travels with the frame.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) struct Label {
    pub(super) carrier: Carrier,
    pub(super) dscp: u8,
    pub(super) fate: Fate,
}

pub(super) struct Tap(Box<dyn FnMut(Tapped<'_>)>);

impl Tap {
    pub(super) fn see(&mut self, tapped: Tapped<'_>) {
        (self.0)(tapped);
    }
}

impl fmt::Debug for Tap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Tap")
    }
}

impl<A: Machine, B: Machine> Pair<A, B> {
    /// Shows every frame to `tap`, once when it leaves and once when it arrives.
    pub fn set_tap(&mut self, tap: impl FnMut(Tapped<'_>) + 'static) {
        self.tap = Some(Tap(Box::new(tap)));
    }

    pub(super) fn tap_departure(&mut self, at: Instant, from: Side, label: Label, frame: &[u8]) {
        let Label { carrier, dscp, fate } = label;
        if let Some(tap) = &mut self.tap {
            tap.see(Tapped { at, end: from, from, carrier, dscp, fate, frame });
        }
    }

    pub(super) fn tap_arrival(&mut self, end: Side, label: Label, frame: &[u8]) {
        let Label { carrier, dscp, fate } = label;
        if let Some(tap) = &mut self.tap {
            tap.see(Tapped { at: self.now, end, from: end.other(), carrier, dscp, fate, frame });
        }
    }

    /// The DSCP of what leaves by this port; nobody asks where nobody listens in.
    pub(super) fn dscp(&self, from: Side, port: Port) -> u8 {
        match (&self.tap, from) {
            (None, _) => 0,
            (Some(_), Side::A) => self.a.dscp(port),
            (Some(_), Side::B) => self.b.dscp(port),
        }
    }
}
