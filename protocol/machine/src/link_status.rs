//! State and counters of a station's Ethernet interface. A machine gets them from its owner, who can ask the operating system.

use core::net::Ipv4Addr;

/// Cable of an interface.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum Medium {
    /// Not known.
    #[default]
    Unknown,
    /// Twisted pair.
    TwistedPair,
    /// Optical fibre.
    Fibre,
}

/// State of an interface.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct LinkStatus {
    /// Carrier: something is at the other end of the cable.
    pub is_up: bool,
    /// Speed in Mbit/s; `None` if the interface does not know it.
    pub speed_mbit_s: Option<u32>,
    /// Full duplex: it sends and receives at the same time; `None` if the interface does not know it.
    pub is_full_duplex: Option<bool>,
    /// Successful negotiation of the speed between both ends; `None` if the interface does not know it.
    pub is_negotiated: Option<bool>,
    /// The cable.
    pub medium: Medium,
    /// Gateway to other networks through it, if there is one.
    pub gateway: Option<Ipv4Addr>,
    /// Its counters since it exists.
    pub counters: LinkCounters,
}

/// Counters of an interface, with the names of RFC 2863 and RFC 3635.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct LinkCounters {
    /// Bytes received.
    pub in_octets: u64,
    /// Frames received for this station alone.
    pub in_unicast: u64,
    /// Frames received for a group.
    pub in_multicast: u64,
    /// Frames received for all, where they are counted apart from unicast.
    pub in_broadcast: u64,
    /// Good frames received and dropped.
    pub in_discards: u64,
    /// Bad frames received.
    pub in_errors: u64,
    /// Frames received that nobody takes.
    pub in_unknown_protocols: u64,
    /// Bytes sent.
    pub out_octets: u64,
    /// Frames sent to one station.
    pub out_unicast: u64,
    /// Frames sent to a group, where they are counted apart from unicast.
    pub out_multicast: u64,
    /// Frames sent to all, where they are counted apart from unicast.
    pub out_broadcast: u64,
    /// Frames dropped instead of sent.
    pub out_discards: u64,
    /// Frames that could not be sent for an error.
    pub out_errors: u64,
    /// Frames that are no whole number of bytes.
    pub alignment_errors: u64,
    /// Frames with a wrong check sequence.
    pub fcs_errors: u64,
    /// Frames sent after one collision; all collisions where they are not counted by frame.
    pub single_collisions: u64,
    /// Frames sent after more than one collision.
    pub multiple_collisions: u64,
    /// Errors of the signal quality test.
    pub sqe_test_errors: u64,
    /// Frames whose sending was deferred.
    pub deferred: u64,
    /// Collisions after the first 512 bits.
    pub late_collisions: u64,
    /// Frames dropped after too many collisions.
    pub excessive_collisions: u64,
    /// Frames lost within the sender.
    pub transmit_errors: u64,
    /// Losses of the carrier while sending.
    pub carrier_sense_errors: u64,
    /// Frames that are too long.
    pub too_long: u64,
    /// Frames lost within the receiver.
    pub receive_errors: u64,
    /// Symbols that are not valid.
    pub symbol_errors: u64,
}
