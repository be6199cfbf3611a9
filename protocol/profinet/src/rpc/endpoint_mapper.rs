//! The endpoint mapper's Lookup: returns the UDP port of an interface (C706, chapter 6 and appendix L).
//!
//! ```text
//! request   inquiry type u32 · object: pointer u32, UUID 16? · interface: pointer u32, (UUID 16, major u16, minor u16)?
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

use super::{DataRepresentation, ENDPOINT_MAPPER_INTERFACE, Header, INSTANCE, object};
use crate::description::Description;
use crate::{RPC_PORT, Uuid};
use machine::wire::{BigEndian, ByteOrder, LittleEndian, Overflow, Reader, Truncated, Writer};

/// Operation number of Lookup.
pub const LOOKUP: u16 = 2;
/// Operation number of LookupHandleFree.
pub const LOOKUP_HANDLE_FREE: u16 = 4;

/// Status: nothing (more) is registered.
const NOT_REGISTERED: u32 = 0x16C9_A0D6;
/// Transfer syntax NDR, version 2.
const NDR: Uuid = Uuid(0x8A88_5D04_1CEB_11C9_9FE8_0800_2B10_4860_u128.to_be_bytes());
/// Length in bytes of a Lookup request with both values.
const WHOLE_LEN: usize = 76;
/// Length in bytes of an entry handle.
const HANDLE_LEN: usize = 20;
/// Length in bytes of the annotation, with the 0 at its end.
const ANNOTATION_LEN: usize = 64;

/// The server of a station, which its endpoint mapper names.
#[derive(Clone, Copy, Debug)]
pub struct Endpoint<'a> {
    /// InterfaceUUID: that of a device or of a controller.
    pub interface: Uuid,
    /// ObjectUUID.
    pub object: Uuid,
    /// Names and versions of the station.
    pub description: &'a Description,
    /// UDP port of the server.
    pub port: u16,
    /// IP address of the station.
    pub address: Ipv4Addr,
}

impl<'a> Endpoint<'a> {
    /// Returns the server of one of our own stations.
    #[must_use]
    pub fn of(interface: Uuid, description: &'a Description, address: Ipv4Addr) -> Self {
        let object = object(INSTANCE, description.identity);
        Self { interface, object, description, port: RPC_PORT, address }
    }
}

/// A call of the endpoint mapper.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum MapperCall {
    /// Asks for the servers of the station.
    Lookup(Lookup),
    /// Ends an inquiry early.
    FreeHandle,
}

/// Why a call of the endpoint mapper is not answered.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum MapperError {
    /// It is truncated.
    #[error("the endpoint mapper's request is cut: {0}")]
    Truncated(#[from] Truncated),
    /// The operation is another one.
    #[error("operation {0} of the endpoint mapper is not supported")]
    Operation(u16),
}

impl MapperCall {
    /// Parses a call from its header and body.
    pub fn parse(header: &Header, body: &[u8]) -> Result<Self, MapperError> {
        match header.operation {
            LOOKUP => Ok(Self::Lookup(Lookup::parse(header, body)?)),
            LOOKUP_HANDLE_FREE => Ok(Self::FreeHandle),
            other => Err(MapperError::Operation(other)),
        }
    }

    /// Writes the answer's body, big-endian. Returns its length.
    pub fn answer(&self, endpoint: &Endpoint<'_>, body: &mut [u8]) -> Result<usize, Overflow> {
        let mut writer = Writer::<BigEndian>::new(body);
        match self {
            Self::Lookup(lookup) => lookup.answer(endpoint, &mut writer),
            // The returned handle is nil, because there was nothing to free; then the status.
            Self::FreeHandle => writer.zeros(HANDLE_LEN + 4),
        }
        writer.finish()
    }
}

/// The fields of a Lookup request on which the answer depends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Lookup {
    /// EntryHandle: nil in the first call of an inquiry, then that of the answer before.
    pub handle: Uuid,
    /// The only interface that it asks for, if any.
    pub interface: Option<Uuid>,
    /// The only object that it asks for, if any.
    pub object: Option<Uuid>,
    /// Largest number of entries in the answer.
    pub most_entries: u32,
}

impl Lookup {
    /// Parses a request's body in the byte order of its header.
    fn parse(header: &Header, body: &[u8]) -> Result<Self, Truncated> {
        match header.order {
            DataRepresentation::BigEndian => Self::parse_in::<BigEndian>(body),
            DataRepresentation::LittleEndian => Self::parse_in::<LittleEndian>(body),
        }
    }

