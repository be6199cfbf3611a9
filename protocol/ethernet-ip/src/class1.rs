//! Cyclic frames of class 1 connections over UDP port 2222 (volume 2, 3-4; volume 1, 3-6.1).
//!
//! ```text
//! 0..2    item count       u16  2
//! 2..4    item type        u16  0x8002, sequenced address
//! 4..6    length           u16  8
//! 6..10   connection       u32
//! 10..14  sequence number  u32  counts the frames of the connection
//! 14..16  item type        u16  0x00B1, connected data
//! 16..18  length           u16  of what follows
//! 18..20  sequence count   u16  changes with the data
//! 20..24  run/idle header  u32  bit 0: run; only where the direction has it (O→T)
//! 24..    data                  20.. without a header
//! ```

use super::cpf::kind;
use super::{Reader, Writer};
use machine::wire::{Overflow, Truncated};

/// An address and data.
const ITEMS: u16 = 2;

/// Connection and sequence number, in bytes.
const ADDRESS_LEN: u16 = 8;

/// Length of the sequence count before the data, in bytes.
pub const SEQUENCE_LEN: u16 = 2;

/// Length of the run/idle header before the data, in bytes.
pub const RUN_IDLE_LEN: u16 = 4;

/// Why a datagram is not a class 1 frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum FrameError {
    /// It ends before a field does.
    #[error("the frame is cut off: {0}")]
    Truncated(#[from] Truncated),
    /// Its first two items are not an address with a sequence number and connected data.
    #[error("the frame's items are not a sequenced address and connected data")]
    WrongItems,
    /// The datagram continues behind its items.
    #[error("the datagram continues after the frame")]
    TrailingBytes,
}

/// A class 1 frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Frame<'a> {
    /// The connection that it belongs to.
    pub connection: u32,
    /// Counts the frames of the connection.
    pub sequence: u32,
    /// Changes with the data.
    pub count: u16,
    /// The run/idle header, if the connection has one, and the data.
    pub payload: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Parses a datagram.
    pub fn parse(datagram: &'a [u8]) -> Result<Self, FrameError> {
        let mut reader = Reader::new(datagram);
        if reader.u16()? != ITEMS || reader.u16()? != kind::SEQUENCED_ADDRESS || reader.u16()? != ADDRESS_LEN
        {
            return Err(FrameError::WrongItems);
        }
        let (connection, sequence) = (reader.u32()?, reader.u32()?);
        if reader.u16()? != kind::CONNECTED_DATA {
            return Err(FrameError::WrongItems);
        }
        let length = reader.u16()?;
        let mut data = Reader::new(reader.bytes(length.into())?);
        if !reader.rest().is_empty() {
            return Err(FrameError::TrailingBytes);
        }
        Ok(Self { connection, sequence, count: data.u16()?, payload: data.rest() })
    }

    /// Splits off the run/idle header: returns whether the sender is in run, and the data.
    pub fn run_and_data(&self) -> Result<(bool, &'a [u8]), Truncated> {
        let mut reader = Reader::new(self.payload);
        let run = reader.u32()? & 1 != 0;
        Ok((run, reader.rest()))
    }
}

/// Writes a frame, with a run/idle header if `run` is set. Returns its length in bytes.
pub fn emit(
    buf: &mut [u8],
    (connection, sequence, count): (u32, u32, u16),
    run: Option<bool>,
    data: &[u8],
) -> Result<usize, Overflow> {
    let header = if run.is_some() { SEQUENCE_LEN + RUN_IDLE_LEN } else { SEQUENCE_LEN };
    let mut writer = Writer::new(buf);
    writer.u16(ITEMS);
    writer.u16(kind::SEQUENCED_ADDRESS);
    writer.u16(ADDRESS_LEN);
    writer.u32(connection);
    writer.u32(sequence);
    writer.u16(kind::CONNECTED_DATA);
    writer.u16(u16::try_from(usize::from(header) + data.len()).unwrap_or(u16::MAX));
    writer.u16(count);
    if let Some(run) = run {
        writer.u32(run.into());
    }
    writer.bytes(data);
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_with_256_bytes_has_288_bytes_o_t_and_284_bytes_t_o() {
        let mut buf = [0; 512];
        assert_eq!(emit(&mut buf, (1, 2, 3), Some(true), &[0; 256]), Ok(280));
        assert_eq!(emit(&mut buf, (1, 2, 3), None, &[0; 256]), Ok(276));
    }

    #[test]
    fn a_frame_has_every_field_where_the_standard_has_it() {
        let mut buf = [0; 64];
        let len = emit(&mut buf, (0x0403_0201, 0x0807_0605, 0x0A09), Some(true), b"data").unwrap();
        let bytes = b"\x02\0\x02\x80\x08\0\x01\x02\x03\x04\x05\x06\x07\x08\xB1\0\x0A\0\x09\x0A\x01\0\0\0data";
        assert_eq!(&buf[..len], bytes);
        let frame = Frame::parse(bytes).unwrap();
        assert_eq!((frame.connection, frame.sequence, frame.count), (0x0403_0201, 0x0807_0605, 0x0A09));
        assert_eq!(frame.run_and_data(), Ok((true, &b"data"[..])));
        assert!((0..len).all(|cut| Frame::parse(&bytes[..cut]).is_err()));
    }

    #[test]
    fn wrong_items_and_bytes_behind_the_frame_are_errors() {
        let mut buf = [0; 64];
        let len = emit(&mut buf, (1, 2, 3), None, b"data").unwrap();
        assert_eq!(Frame::parse(&buf[..len + 1]), Err(FrameError::TrailingBytes));
        let mut swapped = buf;
        swapped[14] = 0xB2;
        assert_eq!(Frame::parse(&swapped[..len]), Err(FrameError::WrongItems));
        assert_eq!(Frame::parse(b"\0\0"), Err(FrameError::WrongItems));
    }
}
