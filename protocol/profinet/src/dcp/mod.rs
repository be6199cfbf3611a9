//! DCP, Discovery and Configuration Protocol: finds stations and sets their names and addresses (IEC 61158-6-10, 4.3).
//!
//! ```text
//! 0..2   FrameID            0xFEFC Hello · 0xFEFD Get, Set · 0xFEFE Identify request · 0xFEFF Identify response
//! 2      ServiceID          3 Get · 4 Set · 5 Identify · 6 Hello
//! 3      ServiceType        0 request · 1 response · 5 response: service not supported
//! 4..8   Xid                chosen by the requester, echoed in the answer
//! 8..10  ResponseDelayFactor in an Identify request; 0 in all others
//! 10..12 DCPDataLength      bytes of the blocks that follow; the bytes after these are padding
//! 12..   blocks             each on an even offset
//! ```
//!
//! A Get request has pairs of option and suboption in place of blocks. The PDU stands behind the EtherType 0x8892.

mod block;

pub use block::{Block, BlockError, Code, Content, IpSuite};

use machine::Duration;
use machine::ethernet::Mac;
use machine::wire::{BigEndian, Reader, Truncated, Writer};

/// Destination of Identify requests.
pub const IDENTIFY_MULTICAST: Mac = Mac([0x01, 0x0E, 0xCF, 0x00, 0x00, 0x00]);

/// Destination of Hello requests.
pub const HELLO_MULTICAST: Mac = Mac([0x01, 0x0E, 0xCF, 0x00, 0x00, 0x01]);

/// The FrameIDs of DCP, first and last.
pub const FRAME_IDS: core::ops::RangeInclusive<u16> = 0xFEFC..=0xFEFF;

/// First bytes of every answer to an Identify request: its FrameID.
pub const IDENTIFY_RESPONSE_ID: [u8; 2] = 0xFEFF_u16.to_be_bytes();

/// Largest number of steps of 10 ms over which answers are spread (IEC 61158-5-10, ResponseDelayFactor 1…0x1900).
pub const MAX_DELAY_FACTOR: u16 = 0x1900;

/// Longest station name in bytes.
pub const MAX_NAME_LEN: usize = 240;

const SERVICE_GET: u8 = 3;
const SERVICE_SET: u8 = 4;
const SERVICE_IDENTIFY: u8 = 5;
const SERVICE_HELLO: u8 = 6;
const TYPE_REQUEST: u8 = 0;
const TYPE_RESPONSE: u8 = 1;
const TYPE_NOT_SUPPORTED: u8 = 5;

/// Service of a DCP PDU.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Service {
    /// Asks which stations match all of these blocks. Multicast.
    IdentifyRequest,
    /// Answer of a matching station.
    IdentifyResponse,
    /// Asks for the values of options.
    GetRequest,
    /// Returns the values of options.
    GetResponse,
    /// Sets options.
    SetRequest,
    /// Returns the result for each option.
    SetResponse,
    /// A station came up. Multicast.
    Hello,
    /// The station does not support the requested service, with its FrameID and ServiceID.
    NotSupported(u16, u8),
}

impl Service {
    const fn wire(self) -> (u16, u8, u8) {
        match self {
            Self::IdentifyRequest => (0xFEFE, SERVICE_IDENTIFY, TYPE_REQUEST),
            Self::IdentifyResponse => (0xFEFF, SERVICE_IDENTIFY, TYPE_RESPONSE),
            Self::GetRequest => (0xFEFD, SERVICE_GET, TYPE_REQUEST),
            Self::GetResponse => (0xFEFD, SERVICE_GET, TYPE_RESPONSE),
            Self::SetRequest => (0xFEFD, SERVICE_SET, TYPE_REQUEST),
            Self::SetResponse => (0xFEFD, SERVICE_SET, TYPE_RESPONSE),
            Self::Hello => (0xFEFC, SERVICE_HELLO, TYPE_REQUEST),
            Self::NotSupported(frame_id, service) => (frame_id, service, TYPE_NOT_SUPPORTED),
        }
    }

