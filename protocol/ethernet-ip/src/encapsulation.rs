//! The encapsulation header, and how messages are reassembled from a TCP stream (volume 2, chapter 2).
//!
//! ```text
//! 0..2    command         u16
//! 2..4    length          u16  of what follows the header, in bytes
//! 4..8    session handle  u32
//! 8..12   status          u32  0 in requests
//! 12..20  sender context       returned unchanged in the reply
//! 20..24  options         u32  0; messages with other values are to be discarded
//! 24..    command-specific data
//! ```

use alloc::boxed::Box;
use alloc::vec;

use super::{Reader, Writer, codes};
use machine::wire::{FRAME_CAPACITY, Overflow, Truncated};

/// Length of the header in bytes.
pub const HEADER_LEN: usize = 24;

/// Length of the longest accepted message, with its header, in bytes.
pub const MAX_MESSAGE_LEN: usize = FRAME_CAPACITY;

/// The protocol version that RegisterSession and the List commands carry.
pub const PROTOCOL_VERSION: u16 = 1;

codes! {
    /// Command of a message (volume 2, table 2-3.2).
    Command: u16 {
        Nop = 0x00: "NOP",
        ListServices = 0x04: "ListServices",
        ListIdentity = 0x63: "ListIdentity",
        ListInterfaces = 0x64: "ListInterfaces",
        RegisterSession = 0x65: "RegisterSession",
        UnRegisterSession = 0x66: "UnRegisterSession",
        SendRRData = 0x6F: "SendRRData",
        SendUnitData = 0x70: "SendUnitData",
    }
}

codes! {
    /// Result of a request (volume 2, table 2-3.3).
    Status: u32 {
        Success = 0x00: "success",
        InvalidCommand = 0x01: "the command is not supported, or not here",
        InsufficientMemory = 0x02: "the receiver has no memory for the command",
        IncorrectData = 0x03: "the data of the command is malformed",
        InvalidSession = 0x64: "the session handle is not valid on this connection",
        InvalidLength = 0x65: "the length does not fit the command",
        UnsupportedProtocol = 0x69: "the protocol version is not supported",
    }
}

/// The header of every message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Header {
    /// The command.
    pub command: Command,
    /// Bytes that follow the header.
    pub length: u16,
    /// The session of the message, 0 if none is needed.
    pub session: u32,
    /// The result, in a reply.
    pub status: Status,
    /// Value chosen by the sender of the request.
    pub context: [u8; 8],
    /// Zero.
    pub options: u32,
}

impl Header {
    /// Creates the header of a request.
    #[must_use]
    pub const fn request(command: Command, session: u32) -> Self {
        Self { command, length: 0, session, status: Status::Success, context: [0; 8], options: 0 }
    }

    /// Returns the header of the reply to this request.
    #[must_use]
    pub const fn reply(self, status: Status) -> Self {
        Self { length: 0, status, options: 0, ..self }
    }

    /// Parses a header.
    pub fn parse(message: &[u8]) -> Result<Self, Truncated> {
        let mut reader = Reader::new(message);
        Ok(Self {
            command: reader.u16()?.into(),
            length: reader.u16()?,
            session: reader.u32()?,
            status: reader.u32()?.into(),
            context: reader.array()?,
            options: reader.u32()?,
        })
    }

    /// Writes a message: this header with the length of what `body` writes behind it. Returns the total length.
    pub fn emit(&self, buf: &mut [u8], body: impl FnOnce(&mut Writer<'_>)) -> Result<usize, Overflow> {
        let mut writer = Writer::new(buf);
        writer.u16(self.command.into());
        writer.u16(0);
        writer.u32(self.session);
        writer.u32(self.status.into());
        writer.bytes(&self.context);
        writer.u32(self.options);
        body(&mut writer);
        let length = writer.len() - HEADER_LEN.min(writer.len());
        writer.patch_u16(2, u16::try_from(length).unwrap_or(u16::MAX));
        writer.finish()
    }
}

/// Reassembles messages from a TCP stream that may be cut anywhere.
///
/// It holds one incomplete message and one more frame. A message longer than [`MAX_MESSAGE_LEN`] is skipped without
/// being stored, so that the messages behind it are still found.
#[derive(Debug)]
pub struct Reassembly {
    buf: Box<[u8]>,
    start: usize,
    end: usize,
    /// Remaining bytes of a message that is too long.
    skip: usize,
}

/// Result of the reassembly.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Message<'a> {
    /// A complete message.
    Whole(Header, &'a [u8]),
    /// The header of a message that is too long; its data is skipped.
    TooLong(Header),
}

impl Default for Reassembly {
    fn default() -> Self {
        Self { buf: vec![0; 2 * MAX_MESSAGE_LEN].into_boxed_slice(), start: 0, end: 0, skip: 0 }
    }
}

impl Reassembly {
    /// Drops all bytes. Call it for a new connection.
    pub const fn clear(&mut self) {
        (self.start, self.end, self.skip) = (0, 0, 0);
    }

