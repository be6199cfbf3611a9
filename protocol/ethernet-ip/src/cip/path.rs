//! Paths: a sequence of segments that says which object a request is for (volume 1, appendix C-1).
//!
//! ```text
//! first byte  segment
//! 000e pppp   port: p = 15 means a 16-bit port number follows; e = a length precedes the link address
//! 001t ttff   logical: t = class, instance, member, connection point, attribute, special; f = 8, 16, 32 bit
//! 010s ssss   network: s = 3 production inhibit time in ms (u8), 17 the same in µs (u32)
//! 011l llll   symbol: l characters
//! 100s ssss   data: s = 0 simple, a length in words and so many; 17 a symbol, a length in bytes and so many
//! ```
//!
//! All paths here are padded: each segment has an even length.

use super::super::{Reader, Writer};
use super::class;
use super::key::ElectronicKey;
use super::violation::Violation;
use machine::Duration;
use machine::wire::Truncated;

/// Kind of number in a logical segment.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Logical {
    /// A class.
    Class,
    /// An instance of the class.
    Instance,
    /// A member of an attribute.
    Member,
    /// A connection point: for an assembly the same as its instance.
    ConnectionPoint,
    /// An attribute.
    Attribute,
}

/// One segment.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Segment<'a> {
    /// A route through this port of the device to this address behind it.
    Port {
        /// Number of the port.
        port: u16,
        /// Address of the next device, in that network's form.
        link: &'a [u8],
    },
    /// A class, instance and so on.
    Logical(Logical, u32),
    /// The electronic key of the intended device.
    Key(ElectronicKey),
    /// Shortest time between two productions of the target.
    ProductionInhibit(Duration),
    /// Another network segment, by its type.
    Network(u8, &'a [u8]),
    /// A name.
    Symbol(&'a [u8]),
    /// Data: the configuration of the target.
    Data(&'a [u8]),
}

/// Type of the network segment of CIP Safety (volume 1, C-1.4.3).
const SAFETY: u8 = 0x10;

/// What is wrong with a path.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum PathError {
    /// A segment ends behind the path.
    #[error("a segment is cut off: {0}")]
    Truncated(#[from] Truncated),
    /// The first byte of a segment is not one of the standard's.
    #[error("no segment starts with 0x{0:02X}")]
    UnknownSegment(u8),
    /// The electronic key has an unknown format.
    #[error("an electronic key of format {0}; only 4 is known")]
    KeyFormat(u8),
}

/// A padded path.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Path<'a>(pub &'a [u8]);

impl<'a> Path<'a> {
    /// Returns the segments one by one; none after the first error.
    #[must_use]
    pub const fn segments(self) -> Segments<'a> {
        Segments { reader: Reader::new(self.0) }
    }

    /// Interprets the path as that of a request to an object of this device.
    pub fn target(self) -> Result<Target, Violation> {
        let mut target = Target::default();
        for segment in self.segments() {
            match segment {
                Ok(Segment::Logical(Logical::Class, value)) => target.class = Some(value),
                Ok(Segment::Logical(Logical::Instance | Logical::ConnectionPoint, value)) => {
                    target.instance = Some(value);
                }
                Ok(Segment::Logical(Logical::Attribute, value)) => target.attribute = Some(value),
                Ok(Segment::Logical(Logical::Member, value)) => target.member = Some(value),
                Ok(_) => return Err(Violation::PathSegment),
                Err(PathError::Truncated(_)) => return Err(Violation::PathSize),
                Err(_) => return Err(Violation::PathSegment),
            }
        }
        Ok(target)
    }

    /// Interprets the path as that of a Forward_Open.
    pub fn application(self) -> Result<Application<'a>, Violation> {
        let mut application = Application::default();
        for segment in self.segments() {
            match segment.map_err(|_| Violation::InvalidSegmentInPath)? {
                Segment::Key(key) => application.key = Some(key),
                Segment::Logical(Logical::Class, value) => application.class = Some(value),
                Segment::Logical(Logical::Instance | Logical::ConnectionPoint, value) => {
                    let free = application.points.iter_mut().find(|point| point.is_none());
                    *free.ok_or(Violation::InconsistentPathCombination)? = Some(value);
                }
                Segment::ProductionInhibit(time) => application.inhibit = Some(time),
                Segment::Data(data) => application.configuration = data,
                Segment::Port { .. } => return Err(Violation::InvalidPort),
                // What has a safety segment must not be opened as a connection without safety.
                Segment::Network(SAFETY, _) => return Err(Violation::InvalidSegmentInPath),
                Segment::Network(..) => {}
                Segment::Logical(..) | Segment::Symbol(_) => return Err(Violation::InvalidSegmentInPath),
            }
        }
        Ok(application)
    }
}

impl Application<'_> {
    /// Returns whether it is the Message Router, to which class 3 connections lead.
    pub(crate) fn is_message_router(&self) -> bool {
        self.class == Some(class::MESSAGE_ROUTER) && self.points == [Some(1), None, None]
    }
}