    const fn from_wire(frame_id: u16, service: u8, service_type: u8) -> Option<Self> {
        Some(match (frame_id, service, service_type) {
            (0xFEFE, SERVICE_IDENTIFY, TYPE_REQUEST) => Self::IdentifyRequest,
            (0xFEFF, SERVICE_IDENTIFY, TYPE_RESPONSE) => Self::IdentifyResponse,
            (0xFEFD, SERVICE_GET, TYPE_REQUEST) => Self::GetRequest,
            (0xFEFD, SERVICE_GET, TYPE_RESPONSE) => Self::GetResponse,
            (0xFEFD, SERVICE_SET, TYPE_REQUEST) => Self::SetRequest,
            (0xFEFD, SERVICE_SET, TYPE_RESPONSE) => Self::SetResponse,
            (0xFEFC, SERVICE_HELLO, TYPE_REQUEST) => Self::Hello,
            (0xFEFC..=0xFEFF, _, TYPE_NOT_SUPPORTED) => Self::NotSupported(frame_id, service),
            _ => return None,
        })
    }

    /// Returns whether the PDU is a request that needs an answer.
    #[must_use]
    pub const fn is_request(self) -> bool {
        matches!(self, Self::IdentifyRequest | Self::GetRequest | Self::SetRequest)
    }

    /// Returns whether blocks of this PDU start with BlockInfo or BlockQualifier.
    const fn has_qualifiers(self) -> bool {
        matches!(self, Self::IdentifyResponse | Self::GetResponse | Self::SetRequest | Self::Hello)
    }
}

/// A malformed DCP PDU.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Violation {
    /// The PDU or one of its blocks ends early.
    #[error("DCP: {0}")]
    Truncated(#[from] Truncated),
    /// FrameID, ServiceID and ServiceType do not match.
    #[error("DCP: FrameID 0x{frame_id:04X} with ServiceID {service} and ServiceType {service_type}")]
    Service {
        /// FrameID of the frame.
        frame_id: u16,
        /// ServiceID.
        service: u8,
        /// ServiceType.
        service_type: u8,
    },
    /// A block does not have the length of its kind.
    #[error("DCP: block 0x{:04X} with {len} bytes", code.0)]
    BlockLength {
        /// Option and suboption.
        code: Code,
        /// Its DCPBlockLength in bytes.
        len: u16,
    },
}

/// A received DCP PDU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Pdu<'a> {
    /// Its service.
    pub service: Service,
    /// Number of the transaction.
    pub xid: u32,
    /// Number of steps of 10 ms over which the answers to an Identify request are spread; see [`response_delay`].
    pub response_delay_factor: u16,
    body: &'a [u8],
}

impl<'a> Pdu<'a> {
    /// Parses the PDU in the payload of an Ethernet frame; ignores the padding behind it.
    pub fn parse(payload: &'a [u8]) -> Result<Self, Violation> {
        let mut reader = Reader::<BigEndian>::new(payload);
        let (frame_id, service, service_type) = (reader.u16()?, reader.u8()?, reader.u8()?);
        let service = Service::from_wire(frame_id, service, service_type).ok_or(Violation::Service {
            frame_id,
            service,
            service_type,
        })?;
        let xid = reader.u32()?;
        let response_delay_factor = reader.u16()?;
        let len = reader.u16()?;
        let body = reader.bytes(usize::from(len))?;
        Ok(Self { service, xid, response_delay_factor, body })
    }

    /// Returns the blocks, up to the first one that is cut off. None in a Get request. A block with a length of another kind
    /// does not hide those behind it.
    pub fn blocks(&self) -> impl Iterator<Item = Result<Block<'a>, Violation>> + use<'a> {
        let body = if self.service == Service::GetRequest { &[] } else { self.body };
        let qualifiers = self.service.has_qualifiers();
        let mut reader = Reader::<BigEndian>::new(body);
        core::iter::from_fn(move || {
            if reader.is_empty() {
                return None;
            }
            let block = Block::parse(&mut reader, qualifiers);
            if matches!(block, Err(Violation::Truncated(_))) {
                reader = Reader::new(&[]);
            }
            Some(block)
        })
    }

