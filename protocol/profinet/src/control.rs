//! Control and Release: all parameters are written, the device is ready, the AR ends.
//!
//! ```text
//! reserved u16 · ARUUID 16 · SessionKey u16 · AlarmSequenceNumber or reserved u16
//! ControlCommand u16 (bit 0 PrmEnd, 1 ApplicationReady, 2 Release, 3 Done, 6 PrmBegin) · ControlBlockProperties u16
//! ```
//!
//! PrmEnd and ApplicationReady have a block for the AR and another one for a submodule that was plugged: that one has the
//! number of its plug alarm.

use super::Uuid;
use super::block::{self, BlockReader, BlockType, BlockWriter, short};
use super::status::{Block, HeadField, Violation};
use machine::wire::Truncated;

/// The command of a control block.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Command {
    /// All parameters are written.
    PrmEnd,
    /// The device is ready for cyclic data.
    ApplicationReady,
    /// The AR ends.
    Release,
    /// The controller will write parameters again.
    PrmBegin,
    /// All parameters of a plugged submodule are written.
    PrmEndPlug {
        /// AlarmSequenceNumber: bits 0 to 10 of the AlarmSpecifier of the plug alarm.
        alarm: u16,
    },
    /// A plugged submodule is ready for cyclic data.
    ApplicationReadyPlug {
        /// AlarmSequenceNumber, as in the PrmEnd before.
        alarm: u16,
    },
}

impl Command {
    const ALL: [Self; 6] = [
        Self::PrmEnd,
        Self::ApplicationReady,
        Self::Release,
        Self::PrmBegin,
        Self::PrmEndPlug { alarm: 0 },
        Self::ApplicationReadyPlug { alarm: 0 },
    ];

    /// Returns AlarmSequenceNumber; 0, which is reserved, in a command for the whole AR.
    const fn alarm(self) -> u16 {
        match self {
            Self::PrmEndPlug { alarm } | Self::ApplicationReadyPlug { alarm } => alarm,
            Self::PrmEnd | Self::ApplicationReady | Self::Release | Self::PrmBegin => 0,
        }
    }

    const fn with_alarm(self, alarm: u16) -> Self {
        match self {
            Self::PrmEndPlug { .. } => Self::PrmEndPlug { alarm },
            Self::ApplicationReadyPlug { .. } => Self::ApplicationReadyPlug { alarm },
            Self::PrmEnd | Self::ApplicationReady | Self::Release | Self::PrmBegin => self,
        }
    }

    /// Returns the ControlCommand of the request.
    #[must_use]
    pub const fn code(self) -> u16 {
        match self {
            Self::PrmEnd | Self::PrmEndPlug { .. } => 1 << 0,
            Self::ApplicationReady | Self::ApplicationReadyPlug { .. } => 1 << 1,
            Self::Release => 1 << 2,
            Self::PrmBegin => 1 << 6,
        }
    }

    const fn request_type(self) -> BlockType {
        match self {
            Self::PrmEnd => BlockType::PrmEnd,
            Self::ApplicationReady => BlockType::ApplicationReady,
            Self::Release => BlockType::Release,
            Self::PrmBegin => BlockType::PrmBegin,
            Self::PrmEndPlug { .. } => BlockType::PrmEndPlug,
            Self::ApplicationReadyPlug { .. } => BlockType::ApplicationReadyPlug,
        }
    }

    const fn response_type(self) -> BlockType {
        match self {
            Self::PrmEnd => BlockType::PrmEndResponse,
            Self::ApplicationReady => BlockType::ApplicationReadyResponse,
            Self::Release => BlockType::ReleaseResponse,
            Self::PrmBegin => BlockType::PrmBeginResponse,
            Self::PrmEndPlug { .. } => BlockType::PrmEndPlugResponse,
            Self::ApplicationReadyPlug { .. } => BlockType::ApplicationReadyPlugResponse,
        }
    }

    /// Returns the block to name in the error for a wrong control block.
    #[must_use]
    pub const fn block(self) -> Block {
        match self {
            Self::PrmEnd => Block::ControlConnect,
            Self::ApplicationReady => Block::XControlConnect,
            Self::Release => Block::Release,
            Self::PrmBegin => Block::PrmBegin,
            Self::PrmEndPlug { .. } => Block::ControlPlug,
            Self::ApplicationReadyPlug { .. } => Block::XControlPlug,
        }
    }

