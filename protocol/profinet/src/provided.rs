//! The data that a station provides in its cyclic frames, stored from one connection to the next.

use alloc::vec;
use alloc::vec::Vec;

/// Why data cannot be set.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum DataError {
    /// There is no submodule with data in this direction.
    #[error("subslot 0x{subslot:04X} of slot {slot} has no data in this direction")]
    NoData {
        /// Slot number.
        slot: u16,
        /// Subslot number.
        subslot: u16,
    },
    /// The submodule has data of another length.
    #[error("subslot 0x{subslot:04X} of slot {slot} has {expected} bytes of data, not {found}")]
    Length {
        /// Slot number.
        slot: u16,
        /// Subslot number.
        subslot: u16,
        /// Its length in bytes.
        expected: usize,
        /// Bytes that were passed.
        found: usize,
    },
}

/// The data of one submodule.
#[derive(Clone, PartialEq, Eq, Debug)]
struct Part {
    slot: u16,
    subslot: u16,
    data: Vec<u8>,
    is_set: bool,
}

/// The data of every submodule that has some in one direction, by ascending slot and subslot.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Provided {
    parts: Vec<Part>,
}

impl Provided {
    /// Creates zeros for submodules of these slots, subslots and lengths in bytes.
    pub(crate) fn new(submodules: impl Iterator<Item = (u16, u16, u16)>) -> Self {
        let part =
            |(slot, subslot, len)| Part { slot, subslot, data: vec![0; usize::from(len)], is_set: false };
        Self { parts: submodules.filter(|(.., len)| *len > 0).map(part).collect() }
    }

    /// Sets the data of one submodule.
    pub(crate) fn set(&mut self, slot: u16, subslot: u16, data: &[u8]) -> Result<(), DataError> {
        let here = |part: &&mut Part| (part.slot, part.subslot) == (slot, subslot);
        let part = self.parts.iter_mut().find(here).ok_or(DataError::NoData { slot, subslot })?;
        if part.data.len() != data.len() {
            let (expected, found) = (part.data.len(), data.len());
            return Err(DataError::Length { slot, subslot, expected, found });
        }
        part.data.copy_from_slice(data);
        part.is_set = true;
        Ok(())
    }

    /// Calls `write` with the place of each submodule's data.
    pub(crate) fn set_all(&mut self, mut write: impl FnMut(u16, u16, &mut [u8])) {
        self.set_some(|slot, subslot, data| {
            write(slot, subslot, data);
            true
        });
    }

    /// Calls `write` with the place of each submodule's data; they count where it returns true.
    pub(crate) fn set_some(&mut self, mut write: impl FnMut(u16, u16, &mut [u8]) -> bool) {
        for Part { slot, subslot, data, is_set } in &mut self.parts {
            *is_set |= write(*slot, *subslot, data);
        }
    }

    /// Makes all data zeros that were never set.
    pub(crate) fn withdraw(&mut self) {
        for Part { data, is_set, .. } in &mut self.parts {
            data.fill(0);
            *is_set = false;
        }
    }

    /// Returns the data of a submodule, and whether they were ever set.
    pub(crate) fn get(&self, slot: u16, subslot: u16) -> Option<(&[u8], bool)> {
        let part = self.parts.iter().find(|part| (part.slot, part.subslot) == (slot, subslot))?;
        Some((&part.data, part.is_set))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_of_another_length_or_place_are_refused_and_change_nothing() {
        let mut provided = Provided::new([(0, 1, 0), (1, 1, 2), (1, 2, 1)].into_iter());
        assert_eq!(provided.set(0, 1, &[]), Err(DataError::NoData { slot: 0, subslot: 1 }));
        let length = DataError::Length { slot: 1, subslot: 1, expected: 2, found: 3 };
        assert_eq!(provided.set(1, 1, &[1, 2, 3]), Err(length));
        assert_eq!(provided.get(1, 1), Some((&[0, 0][..], false)));
        assert_eq!(provided.set(1, 1, &[1, 2]), Ok(()));
        assert_eq!(provided.get(1, 1), Some((&[1, 2][..], true)));
        assert_eq!(provided.get(1, 2), Some((&[0][..], false)));
    }

    #[test]
    fn all_data_are_set_at_once_by_ascending_slot_and_subslot() {
        let mut provided = Provided::new([(0, 1, 0), (1, 1, 2), (1, 2, 1)].into_iter());
        let mut places = Vec::new();
        provided.set_all(|slot, subslot, data| {
            places.push((slot, subslot, data.len()));
            data.fill(subslot as u8);
        });
        assert_eq!(places, [(1, 1, 2), (1, 2, 1)]);
        assert_eq!(provided.get(1, 1), Some((&[1, 1][..], true)));
        assert_eq!(provided.get(1, 2), Some((&[2][..], true)));
    }
}
