//! The common packet format: a number of items, each with a type and a length (volume 2, 2-6).
//!
//! ```text
//! 0..2  item count  u16
//! then, for each item:
//! 0..2  type    u16
//! 2..4  length  u16  of the data, in bytes
//! 4..   data
//! ```

use core::net::{Ipv4Addr, SocketAddrV4};

use super::{Reader, Writer};
use machine::wire::{BigEndian, Truncated};

/// Bytes of interface handle and timeout, in front of the items of a SendRRData (volume 2, table 2-4.16).
const RR_HEAD_LEN: usize = 6;

/// Item types (volume 2, table 2-6.2).
pub mod kind {
    /// Null address: for unconnected messages.
    pub const NULL_ADDRESS: u16 = 0x0000;
    /// A device's answer to ListIdentity.
    pub const LIST_IDENTITY: u16 = 0x000C;
    /// The connection that connected data belongs to.
    pub const CONNECTED_ADDRESS: u16 = 0x00A1;
    /// Data of a connection.
    pub const CONNECTED_DATA: u16 = 0x00B1;
    /// An unconnected message.
    pub const UNCONNECTED_DATA: u16 = 0x00B2;
    /// A device's answer to ListServices.
    pub const LIST_SERVICES: u16 = 0x0100;
    /// Destination of O→T data.
    pub const SOCKET_ADDRESS_O_T: u16 = 0x8000;
    /// Destination of T→O data.
    pub const SOCKET_ADDRESS_T_O: u16 = 0x8001;
    /// Connection and sequence number of cyclic data.
    pub const SEQUENCED_ADDRESS: u16 = 0x8002;
}

/// One item.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Item<'a> {
    /// No address: the message is unconnected.
    NullAddress,
    /// The connection that the data belongs to.
    ConnectedAddress(u32),
    /// The connection, and the number of the frame in it.
    SequencedAddress {
        /// The connection.
        connection: u32,
        /// Counts the frames of this connection.
        sequence: u32,
    },
    /// Data of a connection.
    ConnectedData(&'a [u8]),
    /// An unconnected message.
    UnconnectedData(&'a [u8]),
    /// Destination of O→T data.
    SocketAddressOT(SocketAddrV4),
    /// Destination of T→O data.
    SocketAddressTO(SocketAddrV4),
    /// An item of another type.
    Unknown(u16, &'a [u8]),
}

/// The items of a message, read one by one.
#[derive(Clone, Debug)]
pub struct Items<'a> {
    reader: Reader<'a>,
    left: u16,
}

impl<'a> Items<'a> {
    /// Starts at the item count.
    pub fn parse(mut reader: Reader<'a>) -> Result<Self, Truncated> {
        let left = reader.u16()?;
        Ok(Self { reader, left })
    }

    fn read(&mut self) -> Result<Item<'a>, Truncated> {
        let kind = self.reader.u16()?;
        let length = self.reader.u16()?;
        let data = self.reader.bytes(usize::from(length))?;
        let mut inner = Reader::new(data);
        let item = match kind {
            kind::NULL_ADDRESS if data.is_empty() => Item::NullAddress,
            kind::CONNECTED_ADDRESS if data.len() == 4 => Item::ConnectedAddress(inner.u32()?),
            kind::SEQUENCED_ADDRESS if data.len() == 8 => {
                Item::SequencedAddress { connection: inner.u32()?, sequence: inner.u32()? }
            }
            kind::CONNECTED_DATA => Item::ConnectedData(data),
            kind::UNCONNECTED_DATA => Item::UnconnectedData(data),
            kind::SOCKET_ADDRESS_O_T if data.len() == 16 => Item::SocketAddressOT(read_address(inner)?),
            kind::SOCKET_ADDRESS_T_O if data.len() == 16 => Item::SocketAddressTO(read_address(inner)?),
            kind => Item::Unknown(kind, data),
        };
        Ok(item)
    }
}

impl<'a> Iterator for Items<'a> {
    type Item = Result<Item<'a>, Truncated>;

    fn next(&mut self) -> Option<Self::Item> {
        self.left = self.left.checked_sub(1)?;
        let item = self.read();
        if item.is_err() {
            self.left = 0;
        }
        Some(item)
    }
}

/// The address and the data of a message, with its socket addresses.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Packet<'a> {
    /// The first item.
    pub address: Option<Item<'a>>,
    /// The second item.
    pub data: Option<Item<'a>>,
    /// Destination of O→T data, if the sender gives one.
    pub socket_o_t: Option<SocketAddrV4>,
    /// Destination of T→O data, if the sender gives one.
    pub socket_t_o: Option<SocketAddrV4>,
}

impl<'a> Packet<'a> {
    /// Parses the data of a SendRRData: interface handle and timeout, which do not matter, and all items.
    pub fn parse_unconnected(data: &'a [u8]) -> Result<Self, Truncated> {
        let mut reader = Reader::new(data);
        reader.skip(RR_HEAD_LEN)?;
        Self::parse(reader)
    }

