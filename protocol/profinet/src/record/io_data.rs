//! The data of a submodule as records: what the last cyclic frames contained, for tools that have no cyclic connection.
//!
//! ```text
//! RecordInputDataObjectElement   LengthIOCS u8 · IOCS · LengthIOPS u8 · IOPS · LengthData u16 · data
//! RecordOutputDataObjectElement  SubstituteActiveFlag u16 · LengthIOCS u8 · LengthIOPS u8 · LengthData u16
//!                                IOCS · data · IOPS · SubstituteValue
//! SubstituteValue                SubstitutionMode u16 (0 zero) · IOCS · data · IOPS
//! ```

use crate::block::{self, BlockType, BlockWriter};
use crate::rt::IoxStatus;

/// SubstitutionMode: without valid data the device uses zeros.
const MODE_ZERO: u16 = 0;

/// The data of a submodule in one direction, and its statuses.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct IoData<'a> {
    /// The data.
    pub data: &'a [u8],
    /// IOPS.
    pub provider: IoxStatus,
    /// IOCS; bad if the frames have none for this submodule.
    pub consumer: IoxStatus,
}

impl IoData<'_> {
    fn put_data_len(&self, w: &mut BlockWriter<'_>) {
        w.u16(u16::try_from(self.data.len()).unwrap_or(u16::MAX));
    }

    /// Writes it as RecordInputDataObjectElement.
    pub fn emit_input(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::RecordInputDataObjectElement, |w| {
            w.bytes(&[1, self.consumer.0, 1, self.provider.0]);
            self.put_data_len(w);
            w.bytes(self.data);
        });
    }

    /// Writes it as RecordOutputDataObjectElement. `in_use`: the device uses the data; otherwise it uses zeros.
    pub fn emit_output(&self, in_use: bool, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::RecordOutputDataObjectElement, |w| {
            w.u16((!in_use).into());
            w.bytes(&[1, 1]);
            self.put_data_len(w);
            w.u8(self.consumer.0);
            w.bytes(self.data);
            w.u8(self.provider.0);
            block::write(w, BlockType::SubstituteValue, |w| {
                w.u16(MODE_ZERO);
                w.u8(self.consumer.0);
                w.zeros(self.data.len());
                w.u8(self.provider.0);
            });
        });
    }
}
