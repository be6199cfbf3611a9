//! Connect: the blocks that set an AR up, and the blocks of the answer.
//!
//! ```text
//! request   ARBlockReq · IOCRBlockReq × 2 · AlarmCRBlockReq · ExpectedSubmoduleBlockReq × n, in any order after the first
//! response  ARBlockRes · IOCRBlockRes × 2 · AlarmCRBlockRes · ModuleDiffBlock? · ARServerBlockRes?
//! ```
//!
//! `parse` refuses only blocks that cannot be read; the device decides whether it accepts the AR.

mod alarm_cr;
mod ar;
mod diff;
mod expected;
mod iocr;

pub use alarm_cr::{AlarmCr, AlarmCrResponse};
pub use ar::{Ar, ArProperties, ArResponse};
pub use diff::{
    DiffModule, DiffSubmodule, ModuleState, SubmoduleState, emit as emit_module_diff, parse_module_diff,
};
pub use expected::{ExpectedModule, ExpectedSubmodule};
pub use iocr::{Iocr, IocrResponse, IocrType, Object, RtClass};

use alloc::vec::Vec;

use super::block::{self, BlockReader, BlockType, BlockWriter, short};
use super::status::{Block, HeadField, Violation};

/// The only API of a device without profiles.
pub const API: u32 = 0;

/// Largest number of IOCRs, modules, submodules or objects in a request.
pub const COUNT_LIMIT: usize = 512;

/// A station name as in the blocks, at most 240 bytes.
pub type StationName = Vec<u8>;

/// A Connect request.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ConnectRequest {
    /// The requested AR.
    pub ar: Ar,
    /// Its cyclic connections.
    pub iocrs: Vec<Iocr>,
    /// Its alarm connection, if it has one.
    pub alarm_cr: Option<AlarmCr>,
    /// The modules that the controller expects.
    pub expected: Vec<ExpectedModule>,
}

impl ConnectRequest {
    /// Parses the blocks of a request. Blocks of options that we do not support (ARVendor, MCR, IR, SR, RS info, ARFSU, ARRPC)
    /// are skipped. A block that does not belong in a Connect is refused, and so is PrmServer: a device that has no parameter
    /// server would wait in vain for its parameters.
    pub fn parse(blocks: &[u8]) -> Result<Self, Violation> {
        let mut reader = BlockReader::new(blocks);
        let (first, mut body) = block::next(&mut reader, |_| Block::Ar)?;
        if first != BlockType::Ar {
            return Err(Violation::Head(Block::Ar, HeadField::Type));
        }
        let ar = Ar::parse(&mut body)?;
        let mut request = Self { ar, iocrs: Vec::new(), alarm_cr: None, expected: Vec::new() };
        while !reader.is_empty() {
            let (block_type, mut body) =
                block::next_known(&mut reader, faulty, |block_type| !is_optional(block_type))?;
            match block_type {
                BlockType::Ar => return Err(Violation::Head(Block::Ar, HeadField::Type)),
                BlockType::Iocr if request.iocrs.len() < COUNT_LIMIT => {
                    request.iocrs.push(Iocr::parse(&mut body)?);
                }
                BlockType::Iocr => return Err(Violation::Head(Block::Iocr, HeadField::Type)),
                BlockType::AlarmCr if request.alarm_cr.is_none() => {
                    request.alarm_cr = Some(AlarmCr::parse(&mut body)?);
                }
                BlockType::AlarmCr => return Err(Violation::AlarmCrCount),
                BlockType::ExpectedSubmodule => expected::parse(&mut body, &mut request.expected)?,
                BlockType::PrmServer => return Err(Violation::Head(Block::PrmServer, HeadField::Type)),
                option if is_optional(option) => {}
                _ => return Err(Violation::UnknownBlocks),
            }
        }
        Ok(request)
    }

    /// Writes the blocks.
    pub fn emit(&self, writer: &mut BlockWriter<'_>) {
        self.ar.emit(writer);
        self.iocrs.iter().for_each(|iocr| iocr.emit(writer));
        if let Some(alarm_cr) = &self.alarm_cr {
            alarm_cr.emit(writer);
        }
        self.expected.iter().for_each(|module| module.emit(writer));
    }
}

