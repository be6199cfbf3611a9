//! ARP for IPv4 on Ethernet (RFC 826), and address conflict detection with it (RFC 5227).
//!
//! ```text
//! 0..2    hardware type          1, Ethernet
//! 2..4    protocol type          0x0800, IPv4
//! 4       hardware length        6
//! 5       protocol length        4
//! 6..8    operation              1 request, 2 reply
//! 8..14   sender hardware address
//! 14..18  sender protocol address
//! 18..24  target hardware address, ignored in a request
//! 24..28  target protocol address
//! ```
//!
//! | packet | operation | sender address | target address |
//! |---|---|---|---|
//! | probe (RFC 5227, 2.1.1) | request | 0.0.0.0 | the address in question |
//! | announcement (2.3) | request | the sender's own | the same |
//! | question | request | the sender's own | the address in question |
//! | answer | reply | the address in question | the asker's own, 0.0.0.0 after a probe |
//!
//! The host answers requests for its own address: the kernel in real time, the virtual network in virtual time. A machine
//! only asks, announces and listens.

mod address_claim;
mod holder_search;
mod holders;

pub use address_claim::{AddressClaim, AddressConflict, ClaimEvent};
pub use holder_search::HolderSearch;
pub use holders::{Holders, MOST_HOLDERS};

use core::net::Ipv4Addr;

use crate::PortRequest;
use crate::ethernet::{EthernetHeader, Mac};
use crate::time::Duration;
use crate::wire::{BigEndian, Overflow, Reader, Truncated, Writer};

/// EtherType of ARP (RFC 826).
pub const ETHER_TYPE: u16 = 0x0806;

/// The port on which a machine receives ARP. It needs `CAP_NET_RAW` on Linux.
pub const ETHERNET: PortRequest = PortRequest::Ethernet { ether_type: ETHER_TYPE, groups: &[] };

/// Probes or questions about one address (RFC 5227, 1.1, PROBE_NUM).
pub const PROBES: u8 = 3;

/// Time from one probe to the next, and after the last one until the address counts as free. RFC 5227 waits seconds (1.1,
/// PROBE_MAX and ANNOUNCE_WAIT), since its hosts may join through slow bridges; a fieldbus starts within one second.
pub const PROBE_INTERVAL: Duration = Duration::from_millis(20);

/// Time from the first probe until an address counts as free.
pub const PROBE_TIME: Duration = Duration::from_millis(60);

/// Hardware type of Ethernet.
const HARDWARE_ETHERNET: u16 = 1;
/// Protocol type of IPv4: its EtherType.
const PROTOCOL_IPV4: u16 = 0x0800;
/// The Ethernet address of all stations.
const BROADCAST: Mac = Mac([0xFF; 6]);

/// Operation of an ARP packet.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Operation {
    /// Asks for the hardware address of the target.
    Request,
    /// Gives the hardware address of the sender.
    Reply,
    /// Any other one, such as those of RARP.
    Unknown(u16),
}

impl From<u16> for Operation {
    fn from(code: u16) -> Self {
        match code {
            1 => Self::Request,
            2 => Self::Reply,
            code => Self::Unknown(code),
        }
    }
}

impl From<Operation> for u16 {
    fn from(operation: Operation) -> Self {
        match operation {
            Operation::Request => 1,
            Operation::Reply => 2,
            Operation::Unknown(code) => code,
        }
    }
}

/// Why an ARP packet cannot be used.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum ArpError {
    /// It is cut.
    #[error(transparent)]
    Truncated(#[from] Truncated),
    /// It is about other addresses than those of IPv4 on Ethernet.
    #[error("ARP for hardware type {hardware} and protocol 0x{protocol:04X}, not for IPv4 on Ethernet")]
    OtherNetwork {
        /// The hardware type.
        hardware: u16,
        /// The protocol type.
        protocol: u16,
    },
    /// The lengths are not those of IPv4 and Ethernet addresses.
    #[error("ARP addresses have {hardware} and {protocol} bytes, not 6 and 4")]
    Lengths {
        /// Bytes of a hardware address.
        hardware: u8,
        /// Bytes of a protocol address.
        protocol: u8,
    },
    /// The sender's hardware address is a group address or zero, which no station has.
    #[error("the ARP sender {0} cannot be a station's address")]
    Sender(Mac),
}

/// An ARP packet.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct ArpPacket {
    /// The operation.
    pub operation: Operation,
    /// Hardware address of the sender.
    pub sender_mac: Mac,
    /// IP address of the sender; 0.0.0.0 in a probe.
    pub sender_address: Ipv4Addr,
    /// Hardware address of the target; zeros in a request.
    pub target_mac: Mac,
    /// IP address in question.
    pub target_address: Ipv4Addr,
}

