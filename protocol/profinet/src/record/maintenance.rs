//! I&M1 to 4: what the operator of a plant writes about a device, and the device keeps.
//!
//! ```text
//! I&M1   IM_Tag_Function 32 · IM_Tag_Location 22
//! I&M2   IM_Date 16, as `2026-11-24 13:05`
//! I&M3   IM_Descriptor 54
//! I&M4   IM_Signature 54, of engineering tools for functional safety
//! ```
//!
//! The first three are texts, filled up with blanks (IEC 61158-6-10, I&M1 to I&M4).

use super::{index, only_block};
use crate::block::{self, BlockReader, BlockType, BlockWriter};
use crate::status::Violation;
use machine::wire::Truncated;

/// What the operator wrote; blanks and zeros at first.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Maintenance {
    /// IM_Tag_Function: what the device is for in its plant.
    pub function: [u8; 32],
    /// IM_Tag_Location: where it is.
    pub location: [u8; 22],
    /// IM_Date: when it was installed.
    pub date: [u8; 16],
    /// IM_Descriptor: a comment.
    pub descriptor: [u8; 54],
    /// IM_Signature.
    pub signature: [u8; 54],
}

impl Default for Maintenance {
    fn default() -> Self {
        Self {
            function: [b' '; 32],
            location: [b' '; 22],
            date: [b' '; 16],
            descriptor: [b' '; 54],
            signature: [0; 54],
        }
    }
}

impl Maintenance {
    /// I&M_Supported of I&M0: there are I&M1 to 4.
    pub const SUPPORTED: u16 = 0b1_1110;

    /// Returns whether an index is that of I&M1, 2, 3 or 4.
    #[must_use]
    pub const fn has(index: u16) -> bool {
        matches!(index, index::IDENTIFICATION_AND_MAINTENANCE_1..=index::IDENTIFICATION_AND_MAINTENANCE_4)
    }

    const fn block_type(index: u16) -> Option<BlockType> {
        Some(match index {
            index::IDENTIFICATION_AND_MAINTENANCE_1 => BlockType::IdentificationAndMaintenance1,
            index::IDENTIFICATION_AND_MAINTENANCE_2 => BlockType::IdentificationAndMaintenance2,
            index::IDENTIFICATION_AND_MAINTENANCE_3 => BlockType::IdentificationAndMaintenance3,
            index::IDENTIFICATION_AND_MAINTENANCE_4 => BlockType::IdentificationAndMaintenance4,
            _ => return None,
        })
    }

    /// Returns it as the Write of a record changes it.
    pub fn written(&self, index: u16, record: &[u8]) -> Result<Self, Violation> {
        let wanted = Self::block_type(index).ok_or(Violation::InvalidIndex)?;
        let mut body = only_block(record, wanted)?;
        let mut new = *self;
        new.read(index, &mut body).map_err(|_| Violation::WriteLength)?;
        if body.is_empty() { Ok(new) } else { Err(Violation::WriteLength) }
    }

    fn read(&mut self, index: u16, body: &mut BlockReader<'_>) -> Result<(), Truncated> {
        match index {
            index::IDENTIFICATION_AND_MAINTENANCE_1 => {
                self.function = body.array()?;
                self.location = body.array()?;
            }
            index::IDENTIFICATION_AND_MAINTENANCE_2 => self.date = body.array()?,
            index::IDENTIFICATION_AND_MAINTENANCE_3 => self.descriptor = body.array()?,
            _ => self.signature = body.array()?,
        }
        Ok(())
    }

    /// Writes the record of an index; nothing for an index that is not one of I&M1 to 4.
    pub fn emit(&self, index: u16, writer: &mut BlockWriter<'_>) {
        let Some(block_type) = Self::block_type(index) else { return };
        block::write(writer, block_type, |w| match index {
            index::IDENTIFICATION_AND_MAINTENANCE_1 => {
                w.bytes(&self.function);
                w.bytes(&self.location);
            }
            index::IDENTIFICATION_AND_MAINTENANCE_2 => w.bytes(&self.date),
            index::IDENTIFICATION_AND_MAINTENANCE_3 => w.bytes(&self.descriptor),
            _ => w.bytes(&self.signature),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::emitted;

    #[test]
    fn what_is_written_is_read_again_and_other_lengths_and_blocks_are_refused() {
        let mut all = Maintenance::default();
        for (index, len) in [(0xAFF1, 60), (0xAFF2, 22), (0xAFF3, 60), (0xAFF4, 60)] {
            let mut record = emitted(|w| all.emit(index, w));
            assert_eq!(record.len(), len);
            record[6..].fill(b'a' + index as u8 % 4);
            all = all.written(index, &record).unwrap();
            assert_eq!(emitted(|w| all.emit(index, w)), record);
            for cut in 0..len {
                assert_eq!(all.written(index, &record[..cut]), Err(Violation::WriteLength), "{cut}");
            }
            let padded = |count| [&record[..], &vec![0; count]].concat();
            assert_eq!(all.written(index, &padded(2)), Ok(all));
            assert_eq!(all.written(index, &padded(4)), Err(Violation::WriteLength));
            let other = if index == 0xAFF2 { 0xAFF1 } else { 0xAFF2 };
            assert_eq!(all.written(other, &record), Err(Violation::InvalidParameter));
            record[5] = 1;
            assert_eq!(all.written(index, &record), Err(Violation::InvalidParameter));
        }
        let texts = [&all.function[..], &all.location, &all.date, &all.descriptor, &all.signature];
        assert_eq!(texts.map(|text| text[0]), *b"bbcda");
        assert_eq!(all.written(0xAFF0, &[]), Err(Violation::InvalidIndex));
    }
}
