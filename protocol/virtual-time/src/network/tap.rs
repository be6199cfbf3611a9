//! Taps on the cables: see what passes each end, with everything that a capture needs to write a real packet.

use alloc::boxed::Box;
use core::fmt;
use core::net::SocketAddrV4;

use super::Network;
use super::ids::{CableId, NodeId};
use crate::link::LinkEffect;
use crate::side::Side;
use machine::{Instant, InterfaceId, Multihomed, Port};

/// The protocol headers around a machine's frame.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Carrier {
    /// Nothing: the frame begins with its destination's MAC address.
    Ethernet,
    /// The frame is the payload of a datagram.
    Udp {
        /// The sender.
        source: SocketAddrV4,
        /// The receiver.
        to: SocketAddrV4,
    },
    /// The frame, which may be empty, is the payload of a TCP segment.
    Tcp {
        /// The sender.
        source: SocketAddrV4,
        /// The receiver.
        to: SocketAddrV4,
        /// The kind of segment.
        segment: Segment,
    },
}

/// Kinds of TCP segments (RFC 9293, section 3.5). Acknowledgements without payload are left out.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Segment {
    /// SYN: requests a connection.
    Connect,
    /// SYN and ACK: accepts the connection.
    Accept,
    /// RST: refuses the connection.
    Refuse,
    /// Bytes of the stream.
    Data {
        /// Bytes that the sender sent on this connection before.
        offset: u32,
    },
    /// FIN: the sender sends no more.
    Close {
        /// Bytes that the sender sent on this connection.
        offset: u32,
    },
}

/// A frame at one end of a cable, for [`Network::set_tap`].
#[derive(Clone, Copy, Debug)]
pub struct Tapped<'a> {
    /// When it passes, in true time. A segment that is retransmitted is shown at once, with the later time.
    pub at: Instant,
    /// The cable.
    pub cable: CableId,
    /// The end of the cable at which it is seen.
    pub end: Side,
    /// The end that it comes from. At the other end it has arrived.
    pub from: Side,
    /// The headers around the frame.
    pub carrier: Carrier,
    /// The DSCP of its packet, 0 to 63.
    pub dscp: u8,
    /// What the cable does to it.
    pub effect: LinkEffect,
    /// The frame; at the receiver's end as it arrived.
    pub frame: &'a [u8],
}

/// The part of a [`Tapped`] that travels with the frame.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) struct Label {
    pub(super) carrier: Carrier,
    pub(super) dscp: u8,
    pub(super) effect: LinkEffect,
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

impl<M: Multihomed> Network<M> {
    /// Shows every frame on every cable to `tap`, once where it is sent and once where it arrives.
    pub fn set_tap(&mut self, tap: impl FnMut(Tapped<'_>) + 'static) {
        self.tap = Some(Tap(Box::new(tap)));
    }

    pub(super) fn tap_departure(
        &mut self,
        at: Instant,
        (cable, from): (CableId, Side),
        label: Label,
        frame: &[u8],
    ) {
        let Label { carrier, dscp, effect } = label;
        if let Some(tap) = &mut self.tap {
            tap.see(Tapped { at, cable, end: from, from, carrier, dscp, effect, frame });
        }
    }

    pub(super) fn tap_arrival(
        &mut self,
        at: Instant,
        (cable, end): (CableId, Side),
        label: Label,
        frame: &[u8],
    ) {
        let Label { carrier, dscp, effect } = label;
        if let Some(tap) = &mut self.tap {
            tap.see(Tapped { at, cable, end, from: end.other(), carrier, dscp, effect, frame });
        }
    }

    /// Returns the DSCP of what leaves a node by this port; not computed without a tap.
    pub(super) fn dscp(&self, node: NodeId, on: InterfaceId, port: Port) -> u8 {
        match (&self.tap, self.nodes.get(node.0)) {
            (Some(_), Some(node)) => node.machine.dscp(on, port),
            _ => 0,
        }
    }
}