impl ArpPacket {
    /// Length of a packet in bytes.
    pub const LEN: usize = 28;

    /// Returns the packet by which `mac` asks who has `address`, without naming an address of its own.
    #[must_use]
    pub const fn probe(mac: Mac, address: Ipv4Addr) -> Self {
        Self::question(mac, Ipv4Addr::UNSPECIFIED, address)
    }

    /// Returns the packet by which `mac` tells all stations that it has `address`.
    #[must_use]
    pub const fn announcement(mac: Mac, address: Ipv4Addr) -> Self {
        Self::question(mac, address, address)
    }

    /// Returns the packet by which the station `mac` with the address `own` asks who has `address`.
    #[must_use]
    pub const fn question(mac: Mac, own: Ipv4Addr, address: Ipv4Addr) -> Self {
        Self {
            operation: Operation::Request,
            sender_mac: mac,
            sender_address: own,
            target_mac: Mac([0; 6]),
            target_address: address,
        }
    }

    /// Returns the answer of the station `mac`, which has the address that this packet asks for.
    #[must_use]
    pub const fn answer(&self, mac: Mac) -> Self {
        Self {
            operation: Operation::Reply,
            sender_mac: mac,
            sender_address: self.target_address,
            target_mac: self.sender_mac,
            target_address: self.sender_address,
        }
    }

    /// Returns whether it is a probe: a request whose sender does not use an address yet.
    #[must_use]
    pub fn is_probe(&self) -> bool {
        self.operation == Operation::Request && self.sender_address.is_unspecified()
    }

    /// Returns the station that claims this address by the packet: it sent the packet from the address.
    #[must_use]
    pub fn claimant(&self, address: Ipv4Addr) -> Option<Mac> {
        (self.sender_address == address && !address.is_unspecified()).then_some(self.sender_mac)
    }

    /// Parses a packet from an Ethernet frame's payload; padding follows it.
    pub fn parse(payload: &[u8]) -> Result<Self, ArpError> {
        let mut reader = Reader::<BigEndian>::new(payload);
        let (hardware, protocol) = (reader.u16()?, reader.u16()?);
        if (hardware, protocol) != (HARDWARE_ETHERNET, PROTOCOL_IPV4) {
            return Err(ArpError::OtherNetwork { hardware, protocol });
        }
        let (hardware, protocol) = (reader.u8()?, reader.u8()?);
        if (hardware, protocol) != (6, 4) {
            return Err(ArpError::Lengths { hardware, protocol });
        }
        let packet = Self {
            operation: reader.u16()?.into(),
            sender_mac: Mac(reader.array()?),
            sender_address: Ipv4Addr::from(reader.array::<4>()?),
            target_mac: Mac(reader.array()?),
            target_address: Ipv4Addr::from(reader.array::<4>()?),
        };
        if packet.sender_mac.is_group() || packet.sender_mac == Mac([0; 6]) {
            return Err(ArpError::Sender(packet.sender_mac));
        }
        Ok(packet)
    }

    /// Parses the packet of an Ethernet frame; `None` if the frame has another EtherType.
    #[must_use]
    pub fn from_frame(frame: &[u8]) -> Option<Result<Self, ArpError>> {
        let (header, payload) = EthernetHeader::parse(frame).ok()?;
        (header.ether_type == ETHER_TYPE).then(|| Self::parse(payload))
    }

    /// Writes the packet.
    pub fn emit(&self, writer: &mut Writer<'_, BigEndian>) {
        writer.u16(HARDWARE_ETHERNET);
        writer.u16(PROTOCOL_IPV4);
        writer.u8(6);
        writer.u8(4);
        writer.u16(self.operation.into());
        writer.bytes(&self.sender_mac.0);
        writer.bytes(&self.sender_address.octets());
        writer.bytes(&self.target_mac.0);
        writer.bytes(&self.target_address.octets());
    }

    /// Writes the whole Ethernet frame: a request to all stations, anything else to its target. Returns its length in bytes.
    pub fn emit_frame(&self, buf: &mut [u8]) -> Result<usize, Overflow> {
        let destination = if self.operation == Operation::Request { BROADCAST } else { self.target_mac };
        let header =
            EthernetHeader { destination, source: self.sender_mac, tag: None, ether_type: ETHER_TYPE };
        header.emit(buf, |writer| self.emit(writer))
    }
}

#[cfg(test)]
mod tests;
