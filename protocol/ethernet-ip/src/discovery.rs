//! Finding devices: the ListIdentity request over UDP to all devices, and its replies (volume 2, 2-4.3).
//!
//! ```text
//! item of type 0x000C, in each answer
//! 0..2   protocol version  u16
//! 2..18  socket address        family, port, address: most significant byte first; eight zeros
//! 18..20 vendor            u16
//! 20..22 device type       u16
//! 22..24 product code      u16
//! 24..26 revision              major, minor
//! 26..28 status            u16
//! 28..32 serial number     u32
//! 32..   product name          a length byte and so many characters
//! ..     state             u8
//! ```

use core::net::SocketAddrV4;

use super::Reader;
use super::cip::{ElectronicKey, Revision};
use super::cpf::{Item, Items, kind, read_address};
use super::description::Identity;
use super::encapsulation::{Command, HEADER_LEN, Header, Status};
use machine::wire::{Overflow, Truncated};

/// The reply of a device to ListIdentity.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct IdentityReply<'a> {
    /// The address at which the device says that it listens.
    pub address: SocketAddrV4,
    /// Its identity.
    pub identity: Identity,
    /// Status word of its Identity: bit 0 owned, bit 2 configured, bits 4 to 7 what I/O does.
    pub status: u16,
    /// Its product name, as bytes of whatever character set its vendor uses.
    pub product_name: &'a [u8],
    /// State of its Identity: 3 operational.
    pub state: u8,
}

/// Writes the request to all devices, for UDP port [`super::ENCAPSULATION_PORT`]. A device answers at once or after a
/// random delay of up to `answer_within_ms`, so that not all answer at the same time. Returns the length in bytes.
pub fn emit_request(buf: &mut [u8], answer_within_ms: u16) -> Result<usize, Overflow> {
    let mut header = Header::request(Command::ListIdentity, 0);
    let [low, high] = answer_within_ms.to_le_bytes();
    header.context = [low, high, 0, 0, 0, 0, 0, 0];
    header.emit(buf, |_| {})
}

impl<'a> IdentityReply<'a> {
    /// Parses a reply; `None` if the datagram is something else.
    #[must_use]
    pub fn parse(datagram: &'a [u8]) -> Option<Self> {
        let header = Header::parse(datagram).ok()?;
        if header.command != Command::ListIdentity || header.status != Status::Success {
            return None;
        }
        let data = datagram.get(HEADER_LEN..HEADER_LEN + usize::from(header.length))?;
        // A device may have more to say, for example how it is secured.
        let items = Items::parse(Reader::new(data)).ok()?;
        items.map_while(Result::ok).find_map(|item| match item {
            Item::Unknown(kind::LIST_IDENTITY, item) => Self::parse_item(item).ok(),
            _ => None,
        })
    }

    fn parse_item(item: &'a [u8]) -> Result<Self, Truncated> {
        let mut reader = Reader::new(item);
        reader.skip(2)?;
        let address = read_address(reader.sub(16)?)?;
        let (vendor, device_type, product_code) = (reader.u16()?, reader.u16()?, reader.u16()?);
        let revision = Revision { major: reader.u8()?, minor: reader.u8()? };
        let key = ElectronicKey { vendor, device_type, product_code, revision, compatible: false };
        let status = reader.u16()?;
        let identity = Identity { key, serial_number: reader.u32()? };
        let name_len = reader.u8()?;
        let product_name = reader.bytes(name_len.into())?;
        Ok(Self { address, identity, status, product_name, state: reader.u8()? })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Adapter, AdapterConfig, ENCAPSULATION_PORT};
    use super::*;
    use crate::cpf::{write_address, write_item};
    use crate::samples::DEVICE;
    use core::net::Ipv4Addr;
    use machine::{Instant, Machine, Port, Source};

    #[test]
    fn a_device_that_is_asked_tells_where_and_who_it_is() {
        let address = Ipv4Addr::new(192, 168, 64, 2);
        let mut adapter = Adapter::new(AdapterConfig {
            description: &DEVICE,
            serial_number: 0x1234_5678,
            address,
            mask: Ipv4Addr::new(255, 255, 255, 0),
            gateway: Ipv4Addr::UNSPECIFIED,
            mac: [2, 0, 0, 0, 0, 2],
            first_id: 1,
            originators: machine::Allowed::default(),
        });
        let mut buf = [0; 512];
        let len = emit_request(&mut buf, 500).unwrap();
        let peer = Some(SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, 1), 50_000));
        let from = Source { port: Port::Udp(ENCAPSULATION_PORT), peer };
        adapter.handle_frame(Instant::ZERO, from, &buf[..len]);
        let answer = adapter.poll_transmit(Instant::ZERO, &mut buf).unwrap();
        assert_eq!(answer.to, peer);
        let found = IdentityReply::parse(&buf[..answer.len]).unwrap();
        assert_eq!(found.address, SocketAddrV4::new(address, ENCAPSULATION_PORT));
        assert_eq!(found.identity, Identity { key: DEVICE.key(), serial_number: 0x1234_5678 });
        assert_eq!((found.product_name, found.state), (DEVICE.product_name.as_bytes(), 3));
        assert!((0..answer.len).all(|cut| IdentityReply::parse(&buf[..cut]).is_none()));
        // The command and the status stand at bytes 0 and 8 of the header.
        for (place, value) in [(0, 0x64), (8, 0x01)] {
            let mut other = buf;
            other[place] = value;
            assert_eq!(IdentityReply::parse(&other[..answer.len]), None, "{value} at byte {place}");
        }
    }

    #[test]
    fn an_identity_is_found_behind_another_item() {
        let mut buf = [0; 128];
        let header = Header::request(Command::ListIdentity, 0);
        let len = header.emit(&mut buf, |writer| {
            writer.u16(2);
            // CIP Security information (volume 8).
            write_item(writer, 0x0086, |writer| writer.bytes(&[0; 8]));
            write_item(writer, kind::LIST_IDENTITY, |writer| {
                writer.u16(1);
                write_address(writer, SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 9), ENCAPSULATION_PORT));
                writer.bytes(b"\x01\0\x0C\0\x41\0\x02\x03\x34\0\x78\x56\x34\x12\x04name\x03");
            });
        });
        let found = IdentityReply::parse(&buf[..len.unwrap()]).unwrap();
        assert_eq!((found.product_name, found.identity.serial_number), (&b"name"[..], 0x1234_5678));
    }
}