    fn parse_in<O: ByteOrder>(body: &[u8]) -> Result<Self, Truncated> {
        let mut reader = Reader::<O>::new(body);
        let inquiry = reader.u32()?;
        // Nothing follows a pointer that is null. Stations of PROFINET send both values in any case.
        let is_whole = body.len() >= WHOLE_LEN;
        let (mut object, mut interface) = (Uuid::NIL, Uuid::NIL);
        if reader.u32()? != 0 || is_whole {
            object = Uuid::read(&mut reader)?;
        }
        if reader.u32()? != 0 || is_whole {
            interface = Uuid::read(&mut reader)?;
            reader.skip(2 + 2)?;
        }
        reader.skip(4 + 4)?;
        let handle = Uuid::read(&mut reader)?;
        let most_entries = reader.u32()?;
        Ok(Self {
            handle,
            interface: matches!(inquiry, 1 | 3).then_some(interface),
            object: matches!(inquiry, 2 | 3).then_some(object),
            most_entries,
        })
    }

    /// Writes the answer: the first call of an inquiry gets the endpoint mapper itself, the next one the station's server, as far
    /// as it asks for them; the one after them the end of the list.
    fn answer(&self, endpoint: &Endpoint<'_>, writer: &mut Writer<'_, BigEndian>) {
        let Endpoint { interface, object, description, port, address } = *endpoint;
        let is_wanted = |wanted: Option<Uuid>, there| wanted.is_none_or(|wanted| wanted == there);
        let mapper = EndpointEntry { object: Uuid::NIL, interface: ENDPOINT_MAPPER_INTERFACE, version: 3 };
        let entries = [mapper, EndpointEntry { object, interface, version: 1 }];
        let mut wanted = (1..).zip(entries).filter(|(_, entry)| {
            is_wanted(self.interface, entry.interface) && is_wanted(self.object, entry.object)
        });
        let found = match self.handle {
            _ if self.most_entries == 0 => None,
            Uuid::NIL => wanted.next(),
            handle => wanted.find(|(number, _)| handle == entry_handle(number - 1, object)),
        };
        writer.u32(0);
        let handle = found.map_or(Uuid::NIL, |(number, _)| entry_handle(number, object));
        handle.write(writer);
        writer.u32(found.is_some().into());
        writer.u32(self.most_entries.min(1));
        writer.u32(0);
        writer.u32(found.is_some().into());
        if let Some((_, entry)) = found {
            entry.object.write(writer);
            writer.u32(3);
            writer.u32(0);
            writer.u32(ANNOTATION_LEN as u32);
            write_annotation(description, writer);
            write_tower(&entry, port, address, writer);
        }
        writer.u32(if found.is_some() { 0 } else { NOT_REGISTERED });
    }
}

/// What the endpoint mapper knows.
#[derive(Clone, Copy, Debug)]
struct EndpointEntry {
    object: Uuid,
    interface: Uuid,
    /// Major version of the interface.
    version: u16,
}

