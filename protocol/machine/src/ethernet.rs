//! The Ethernet II header, with or without an IEEE 802.1Q tag.
//!
//! ```text
//! 0..6    destination
//! 6..12   source
//! 12..16  tag          0x8100, TCI   only where the frame is tagged
//! 12..14  EtherType    16..18 in a tagged frame
//! 14..    payload      18.. in a tagged frame; zeros bring the frame to 60 bytes
//! ```
//!
//! A network card or the kernel may take the tag off before we see the frame, so every frame is read with and without it.

use core::fmt;

use crate::wire::{BigEndian, Overflow, Reader, Truncated, Writer};

/// EtherType that announces an 802.1Q tag.
const ETHER_TYPE_TAG: u16 = 0x8100;

/// Length in bytes, without FCS, below which Ethernet frames are padded with zeros.
pub const MIN_FRAME_LEN: usize = 60;

/// An Ethernet MAC address.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct Mac(pub [u8; 6]);

impl Mac {
    /// Returns whether this is a group address; the broadcast address is one, too.
    #[must_use]
    pub const fn is_group(self) -> bool {
        self.0[0] & 1 != 0
    }
}

/// A text is not a MAC address.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct NotAMac;

impl fmt::Display for NotAMac {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a MAC address is six bytes such as 02:00:00:00:00:01")
    }
}

impl core::error::Error for NotAMac {}

impl core::str::FromStr for Mac {
    type Err = NotAMac;

    fn from_str(text: &str) -> Result<Self, NotAMac> {
        let mut mac = Self([0; 6]);
        let mut parts = text.split(':');
        for byte in &mut mac.0 {
            let part = parts.next().filter(|part| part.len() == 2).ok_or(NotAMac)?;
            // A sign would be a number too.
            if !part.bytes().all(|digit| digit.is_ascii_hexdigit()) {
                return Err(NotAMac);
            }
            *byte = u8::from_str_radix(part, 16).map_err(|_| NotAMac)?;
        }
        if parts.next().is_none() { Ok(mac) } else { Err(NotAMac) }
    }
}

impl fmt::Display for Mac {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b, c, d, e, g] = self.0;
        write!(f, "{a:02x}:{b:02x}:{c:02x}:{d:02x}:{e:02x}:{g:02x}")
    }
}

impl fmt::Debug for Mac {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// The tag control information of an 802.1Q tag: priority in bits 13..16, VLAN in bits 0..12.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Tag(pub u16);

impl Tag {
    /// Creates a tag with a priority from 0 to 7, the highest, and no VLAN.
    #[must_use]
    pub const fn priority(priority: u8) -> Self {
        Self((priority as u16 & 7) << 13)
    }
}

/// An Ethernet II header.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct EthernetHeader {
    /// Destination address.
    pub destination: Mac,
    /// Source address.
    pub source: Mac,
    /// The 802.1Q tag, if the frame has one.
    pub tag: Option<Tag>,
    /// EtherType of the payload.
    pub ether_type: u16,
}

impl EthernetHeader {
    /// Splits a frame into its header and its payload, padding included.
    pub fn parse(frame: &[u8]) -> Result<(Self, &[u8]), Truncated> {
        let mut reader = Reader::<BigEndian>::new(frame);
        let destination = Mac(reader.array()?);
        let source = Mac(reader.array()?);
        let mut ether_type = reader.u16()?;
        let mut tag = None;
        if ether_type == ETHER_TYPE_TAG {
            tag = Some(Tag(reader.u16()?));
            ether_type = reader.u16()?;
        }
        Ok((Self { destination, source, tag, ether_type }, reader.rest()))
    }

    /// Returns the length of the header in bytes.
    #[must_use]
    pub const fn buffer_len(&self) -> usize {
        if self.tag.is_some() { 18 } else { 14 }
    }

    /// Writes a whole frame: this header, what `payload` writes, and zeros up to [`MIN_FRAME_LEN`]. A tagged frame is
    /// padded to four bytes more, so that it keeps the minimum length when a switch removes the tag.
    ///
    /// Returns the frame's length in bytes.
    pub fn emit(
        &self,
        buf: &mut [u8],
        payload: impl FnOnce(&mut Writer<'_, BigEndian>),
    ) -> Result<usize, Overflow> {
        let mut writer = Writer::<BigEndian>::new(buf);
        writer.bytes(&self.destination.0);
        writer.bytes(&self.source.0);
        if let Some(Tag(tci)) = self.tag {
            writer.u16(ETHER_TYPE_TAG);
            writer.u16(tci);
        }
        writer.u16(self.ether_type);
        payload(&mut writer);
        writer.pad_to(MIN_FRAME_LEN + self.buffer_len() - 14);
        writer.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: EthernetHeader = EthernetHeader {
        destination: Mac([0x8C, 0xF3, 0x19, 0xCD, 0x19, 0xF8]),
        source: Mac([0xEC, 0x1C, 0x5D, 0x61, 0xE7, 0x3F]),
        tag: Some(Tag::priority(6)),
        ether_type: 0x8892,
    };

    /// First 20 bytes of a cyclic frame that a Siemens CPU 1515-2 PN V2.9.4 sent (test data of crate `pnio` 0.1.0).
    const SIEMENS: [u8; 20] = [
        0x8C, 0xF3, 0x19, 0xCD, 0x19, 0xF8, 0xEC, 0x1C, 0x5D, 0x61, 0xE7, 0x3F, 0x81, 0x00, 0xC0, 0x00, 0x88,
        0x92, 0x80, 0x01,
    ];

    #[test]
    fn a_priority_tagged_frame_has_the_specified_bytes() {
        let mut buf = [0xFF; 100];
        let len = HEADER.emit(&mut buf, |payload| payload.u16(0x8001)).unwrap();
        assert_eq!(len, 64);
        assert_eq!(buf[..20], SIEMENS);
        assert_eq!(buf[20..64], [0; 44]);
        assert_eq!(EthernetHeader::parse(&SIEMENS), Ok((HEADER, &[0x80, 0x01][..])));
    }

    #[test]
    fn a_mac_address_is_read_as_it_is_written() {
        let mac = Mac([2, 0, 0, 0xAB, 0, 1]);
        assert_eq!(mac.to_string().parse(), Ok(mac));
        for wrong in [
            "",
            "02:00:00:ab:00",
            "02:00:00:ab:00:01:02",
            "2:00:00:ab:00:01",
            "02:00:00:ab:00:+1",
            "02-00-00-ab-00-01",
        ] {
            assert!(wrong.parse::<Mac>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_frame_whose_tag_was_removed_parses_to_the_same_header_without_the_tag() {
        let untagged = EthernetHeader { tag: None, ..HEADER };
        let mut buf = [0xFF; 100];
        assert_eq!(untagged.emit(&mut buf, |payload| payload.u16(0x8001)), Ok(60));
        assert_eq!(EthernetHeader::parse(&buf[..16]), Ok((untagged, &[0x80, 0x01][..])));
    }

    #[test]
    fn a_header_cut_anywhere_is_truncated() {
        for len in 0..18 {
            assert!(EthernetHeader::parse(&SIEMENS[..len]).is_err(), "{len} bytes");
        }
    }
}