/// The object of a request.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Target {
    /// Class.
    pub class: Option<u32>,
    /// Instance, 0 for the class itself.
    pub instance: Option<u32>,
    /// Attribute.
    pub attribute: Option<u32>,
    /// Member of the attribute.
    pub member: Option<u32>,
}

/// What a Forward_Open connects to.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Application<'a> {
    /// The electronic key of the intended device.
    pub key: Option<ElectronicKey>,
    /// The last class named.
    pub class: Option<u32>,
    /// Instances or connection points, in their order.
    pub points: [Option<u32>; 3],
    /// Production inhibit time.
    pub inhibit: Option<Duration>,
    /// Configuration data.
    pub configuration: &'a [u8],
}

/// The segments of a [`Path`].
#[derive(Clone, Debug)]
pub struct Segments<'a> {
    reader: Reader<'a>,
}

impl<'a> Segments<'a> {
    fn read(&mut self) -> Result<Segment<'a>, PathError> {
        let first = self.reader.u8()?;
        match first >> 5 {
            0 => self.port(first),
            1 => self.logical(first),
            2 => self.network(first),
            3 => {
                let symbol = self.reader.bytes(usize::from(first & 0x1F))?;
                self.reader.align(2);
                if symbol.is_empty() {
                    return Err(PathError::UnknownSegment(first));
                }
                Ok(Segment::Symbol(symbol))
            }
            4 => self.data(first),
            _ => Err(PathError::UnknownSegment(first)),
        }
    }

    fn port(&mut self, first: u8) -> Result<Segment<'a>, PathError> {
        let extended = first & 0x10 != 0;
        let len = if extended { usize::from(self.reader.u8()?) } else { 1 };
        let port = match first & 0x0F {
            0 => return Err(PathError::UnknownSegment(first)),
            15 => self.reader.u16()?,
            port => u16::from(port),
        };
        let link = self.reader.bytes(len)?;
        self.reader.align(2);
        Ok(Segment::Port { port, link })
    }

    fn logical(&mut self, first: u8) -> Result<Segment<'a>, PathError> {
        let kind = match first >> 2 & 7 {
            0 => Logical::Class,
            1 => Logical::Instance,
            2 => Logical::Member,
            3 => Logical::ConnectionPoint,
            4 => Logical::Attribute,
            5 if first & 3 == 0 => {
                let format = self.reader.u8()?;
                if format != ElectronicKey::FORMAT {
                    return Err(PathError::KeyFormat(format));
                }
                return Ok(Segment::Key(ElectronicKey::parse(&mut self.reader)?));
            }
            _ => return Err(PathError::UnknownSegment(first)),
        };
        let value = match first & 3 {
            0 => u32::from(self.reader.u8()?),
            1 => {
                self.reader.skip(1)?;
                u32::from(self.reader.u16()?)
            }
            2 => {
                self.reader.skip(1)?;
                self.reader.u32()?
            }
            _ => return Err(PathError::UnknownSegment(first)),
        };
        Ok(Segment::Logical(kind, value))
    }

    fn network(&mut self, first: u8) -> Result<Segment<'a>, PathError> {
        let kind = first & 0x1F;
        let data = if kind & 0x10 == 0 {
            self.reader.bytes(1)?
        } else {
            let words = self.reader.u8()?;
            self.reader.bytes(2 * usize::from(words))?
        };
        let mut inner = Reader::new(data);
        Ok(match kind {
            0x03 => Segment::ProductionInhibit(Duration::from_millis(inner.u8()?.into())),
            0x11 => Segment::ProductionInhibit(Duration::from_micros(inner.u32()?.into())),
            kind => Segment::Network(kind, data),
        })
    }

    fn data(&mut self, first: u8) -> Result<Segment<'a>, PathError> {
        let len = usize::from(self.reader.u8()?);
        match first & 0x1F {
            0x00 => Ok(Segment::Data(self.reader.bytes(2 * len)?)),
            0x11 => {
                let symbol = self.reader.bytes(len)?;
                self.reader.align(2);
                Ok(Segment::Symbol(symbol))
            }
            _ => Err(PathError::UnknownSegment(first)),
        }
    }
}

impl<'a> Iterator for Segments<'a> {
    type Item = Result<Segment<'a>, PathError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.reader.is_empty() {
            return None;
        }
        let segment = self.read();
        if segment.is_err() {
            self.reader = Reader::new(&[]);
        }
        Some(segment)
    }
}

