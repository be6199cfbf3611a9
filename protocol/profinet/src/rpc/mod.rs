//! Connectionless DCE RPC, version 4 (C706, chapter 12), as connection management uses it over UDP.
//!
//! ```text
//!  0 RPCVersion (4)      1 PDUType            2 Flags1               3 Flags2
//!  4..7 DataRepresentation; high half of byte 4: 0 big-endian, 1 little-endian      7 SerialHigh
//!  8..24 ObjectUUID     24..40 InterfaceUUID 40..56 ActivityUUID
//! 56..60 ServerBootTime 60..64 InterfaceVersion 64..68 SequenceNumber
//! 68..70 OperationNumber 70..72 InterfaceHint 72..74 ActivityHint
//! 74..76 LengthOfBody   76..78 FragmentNumber 78 AuthenticationProtocol 79 SerialLow    80.. body
//! ```

mod args;
mod codes;
mod endpoint_mapper;
mod fragment;

pub use args::{RequestArgs, ResponseArgs};
pub use codes::{Kind, Operation, flags, rpc_status};
pub use endpoint_mapper::{Endpoint, LOOKUP, LOOKUP_HANDLE_FREE, Lookup, MapperCall, MapperError};
pub use fragment::{Message, Reassembly, Received};

use super::Uuid;
use super::description::Identity;
use machine::wire::{BigEndian, ByteOrder, LittleEndian, Overflow, Reader, Truncated, Writer};

/// Length in bytes of the header.
pub const HEADER_LEN: usize = 80;

/// Length in bytes of the five NDR numbers before the blocks.
pub const ARGS_LEN: usize = 20;

/// Body bytes of one datagram; a longer body is sent in fragments of this length.
pub const FRAGMENT_LEN: usize = 1312;

/// Length of the longest body in bytes that is reassembled from fragments or sent in fragments.
pub const BODY_CAPACITY: usize = 8192;

/// Longest record in bytes that a call carries: with its heads the body has 64 KiB.
pub const LONGEST_RECORD: usize = LONGEST_BODY - ARGS_LEN - crate::record::HEADER_LEN;

/// Largest body in bytes of a call with a long record.
pub const LONGEST_BODY: usize = 65_536;

/// InterfaceUUID of an IO-Device.
pub const DEVICE_INTERFACE: Uuid = interface(1);

/// InterfaceUUID of an IO-Controller.
pub const CONTROLLER_INTERFACE: Uuid = interface(2);

/// InterfaceUUID of the endpoint mapper (C706, appendix O).
pub const ENDPOINT_MAPPER_INTERFACE: Uuid =
    Uuid(0xE1AF_8308_5D1F_11C9_91A4_0800_2B14_A0FA_u128.to_be_bytes());

const fn interface(number: u128) -> Uuid {
    Uuid((0xDEA0_0000_6C97_11D1_8271_00A0_2442_DF7D_u128 | number << 96).to_be_bytes())
}

/// Instance of the objects of our own stations.
pub const INSTANCE: u16 = 1;

/// Returns the ObjectUUID of a station: instance (1 for the first interface), device and vendor.
#[must_use]
pub fn object(instance: u16, identity: Identity) -> Uuid {
    let node = u128::from(instance) << 32 | u128::from(identity.device) << 16 | u128::from(identity.vendor);
    Uuid((0xDEA0_0000_6C97_11D1_8271_0000_0000_0000_u128 | node).to_be_bytes())
}

/// Byte order of an RPC header's sender.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum DataRepresentation {
    /// Most significant byte first.
    BigEndian,
    /// Least significant byte first.
    LittleEndian,
}

/// Why a datagram is not an RPC PDU.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Error {
    /// It is shorter than its header, or than the body length in the header.
    #[error("the RPC PDU is cut: {0}")]
    Truncated(#[from] Truncated),
    /// RPCVersion is not 4.
    #[error("RPC version {0}, where connectionless RPC has 4")]
    Version(u8),
    /// It requests authentication, which PROFINET does not have.
    #[error("authentication protocol {0}, where PROFINET has none (0)")]
    Authentication(u8),
}

/// An RPC header.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Header {
    /// Kind of the PDU.
    pub kind: Kind,
    /// [`flags`].
    pub flags: u8,
    /// Flags2: bit 1 = cancel pending.
    pub flags2: u8,
    /// The sender's byte order of this header and of the NDR numbers.
    pub order: DataRepresentation,
    /// Number of the PDU within one call; fragments and repetitions count.
    pub serial: u16,
    /// The called station.
    pub object: Uuid,
    /// The called interface.
    pub interface: Uuid,
    /// The caller's activity: the sequence of its calls.
    pub activity: Uuid,
    /// When the server started, in its own units; 0 if the caller does not know it.
    pub server_boot: u32,
    /// Version of the interface; 1 for PROFINET, 3 for the endpoint mapper.
    pub interface_version: u32,
    /// Number of the call within its activity.
    pub sequence: u32,
    /// Operation number; see [`Operation`].
    pub operation: u16,
    /// A hint for the server; 0xFFFF = none.
    pub interface_hint: u16,
    /// A hint for the server; 0xFFFF = none.
    pub activity_hint: u16,
    /// Number of the fragment, from 0.
    pub fragment: u16,
}

