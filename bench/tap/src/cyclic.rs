//! The cyclic frames of both buses, before it is known where the image is in them.

use std::net::SocketAddrV4;

use ethernet_ip::class1;
use profinet::rt;

use crate::address::{CyclicBus, EndAddress};
use crate::packet::{EthernetPacket, Payload};

/// Length of a FrameID in bytes.
const FRAME_ID_LEN: usize = 2;

/// Cycle counter, data status and transfer status after the data of a PROFINET frame, in bytes.
const TRAILER_LEN: usize = 4;

/// Check sequence of Ethernet, which some taps record, in bytes.
const FCS_LEN: usize = 4;

/// One direction of a connection.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct FlowKey {
    pub(crate) bus: CyclicBus,
    pub(crate) from: EndAddress,
    pub(crate) to: EndAddress,
    /// FrameID, or number of the connection.
    pub(crate) connection: u32,
}

/// A cyclic frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CyclicFrame<'a> {
    pub(crate) key: FlowKey,
    /// Data with what surrounds it: of PROFINET all after the FrameID to the end of the frame, of EtherNet/IP the payload.
    pub(crate) body: &'a [u8],
    /// Sequence number of EtherNet/IP.
    sequence: Option<u32>,
}

impl<'a> CyclicFrame<'a> {
    /// Finds the cyclic frame in a packet.
    pub(crate) fn of(packet: &EthernetPacket<'a>) -> Option<Self> {
        match packet.payload {
            Payload::Profinet(data) => {
                let ends = (EndAddress::Mac(packet.source), EndAddress::Mac(packet.destination));
                Self::profinet(CyclicBus::ProfinetRt, ends, data)
            }
            Payload::Udp { from, to, data } if to.port() == rt::UDP_PORT => {
                Self::profinet(CyclicBus::ProfinetUdp, ips(from, to), data)
            }
            Payload::Udp { from, to, data } if to.port() == ethernet_ip::IO_PORT => {
                let frame = class1::Frame::parse(data).ok()?;
                let (from, to) = ips(from, to);
                let key = FlowKey { bus: CyclicBus::EthernetIp, from, to, connection: frame.connection };
                Some(Self { key, body: frame.payload, sequence: Some(frame.sequence) })
            }
            _ => None,
        }
    }

    fn profinet(bus: CyclicBus, (from, to): (EndAddress, EndAddress), data: &'a [u8]) -> Option<Self> {
        let (id, body) = data.split_first_chunk::<FRAME_ID_LEN>()?;
        let connection = u16::from_be_bytes(*id);
        let key = FlowKey { bus, from, to, connection: connection.into() };
        rt::is_cyclic(connection).then_some(Self { key, body, sequence: None })
    }

    /// Returns the counter of the frame, modulo 2^32 for EtherNet/IP and 2^16 for PROFINET; of the latter `sdu_len` is the length
    /// of the data, if it is known.
    pub(crate) fn counter(&self, sdu_len: Option<usize>) -> Option<u32> {
        match self.sequence {
            Some(sequence) => Some(sequence),
            None => {
                let sdu_len = sdu_len.or_else(|| profinet_sdu_len(self.body))?;
                let counter = self.body.get(sdu_len..)?.first_chunk::<2>()?;
                Some(u16::from_be_bytes(*counter).into())
            }
        }
    }
}

/// Returns the length of the data of a PROFINET frame whose IOCR is unknown: up to its status, after which a tap may have
/// recorded the check sequence of Ethernet.
fn profinet_sdu_len(body: &[u8]) -> Option<usize> {
    [TRAILER_LEN, TRAILER_LEN + FCS_LEN].into_iter().find_map(|rest| {
        let length = body.len().checked_sub(rest)?;
        let [_, _, data_status, transfer_status] = *body.get(length..)?.first_chunk::<TRAILER_LEN>()?;
        // Bits 3 and 6 of the data status are 0 (IEC 61158-6-10, 4.7.2.1.2), and what is sent is valid.
        let is_status = data_status & 0x48 == 0 && data_status & rt::DataStatus::VALID != 0;
        (is_status && transfer_status == 0).then_some(length)
    })
}

fn ips(from: SocketAddrV4, to: SocketAddrV4) -> (EndAddress, EndAddress) {
    (EndAddress::Ip(*from.ip()), EndAddress::Ip(*to.ip()))
}