    /// Returns the options that a Get request asks for. None in other PDUs.
    pub fn requested_options(&self) -> impl Iterator<Item = Code> + use<'a> {
        let body = if self.service == Service::GetRequest { self.body } else { &[] };
        let mut reader = Reader::<BigEndian>::new(body);
        core::iter::from_fn(move || reader.u16().ok().map(Code))
    }
}

/// Writes a PDU with these blocks, from the FrameID on. `response_delay_factor` is 0 except in Identify requests.
pub fn emit<'b>(
    writer: &mut Writer<'_, BigEndian>,
    service: Service,
    xid: u32,
    response_delay_factor: u16,
    blocks: impl IntoIterator<Item = Block<'b>>,
) {
    emit_pdu(writer, service, xid, response_delay_factor, |writer| {
        for block in blocks {
            block.emit(writer, service.has_qualifiers());
        }
    });
}

/// Writes a Get request for these options, from the FrameID on.
pub fn emit_get_request(writer: &mut Writer<'_, BigEndian>, xid: u32, wanted: &[Code]) {
    emit_pdu(writer, Service::GetRequest, xid, 0, |writer| {
        for code in wanted {
            writer.u16(code.0);
        }
    });
}

fn emit_pdu(
    writer: &mut Writer<'_, BigEndian>,
    service: Service,
    xid: u32,
    response_delay_factor: u16,
    body: impl FnOnce(&mut Writer<'_, BigEndian>),
) {
    let (frame_id, service, service_type) = service.wire();
    writer.u16(frame_id);
    writer.u8(service);
    writer.u8(service_type);
    writer.u32(xid);
    writer.u16(response_delay_factor);
    let len_at = writer.len();
    writer.u16(0);
    let start = writer.len();
    body(writer);
    let len = writer.len() - start;
    writer.patch_u16(len_at, u16::try_from(len).unwrap_or(u16::MAX));
}

/// Returns how long a station waits before it answers an Identify request, so that not all stations answer at once:
/// its MAC address selects one of `factor` steps of 10 ms.
#[must_use]
pub fn response_delay(mac: Mac, factor: u16) -> Duration {
    let [.., high, low] = mac.0;
    let step = u16::from_be_bytes([high, low]) % factor.clamp(1, MAX_DELAY_FACTOR);
    Duration::from_millis(10).saturating_mul(u32::from(step))
}

/// The station described by an Identify response or a Hello.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Station<'a> {
    /// Its name; empty if none is set. Lower-case ASCII if the station follows the standard.
    pub name: &'a [u8],
    /// Its type of station, chosen by the vendor.
    pub type_of_station: &'a [u8],
    /// Its VendorID and DeviceID.
    pub identity: Option<(u16, u16)>,
    /// Its IP address, subnet mask and gateway; 0.0.0.0 if not set.
    pub ip: Option<IpSuite>,
    /// Its roles as bits: 1 IO-Device, 2 IO-Controller, 4 IO-Multidevice, 8 IO-Supervisor.
    pub roles: u8,
}

impl<'a> Station<'a> {
    /// Collects the blocks of an Identify response or a Hello. A block whose length is not that of its option does not hide
    /// the others.
    pub fn from_pdu(pdu: &Pdu<'a>) -> Result<Self, Violation> {
        let mut station = Self { name: &[], type_of_station: &[], identity: None, ip: None, roles: 0 };
        for block in pdu.blocks() {
            let block = match block {
                Err(Violation::BlockLength { .. }) => continue,
                block => block?,
            };
            match block.content {
                Content::NameOfStation(name) => station.name = name,
                Content::TypeOfStation(text) => station.type_of_station = text,
                Content::DeviceId { vendor, device } => station.identity = Some((vendor, device)),
                Content::Ip(suite) => station.ip = Some(suite),
                Content::DeviceRole(roles) => station.roles = roles,
                _ => {}
            }
        }
        Ok(station)
    }
}

#[cfg(test)]
mod tests;