/// Returns the handle with which an inquiry continues behind entry `number`, so that the server need not remember it: the
/// station's ObjectUUID with this number in place of its first bytes.
const fn entry_handle(number: u32, object: Uuid) -> Uuid {
    let Uuid([.., a, b, c, d, e, f, g, h, i, j, k, l]) = object;
    let [w, x, y, z] = number.to_be_bytes();
    Uuid([w, x, y, z, a, b, c, d, e, f, g, h, i, j, k, l])
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

fn write_tower(entry: &EndpointEntry, port: u16, address: Ipv4Addr, writer: &mut Writer<'_, BigEndian>) {
    const TOWER_LEN: u32 = 2 + 2 * (2 + 19 + 2 + 2) + 2 * (2 + 1 + 2 + 2) + (2 + 1 + 2 + 4);
    writer.u32(TOWER_LEN);
    writer.u32(TOWER_LEN);
    writer.in_order::<LittleEndian>(|w| {
        w.u16(5);
        for (uuid, major) in [(entry.interface, entry.version), (NDR, 2)] {
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
    use proptest::prelude::*;

    use super::*;
    use crate::rpc::{CONTROLLER_INTERFACE, DEVICE_INTERFACE, Operation};
    use crate::samples;

    fn header() -> Header {
        let operation = Operation::Unknown(LOOKUP);
        Header::request(operation, Uuid::NIL, ENDPOINT_MAPPER_INTERFACE, Uuid([1; 16]), 0)
    }

    fn answer(lookup: Lookup, object: Uuid, address: Ipv4Addr, body: &mut [u8]) -> usize {
        let (interface, description) = (DEVICE_INTERFACE, &samples::P_NET);
        let endpoint = Endpoint { interface, object, description, port: 34964, address };
        MapperCall::Lookup(lookup).answer(&endpoint, body).unwrap()
    }

    #[test]
    fn the_first_lookup_returns_the_mapper_the_second_the_server_and_the_third_ends_the_inquiry() {
        let mut request = [0; 76];
        request[75] = 1;
        let object = Uuid([5; 16]);
        let mut body = [0; 300];
        let mut found = Vec::new();
        for _ in 0..3 {
            let lookup = Lookup::parse(&header(), &request).unwrap();
            assert_eq!((lookup.interface, lookup.object, lookup.most_entries), (None, None, 1));
            let len = answer(lookup, object, Ipv4Addr::new(10, 0, 0, 2), &mut body);
            found.push((len, u32::from_be_bytes(body[len - 4..len].try_into().unwrap())));
            let port_and_address = [0x88, 0x94, 1, 0, 9, 4, 0, 10, 0, 0, 2];
            let names_port = body[..len].windows(11).any(|window| window == port_and_address);
            assert_eq!(names_port, found.len() < 3);
            request[52..72].copy_from_slice(&body[..20]);
        }
        const ENTRY: usize = 20 + 16 + 16 + 4 + 8 + 64 + 8 + 76 + 4;
        assert_eq!(found, [(ENTRY, 0), (ENTRY, 0), (40, NOT_REGISTERED)]);
        assert_eq!(request[52..72], [0; 20], "the handle is nil again");
    }

    #[test]
    fn the_annotation_has_type_article_number_and_versions_at_their_places() {
        let mut request = [0; 76];
        request[75] = 1;
        let lookup = Lookup::parse(&header(), &request).unwrap();
        let mut body = [0; 300];
        answer(lookup, Uuid([5; 16]), Ipv4Addr::LOCALHOST, &mut body);
        let text = b"P-Net Sample Application  12345 Abcdefghijk        3 V  0  2  0\0";
        assert_eq!(text.len(), 64);
        assert_eq!(body[64..128], text[..], "{}", String::from_utf8_lossy(&body[64..128]));
    }

    #[test]
    fn a_lookup_of_another_interface_or_object_finds_nothing() {
        let object = Uuid([5; 16]);
        for (inquiry, asked_object, interface, found) in [
            (1, Uuid::NIL, DEVICE_INTERFACE, true),
            (1, Uuid::NIL, ENDPOINT_MAPPER_INTERFACE, true),
            (1, Uuid::NIL, CONTROLLER_INTERFACE, false),
            (2, object, Uuid::NIL, true),
            (2, Uuid::NIL, Uuid::NIL, true),
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
            let len = answer(lookup, object, Ipv4Addr::LOCALHOST, &mut body);
            assert_eq!(body[len - 4..len] == [0; 4], found, "inquiry {inquiry}");
            // There is only one of each.
            request[52..72].copy_from_slice(&body[..20]);
            let next = Lookup::parse(&header(), &request).unwrap();
            if found {
                let len = answer(next, object, Ipv4Addr::LOCALHOST, &mut body);
                assert_eq!(body[len - 4..len], NOT_REGISTERED.to_be_bytes());
            }
        }
    }

    proptest! {
        #[test]
        fn any_call_in_either_order_is_refused_or_answered_with_at_most_one_entry(
            operation in 0_u16..6,
            little in any::<bool>(),
            body in proptest::collection::vec(any::<u8>(), 60..90),
        ) {
            let order =
                if little { DataRepresentation::LittleEndian } else { DataRepresentation::BigEndian };
            let header = Header { operation, order, ..header() };
            if let Ok(asked) = MapperCall::parse(&header, &body) {
                let endpoint = Endpoint {
                    interface: DEVICE_INTERFACE,
                    object: Uuid([5; 16]),
                    description: &samples::P_NET,
                    port: 34964,
                    address: Ipv4Addr::LOCALHOST,
                };
                let len = asked.answer(&endpoint, &mut [0; 300]).unwrap();
                prop_assert!([24, 40, 268].contains(&len), "{}", len);
            }
        }
    }

    #[test]
    fn a_cut_lookup_is_refused() {
        let mut request = [0; 76];
        (request[7], request[27]) = (1, 2);
        for len in 0..76 {
            assert!(Lookup::parse(&header(), &request[..len]).is_err());
        }
        assert!(Lookup::parse(&header(), &request).is_ok());
        for len in 0..40 {
            assert!(Lookup::parse(&header(), &request[28..28 + len]).is_err(), "two null pointers");
        }
    }

    #[test]
    fn values_whose_pointers_are_null_are_left_out() {
        let uuid = [5; 16];
        let interface = [&DEVICE_INTERFACE.0[..], &[0, 1, 0, 0]].concat();
        // Vers option, handle, most entries.
        let rest = [&[0; 27][..], &[1]].concat();
        for (inquiry, object, interface) in [
            (0, None, None),
            (1, None, Some(&interface)),
            (2, Some(&uuid), None),
            (3, Some(&uuid), Some(&interface)),
        ] {
            let pointer = |is_there| [0, 0, 0, u8::from(is_there)];
            let (of_object, of_interface) = (pointer(object.is_some()), pointer(interface.is_some()));
            let request = [
                &[0, 0, 0, inquiry][..],
                &of_object,
                object.map_or(&[], |object| &object[..]),
                &of_interface,
                interface.map_or(&[], |interface| &interface[..]),
                &rest,
            ]
            .concat();
            let lookup = Lookup::parse(&header(), &request).unwrap();
            let wanted = Lookup {
                handle: Uuid::NIL,
                interface: interface.map(|_| DEVICE_INTERFACE),
                object: object.map(|uuid| Uuid(*uuid)),
                most_entries: 1,
            };
            assert_eq!(lookup, wanted, "inquiry {inquiry}");
        }
    }
}