    /// Adds the next bytes of the stream. Fails if there is no room because messages were not taken out.
    pub fn push(&mut self, bytes: &[u8]) -> Result<(), Overflow> {
        let bytes = self.pass_over(bytes);
        if self.start > 0 {
            self.buf.copy_within(self.start..self.end, 0);
            (self.start, self.end) = (0, self.end - self.start);
        }
        let capacity = self.buf.len();
        let room = self.buf.get_mut(self.end..).and_then(|room| room.get_mut(..bytes.len()));
        room.ok_or(Overflow { capacity })?.copy_from_slice(bytes);
        self.end += bytes.len();
        Ok(())
    }

    /// Returns the next message, if it is complete.
    pub fn next_message(&mut self) -> Option<Message<'_>> {
        let held = self.buf.get(self.start..self.end)?;
        let header = Header::parse(held).ok()?;
        let len = HEADER_LEN + usize::from(header.length);
        if len > MAX_MESSAGE_LEN {
            let here = held.len().min(len);
            self.start += here;
            self.skip = len - here;
            return Some(Message::TooLong(header));
        }
        let data = held.get(HEADER_LEN..len)?;
        self.start += len;
        Some(Message::Whole(header, data))
    }

    fn pass_over<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        let passed = self.skip.min(bytes.len());
        self.skip -= passed;
        bytes.get(passed..).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RegisterSession as volume 2, 2-4.4 lays it out: version 1, options 0.
    const REGISTER: &[u8] = b"\x65\x00\x04\x00\0\0\0\0\0\0\0\0context!\0\0\0\0\x01\x00\0\0";

    fn commands(reassembly: &mut Reassembly) -> Vec<(Command, usize)> {
        let mut found = Vec::new();
        while let Some(message) = reassembly.next_message() {
            found.push(match message {
                Message::Whole(header, data) => (header.command, data.len()),
                Message::TooLong(header) => (header.command, usize::MAX),
            });
        }
        found
    }

    #[test]
    fn a_written_header_is_parsed_unchanged() {
        let header = Header::parse(REGISTER).unwrap();
        assert_eq!(
            (header.command, header.length, &header.context),
            (Command::RegisterSession, 4, b"context!")
        );
        let mut buf = [0; 64];
        let len = header.emit(&mut buf, |w| w.bytes(&[1, 0, 0, 0])).unwrap();
        assert_eq!(&buf[..len], REGISTER);
    }

    #[test]
    fn a_reply_takes_session_and_context_of_its_request_and_neither_length_nor_options() {
        let request = Header { session: 7, options: 9, ..Header::parse(REGISTER).unwrap() };
        let reply = request.reply(Status::InvalidLength);
        let expected = Header { length: 0, options: 0, status: Status::InvalidLength, ..request };
        assert_eq!((reply, reply.length, reply.options), (expected, 0, 0));
    }

    #[test]
    fn messages_are_reassembled_from_a_stream_that_is_cut_at_every_byte() {
        let mut reassembly = Reassembly::default();
        for byte in &REGISTER[..REGISTER.len() - 1] {
            reassembly.push(&[*byte]).unwrap();
            assert_eq!(reassembly.next_message(), None);
        }
        reassembly.push(&REGISTER[REGISTER.len() - 1..]).unwrap();
        assert_eq!(commands(&mut reassembly), [(Command::RegisterSession, 4)]);
    }

    #[test]
    fn messages_without_a_gap_are_separated() {
        let mut reassembly = Reassembly::default();
        reassembly.push(&[REGISTER, REGISTER, &REGISTER[..9]].concat()).unwrap();
        assert_eq!(commands(&mut reassembly).len(), 2);
        reassembly.push(&REGISTER[9..]).unwrap();
        assert_eq!(commands(&mut reassembly).len(), 1);
    }

    #[test]
    fn a_message_that_is_too_long_is_skipped_and_the_next_one_is_found() {
        let mut long = REGISTER.to_vec();
        long[2..4].copy_from_slice(&60_000_u16.to_le_bytes());
        long.resize(HEADER_LEN + 60_000, 0xEE);
        long.extend_from_slice(REGISTER);
        let mut reassembly = Reassembly::default();
        let mut found = Vec::new();
        for piece in long.chunks(1_448) {
            reassembly.push(piece).unwrap();
            found.extend(commands(&mut reassembly));
        }
        assert_eq!(found, [(Command::RegisterSession, usize::MAX), (Command::RegisterSession, 4)]);
    }

    #[test]
    fn a_message_may_be_as_long_as_a_frame_and_no_longer() {
        for (len, is_whole) in [(4_096, true), (4_097, false)] {
            let mut reassembly = Reassembly::default();
            let mut message = vec![0; len];
            message[2..4].copy_from_slice(&u16::try_from(len - HEADER_LEN).unwrap().to_le_bytes());
            reassembly.push(&message).unwrap();
            assert_eq!(
                matches!(reassembly.next_message(), Some(Message::Whole(..))),
                is_whole,
                "{len} bytes"
            );
        }
    }

    #[test]
    fn a_stream_whose_messages_are_not_taken_overflows_and_does_not_grow() {
        let mut reassembly = Reassembly::default();
        let pushed = (0..1_000).take_while(|_| reassembly.push(REGISTER).is_ok()).count();
        assert_eq!(pushed, 2 * MAX_MESSAGE_LEN / REGISTER.len());
    }
}
