//! The headers around a payload.
//!
//! | bytes | IPv4 (RFC 791) | UDP (RFC 768) | TCP (RFC 9293) |
//! |---|---|---|---|
//! | 0..4 | version, length, DSCP, total length | ports | ports |
//! | 4..8 | identification, flags and offset | length, checksum | sequence number |
//! | 8..12 | TTL, protocol, checksum | | acknowledgement number |
//! | 12..20 | source, destination | | offset, flags, window, checksum, urgent |

use std::net::{Ipv4Addr, SocketAddrV4};

use machine::ethernet::Mac;

pub(super) const TCP: u8 = 6;
pub(super) const UDP: u8 = 17;

pub(super) const FIN: u8 = 0x01;
pub(super) const SYN: u8 = 0x02;
pub(super) const RST: u8 = 0x04;
pub(super) const PSH: u8 = 0x08;
pub(super) const ACK: u8 = 0x10;

/// Payload of an IP packet in bytes, at an MTU of 1500; a multiple of 8, as fragments need.
const FRAGMENT: usize = 1480;

const ETHER_TYPE_IPV4: u16 = 0x0800;
const DONT_FRAGMENT: u16 = 0x4000;
const MORE_FRAGMENTS: u16 = 0x2000;

/// Window that Linux offers by default.
const WINDOW: u16 = 64_240;
pub(super) const MAXIMUM_SEGMENT: u16 = 1460;

/// Addresses and options of an IP packet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ip {
    pub(super) source_mac: Mac,
    pub(super) peer_mac: Mac,
    pub(super) source: Ipv4Addr,
    pub(super) to: Ipv4Addr,
    pub(super) dscp: u8,
    pub(super) protocol: u8,
}

impl Ip {
    /// Returns the Ethernet frames that carry `payload`: one, or its fragments.
    pub(super) fn packets<'a>(&'a self, payload: &'a [u8]) -> impl Iterator<Item = Vec<u8>> + 'a {
        let whole = payload.len() <= FRAGMENT;
        let last = payload.len().saturating_sub(1) / FRAGMENT;
        // A packet that is not fragmented needs no identification (RFC 6864, section 4.1). Both ends must show the
        // same one.
        let identification = if whole { 0 } else { !sum(payload) };
        payload.chunks(FRAGMENT).enumerate().map(move |(index, part)| {
            let flags = match (whole, index == last) {
                (true, _) => DONT_FRAGMENT,
                (false, true) => 0,
                (false, false) => MORE_FRAGMENTS,
            };
            self.packet(part, identification, flags | (index * FRAGMENT / 8) as u16)
        })
    }

    fn packet(&self, payload: &[u8], identification: u16, flags_and_offset: u16) -> Vec<u8> {
        let mut header = Vec::with_capacity(20);
        header.extend([0x45, self.dscp << 2]);
        header.extend(((20 + payload.len()) as u16).to_be_bytes());
        header.extend(identification.to_be_bytes());
        header.extend(flags_and_offset.to_be_bytes());
        header.extend([if self.to.is_multicast() { 1 } else { 64 }, self.protocol, 0, 0]);
        header.extend(self.source.octets());
        header.extend(self.to.octets());
        let checksum = !sum(&header);
        put_u16(&mut header, 10, checksum);
        let mut packet = Vec::with_capacity(34 + payload.len());
        packet.extend(self.destination().0);
        packet.extend(self.source_mac.0);
        packet.extend(ETHER_TYPE_IPV4.to_be_bytes());
        packet.extend(header);
        packet.extend(payload);
        packet
    }

    fn destination(&self) -> Mac {
        match self.to.octets() {
            [255, 255, 255, 255] => Mac([0xFF; 6]),
            // The lower 23 bits of a group (RFC 1112, section 6.4).
            [_, b, c, d] if self.to.is_multicast() => Mac([0x01, 0x00, 0x5E, b & 0x7F, c, d]),
            _ => self.peer_mac,
        }
    }
}

/// Builds a UDP datagram.
pub(super) fn udp(source: SocketAddrV4, to: SocketAddrV4, payload: &[u8]) -> Vec<u8> {
    let mut datagram = Vec::with_capacity(8 + payload.len());
    datagram.extend(source.port().to_be_bytes());
    datagram.extend(to.port().to_be_bytes());
    datagram.extend(((8 + payload.len()) as u16).to_be_bytes());
    datagram.extend([0, 0]);
    datagram.extend(payload);
    // A checksum of 0 would mean that there is none.
    let checksum = match checksum(source, to, UDP, &datagram) {
        0 => 0xFFFF,
        checksum => checksum,
    };
    put_u16(&mut datagram, 6, checksum);
    datagram
}

/// Header fields that change from segment to segment; sequence numbers count from the SYN of their side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tcp {
    pub(super) sequence: u32,
    pub(super) acknowledged: u32,
    pub(super) flags: u8,
}

impl Tcp {
    pub(super) fn segment(self, source: SocketAddrV4, to: SocketAddrV4, payload: &[u8]) -> Vec<u8> {
        let options: &[u8] = match self.flags & SYN {
            0 => &[],
            // Maximum segment size: kind 2, length 4.
            _ => &[2, 4, MAXIMUM_SEGMENT.to_be_bytes()[0], MAXIMUM_SEGMENT.to_be_bytes()[1]],
        };
        let acknowledged =
            if self.flags & ACK == 0 { 0 } else { initial_sequence(to).wrapping_add(self.acknowledged) };
        let mut segment = Vec::with_capacity(24 + payload.len());
        segment.extend(source.port().to_be_bytes());
        segment.extend(to.port().to_be_bytes());
        segment.extend(initial_sequence(source).wrapping_add(self.sequence).to_be_bytes());
        segment.extend(acknowledged.to_be_bytes());
        segment.extend([((20 + options.len()) as u8 / 4) << 4, self.flags]);
        segment.extend(WINDOW.to_be_bytes());
        segment.extend([0; 4]);
        segment.extend(options);
        segment.extend(payload);
        let checksum = checksum(source, to, TCP, &segment);
        put_u16(&mut segment, 16, checksum);
        segment
    }
}

/// Returns a side's initial sequence number. Any number is allowed; one that depends on the side reveals mistakes.
fn initial_sequence(sender: SocketAddrV4) -> u32 {
    u32::from(*sender.ip()).wrapping_mul(0x9E37_79B9) ^ u32::from(sender.port())
}

/// Returns the checksum of UDP or TCP, including the pseudo header.
fn checksum(source: SocketAddrV4, to: SocketAddrV4, protocol: u8, bytes: &[u8]) -> u16 {
    let mut pseudo = Vec::with_capacity(12 + bytes.len());
    pseudo.extend(source.ip().octets());
    pseudo.extend(to.ip().octets());
    pseudo.extend([0, protocol]);
    pseudo.extend((bytes.len() as u16).to_be_bytes());
    pseudo.extend(bytes);
    !sum(&pseudo)
}

/// Returns the ones' complement sum of RFC 1071.
fn sum(bytes: &[u8]) -> u16 {
    let mut sum = 0_u32;
    for pair in bytes.chunks(2) {
        let high = pair.first().copied().unwrap_or_default();
        let low = pair.get(1).copied().unwrap_or_default();
        sum += u32::from(u16::from_be_bytes([high, low]));
    }
    while sum > 0xFFFF {
        sum = (sum & 0xFFFF) + (sum >> 16);
    }
    sum as u16
}

fn put_u16(bytes: &mut [u8], at: usize, value: u16) {
    if let Some(place) = bytes.get_mut(at..at + 2) {
        place.copy_from_slice(&value.to_be_bytes());
    }
}
