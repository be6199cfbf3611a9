//! The endpoint mapper's Lookup: returns the UDP port of an interface (C706, chapter 6 and appendix L).
//!
//! ```text
//! request   inquiry type u32 · object: pointer u32, UUID 16 · interface: pointer u32, UUID 16, major u16, minor u16
//!           version option u32 · entry handle: attributes u32, UUID 16 · most entries u32
//!           inquiry type: 0 all · 1 of the interface · 2 of the object · 3 of both
//! response  entry handle: attributes u32, UUID 16 · entries u32 · array: maximum, offset, count u32
//!             each: object UUID 16 · pointer u32 · annotation: offset u32, length u32, text padded to 4
//!             each: tower: length u32, length u32, floors, padding to 4
//!           status u32
//! annotation  DeviceType 25 · blank · OrderID 20 · blank · hardware revision 5 · blank · V · software revision 3 · 3 · 3 · 0
//! ```
//!
//! The texts of an annotation are filled up with blanks behind, its numbers before (IEC 61158-6-10, RPC annotation).
//! A tower is little-endian whatever the header says, but for the port. Its floors: interface, NDR, connectionless
//! RPC, UDP port, IP address.

use core::net::Ipv4Addr;

use super::{DEVICE_INTERFACE, DataRepresentation, Header};
use crate::Uuid;
use crate::description::Description;
use machine::wire::{BigEndian, ByteOrder, LittleEndian, Overflow, Reader, Truncated, Writer};

/// Operation number of Lookup.
pub const LOOKUP: u16 = 2;
/// Operation number of LookupHandleFree.
pub const LOOKUP_HANDLE_FREE: u16 = 4;

/// Status: nothing (more) is registered.
const NOT_REGISTERED: u32 = 0x16C9_A0D6;
/// Transfer syntax NDR, version 2.
const NDR: Uuid = Uuid(0x8A88_5D04_1CEB_11C9_9FE8_0800_2B10_4860_u128.to_be_bytes());
/// Length in bytes of the annotation, with the 0 at its end.
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
    /// The only interface that it asks for, if any.
    pub interface: Option<Uuid>,
    /// The only object that it asks for, if any.
    pub object: Option<Uuid>,
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
        let inquiry = reader.u32()?;
        reader.skip(4)?;
        let object = Uuid::read(&mut reader)?;
        reader.skip(4)?;
        let interface = Uuid::read(&mut reader)?;
        reader.skip(2 + 2 + 4)?;
        let attributes = reader.u32()?;
        let handle = Uuid::read(&mut reader)?;
        let most_entries = reader.u32()?;
        Ok(Self {
            first: attributes == 0 && handle.is_nil(),
            interface: matches!(inquiry, 1 | 3).then_some(interface),
            object: matches!(inquiry, 2 | 3).then_some(object),
            most_entries,
        })
    }

    /// Writes the answer's body, big-endian: the first call gets the device's interface, the next one the end of the
    /// list. Returns its length.
    pub fn answer(
        &self,
        object: Uuid,
        description: &Description,
        port: u16,
        address: Ipv4Addr,
        body: &mut [u8],
    ) -> Result<usize, Overflow> {
        let mut writer = Writer::<BigEndian>::new(body);
        let is_wanted = |wanted: Option<Uuid>, there| wanted.is_none_or(|wanted| wanted == there);
        let found = self.first
            && self.most_entries > 0
            && is_wanted(self.interface, DEVICE_INTERFACE)
            && is_wanted(self.object, object);
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
            write_annotation(description, &mut writer);
            write_tower(port, address, &mut writer);
        }
        writer.u32(if found { 0 } else { NOT_REGISTERED });
        writer.finish()
    }
}

fn write_annotation(description: &Description, writer: &mut Writer<'_, BigEndian>) {
    let start = writer.len();
    for (text, len) in [(description.station_type, 25), (description.order_id, 20)] {
        let text = text.as_bytes();
        let text = text.get(..len).unwrap_or(text);
        writer.bytes(text);
        (text.len()..=len).for_each(|_| writer.u8(b' '));
    }
    write_number::<5>(description.hardware_revision, writer);
    writer.bytes(b" V");
    for part in description.software_revision {
        write_number::<3>(part.into(), writer);
    }
    writer.pad_to(start + ANNOTATION_LEN);
}

