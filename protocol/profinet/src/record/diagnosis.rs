//! DiagnosisData: faults of a device, also from before the connection.
//!
//! ```text
//! DiagnosisData   version 1.1: API u32 · slot u16 · subslot u16 · ChannelNumber u16 · ChannelProperties u16
//!                 UserStructureIdentifier u16 · data up to the end of the block; version 1.0 has no API
//! ```
//!
//! A record has a block for each diagnosis (IEC 61158-6-10, DiagnosisData).

use alloc::vec::Vec;

use crate::block::{self, BlockReader, BlockType, BlockWriter, HEAD_LEN};
use crate::connect::API;

/// Diagnosis of a channel, or of the submodule as a whole.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Diagnosis {
    /// API.
    pub api: u32,
    /// Slot number.
    pub slot: u16,
    /// Subslot number.
    pub subslot: u16,
    /// ChannelNumber; 0x8000 is the submodule as a whole.
    pub channel: u16,
    /// ChannelProperties: kind, maintenance, and whether the error appears.
    pub properties: u16,
    /// UserStructureIdentifier: the form of the data.
    pub identifier: u16,
    /// Data, such as ChannelDiagnosisData.
    pub data: Vec<u8>,
}

/// Bits 9 and 10 of ChannelProperties: maintenance required, maintenance demanded.
const MAINTENANCE: [u16; 2] = [1 << 9, 1 << 10];

/// BlockVersionLow of a block with an API.
const WITH_API: u8 = 1;

/// First UserStructureIdentifier of diagnosis by channel, and its last one.
const CHANNEL_CODING: core::ops::RangeInclusive<u16> = 0x8000..=0x8003;

impl Diagnosis {
    /// Returns whether it belongs into the diagnosis record of an index, whatever the record is about (IEC 61158-6-10, Index):
    /// 00A diagnosis by channel, 00B diagnosis, 00C all, 010 to 013 maintenance.
    pub(crate) fn is_in(&self, index: u16) -> bool {
        let [required, demanded] = MAINTENANCE.map(|bit| self.properties & bit != 0);
        let by_channel = CHANNEL_CODING.contains(&self.identifier);
        match index & 0x0FFF {
            0x00A => by_channel && !required && !demanded,
            0x00B | 0x80B => !required && !demanded,
            0x00C | 0x80C => true,
            0x010 => by_channel && required,
            0x011 => by_channel && demanded,
            0x012 => required,
            0x013 => demanded,
            _ => false,
        }
    }

    /// Writes it, as a block of version 1.1.
    pub fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write_version(writer, BlockType::DiagnosisData, WITH_API, |w| {
            w.u32(self.api);
            for word in [self.slot, self.subslot, self.channel, self.properties, self.identifier] {
                w.u16(word);
            }
            w.bytes(&self.data);
        });
    }
}

/// Reads the diagnosis of a record; `None` if it is not one. Blocks of other types are left out.
#[must_use]
pub fn parse_diagnosis(record: &[u8]) -> Option<Vec<Diagnosis>> {
    let mut reader = BlockReader::new(record);
    let mut found = Vec::new();
    // A device may fill the record up to a multiple of four bytes.
    while reader.left() >= HEAD_LEN {
        let block_type = reader.u16().ok()?;
        let length = usize::from(reader.u16().ok()?);
        let mut block = BlockReader::new(reader.bytes(length).ok()?);
        let version = (block.u8().ok()?, block.u8().ok()?);
        if BlockType::from(block_type) != BlockType::DiagnosisData {
            continue;
        }
        let api = match version {
            (1, 0) => API,
            (1, WITH_API) => block.u32().ok()?,
            _ => return None,
        };
        let mut word = || block.u16().ok();
        let (slot, subslot) = (word()?, word()?);
        let (channel, properties, identifier) = (word()?, word()?, word()?);
        let data = block.rest().to_vec();
        found.push(Diagnosis { api, slot, subslot, channel, properties, identifier, data });
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::emitted;

    fn short_circuit(channel: u16, properties: u16) -> Diagnosis {
        let words = [channel, properties, 1].map(u16::to_be_bytes);
        Diagnosis {
            api: 0,
            slot: 2,
            subslot: 1,
            channel,
            properties,
            identifier: 0x8000,
            data: words.as_flattened().to_vec(),
        }
    }

    #[test]
    fn diagnosis_is_read_as_it_is_written_also_without_an_api() {
        let both = [short_circuit(3, 1 << 11), short_circuit(0x8000, 1 << 11)];
        let record: Vec<u8> = both.iter().flat_map(|it| emitted(|w| it.emit(w))).collect();
        assert_eq!(parse_diagnosis(&record).unwrap(), both);
        assert_eq!(record[..8], [0, 0x10, 0, 22, 1, 1, 0, 0]);
        // Version 1.0 is the same without the API.
        let mut old = emitted(|w| both[0].emit(w));
        old.drain(6..10);
        (old[3], old[5]) = (18, 0);
        assert_eq!(parse_diagnosis(&old).unwrap(), both[..1]);
        assert_eq!(parse_diagnosis(&[]).unwrap(), []);
    }

    #[test]
    fn a_record_cut_or_altered_anywhere_is_taken_without_a_panic() {
        let whole = emitted(|w| short_circuit(3, 1 << 11).emit(w));
        for len in 6..whole.len() {
            assert_eq!(parse_diagnosis(&whole[..len]), None, "{len}");
        }
        for place in 0..whole.len() {
            for value in 0..=u8::MAX {
                let mut altered = whole.clone();
                altered[place] = value;
                let _ = parse_diagnosis(&altered);
            }
        }
    }

    #[test]
    fn records_of_maintenance_and_of_diagnosis_have_each_their_own() {
        let (fault, required) = (short_circuit(1, 1 << 11), short_circuit(1, 1 << 11 | 1 << 9));
        let indices = [0x800A, 0xF00B, 0xF80C, 0xC010, 0xE013];
        assert_eq!(indices.map(|index| fault.is_in(index)), [true, true, true, false, false]);
        assert_eq!(indices.map(|index| required.is_in(index)), [false, false, true, true, false]);
    }
}
