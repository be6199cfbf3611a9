//! A frame down to what the buses use: PROFINET's EtherType, UDP datagrams, TCP segments.
//!
//! ```text
//! Ethernet 0..6 destination  6..12 source  12..14 EtherType; 0x8100 and 0x88A8 announce a tag of 4 bytes
//! IPv4     0 version, words of the header  2..4 total length  6..8 flags, fragment  9 protocol  12..16 source  16..20 destination
//! UDP      0..2 source  2..4 destination  4..6 length  8.. data
//! TCP      0..2 source  2..4 destination  12 words of the header, high four bits
//! ```

use std::net::{Ipv4Addr, SocketAddrV4};

use machine::ethernet::Mac;
use machine::wire::{BigEndian, Reader, Truncated};

const ETHER_TYPE_IPV4: u16 = 0x0800;
const ETHER_TYPE_PROFINET: u16 = 0x8892;
/// Tags of IEEE 802.1Q and 802.1ad. Mirror ports may add a second one.
const TAGS: [u16; 2] = [0x8100, 0x88A8];
const MAX_TAGS: usize = 4;

const PROTOCOL_TCP: u8 = 6;
const PROTOCOL_UDP: u8 = 17;

/// More fragments, or an offset other than 0 (RFC 791).
const FRAGMENT: u16 = 0x3FFF;

/// A frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct EthernetPacket<'a> {
    pub(crate) source: Mac,
    pub(crate) destination: Mac,
    pub(crate) payload: Payload<'a>,
}

/// Content of a frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Payload<'a> {
    /// A PROFINET frame from its FrameID on, with padding.
    Profinet(&'a [u8]),
    /// A datagram.
    Udp { from: SocketAddrV4, to: SocketAddrV4, data: &'a [u8] },
    /// A piece of a stream.
    Tcp { from: SocketAddrV4, to: SocketAddrV4, data: &'a [u8] },
    /// The names of a neighbour, LLDP.
    Lldp(&'a [u8]),
    /// Addresses of a station, ARP.
    Arp(&'a [u8]),
    /// Anything else, fragments of datagrams included.
    Other,
}

impl<'a> EthernetPacket<'a> {
    /// Parses a frame.
    pub(crate) fn parse(frame: &'a [u8]) -> Result<Self, Truncated> {
        let mut reader = Reader::<BigEndian>::new(frame);
        let (destination, source) = (Mac(reader.array()?), Mac(reader.array()?));
        let mut ether_type = reader.u16()?;
        for _ in 0..MAX_TAGS {
            if TAGS.contains(&ether_type) {
                reader.skip(2)?;
                ether_type = reader.u16()?;
            }
        }
        let payload = match ether_type {
            ETHER_TYPE_PROFINET => Payload::Profinet(reader.rest()),
            profinet::lldp::ETHER_TYPE => Payload::Lldp(reader.rest()),
            machine::arp::ETHER_TYPE => Payload::Arp(reader.rest()),
            ETHER_TYPE_IPV4 => parse_ipv4(reader.rest())?,
            _ => Payload::Other,
        };
        Ok(Self { source, destination, payload })
    }
}

fn parse_ipv4(packet: &[u8]) -> Result<Payload<'_>, Truncated> {
    let mut reader = Reader::<BigEndian>::new(packet);
    let first = reader.u8()?;
    reader.skip(1)?;
    let length = usize::from(reader.u16()?);
    reader.skip(2)?;
    let fragment = reader.u16()? & FRAGMENT;
    reader.skip(1)?;
    let protocol = reader.u8()?;
    reader.skip(2)?;
    let (source, destination) = (Ipv4Addr::from_bits(reader.u32()?), Ipv4Addr::from_bits(reader.u32()?));
    let header = usize::from(first & 0x0F) * 4;
    if first >> 4 != 4 || header < 20 || fragment != 0 {
        return Ok(Payload::Other);
    }
    // Short packets are padded, and a snapshot may lack their end.
    let end = length.min(packet.len());
    let mut reader = Reader::<BigEndian>::new(packet.get(header..end).unwrap_or_default());
    Ok(match protocol {
        PROTOCOL_UDP => {
            let (from, to) = (reader.u16()?, reader.u16()?);
            let length = usize::from(reader.u16()?).saturating_sub(8);
            reader.skip(2)?;
            let data = reader.rest();
            let data = data.get(..length).unwrap_or(data);
            Payload::Udp {
                from: SocketAddrV4::new(source, from),
                to: SocketAddrV4::new(destination, to),
                data,
            }
        }
        PROTOCOL_TCP => {
            let (from, to) = (reader.u16()?, reader.u16()?);
            reader.skip(8)?;
            let header = usize::from(reader.u8()? >> 4) * 4;
            // Ports, numbers and the length itself were read.
            reader.skip(header.saturating_sub(13))?;
            let data = reader.rest();
            Payload::Tcp {
                from: SocketAddrV4::new(source, from),
                to: SocketAddrV4::new(destination, to),
                data,
            }
        }
        _ => Payload::Other,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(tags: &[u16], ether_type: u16, rest: &[u8]) -> Vec<u8> {
        let mut frame = vec![2, 0, 0, 0, 0, 1, 2, 0, 0, 0, 0, 2];
        for tag in tags {
            frame.extend(tag.to_be_bytes());
            frame.extend([0xC0, 0]);
        }
        frame.extend(ether_type.to_be_bytes());
        frame.extend(rest);
        frame
    }

    #[test]
    fn tags_of_switches_and_mirror_ports_are_taken_off() {
        for tags in [&[][..], &[0x8100], &[0x88A8, 0x8100]] {
            let frame = frame(tags, 0x8892, b"data");
            let packet = EthernetPacket::parse(&frame).unwrap();
            assert_eq!((packet.source.0[5], packet.payload), (2, Payload::Profinet(b"data")));
        }
    }

    #[test]
    fn a_datagram_ends_where_its_length_says_and_a_fragment_is_not_one() {
        let datagram = |fragment: u8, length: u8| {
            let ip = [0x45, 0, 0, 32, 0, 0, fragment, 0, 64, 17, 0, 0, 10, 0, 0, 1, 10, 0, 0, 2];
            let udp = [0x88, 0x92, 0x88, 0x92, 0, length, 0, 0, 1, 2, 3, 4, 9, 9];
            frame(&[], 0x0800, &[&ip[..], &udp].concat())
        };
        let (from, to) = ("10.0.0.1:34962".parse().unwrap(), "10.0.0.2:34962".parse().unwrap());
        let whole = datagram(0x40, 12);
        assert_eq!(
            EthernetPacket::parse(&whole).unwrap().payload,
            Payload::Udp { from, to, data: &[1, 2, 3, 4] }
        );
        assert_eq!(EthernetPacket::parse(&datagram(0x20, 12)).unwrap().payload, Payload::Other);
        for cut in 0..whole.len() {
            let _ = EthernetPacket::parse(&whole[..cut]);
        }
    }
}
