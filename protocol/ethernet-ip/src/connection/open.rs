//! Forward_Open, Large_Forward_Open and Forward_Close on the wire (volume 1, 3-5.5.2 and 3-5.5.3).
//!
//! ```text
//! Forward_Open request                     Forward_Close request
//! 0     priority and time tick   u8        0     priority and time tick   u8
//! 1     timeout ticks            u8        1     timeout ticks            u8
//! 2..6  O→T connection           u32       2..4  connection serial        u16
//! 6..10 T→O connection           u32       4..6  originator's vendor      u16
//! 10..12 connection serial       u16       6..10 originator's serial      u32
//! 12..14 originator's vendor     u16       10    path size                u8, words
//! 14..18 originator's serial     u32       11    0
//! 18    timeout multiplier       u8        12..  path
//! 19..22 0
//! 22..26 O→T packet interval     u32, µs
//! 26..28 O→T parameters          u16 (u32 in Large_Forward_Open, all behind it 2 later)
//! 28..32 T→O packet interval     u32, µs
//! 32..34 T→O parameters          u16 (u32)
//! 34    transport                u8
//! 35    path size                u8, words
//! 36..  path
//!
//! reply, opened                            reply, refused             reply, closed
//! 0..4   O→T connection       u32          0..2 connection serial     0..2 connection serial
//! 4..8   T→O connection       u32          2..4 originator's vendor   2..4 originator's vendor
//! 8..10  connection serial    u16          4..8 originator's serial   4..8 originator's serial
//! 10..12 originator's vendor  u16          8    path left, words      8    application reply, words
//! 12..16 originator's serial  u32          9    0                     9    0
//! 16..20 O→T real interval    u32, µs                                 10.. application reply
//! 20..24 T→O real interval    u32, µs
//! 24     application reply    u8, words
//! 25     0
//! 26..   application reply
//! ```

use super::super::{Reader, Writer, cip};
use super::data::{ConnectionData, DirectionData};
use super::parameters::{Parameters, Transport};
use super::timing::TimeoutMultiplier;
use super::triad::Triad;
use crate::PORT_NUMBER;
use cip::{Path, Violation};
use machine::wire::Truncated;

/// Priority/tick 10 and 240 ticks: a request may take 2^10 ms × 240 to pass routers.
const TIME_TICK: [u8; 2] = [0x0A, 0xF0];

/// The request of a Forward_Open or Large_Forward_Open.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OpenRequest<'a> {
    /// Number of the O→T connection; for point to point the target chooses its own.
    pub o_t_id: u32,
    /// Number of the T→O connection.
    pub t_o_id: u32,
    /// Identity of the connection.
    pub triad: Triad,
    /// Code of the timeout multiplier, possibly an undefined one.
    pub multiplier: u8,
    /// Requested packet interval O→T in µs.
    pub o_t_rpi_us: u32,
    /// Parameters O→T.
    pub o_t: Parameters,
    /// Requested packet interval T→O in µs.
    pub t_o_rpi_us: u32,
    /// Parameters T→O.
    pub t_o: Parameters,
    /// Transport class and trigger.
    pub transport: Transport,
    /// What to connect to.
    pub path: Path<'a>,
}

impl<'a> OpenRequest<'a> {
    /// Parses a request; `large` for a Large_Forward_Open.
    pub fn parse(data: &'a [u8], large: bool) -> Result<Self, Violation> {
        let mut reader = Reader::new(data);
        let request = Self::parse_fields(&mut reader, large).map_err(|_| Violation::TooShort)?;
        let path = parse_path(&mut reader, false)?;
        Ok(Self { path, ..request })
    }

    /// Returns the data of the connection that a target opens on request: its number, the numbers O→T and T→O in use, and the
    /// actual packet interval T→O in µs.
    #[must_use]
    pub const fn data(
        &self,
        number: u16,
        multiplier: TimeoutMultiplier,
        (o_t_id, t_o_id): (u32, u32),
        t_o_api_us: u32,
    ) -> ConnectionData {
        let multiplier = multiplier.code();
        let Self { o_t_rpi_us, t_o_rpi_us, triad, .. } = *self;
        ConnectionData {
            number,
            originator_port: PORT_NUMBER,
            target_port: 0,
            triad,
            o_t: DirectionData {
                originator_id: self.o_t_id,
                target_id: o_t_id,
                multiplier,
                rpi_us: o_t_rpi_us,
                api_us: o_t_rpi_us,
            },
            t_o: DirectionData {
                originator_id: self.t_o_id,
                target_id: t_o_id,
                multiplier,
                rpi_us: t_o_rpi_us,
                api_us: t_o_api_us,
            },
        }
    }

