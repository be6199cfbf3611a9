//! ModuleDiffBlock: the differences between the device's modules and the ones that the controller expects.
//!
//! ```text
//! NumberOfAPIs u16 · each: API u32 · NumberOfModules u16
//!   each: slot u16 · ModuleIdentNumber u32 · ModuleState u16 · NumberOfSubmodules u16
//!     each: subslot u16 · SubmoduleIdentNumber u32 · SubmoduleState u16
//! SubmoduleState   bit 15 (FormatIndicator) set: bits 11..15 IdentInfo     bit 15 not set: all other bits are Detail
//! ```

use alloc::vec::Vec;

use super::{API, COUNT_LIMIT};
use crate::block::{self, BlockReader, BlockType, BlockWriter, short};
use crate::status::{Block, HeadField, Violation};

/// ModuleState.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ModuleState {
    /// The slot is empty.
    NoModule,
    /// Another module is in the slot.
    WrongModule,
    /// The module is the expected one, but one of its submodules is not.
    ProperModule,
    /// Another module is in the slot, and can replace the expected one.
    Substitute,
    /// A state that this version does not know; it survives a round trip.
    Unknown(u16),
}

impl From<u16> for ModuleState {
    fn from(code: u16) -> Self {
        match code {
            0 => Self::NoModule,
            1 => Self::WrongModule,
            2 => Self::ProperModule,
            3 => Self::Substitute,
            other => Self::Unknown(other),
        }
    }
}

impl From<ModuleState> for u16 {
    fn from(value: ModuleState) -> Self {
        match value {
            ModuleState::NoModule => 0,
            ModuleState::WrongModule => 1,
            ModuleState::ProperModule => 2,
            ModuleState::Substitute => 3,
            ModuleState::Unknown(code) => code,
        }
    }
}

/// SubmoduleState, in either of its formats.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SubmoduleState(pub u16);

impl SubmoduleState {
    /// IdentInfo: the submodule is the expected one.
    pub const PROPER: Self = Self(0x8000);
    /// IdentInfo: another submodule is plugged.
    pub const WRONG: Self = Self(0x9000);
    /// IdentInfo: no submodule is plugged.
    pub const NONE: Self = Self(0x9800);

    /// Detail, of devices that use the format without IdentInfo: no submodule is plugged.
    pub const DETAIL_NONE: Self = Self(0);
    /// Detail: another submodule is plugged.
    pub const DETAIL_WRONG: Self = Self(1);

    /// Returns whether the submodule is the expected one, or one that can replace it. It may still be locked or not ready.
    #[must_use]
    pub const fn is_usable(self) -> bool {
        const FORMAT: u16 = 1 << 15;
        if self.0 & FORMAT == 0 {
            return !matches!(self, Self::DETAIL_NONE | Self::DETAIL_WRONG);
        }
        (self.0 >> 11) & 0xF < 2
    }
}

/// A submodule that is not the expected one.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct DiffSubmodule {
    /// Subslot number.
    pub subslot: u16,
    /// SubmoduleIdentNumber of the plugged submodule; 0 if there is none.
    pub ident: u32,
    /// How it differs.
    pub state: SubmoduleState,
}

/// A module that differs from the expected one.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct DiffModule {
    /// Slot number.
    pub slot: u16,
    /// ModuleIdentNumber of the plugged module; 0 if there is none.
    pub ident: u32,
    /// How it differs.
    pub state: ModuleState,
    /// Its submodules that differ from the expected ones.
    pub submodules: Vec<DiffSubmodule>,
}

/// Parses the first ModuleDiffBlock among these blocks; `None` if there is none.
pub fn parse_module_diff(blocks: &[u8]) -> Result<Option<Vec<DiffModule>>, Violation> {
    let mut reader = BlockReader::new(blocks);
    while !reader.is_empty() {
        let is_diff = |block_type| block_type == BlockType::ModuleDiff;
        let (block_type, mut body) = block::next_known(&mut reader, |_| Block::ModuleDiff, is_diff)?;
        if is_diff(block_type) {
            return parse(&mut body).map(Some);
        }
    }
    Ok(None)
}

pub(super) fn parse(body: &mut BlockReader<'_>) -> Result<Vec<DiffModule>, Violation> {
    let short = short(Block::ModuleDiff);
    let wrong = Violation::Head(Block::ModuleDiff, HeadField::Length);
    let mut diff = Vec::new();
    let apis = body.u16().map_err(&short)?;
    for _ in 0..apis {
        let _api = body.u32().map_err(&short)?;
        let modules = body.u16().map_err(&short)?;
        for _ in 0..modules {
            let slot = body.u16().map_err(&short)?;
            let ident = body.u32().map_err(&short)?;
            let state = body.u16().map_err(&short)?.into();
            let count = body.u16().map_err(&short)?;
            if diff.len() >= COUNT_LIMIT || usize::from(count) > COUNT_LIMIT {
                return Err(wrong);
            }
            let mut submodules = Vec::new();
            for _ in 0..count {
                let subslot = body.u16().map_err(&short)?;
                let ident = body.u32().map_err(&short)?;
                let state = SubmoduleState(body.u16().map_err(&short)?);
                submodules.push(DiffSubmodule { subslot, ident, state });
            }
            diff.push(DiffModule { slot, ident, state, submodules });
        }
    }
    Ok(diff)
}

/// Writes the block.
pub fn emit(diff: &[DiffModule], writer: &mut BlockWriter<'_>) {
    block::write(writer, BlockType::ModuleDiff, |w| {
        w.u16(1);
        w.u32(API);
        w.u16(u16::try_from(diff.len()).unwrap_or(u16::MAX));
        for module in diff {
            w.u16(module.slot);
            w.u32(module.ident);
            w.u16(module.state.into());
            w.u16(u16::try_from(module.submodules.len()).unwrap_or(u16::MAX));
            for submodule in &module.submodules {
                w.u16(submodule.subslot);
                w.u32(submodule.ident);
                w.u16(submodule.state.0);
            }
        }
    });
}