    /// Returns the violation for a wrong session key.
    #[must_use]
    pub const fn wrong_session(self) -> Violation {
        match self {
            Self::PrmEnd => Violation::ControlSessionKey,
            Self::ApplicationReady => Violation::XControlSessionKey,
            Self::Release => Violation::ReleaseSessionKey,
            Self::PrmBegin => Violation::PrmBeginSessionKey,
            Self::PrmEndPlug { .. } => Violation::ControlPlugSessionKey,
            Self::ApplicationReadyPlug { .. } => Violation::XControlPlugSessionKey,
        }
    }

    const fn wrong_command(self) -> Violation {
        match self {
            Self::PrmEnd => Violation::ControlCommand,
            Self::ApplicationReady => Violation::XControlCommand,
            Self::Release => Violation::ReleaseCommand,
            Self::PrmBegin => Violation::PrmBeginCommand,
            Self::PrmEndPlug { .. } => Violation::ControlPlugCommand,
            Self::ApplicationReadyPlug { .. } => Violation::XControlPlugCommand,
        }
    }
}

/// ControlCommand of every response.
const DONE: u16 = 1 << 3;

/// A control block. A request contains a command, a response confirms it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Control {
    /// The command.
    pub command: Command,
    /// ARUUID.
    pub ar: Uuid,
    /// SessionKey.
    pub session: u16,
    /// ControlBlockProperties.
    pub properties: u16,
}

impl Control {
    /// Parses a request. Blocks after it (a SubmoduleListBlock after PrmBegin, a ModuleDiffBlock after ApplicationReady) are
    /// ignored.
    pub fn parse_request(blocks: &[u8]) -> Result<Self, Violation> {
        Self::parse(blocks, Command::request_type, Command::code)
    }

    /// Parses a response.
    pub fn parse_response(blocks: &[u8]) -> Result<Self, Violation> {
        Self::parse(blocks, Command::response_type, |_| DONE)
    }

    fn parse(
        blocks: &[u8],
        type_of: impl Fn(Command) -> BlockType,
        code_of: impl Fn(Command) -> u16,
    ) -> Result<Self, Violation> {
        let command_of =
            |block_type| Command::ALL.into_iter().find(|command| type_of(*command) == block_type);
        let mut reader = BlockReader::new(blocks);
        let faulty = |block_type| command_of(block_type).map_or(Block::ControlConnect, Command::block);
        let (block_type, mut body) = block::next(&mut reader, faulty)?;
        let command = command_of(block_type).ok_or(Violation::UnknownBlocks)?;
        let (ar, session, alarm, code, properties) =
            Self::parse_fields(&mut body).map_err(short(command.block()))?;
        if !body.is_empty() {
            return Err(Violation::Head(command.block(), HeadField::Length));
        }
        // Bits 4 and 5 of a response, readiness for a companion AR and RT_CLASS_3, may come with Done.
        if code & !0x30 != code_of(command) {
            return Err(command.wrong_command());
        }
        Ok(Self { command: command.with_alarm(alarm), ar, session, properties })
    }

    fn parse_fields(body: &mut BlockReader<'_>) -> Result<(Uuid, u16, u16, u16, u16), Truncated> {
        body.skip(2)?;
        let ar = Uuid::read(body)?;
        Ok((ar, body.u16()?, body.u16()?, body.u16()?, body.u16()?))
    }

    /// Writes it as a request.
    pub fn emit_request(&self, writer: &mut BlockWriter<'_>) {
        self.emit(self.command.request_type(), self.command.code(), writer);
    }

    /// Writes it as a response: done.
    pub fn emit_response(&self, writer: &mut BlockWriter<'_>) {
        self.emit(self.command.response_type(), DONE, writer);
    }