    fn parse_fields(reader: &mut Reader<'_>, large: bool) -> Result<Self, Truncated> {
        let parameters = |reader: &mut Reader<'_>| {
            Ok(if large {
                Parameters::from_large(reader.u32()?)
            } else {
                Parameters::from_plain(reader.u16()?)
            })
        };
        reader.skip(2)?;
        let (o_t_id, t_o_id) = (reader.u32()?, reader.u32()?);
        let triad = Triad::parse(reader)?;
        let multiplier = reader.u8()?;
        reader.skip(3)?;
        let (o_t_rpi_us, o_t) = (reader.u32()?, parameters(reader)?);
        let (t_o_rpi_us, t_o) = (reader.u32()?, parameters(reader)?);
        let transport = Transport(reader.u8()?);
        let path = Path(&[]);
        Ok(Self { o_t_id, t_o_id, triad, multiplier, o_t_rpi_us, o_t, t_o_rpi_us, t_o, transport, path })
    }

    /// Writes the request; `large` for a Large_Forward_Open.
    pub fn emit(&self, writer: &mut Writer<'_>, large: bool) {
        let parameters = |writer: &mut Writer<'_>, parameters: Parameters| {
            if large { writer.u32(parameters.to_large()) } else { writer.u16(parameters.to_plain()) }
        };
        writer.bytes(&TIME_TICK);
        writer.u32(self.o_t_id);
        writer.u32(self.t_o_id);
        self.triad.emit(writer);
        writer.bytes(&[self.multiplier, 0, 0, 0]);
        writer.u32(self.o_t_rpi_us);
        parameters(writer, self.o_t);
        writer.u32(self.t_o_rpi_us);
        parameters(writer, self.t_o);
        writer.u8(self.transport.0);
        writer.u8(u8::try_from(self.path.0.len() / 2).unwrap_or(u8::MAX));
        writer.bytes(self.path.0);
    }
}

/// Parses the path of a connection at the end of a request. In a Forward_Close a zero byte precedes it.
fn parse_path<'a>(reader: &mut Reader<'a>, reserved: bool) -> Result<Path<'a>, Violation> {
    let words = reader.u8().map_err(|_| Violation::TooShort)?;
    if reserved {
        reader.skip(1).map_err(|_| Violation::TooShort)?;
    }
    let path = reader.bytes(2 * usize::from(words)).map_err(|_| Violation::TooShort)?;
    if reader.is_empty() { Ok(Path(path)) } else { Err(Violation::TooLong) }
}

/// The reply of a target that opened the connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OpenReply {
    /// Number of the O→T connection.
    pub o_t_id: u32,
    /// Number of the T→O connection.
    pub t_o_id: u32,
    /// Identity of the connection.
    pub triad: Triad,
    /// Actual packet interval O→T in µs.
    pub o_t_api_us: u32,
    /// Actual packet interval T→O in µs.
    pub t_o_api_us: u32,
}

impl OpenReply {
    /// Parses the reply's data.
    pub fn parse(data: &[u8]) -> Result<Self, Truncated> {
        let mut reader = Reader::new(data);
        Ok(Self {
            o_t_id: reader.u32()?,
            t_o_id: reader.u32()?,
            triad: Triad::parse(&mut reader)?,
            o_t_api_us: reader.u32()?,
            t_o_api_us: reader.u32()?,
        })
    }

    /// Writes the reply's data.
    pub fn emit(&self, writer: &mut Writer<'_>) {
        writer.u32(self.o_t_id);
        writer.u32(self.t_o_id);
        self.triad.emit(writer);
        writer.u32(self.o_t_api_us);
        writer.u32(self.t_o_api_us);
        writer.u16(0);
    }
}

/// The data behind the status of a target that refused to open or to close a connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct RefusedReply {
    /// Identity of the connection.
    pub triad: Triad,
    /// What is left of the path, in words: the path as this device received it where it cannot follow its route, otherwise 0.
    pub path_left: u8,
}

impl RefusedReply {
    /// Writes the data.
    pub fn emit(&self, writer: &mut Writer<'_>) {
        self.triad.emit(writer);
        writer.bytes(&[self.path_left, 0]);
    }

    /// Reads the triad from a request that may be truncated.
    #[must_use]
    pub fn from_open_request(data: &[u8]) -> Option<Self> {
        let triad = data.get(10..).and_then(|data| Triad::parse(&mut Reader::new(data)).ok());
        triad.map(|triad| Self { triad, path_left: 0 })
    }

    /// Reads the triad from a Forward_Close that may be truncated.
    #[must_use]
    pub fn from_close_request(data: &[u8]) -> Option<Self> {
        let triad = data.get(2..).and_then(|data| Triad::parse(&mut Reader::new(data)).ok());
        triad.map(|triad| Self { triad, path_left: 0 })
    }
}

/// The request of a Forward_Close.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CloseRequest<'a> {
    /// Identity of the connection to close.
    pub triad: Triad,
    /// The path with which it was opened, or none.
    pub path: Path<'a>,
}

