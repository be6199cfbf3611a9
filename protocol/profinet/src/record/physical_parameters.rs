//! What a controller writes to the interface and the ports of a device: kept for the AR, so that it can be read again, one by
//! one and all together as PDExpectedData.
//!
//! ```text
//! PDPortDataCheck    padding 2 · slot u16 · subslot u16 · blocks: the neighbours and the state that a port should have
//! PDPortDataAdjust   padding 2 · slot u16 · subslot u16 · blocks: settings of a port
//! PDInterfaceAdjust  padding 2 · MultipleInterfaceMode u32
//! ```
//!
//! MultipleInterfaceMode tells how the station names itself by LLDP. All else has no effect, since the operating system owns the
//! interface; a neighbour that is not the one that a port should have is not reported.

use alloc::vec::Vec;

use super::{emit_multiple, index, is_port, only_block};
use crate::block::{BlockType, BlockWriter, HEAD_LEN};
use crate::description::{Description, INTERFACE_SUBSLOT};
use crate::lldp::Naming;
use crate::status::Violation;
use machine::wire::{BigEndian, Reader};

/// Length of the longest record in bytes: a neighbour of a port has two names of up to 255 bytes.
const MOST_BYTES: usize = 1024;

/// The records that can be written.
const INDICES: [u16; 3] = [index::PD_PORT_DATA_CHECK, index::PD_PORT_DATA_ADJUST, index::PD_INTERFACE_ADJUST];

/// What was written to the interface and the ports of a device.
#[derive(Debug)]
pub struct PhysicalParameters {
    places: Vec<Place>,
}

#[derive(Debug)]
struct Place {
    slot: u16,
    subslot: u16,
    index: u16,
    /// The record; empty if it was not written.
    record: Vec<u8>,
}

impl PhysicalParameters {
    /// Allocates the memory for all records that the device can have; nothing later allocates.
    #[must_use]
    pub fn new(description: &Description) -> Self {
        let mut places = Vec::new();
        for (slot, submodule) in description.submodules() {
            let subslot = submodule.subslot;
            for index in INDICES.into_iter().filter(|index| Self::has(subslot, *index)) {
                places.push(Place { slot, subslot, index, record: Vec::with_capacity(MOST_BYTES) });
            }
        }
        Self { places }
    }

    /// Returns whether a submodule has a record of this index.
    #[must_use]
    pub const fn has(subslot: u16, index: u16) -> bool {
        block_type(subslot, index).is_some()
    }

    /// Checks a Write to a submodule that has a record of this index. Returns the block without what fills the record up.
    pub fn check(subslot: u16, index: u16, record: &[u8]) -> Result<&[u8], Violation> {
        let wanted = block_type(subslot, index).ok_or(Violation::InvalidIndex)?;
        let len = HEAD_LEN + only_block(record, wanted)?.left();
        record.get(..len).filter(|_| len <= MOST_BYTES).ok_or(Violation::WriteLength)
    }

    /// Keeps a block that was checked.
    pub fn write(&mut self, slot: u16, subslot: u16, index: u16, block: &[u8]) {
        let is_it = |place: &&mut Place| (place.slot, place.subslot, place.index) == (slot, subslot, index);
        if let Some(place) = self.places.iter_mut().find(is_it) {
            place.record.clear();
            place.record.extend_from_slice(block.get(..MOST_BYTES).unwrap_or(block));
        }
    }

    /// Returns how the station is named to its neighbour: bit 0 of MultipleInterfaceMode.
    #[must_use]
    pub fn naming(&self) -> Naming {
        let adjust = self.places.iter().find(|place| place.index == index::PD_INTERFACE_ADJUST);
        let mut block = Reader::<BigEndian>::new(adjust.map_or(&[], |place| &place.record));
        let mode = block.skip(HEAD_LEN + 2).and_then(|()| block.u32()).unwrap_or(0);
        if mode & 1 == 0 { Naming::Station } else { Naming::Device }
    }

    /// Writes what was written to a submodule with this index; nothing if it was not written.
    pub fn emit(&self, slot: u16, subslot: u16, index: u16, writer: &mut BlockWriter<'_>) {
        let is_it = |place: &&Place| (place.slot, place.subslot, place.index) == (slot, subslot, index);
        if let Some(place) = self.places.iter().find(is_it) {
            writer.bytes(&place.record);
        }
    }

    /// Writes PDExpectedData: all that was written, by submodule; nothing if nothing was.
    pub fn emit_all(&self, writer: &mut BlockWriter<'_>) {
        let is_same = |one: &Place, other: &Place| (one.slot, one.subslot) == (other.slot, other.subslot);
        for of_submodule in self.places.chunk_by(is_same) {
            let written = of_submodule.iter().filter(|place| !place.record.is_empty());
            if let Some(Place { slot, subslot, .. }) = written.clone().next() {
                emit_multiple(*slot, *subslot, writer, |w| written.for_each(|place| w.bytes(&place.record)));
            }
        }
    }
}

const fn block_type(subslot: u16, index: u16) -> Option<BlockType> {
    match index {
        index::PD_PORT_DATA_CHECK if is_port(subslot) => Some(BlockType::PdPortDataCheck),
        index::PD_PORT_DATA_ADJUST if is_port(subslot) => Some(BlockType::PdPortDataAdjust),
        index::PD_INTERFACE_ADJUST if subslot == INTERFACE_SUBSLOT => Some(BlockType::PdInterfaceAdjust),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::samples;

    proptest! {
        /// Whatever is written, what is accepted is one block with the length in its head, and comes back as it was.
        #[test]
        fn what_is_accepted_is_one_whole_block(
            place in proptest::sample::select(vec![(0x8001, 0x802B), (0x8001, 0x802F), (0x8000, 0x8071)]),
            block_type in any::<u8>(),
            len in 0_u16..1_100,
            rest in proptest::collection::vec(any::<u8>(), 0..1_100),
        ) {
            let ((subslot, index), [high, low]) = (place, len.to_be_bytes());
            let codes = [0, 2, 0x50, block_type];
            let record = [&[2, codes[usize::from(block_type) % 4], high, low, 1, 0][..], &rest].concat();
            let mut parameters = PhysicalParameters::new(&samples::DEVICE);
            let mut buf = [0; 2_000];
            if let Ok(block) = PhysicalParameters::check(subslot, index, &record) {
                prop_assert_eq!(block.len(), usize::from(len) + 4);
                prop_assert!(record.starts_with(block) && record.len() < block.len() + 4);
                parameters.write(0, subslot, index, block);
                let mut writer = BlockWriter::new(&mut buf);
                parameters.emit(0, subslot, index, &mut writer);
                let end = writer.finish().unwrap();
                prop_assert_eq!(&buf[..end], block);
            }
            let mut writer = BlockWriter::new(&mut buf);
            parameters.emit_all(&mut writer);
            let end = writer.finish().unwrap();
            // One MultipleBlockHeader of 16 bytes before what was accepted.
            let whole = end == 0 || buf[..end].ends_with(&record[..end - 16]);
            prop_assert!(whole, "{}", end);
        }
    }
}
