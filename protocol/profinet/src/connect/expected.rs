//! ExpectedSubmoduleBlockReq: the modules and submodules that the controller was configured for.
//!
//! ```text
//! NumberOfAPIs u16 · each: API u32 · slot u16 · ModuleIdentNumber u32 · ModuleProperties u16 · NumberOfSubmodules u16
//!   each: subslot u16 · SubmoduleIdentNumber u32 · SubmoduleProperties u16 (bits 0..2: 0 no I/O, 1 in, 2 out, 3 both)
//!     one description, or two if both: DataDescription u16 (1 in, 2 out) · length u16 · LengthIOCS u8 · LengthIOPS u8
//! ```

use alloc::vec::Vec;

use super::{API, COUNT_LIMIT};
use crate::block::{self, BlockReader, BlockType, BlockWriter, short};
use crate::status::{Block, Violation};

/// A submodule as the controller expects it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ExpectedSubmodule {
    /// Subslot number.
    pub subslot: u16,
    /// SubmoduleIdentNumber.
    pub ident: u32,
    /// Bits 2 and up of SubmoduleProperties, not shifted.
    pub properties: u16,
    /// Bytes from device to controller; a submodule without I/O has 0, and still a provider status.
    pub input_len: Option<u16>,
    /// Bytes from controller to device.
    pub output_len: Option<u16>,
}

/// A module as the controller expects it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ExpectedModule {
    /// Slot number.
    pub slot: u16,
    /// ModuleIdentNumber.
    pub ident: u32,
    /// ModuleProperties.
    pub properties: u16,
    /// Its submodules.
    pub submodules: Vec<ExpectedSubmodule>,
}

impl ExpectedSubmodule {
    /// Bits of SubmoduleProperties that change the frame: data of length 0 instead of those of the submodule, each way
    /// (ReduceInputSubmoduleDataLength, ReduceOutputSubmoduleDataLength), and neither IOPS nor IOCS (DiscardIOXS).
    pub const CHANGES: u16 = 1 << 3 | 1 << 4 | 1 << 5;

    /// Returns whether it has no I/O: its only data is an input of zero bytes.
    #[must_use]
    pub const fn has_no_io(&self) -> bool {
        matches!((self.input_len, self.output_len), (Some(0), None))
    }

    const fn kind(&self) -> u16 {
        match (self.input_len, self.output_len) {
            (Some(0) | None, None) => 0,
            (Some(_), None) => 1,
            (None, Some(_)) => 2,
            (Some(_), Some(_)) => 3,
        }
    }

    fn parse(body: &mut BlockReader<'_>) -> Result<Self, Violation> {
        let short = short(Block::ExpectedSubmodule);
        let subslot = body.u16().map_err(&short)?;
        let ident = body.u32().map_err(&short)?;
        let properties = body.u16().map_err(&short)?;
        let kind = properties & 3;
        let mut submodule =
            Self { subslot, ident, properties: properties & !3, input_len: None, output_len: None };
        for _ in 0..if kind == 3 { 2 } else { 1 } {
            let direction = body.u16().map_err(&short)?;
            let length = body.u16().map_err(&short)?;
            let [iocs_len, iops_len] = body.array().map_err(&short)?;
            let place = match direction & 3 {
                1 => &mut submodule.input_len,
                2 => &mut submodule.output_len,
                _ => return Err(Violation::DataDescription),
            };
            if place.replace(length).is_some() {
                return Err(Violation::DataDescription);
            }
            if length > 1439 {
                return Err(Violation::SubmoduleDataLength);
            }
            if iops_len != 1 {
                return Err(Violation::LengthIops);
            }
            if iocs_len != 1 {
                return Err(Violation::LengthIocs);
            }
        }
        let fits = match kind {
            0 => submodule.has_no_io(),
            1 => submodule.input_len.is_some(),
            2 => submodule.output_len.is_some(),
            _ => true,
        };
        if fits { Ok(submodule) } else { Err(Violation::SubmoduleProperties) }
    }

    fn emit(&self, writer: &mut BlockWriter<'_>) {
        writer.u16(self.subslot);
        writer.u32(self.ident);
        writer.u16(self.properties | self.kind());
        let input_len = self.input_len.or_else(|| self.output_len.is_none().then_some(0));
        for (direction, length) in [(1, input_len), (2, self.output_len)] {
            if let Some(length) = length {
                writer.u16(direction);
                writer.u16(length);
                writer.bytes(&[1, 1]);
            }
        }
    }
}

impl ExpectedModule {
    pub(super) fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::ExpectedSubmodule, |w| {
            w.u16(1);
            w.u32(API);
            w.u16(self.slot);
            w.u32(self.ident);
            w.u16(self.properties);
            w.u16(u16::try_from(self.submodules.len()).unwrap_or(u16::MAX));
            self.submodules.iter().for_each(|submodule| submodule.emit(w));
        });
    }
}

/// Parses one block, which may contain several modules, and adds them to those of the blocks before.
pub(super) fn parse(body: &mut BlockReader<'_>, modules: &mut Vec<ExpectedModule>) -> Result<(), Violation> {
    let short = short(Block::ExpectedSubmodule);
    let apis = body.u16().map_err(&short)?;
    if apis == 0 || modules.len() + usize::from(apis) > COUNT_LIMIT {
        return Err(Violation::ExpectedApiCount);
    }
    for _ in 0..apis {
        if body.u32().map_err(&short)? != API {
            return Err(Violation::ExpectedApi);
        }
        let slot = body.u16().map_err(&short)?;
        let ident = body.u32().map_err(&short)?;
        let properties = body.u16().map_err(&short)?;
        let count = body.u16().map_err(&short)?;
        if count == 0 || usize::from(count) > COUNT_LIMIT {
            return Err(Violation::ExpectedSubmoduleCount);
        }
        if modules.iter().any(|module| module.slot == slot) {
            return Err(Violation::ExpectedSlot);
        }
        let mut module = ExpectedModule { slot, ident, properties, submodules: Vec::new() };
        for _ in 0..count {
            let submodule = ExpectedSubmodule::parse(body)?;
            if module.submodules.iter().any(|other| other.subslot == submodule.subslot) {
                return Err(Violation::ExpectedSubslot);
            }
            module.submodules.push(submodule);
        }
        modules.push(module);
    }
    Ok(())
}