/// Writes a decimal number of `LEN` characters, with blanks before it.
fn write_number<const LEN: usize>(number: u16, writer: &mut Writer<'_, BigEndian>) {
    let mut digits = [b' '; LEN];
    let mut rest = number;
    for (index, digit) in digits.iter_mut().rev().enumerate() {
        if rest == 0 && index > 0 {
            break;
        }
        *digit = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    writer.bytes(&digits);
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
    use crate::samples;

    fn header() -> Header {
        let operation = Operation::Unknown(LOOKUP);
        Header::request(operation, Uuid::NIL, ENDPOINT_MAPPER_INTERFACE, Uuid([1; 16]), 0)
    }

    #[test]
    fn the_first_lookup_returns_the_port_and_the_second_ends_the_inquiry() {
        let mut request = [0; 76];
        request[75] = 1;
        let lookup = Lookup::parse(&header(), &request).unwrap();
        assert_eq!(lookup, Lookup { first: true, interface: None, object: None, most_entries: 1 });
        let mut body = [0; 300];
        let object = Uuid([5; 16]);
        let len =
            lookup.answer(object, &samples::P_NET, 34964, Ipv4Addr::new(10, 0, 0, 2), &mut body).unwrap();
        assert_eq!(len, 20 + 16 + 16 + 4 + 8 + 64 + 8 + 76 + 4);
        assert_eq!(body[len - 4..len], [0; 4]);
        let port_and_address = [0x88, 0x94, 1, 0, 9, 4, 0, 10, 0, 0, 2];
        assert!(body.windows(11).any(|window| window == port_and_address));

        request[52..72].copy_from_slice(&body[..20]);
        let lookup = Lookup::parse(&header(), &request).unwrap();
        let len = lookup.answer(object, &samples::P_NET, 34964, Ipv4Addr::LOCALHOST, &mut body).unwrap();
        assert_eq!(body[len - 4..len], NOT_REGISTERED.to_be_bytes());
    }

    #[test]
    fn the_annotation_has_type_article_number_and_versions_at_their_places() {
        let mut request = [0; 76];
        request[75] = 1;
        let lookup = Lookup::parse(&header(), &request).unwrap();
        let mut body = [0; 300];
        lookup.answer(Uuid([5; 16]), &samples::P_NET, 34964, Ipv4Addr::LOCALHOST, &mut body).unwrap();
        let text = b"P-Net Sample Application  12345 Abcdefghijk        3 V  0  2  0\0";
        assert_eq!(text.len(), 64);
        assert_eq!(body[64..128], text[..], "{}", String::from_utf8_lossy(&body[64..128]));
    }

    #[test]
    fn a_lookup_of_another_interface_or_object_finds_nothing() {
        let object = Uuid([5; 16]);
        for (inquiry, asked_object, interface, found) in [
            (1, Uuid::NIL, DEVICE_INTERFACE, true),
            (1, Uuid::NIL, ENDPOINT_MAPPER_INTERFACE, false),
            (2, object, Uuid::NIL, true),
            (2, Uuid([6; 16]), Uuid::NIL, false),
            (3, object, DEVICE_INTERFACE, true),
            (3, object, Uuid::NIL, false),
        ] {
            let mut request = [0; 76];
            request[3] = inquiry;
            request[8..24].copy_from_slice(&asked_object.0);
            request[28..44].copy_from_slice(&interface.0);
            request[75] = 1;
            let lookup = Lookup::parse(&header(), &request).unwrap();
            let mut body = [0; 300];
            let len = lookup.answer(object, &samples::P_NET, 34964, Ipv4Addr::LOCALHOST, &mut body).unwrap();
            assert_eq!(body[len - 4..len] == [0; 4], found, "inquiry {inquiry}");
        }
    }

    #[test]
    fn a_cut_lookup_is_refused() {
        for len in 0..76 {
            assert!(Lookup::parse(&header(), &[0; 76][..len]).is_err());
        }
    }
}