impl Header {
    /// Creates the header of a call.
    #[must_use]
    pub const fn request(
        operation: Operation,
        object: Uuid,
        interface: Uuid,
        activity: Uuid,
        sequence: u32,
    ) -> Self {
        Self {
            kind: Kind::Request,
            flags: flags::IDEMPOTENT,
            flags2: 0,
            order: DataRepresentation::BigEndian,
            serial: 0,
            object,
            interface,
            activity,
            server_boot: 0,
            interface_version: 1,
            sequence,
            operation: operation.code(),
            interface_hint: 0xFFFF,
            activity_hint: 0xFFFF,
            fragment: 0,
        }
    }

    /// Creates the header of the answer to this call.
    #[must_use]
    pub const fn answer(&self, kind: Kind) -> Self {
        Self {
            kind,
            flags: flags::IDEMPOTENT | flags::NO_FRAGMENT_ACK,
            flags2: 0,
            order: DataRepresentation::BigEndian,
            serial: 0,
            fragment: 0,
            ..*self
        }
    }

    /// Returns whether `other` belongs to the same call.
    #[must_use]
    pub fn is_same_call(&self, other: &Self) -> bool {
        self.activity == other.activity && self.sequence == other.sequence
    }

    /// Returns whether this is one fragment of several.
    #[must_use]
    pub const fn is_fragment(&self) -> bool {
        self.flags & flags::FRAGMENT != 0
    }

    /// Parses a datagram into the header and its body. Bytes after the body are ignored.
    pub fn parse(datagram: &[u8]) -> Result<(Self, &[u8]), Error> {
        let mut reader = Reader::<BigEndian>::new(datagram);
        let version = reader.u8()?;
        let kind = reader.u8()?.into();
        let [flags, flags2, representation] = reader.array()?;
        reader.skip(2)?;
        if version != 4 {
            return Err(Error::Version(version));
        }
        match representation >> 4 {
            0 => Self::parse_rest(reader, (kind, flags, flags2, DataRepresentation::BigEndian)),
            _ => Self::parse_rest(
                reader.in_order::<LittleEndian>(),
                (kind, flags, flags2, DataRepresentation::LittleEndian),
            ),
        }
    }

    fn parse_rest<O: ByteOrder>(
        mut reader: Reader<'_, O>,
        (kind, flags, flags2, order): (Kind, u8, u8, DataRepresentation),
    ) -> Result<(Self, &[u8]), Error> {
        let serial_high = reader.u8()?;
        let object = Uuid::read(&mut reader)?;
        let interface = Uuid::read(&mut reader)?;
        let activity = Uuid::read(&mut reader)?;
        let server_boot = reader.u32()?;
        let interface_version = reader.u32()?;
        let sequence = reader.u32()?;
        let operation = reader.u16()?;
        let interface_hint = reader.u16()?;
        let activity_hint = reader.u16()?;
        let body_len = reader.u16()?;
        let fragment = reader.u16()?;
        let [authentication, serial_low] = reader.array()?;
        if authentication != 0 {
            return Err(Error::Authentication(authentication));
        }
        let body = reader.bytes(usize::from(body_len))?;
        let header = Self {
            kind,
            flags,
            flags2,
            order,
            serial: u16::from_be_bytes([serial_high, serial_low]),
            object,
            interface,
            activity,
            server_boot,
            interface_version,
            sequence,
            operation,
            interface_hint,
            activity_hint,
            fragment,
        };
        Ok((header, body))
    }

    /// Writes the header and a body of at most 65535 bytes; returns the datagram's length.
    pub fn emit(&self, body: &[u8], datagram: &mut [u8]) -> Result<usize, Overflow> {
        let mut writer = Writer::<BigEndian>::new(datagram);
        let representation = match self.order {
            DataRepresentation::BigEndian => 0x00,
            DataRepresentation::LittleEndian => 0x10,
        };
        let [serial_high, serial_low] = self.serial.to_be_bytes();
        writer.bytes(&[4, self.kind.into(), self.flags, self.flags2, representation, 0, 0, serial_high]);
        match self.order {
            DataRepresentation::BigEndian => self.emit_rest(body.len(), serial_low, &mut writer),
            DataRepresentation::LittleEndian => {
                writer.in_order::<LittleEndian>(|w| self.emit_rest(body.len(), serial_low, w))
            }
        }
        writer.bytes(body);
        writer.finish()
    }

    fn emit_rest<O: ByteOrder>(&self, body_len: usize, serial_low: u8, writer: &mut Writer<'_, O>) {
        self.object.write(writer);
        self.interface.write(writer);
        self.activity.write(writer);
        writer.u32(self.server_boot);
        writer.u32(self.interface_version);
        writer.u32(self.sequence);
        writer.u16(self.operation);
        writer.u16(self.interface_hint);
        writer.u16(self.activity_hint);
        writer.u16(u16::try_from(body_len).unwrap_or(u16::MAX));
        writer.u16(self.fragment);
        writer.bytes(&[0, serial_low]);
    }
}

/// Reads the status in the body of a Reject or Fault.
#[must_use]
pub fn read_rpc_status(header: &Header, body: &[u8]) -> Option<u32> {
    match header.order {
        DataRepresentation::BigEndian => Reader::<BigEndian>::new(body).u32().ok(),
        DataRepresentation::LittleEndian => Reader::<LittleEndian>::new(body).u32().ok(),
    }
}

#[cfg(test)]
mod tests;