impl<'a> CloseRequest<'a> {
    /// Parses a request.
    pub fn parse(data: &'a [u8]) -> Result<Self, Violation> {
        let mut reader = Reader::new(data);
        reader.skip(2).map_err(|_| Violation::TooShort)?;
        let triad = Triad::parse(&mut reader).map_err(|_| Violation::TooShort)?;
        Ok(Self { triad, path: parse_path(&mut reader, true)? })
    }

    /// Writes the request.
    pub fn emit(&self, writer: &mut Writer<'_>) {
        writer.bytes(&TIME_TICK);
        self.triad.emit(writer);
        writer.u8(u8::try_from(self.path.0.len() / 2).unwrap_or(u8::MAX));
        writer.u8(0);
        writer.bytes(self.path.0);
    }
}

/// The reply of a target that closed the connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CloseReply {
    /// Identity of the connection.
    pub triad: Triad,
}

impl CloseReply {
    /// Writes the reply's data.
    pub fn emit(&self, writer: &mut Writer<'_>) {
        self.triad.emit(writer);
        writer.u16(0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{ConnectionType, Priority};
    use super::*;

    const TRIAD: Triad = Triad { connection_serial: 0x1234, vendor: 0x00AB, originator_serial: 0x89AB_CDEF };

    fn request(path: &[u8]) -> OpenRequest<'_> {
        let parameters = |size| Parameters {
            redundant_owner: false,
            kind: ConnectionType::PointToPoint,
            priority: Priority::Scheduled,
            variable: false,
            size,
        };
        OpenRequest {
            o_t_id: 0,
            t_o_id: 0x0102_0304,
            triad: TRIAD,
            multiplier: 5,
            o_t_rpi_us: 1_000,
            o_t: parameters(262),
            t_o_rpi_us: 2_000,
            t_o: parameters(258),
            transport: Transport::CYCLIC,
            path: Path(path),
        }
    }

    #[test]
    fn a_forward_open_has_every_field_where_the_standard_has_it() {
        let mut buf = [0; 128];
        let mut writer = Writer::new(&mut buf);
        request(&[0x20, 4, 0x2C, 150, 0x2C, 100]).emit(&mut writer, false);
        let len = writer.finish().unwrap();
        let expected = b"\x0A\xF0\0\0\0\0\x04\x03\x02\x01\x34\x12\xAB\x00\xEF\xCD\xAB\x89\x05\0\0\0\
            \xE8\x03\0\0\x06\x49\xD0\x07\0\0\x02\x49\x01\x03\x20\x04\x2C\x96\x2C\x64";
        assert_eq!(&buf[..len], expected);
    }

    #[test]
    fn plain_and_large_requests_are_parsed_as_written_and_refused_when_truncated_anywhere() {
        let path = [0x20, 4, 0x2C, 150, 0x2C, 100];
        for large in [false, true] {
            let mut buf = [0; 128];
            let mut writer = Writer::new(&mut buf);
            request(&path).emit(&mut writer, large);
            let len = writer.finish().unwrap();
            assert_eq!(OpenRequest::parse(&buf[..len], large), Ok(request(&path)));
            for cut in 0..len {
                assert_eq!(OpenRequest::parse(&buf[..cut], large), Err(Violation::TooShort), "at {cut}");
            }
            assert_eq!(OpenRequest::parse(&buf[..len + 2], large), Err(Violation::TooLong));
        }
    }

    #[test]
    fn the_replies_to_a_forward_close_name_the_connection_and_have_nothing_behind_it() {
        let written = |emit: &dyn Fn(&mut Writer<'_>)| {
            let mut buf = [0xFF; 16];
            let mut writer = Writer::new(&mut buf);
            emit(&mut writer);
            let len = writer.finish().unwrap();
            buf[..len].to_vec()
        };
        let expected = b"\x34\x12\xAB\0\xEF\xCD\xAB\x89\0\0";
        assert_eq!(written(&|writer| CloseReply { triad: TRIAD }.emit(writer)), expected);
        assert_eq!(written(&|writer| RefusedReply { triad: TRIAD, path_left: 0 }.emit(writer)), expected);
    }

    #[test]
    fn a_forward_close_is_parsed_as_written_and_refused_when_truncated_anywhere() {
        let close = CloseRequest { triad: TRIAD, path: Path(&[0x20, 4, 0x2C, 150, 0x2C, 100]) };
        let mut buf = [0; 64];
        let mut writer = Writer::new(&mut buf);
        close.emit(&mut writer);
        let len = writer.finish().unwrap();
        assert_eq!(CloseRequest::parse(&buf[..len]), Ok(close));
        assert!((0..len).all(|cut| CloseRequest::parse(&buf[..cut]) == Err(Violation::TooShort)));
        assert_eq!(
            RefusedReply::from_close_request(&buf[..len]),
            Some(RefusedReply { triad: TRIAD, path_left: 0 })
        );
    }
}
