//! The endpoint mapper's Lookup: returns the UDP port of an interface (C706, chapter 6 and appendix L).
//!
//! ```text
//! request   inquiry type u32 · object: pointer u32, UUID 16 · interface: pointer u32, UUID 16, major u16, minor u16
//!           version option u32 · entry handle: attributes u32, UUID 16 · most entries u32
//! response  entry handle: attributes u32, UUID 16 · entries u32 · array: maximum, offset, count u32
//!             each: object UUID 16 · pointer u32 · annotation: offset u32, length u32, text padded to 4
//!             each: tower: length u32, length u32, floors, padding to 4
//!           status u32
//! ```
//!
//! A tower is little-endian whatever the header says, but for the port. Its floors: interface, NDR, connectionless
//! RPC, UDP port, IP address.

use core::net::Ipv4Addr;

use super::{DEVICE_INTERFACE, DataRepresentation, Header};
use crate::Uuid;
use machine::wire::{BigEndian, ByteOrder, LittleEndian, Overflow, Reader, Truncated, Writer};

/// Operation number of Lookup.
pub const LOOKUP: u16 = 2;
/// Operation number of LookupHandleFree.
pub const LOOKUP_HANDLE_FREE: u16 = 4;

/// Status: nothing (more) is registered.
const NOT_REGISTERED: u32 = 0x16C9_A0D6;
/// Transfer syntax NDR, version 2.
const NDR: Uuid = Uuid(0x8A88_5D04_1CEB_11C9_9FE8_0800_2B10_4860_u128.to_be_bytes());
/// Length in bytes of the annotation's text.
const ANNOTATION_LEN: usize = 64;

/// Why a Lookup request cannot be parsed.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum LookupError {
    /// It is truncated.
    #[error("the endpoint mapper's request is cut: {0}")]
    Truncated(#[from] Truncated),
}

/// The fields of a Lookup request on which the answer depends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Lookup {
    /// Whether this is the first call of an inquiry: its handle is nil.
    pub first: bool,
    /// Largest number of entries in the answer.
    pub most_entries: u32,
}

impl Lookup {
    /// Parses a request's body in the byte order of its header.
    pub fn parse(header: &Header, body: &[u8]) -> Result<Self, LookupError> {
        match header.order {
            DataRepresentation::BigEndian => Self::parse_in::<BigEndian>(body),
            DataRepresentation::LittleEndian => Self::parse_in::<LittleEndian>(body),
        }
    }

    fn parse_in<O: ByteOrder>(body: &[u8]) -> Result<Self, LookupError> {
        let mut reader = Reader::<O>::new(body);
        reader.skip(4 + 20 + 24 + 4)?;
        let attributes = reader.u32()?;
        let handle = Uuid::read(&mut reader)?;
        let most_entries = reader.u32()?;
        Ok(Self { first: attributes == 0 && handle.is_nil(), most_entries })
    }

    /// Writes the answer's body, big-endian: the first call gets the device's interface, the next one the end of the
    /// list. Returns its length.
    pub fn answer(
        &self,
        object: Uuid,
        annotation: &[u8],
        port: u16,
        address: Ipv4Addr,
        body: &mut [u8],
    ) -> Result<usize, Overflow> {
        let mut writer = Writer::<BigEndian>::new(body);
        let found = self.first && self.most_entries > 0;
        writer.u32(0);
        let handle = if found { object } else { Uuid::NIL };
        handle.write(&mut writer);
        writer.u32(u32::from(found));
        writer.u32(self.most_entries.min(1));
        writer.u32(0);
        writer.u32(u32::from(found));
        if found {
            object.write(&mut writer);
            writer.u32(3);
            writer.u32(0);
            writer.u32(ANNOTATION_LEN as u32);
            let start = writer.len();
            writer.bytes(annotation.get(..ANNOTATION_LEN - 1).unwrap_or(annotation));
            writer.pad_to(start + ANNOTATION_LEN);
            write_tower(port, address, &mut writer);
        }
        writer.u32(if found { 0 } else { NOT_REGISTERED });
        writer.finish()
    }
}

fn write_tower(port: u16, address: Ipv4Addr, writer: &mut Writer<'_, BigEndian>) {
    const TOWER_LEN: u32 = 2 + 2 * (2 + 19 + 2 + 2) + 2 * (2 + 1 + 2 + 2) + (2 + 1 + 2 + 4);
    writer.u32(TOWER_LEN);
    writer.u32(TOWER_LEN);
    writer.in_order::<LittleEndian>(|w| {
        w.u16(5);
        for (uuid, major) in [(DEVICE_INTERFACE, 1), (NDR, 2)] {
            w.u16(19);
            w.u8(0x0D);
            uuid.write(w);
            w.u16(major);
            w.u16(2);
            w.u16(0);
        }
        w.u16(1);
        w.u8(0x0A);
        w.u16(2);
        w.u16(0);
        w.u16(1);
        w.u8(0x08);
        w.u16(2);
        w.bytes(&port.to_be_bytes());
        w.u16(1);
        w.u8(0x09);
        w.u16(4);
        w.bytes(&address.octets());
    });
    writer.align(4);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rpc::{ENDPOINT_MAPPER_INTERFACE, Operation};

    fn header() -> Header {
        let operation = Operation::Unknown(LOOKUP);
        Header::request(operation, Uuid::NIL, ENDPOINT_MAPPER_INTERFACE, Uuid([1; 16]), 0)
    }

    #[test]
    fn the_first_lookup_returns_the_port_and_the_second_ends_the_inquiry() {
        let mut request = [0; 76];
        request[75] = 1;
        let lookup = Lookup::parse(&header(), &request).unwrap();
        assert_eq!(lookup, Lookup { first: true, most_entries: 1 });
        let mut body = [0; 300];
        let object = Uuid([5; 16]);
        let len = lookup.answer(object, b"robot", 34964, Ipv4Addr::new(10, 0, 0, 2), &mut body).unwrap();
        assert_eq!(len, 20 + 16 + 16 + 4 + 8 + 64 + 8 + 76 + 4);
        assert_eq!(body[len - 4..len], [0; 4]);
        let port_and_address = [0x88, 0x94, 1, 0, 9, 4, 0, 10, 0, 0, 2];
        assert!(body.windows(11).any(|window| window == port_and_address));

        request[52..72].copy_from_slice(&body[..20]);
        let lookup = Lookup::parse(&header(), &request).unwrap();
        let len = lookup.answer(object, b"robot", 34964, Ipv4Addr::LOCALHOST, &mut body).unwrap();
        assert_eq!(body[len - 4..len], NOT_REGISTERED.to_be_bytes());
    }

    #[test]
    fn a_cut_lookup_is_refused() {
        for len in 0..76 {
            assert!(Lookup::parse(&header(), &[0; 76][..len]).is_err());
        }
    }
}