/// Writes a logical segment in its shortest form: with 8 bits if possible.
pub fn write_logical(writer: &mut Writer<'_>, kind: Logical, value: u32) {
    let first = 0x20
        | match kind {
            Logical::Class => 0,
            Logical::Instance => 1 << 2,
            Logical::Member => 2 << 2,
            Logical::ConnectionPoint => 3 << 2,
            Logical::Attribute => 4 << 2,
        };
    if let Ok(value) = u8::try_from(value) {
        writer.bytes(&[first, value]);
    } else if let Ok(value) = u16::try_from(value) {
        writer.bytes(&[first | 1, 0]);
        writer.u16(value);
    } else {
        writer.bytes(&[first | 2, 0]);
        writer.u32(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec::Vec;

    fn segments(path: &[u8]) -> Result<Vec<Segment<'_>>, PathError> {
        Path(path).segments().collect()
    }

    #[test]
    fn logical_segments_of_8_16_and_32_bits_have_the_same_meaning() {
        let expected = Segment::Logical(Logical::Class, 4);
        for path in [&[0x20, 4][..], &[0x21, 0, 4, 0], &[0x22, 0, 4, 0, 0, 0]] {
            assert_eq!(segments(path).as_deref(), Ok(&[expected][..]), "{path:02X?}");
        }
    }

    #[test]
    fn a_forward_open_path_names_key_configuration_and_both_connection_points() {
        let path = b"\x34\x04\x01\x00\x0C\x00\x41\x00\x82\x03\x43\x05\x20\x04\x24\x97\x2C\x96\x2C\x64\x80\x01\xAB\xCD";
        let application = Path(path).application().unwrap();
        assert_eq!(application.points, [Some(151), Some(150), Some(100)]);
        assert_eq!(application.key.map(|key| (key.vendor, key.compatible)), Some((1, true)));
        assert_eq!(application.inhibit, Some(Duration::from_millis(5)));
        assert_eq!((application.class, application.configuration), (Some(4), &b"\xAB\xCD"[..]));
    }

    #[test]
    fn a_port_segment_carries_a_link_address_of_any_length() {
        let path = b"\x01\x00\x12\x0B10.0.0.2:80\x00\x0F\x22\x01\x07";
        assert_eq!(
            segments(path).unwrap(),
            [
                Segment::Port { port: 1, link: &[0] },
                Segment::Port { port: 2, link: b"10.0.0.2:80" },
                Segment::Port { port: 0x0122, link: &[7] },
            ]
        );
    }

    #[test]
    fn every_truncated_segment_is_an_error() {
        for path in [
            &[0x34, 4, 1, 0][..],
            &[0x20],
            &[0x21, 0, 4],
            &[0x80, 9, 1, 2],
            &[0x43],
            &[0x51, 2, 1],
            &[0x12, 9, 1],
        ] {
            assert!(matches!(segments(path), Err(PathError::Truncated(_))), "{path:02X?}");
        }
        assert_eq!(segments(&[0xE0, 0]), Err(PathError::UnknownSegment(0xE0)));
        assert_eq!(segments(&[0x34, 5, 0]), Err(PathError::KeyFormat(5)));
    }

    #[test]
    fn a_symbol_is_short_or_extended_and_filled_up_to_whole_words() {
        let path = b"\x62ab\0\x63abc\x91\x03abc\0\x20\x04";
        let symbol = |name: &'static [u8]| Segment::Symbol(name);
        let class = Segment::Logical(Logical::Class, 4);
        assert_eq!(segments(path).unwrap(), [symbol(b"ab"), symbol(b"abc"), symbol(b"abc"), class]);
        assert_eq!(segments(&[0x60, 0]), Err(PathError::UnknownSegment(0x60)));
    }

    #[test]
    fn a_network_segment_has_one_byte_or_as_many_words_as_it_says() {
        let path = [0x41, 7, 0x50, 1, 1, 2, 0x52, 3, 1, 2, 3, 4, 5, 6, 0x20, 4];
        let network = |kind, data| Segment::Network(kind, data);
        let expected = [
            network(0x01, &[7]),
            network(0x10, &[1, 2]),
            network(0x12, &[1, 2, 3, 4, 5, 6]),
            Segment::Logical(Logical::Class, 4),
        ];
        assert_eq!(segments(&path).unwrap(), expected);
    }

    #[test]
    fn of_the_special_logical_segments_only_the_electronic_key_is_known() {
        for first in [0x35, 0x36, 0x37, 0x38] {
            let path = [first, 4, 0, 0, 0, 0, 0, 0, 0, 0];
            assert_eq!(segments(&path), Err(PathError::UnknownSegment(first)));
        }
    }

    #[test]
    fn each_kind_of_logical_segment_is_written_and_read_by_its_number() {
        let kinds = [
            (Logical::Class, 0x20),
            (Logical::Instance, 0x24),
            (Logical::Member, 0x28),
            (Logical::ConnectionPoint, 0x2C),
            (Logical::Attribute, 0x30),
        ];
        for (kind, first) in kinds {
            let mut buf = [0; 2];
            let mut writer = Writer::new(&mut buf);
            write_logical(&mut writer, kind, 9);
            assert_eq!((writer.finish(), buf), (Ok(2), [first, 9]));
            assert_eq!(segments(&buf).unwrap(), [Segment::Logical(kind, 9)]);
        }
    }

    #[test]
    fn a_number_is_written_in_its_shortest_form() {
        let mut buf = [0; 14];
        let mut writer = Writer::new(&mut buf);
        write_logical(&mut writer, Logical::Class, 4);
        write_logical(&mut writer, Logical::Instance, 0x300);
        write_logical(&mut writer, Logical::ConnectionPoint, 0x1_0000);
        assert_eq!(writer.finish(), Ok(12));
        assert_eq!(&buf[..12], [0x20, 4, 0x25, 0, 0, 3, 0x2E, 0, 0, 0, 1, 0]);
    }
}