/// The answer to a Connect.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ConnectResponse {
    /// The AR.
    pub ar: ArResponse,
    /// Its cyclic connections, with the FrameIDs in use.
    pub iocrs: Vec<IocrResponse>,
    /// Its alarm connection.
    pub alarm_cr: Option<AlarmCrResponse>,
    /// The modules that differ from the expected ones; empty if none does.
    pub diff: Vec<DiffModule>,
    /// The device's station name; only if the controller uses advanced startup mode.
    pub server: Option<StationName>,
}

impl ConnectResponse {
    /// Parses the blocks of an answer. Unknown blocks are skipped.
    pub fn parse(blocks: &[u8]) -> Result<Self, Violation> {
        let mut reader = BlockReader::new(blocks);
        let (first, mut body) = block::next(&mut reader, |_| Block::ArRes)?;
        if first != BlockType::ArResponse {
            return Err(Violation::Head(Block::ArRes, HeadField::Type));
        }
        let ar = ArResponse::parse(&mut body)?;
        let mut response = Self { ar, iocrs: Vec::new(), alarm_cr: None, diff: Vec::new(), server: None };
        while !reader.is_empty() {
            let (block_type, mut body) = block::next_known(&mut reader, faulty, |block_type| {
                !matches!(block_type, BlockType::Unknown(_))
            })?;
            match block_type {
                BlockType::ArResponse => return Err(Violation::Head(Block::ArRes, HeadField::Type)),
                BlockType::IocrResponse if response.iocrs.len() < COUNT_LIMIT => {
                    response.iocrs.push(IocrResponse::parse(&mut body)?);
                }
                BlockType::AlarmCrResponse => {
                    response.alarm_cr = Some(AlarmCrResponse::parse(&mut body)?);
                }
                BlockType::ModuleDiff => response.diff = diff::parse(&mut body)?,
                BlockType::ArServer => {
                    let length = body.u16().map_err(short(Block::ArServer))?;
                    let name = body.bytes(usize::from(length)).map_err(short(Block::ArServer))?;
                    response.server = Some(name.to_vec());
                }
                _ => {}
            }
        }
        Ok(response)
    }

    /// Writes the blocks.
    pub fn emit(&self, writer: &mut BlockWriter<'_>) {
        self.ar.emit(writer);
        self.iocrs.iter().for_each(|iocr| iocr.emit(writer));
        if let Some(alarm_cr) = &self.alarm_cr {
            alarm_cr.emit(writer);
        }
        if !self.diff.is_empty() {
            diff::emit(&self.diff, writer);
        }
        if let Some(name) = &self.server {
            let start = writer.len();
            block::write(writer, BlockType::ArServer, |w| {
                w.u16(u16::try_from(name.len()).unwrap_or(u16::MAX));
                w.bytes(name);
                // The block is a multiple of four bytes long (IEC 61158-6-10, ARServerBlock).
                w.pad_to(start + (w.len() - start).next_multiple_of(4));
            });
        }
    }
}

/// Returns whether a block of a Connect is about an option that we do not support, so that it is skipped.
const fn is_optional(block_type: BlockType) -> bool {
    matches!(
        block_type,
        BlockType::Mcr
            | BlockType::ArRpc
            | BlockType::ArVendor
            | BlockType::IrInfo
            | BlockType::SrInfo
            | BlockType::ArFsu
            | BlockType::RsInfo
    )
}

fn faulty(block_type: BlockType) -> Block {
    match block_type {
        BlockType::Iocr => Block::Iocr,
        BlockType::AlarmCr => Block::AlarmCr,
        BlockType::ExpectedSubmodule => Block::ExpectedSubmodule,
        BlockType::PrmServer => Block::PrmServer,
        BlockType::Mcr => Block::Mcr,
        BlockType::ArRpc => Block::ArRpc,
        BlockType::ArVendor => Block::ArVendor,
        BlockType::IrInfo => Block::IrInfo,
        BlockType::SrInfo => Block::SrInfo,
        BlockType::ArFsu => Block::ArFsu,
        BlockType::RsInfo => Block::RsInfo,
        BlockType::IocrResponse => Block::IocrRes,
        BlockType::AlarmCrResponse => Block::AlarmCrRes,
        BlockType::ModuleDiff => Block::ModuleDiff,
        BlockType::ArServer => Block::ArServer,
        BlockType::ArResponse => Block::ArRes,
        _ => Block::Ar,
    }
}

#[cfg(test)]
mod tests;
