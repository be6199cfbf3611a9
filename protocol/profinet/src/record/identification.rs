//! RealIdentificationData: the modules and submodules that a device has (IEC 61158-6-10, RealIdentificationData).
//!
//! ```text
//! block header, version 1.0 or 1.1 · version 1.1: NumberOfAPIs u16, and for each: API u32
//! NumberOfSlots u16 · each: slot u16 · ModuleIdentNumber u32 · NumberOfSubslots u16
//!   each: subslot u16 · SubmoduleIdentNumber u32
//! ```

use alloc::vec::Vec;

use crate::block::{self, BlockReader, BlockType, short};
use crate::status::{Block, HeadField, Violation};
use machine::wire::Truncated;

/// Module that a device has.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct RealModule {
    /// Slot number.
    pub slot: u16,
    /// ModuleIdentNumber.
    pub ident: u32,
    /// Subslot and SubmoduleIdentNumber of each submodule.
    pub submodules: Vec<(u16, u32)>,
}

/// Reads the modules of all APIs in a record.
///
/// # Errors
///
/// The record is another one, or is cut.
pub fn parse_real_identification(record: &[u8]) -> Result<Vec<RealModule>, Violation> {
    // The version follows type and length.
    let has_apis = record.get(5).is_some_and(|version_low| *version_low > 0);
    let mut reader = BlockReader::new(record);
    let (block_type, mut body) = block::next_known(&mut reader, |_| Block::Record, |_| false)?;
    if block_type != BlockType::RealIdentification {
        return Err(Violation::Head(Block::Record, HeadField::Type));
    }
    modules(&mut body, has_apis).map_err(short(Block::Record))
}

fn modules(body: &mut BlockReader<'_>, has_apis: bool) -> Result<Vec<RealModule>, Truncated> {
    let mut modules: Vec<RealModule> = Vec::new();
    let apis = if has_apis { body.u16()? } else { 1 };
    for _ in 0..apis {
        if has_apis {
            body.u32()?;
        }
        // Each count is followed by what it counts, so that a record allocates no more than it has.
        for _ in 0..body.u16()? {
            let (slot, ident) = (body.u16()?, body.u32()?);
            let mut submodules = Vec::new();
            for _ in 0..body.u16()? {
                submodules.push((body.u16()?, body.u32()?));
            }
            match modules.iter_mut().find(|known| known.slot == slot) {
                // Submodules of another API are in the same slot.
                Some(known) => known.submodules.append(&mut submodules),
                None => modules.push(RealModule { slot, ident, submodules }),
            }
        }
    }
    Ok(modules)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::emit_real_identification;
    use crate::samples;
    use machine::wire::Writer;

    #[test]
    fn the_modules_of_a_device_are_read_as_it_writes_them_and_cut_ones_are_refused() {
        let mut buf = [0; 512];
        let mut writer = Writer::new(&mut buf);
        emit_real_identification(&samples::P_NET, |_, _| true, &mut writer);
        let len = writer.finish().unwrap();
        let modules = parse_real_identification(&buf[..len]).unwrap();
        let expected: Vec<_> = samples::P_NET.modules.iter().map(|it| (it.slot, it.ident)).collect();
        assert_eq!(modules.iter().map(|it| (it.slot, it.ident)).collect::<Vec<_>>(), expected);
        let count: usize = modules.iter().map(|it| it.submodules.len()).sum();
        assert_eq!(count, samples::P_NET.submodules().count());
        assert!((0..len).all(|cut| parse_real_identification(&buf[..cut]).is_err()));
    }

    #[test]
    fn a_record_of_version_1_0_has_no_apis() {
        let record = [0, 0x13, 0, 0x12, 1, 0, 0, 1, 0, 5, 0, 0, 0, 7, 0, 1, 0, 1, 0, 0, 0, 9];
        let module = RealModule { slot: 5, ident: 7, submodules: alloc::vec![(1, 9)] };
        assert_eq!(parse_real_identification(&record), Ok(alloc::vec![module]));
    }
}