    fn emit(&self, block_type: BlockType, code: u16, writer: &mut BlockWriter<'_>) {
        block::write(writer, block_type, |w| {
            w.zeros(2);
            self.ar.write(w);
            w.u16(self.session);
            w.u16(self.command.alarm());
            w.u16(code);
            w.u16(self.properties);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::captured;
    use crate::rpc::{Header, RequestArgs, ResponseArgs};

    fn request(text: &str) -> Vec<u8> {
        let datagram = captured::datagram(text);
        let (header, body) = Header::parse(&datagram).unwrap();
        RequestArgs::parse(&header, body).unwrap().blocks.to_vec()
    }

    fn response(text: &str) -> Vec<u8> {
        let datagram = captured::datagram(text);
        let (header, body) = Header::parse(&datagram).unwrap();
        ResponseArgs::parse(&header, body).unwrap().blocks.to_vec()
    }

    #[test]
    fn captured_control_blocks_are_parsed_and_written_back_unchanged() {
        let mut buf = [0; 64];
        for (command, asked, answered) in [
            (Command::PrmEnd, captured::PRMEND_REQ, captured::PRMEND_RES),
            (Command::ApplicationReady, captured::APPREADY_REQ, captured::APPREADY_RES),
        ] {
            let blocks = request(asked);
            let control = Control::parse_request(&blocks).unwrap();
            assert_eq!((control.command, control.session), (command, 2));
            let mut writer = BlockWriter::new(&mut buf);
            control.emit_request(&mut writer);
            assert_eq!(writer.finish(), Ok(32));
            assert_eq!(buf[..32], blocks);

            let blocks = response(answered);
            assert_eq!(Control::parse_response(&blocks), Ok(control));
            let mut writer = BlockWriter::new(&mut buf);
            control.emit_response(&mut writer);
            assert_eq!(writer.finish(), Ok(32));
            assert_eq!(buf[..32], blocks);
        }
    }

    #[test]
    fn the_blocks_of_a_plugged_submodule_have_the_number_of_its_alarm() {
        let (ar, session, alarm) = (Uuid([7; 16]), 2, 0x123);
        for (command, request, response) in [
            (Command::PrmEndPlug { alarm }, 0x0111, 0x8111),
            (Command::ApplicationReadyPlug { alarm }, 0x0113, 0x8113),
        ] {
            let control = Control { command, ar, session, properties: 0 };
            for (block_type, code) in [(request, command.code()), (response, DONE)] {
                let mut buf = [0; 32];
                let mut writer = BlockWriter::new(&mut buf);
                if block_type == request {
                    control.emit_request(&mut writer);
                } else {
                    control.emit_response(&mut writer);
                }
                assert_eq!(writer.finish(), Ok(32));
                assert_eq!(u16::from_be_bytes([buf[0], buf[1]]), block_type);
                assert_eq!(buf[26..30], [0x01, 0x23, 0, code as u8]);
                let parsed = if block_type == request {
                    Control::parse_request(&buf)
                } else {
                    Control::parse_response(&buf)
                };
                assert_eq!(parsed, Ok(control));
            }
        }
    }

    #[test]
    fn each_command_has_its_block_type_and_its_bit() {
        for (command, request, response, bit) in [
            (Command::PrmEnd, 0x0110, 0x8110, 0),
            (Command::ApplicationReady, 0x0112, 0x8112, 1),
            (Command::Release, 0x0114, 0x8114, 2),
            (Command::PrmBegin, 0x0118, 0x8118, 6),
        ] {
            let control = Control { command, ar: Uuid([7; 16]), session: 2, properties: 0 };
            let (mut asked, mut answered) = ([0; 32], [0; 32]);
            control.emit_request(&mut BlockWriter::new(&mut asked));
            control.emit_response(&mut BlockWriter::new(&mut answered));
            for (buf, block_type, code) in [(&asked, request, 1 << bit), (&answered, response, DONE)] {
                let number = |at: usize| u16::from_be_bytes([buf[at], buf[at + 1]]);
                assert_eq!((number(0), number(28)), (block_type, code), "{command:?}");
            }
            assert_eq!(Control::parse_request(&asked), Ok(control));
            assert_eq!(Control::parse_response(&answered), Ok(control));
        }
    }

    #[test]
    fn a_command_that_does_not_fit_its_block_and_a_wrong_length_are_refused() {
        let mut blocks = request(captured::PRMEND_REQ);
        blocks[29] = 4;
        assert_eq!(Control::parse_request(&blocks), Err(Violation::ControlCommand));
        blocks[3] += 1;
        blocks.push(0);
        let length = Violation::Head(Block::ControlConnect, HeadField::Length);
        assert_eq!(Control::parse_request(&blocks), Err(length));
        blocks[3] = 10;
        assert_eq!(Control::parse_request(&blocks), Err(length));
        blocks[1] = 0x77;
        blocks[3] = 28;
        assert_eq!(Control::parse_request(&blocks), Err(Violation::UnknownBlocks));
    }
}