    /// Parses all items. Items of unknown types behind the first two are skipped.
    pub fn parse(reader: Reader<'a>) -> Result<Self, Truncated> {
        let mut packet = Self::default();
        for (index, item) in Items::parse(reader)?.enumerate() {
            match (index, item?) {
                (0, item) => packet.address = Some(item),
                (1, item) => packet.data = Some(item),
                (_, Item::SocketAddressOT(address)) => packet.socket_o_t = Some(address),
                (_, Item::SocketAddressTO(address)) => packet.socket_t_o = Some(address),
                _ => {}
            }
        }
        Ok(packet)
    }
}

/// Parses a socket address. It is written most significant byte first, unlike everything else (volume 2, 2-6.3.3).
pub(super) fn read_address(reader: Reader<'_>) -> Result<SocketAddrV4, Truncated> {
    let mut reader = reader.in_order::<BigEndian>();
    reader.skip(2)?;
    let port = reader.u16()?;
    Ok(SocketAddrV4::new(Ipv4Addr::from_bits(reader.u32()?), port))
}

/// Writes the 16 bytes of a socket address: family AF_INET, port, address, eight zeros.
pub fn write_address(writer: &mut Writer<'_>, address: SocketAddrV4) {
    writer.in_order::<BigEndian>(|writer| {
        writer.u16(2);
        writer.u16(address.port());
        writer.bytes(&address.ip().octets());
        writer.zeros(8);
    });
}

/// Writes an item of `kind` with what `data` writes, and its length.
pub fn write_item(writer: &mut Writer<'_>, kind: u16, data: impl FnOnce(&mut Writer<'_>)) {
    writer.u16(kind);
    let length_at = writer.len();
    writer.u16(0);
    let start = writer.len();
    data(writer);
    writer.patch_u16(length_at, u16::try_from(writer.len() - start).unwrap_or(u16::MAX));
}

/// Writes the data of a SendRRData: an unconnected message, which `message` writes.
pub fn write_unconnected(writer: &mut Writer<'_>, message: impl FnOnce(&mut Writer<'_>)) {
    writer.zeros(RR_HEAD_LEN);
    writer.u16(2);
    write_item(writer, kind::NULL_ADDRESS, |_| {});
    write_item(writer, kind::UNCONNECTED_DATA, message);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_items_of_a_forward_open_over_tcp_are_found() {
        let mut buf = [0; 64];
        let mut writer = Writer::new(&mut buf);
        writer.u16(3);
        write_item(&mut writer, kind::NULL_ADDRESS, |_| {});
        write_item(&mut writer, kind::UNCONNECTED_DATA, |w| w.bytes(b"cip"));
        let to = SocketAddrV4::new(Ipv4Addr::new(239, 192, 1, 32), 2222);
        write_item(&mut writer, kind::SOCKET_ADDRESS_T_O, |w| write_address(w, to));
        let len = writer.finish().unwrap();
        assert_eq!(&buf[13..21], b"\x01\x80\x10\x00\x00\x02\x08\xAE");
        let packet = Packet::parse(Reader::new(&buf[..len])).unwrap();
        assert_eq!(packet.address, Some(Item::NullAddress));
        assert_eq!(packet.data, Some(Item::UnconnectedData(b"cip")));
        assert_eq!((packet.socket_o_t, packet.socket_t_o), (None, Some(to)));
    }

    #[test]
    fn a_count_or_a_length_beyond_the_end_is_an_error() {
        assert!(Packet::parse(Reader::new(b"\xFF\xFF\x00\x00\x00\x00")).is_err());
        assert!(Packet::parse(Reader::new(b"\x01\x00\xB1\x00\xFF\xFFabc")).is_err());
        assert!(Packet::parse(Reader::new(b"\x01")).is_err());
        assert_eq!(Packet::parse(Reader::new(b"\0\0")), Ok(Packet::default()));
    }

    #[test]
    fn an_item_whose_length_does_not_match_its_type_is_unknown() {
        let lengths = [
            (kind::NULL_ADDRESS, 0),
            (kind::CONNECTED_ADDRESS, 4),
            (kind::SEQUENCED_ADDRESS, 8),
            (kind::SOCKET_ADDRESS_O_T, 16),
            (kind::SOCKET_ADDRESS_T_O, 16),
        ];
        for (kind, right) in lengths {
            for len in 0..20_u16 {
                let mut buf = [0; 32];
                let mut writer = Writer::new(&mut buf);
                writer.u16(1);
                write_item(&mut writer, kind, |writer| writer.zeros(len.into()));
                let end = writer.finish().unwrap();
                let item = Items::parse(Reader::new(&buf[..end])).unwrap().next().unwrap().unwrap();
                let is_unknown =
                    matches!(item, Item::Unknown(named, data) if named == kind && data.len() == end - 6);
                assert_eq!(is_unknown, len != right, "{kind:04X} with {len} bytes");
            }
        }
    }
}
