//! Data of an open connection, as Get_Connection_Data and Search_Connection_Data return them (volume 1, 3-5.5).
//!
//! ```text
//! 0..2   connection number        u16
//! 2..4   state                    u16, 3: established
//! 4..6   originator's port        u16
//! 6..8   target's port            u16
//! 8..10  connection serial        u16
//! 10..12 originator's vendor      u16
//! 12..16 originator's serial      u32
//! 16..20 O→T connection           u32, of the originator
//! 20..24 O→T connection           u32, of the target
//! 24     O→T timeout multiplier   u8; three zeros
//! 28..32 O→T requested interval   u32, µs
//! 32..36 O→T actual interval      u32, µs
//! 36..56 T→O                      as 16..36
//! ```

use super::super::{Reader, Writer};
use super::timing::TimeoutMultiplier;
use super::triad::Triad;
use machine::Duration;
use machine::wire::Truncated;

/// State of a connection that is open.
const ESTABLISHED: u16 = 3;

/// One direction of an open connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct DirectionData {
    /// Connection number that the originator requested.
    pub originator_id: u32,
    /// Connection number in use.
    pub target_id: u32,
    /// Code of the timeout multiplier.
    pub multiplier: u8,
    /// Requested packet interval in µs.
    pub rpi_us: u32,
    /// Actual packet interval in µs.
    pub api_us: u32,
}

/// Data of an open connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ConnectionData {
    /// Number of the connection in the target, from 1.
    pub number: u16,
    /// Port of the target through which it came.
    pub originator_port: u16,
    /// Port of the target through which it leaves; 0 as it ends there.
    pub target_port: u16,
    /// Identity of the connection.
    pub triad: Triad,
    /// O→T.
    pub o_t: DirectionData,
    /// T→O.
    pub t_o: DirectionData,
}

impl DirectionData {
    fn parse(reader: &mut Reader<'_>) -> Result<Self, Truncated> {
        let (originator_id, target_id) = (reader.u32()?, reader.u32()?);
        let multiplier = reader.u8()?;
        reader.skip(3)?;
        Ok(Self { originator_id, target_id, multiplier, rpi_us: reader.u32()?, api_us: reader.u32()? })
    }

    fn emit(self, writer: &mut Writer<'_>) {
        writer.u32(self.originator_id);
        writer.u32(self.target_id);
        writer.bytes(&[self.multiplier, 0, 0, 0]);
        writer.u32(self.rpi_us);
        writer.u32(self.api_us);
    }

    /// Returns the time after which the connection ends without a frame; `None` for a code that is not defined.
    #[must_use]
    pub fn timeout(&self) -> Option<Duration> {
        let interval = Duration::from_micros(self.rpi_us.into());
        TimeoutMultiplier::new(self.multiplier).map(|multiplier| multiplier.timeout(interval))
    }
}

impl ConnectionData {
    /// Parses the data of a reply.
    pub fn parse(data: &[u8]) -> Result<Self, Truncated> {
        let mut reader = Reader::new(data);
        let number = reader.u16()?;
        reader.skip(2)?;
        Ok(Self {
            number,
            originator_port: reader.u16()?,
            target_port: reader.u16()?,
            triad: Triad::parse(&mut reader)?,
            o_t: DirectionData::parse(&mut reader)?,
            t_o: DirectionData::parse(&mut reader)?,
        })
    }

    /// Writes the data of a reply.
    pub fn emit(&self, writer: &mut Writer<'_>) {
        writer.u16(self.number);
        writer.u16(ESTABLISHED);
        writer.u16(self.originator_port);
        writer.u16(self.target_port);
        self.triad.emit(writer);
        self.o_t.emit(writer);
        self.t_o.emit(writer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connection_data_have_every_field_where_other_stacks_have_it_and_are_parsed_as_written() {
        let direction = |id| DirectionData {
            originator_id: id,
            target_id: id + 1,
            multiplier: 7,
            rpi_us: 10_000_000,
            api_us: 10_000_000,
        };
        let data = ConnectionData {
            number: 1,
            originator_port: 2,
            target_port: 0,
            triad: Triad { connection_serial: 0x1234, vendor: 0xAB, originator_serial: 0x89AB_CDEF },
            o_t: direction(0x10),
            t_o: direction(0x20),
        };
        let mut buf = [0; 64];
        let mut writer = Writer::new(&mut buf);
        data.emit(&mut writer);
        let len = writer.finish().unwrap();
        let expected = b"\x01\0\x03\0\x02\0\0\0\x34\x12\xAB\0\xEF\xCD\xAB\x89\
            \x10\0\0\0\x11\0\0\0\x07\0\0\0\x80\x96\x98\0\x80\x96\x98\0\
            \x20\0\0\0\x21\0\0\0\x07\0\0\0\x80\x96\x98\0\x80\x96\x98\0";
        assert_eq!(&buf[..len], expected);
        assert_eq!(ConnectionData::parse(&buf[..len]), Ok(data));
        assert!((0..len).all(|cut| ConnectionData::parse(&buf[..cut]).is_err()));
        assert_eq!(data.o_t.timeout(), Some(Duration::from_micros(5_120_000_000)));
        assert_eq!(DirectionData { multiplier: 8, ..data.o_t }.timeout(), None);
    }
}
