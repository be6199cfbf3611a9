//! Inputs and outputs of a device as bytes, and the places in them that a script names.

use serde::Serialize;

/// Place of data, such as a submodule, an assembly or an entry of a process data object.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct DataPlace {
    /// Name for a script: `1.2` for a subslot, `100` for an assembly, `0x6000:01` for an entry.
    pub place: String,
    /// Name in the file.
    pub name: String,
    /// First bit in the bytes of its direction.
    pub bit: usize,
    /// Bits.
    pub bits: usize,
}

/// Data of one direction.
#[derive(Clone, Default, Debug)]
pub(crate) struct Image {
    pub(crate) places: Vec<DataPlace>,
    pub(crate) bytes: Box<[u8]>,
    /// True for each place whose data count now; those of one whose provider status is bad do not.
    pub(crate) counts: Box<[bool]>,
    /// True if numbers have their highest byte first.
    pub(crate) is_big_endian: bool,
}

impl Image {
    /// Makes an image of zeros for these places.
    pub(crate) fn new(places: Vec<DataPlace>, is_big_endian: bool) -> Self {
        let bits = places.iter().map(|place| place.bit + place.bits).max().unwrap_or(0);
        let counts = vec![false; places.len()].into_boxed_slice();
        Self { places, bytes: vec![0; bits.div_ceil(8)].into_boxed_slice(), counts, is_big_endian }
    }

    /// Returns whether the data of any place count.
    pub(crate) fn has_data(&self) -> bool {
        self.counts.contains(&true)
    }

    /// Returns whether the data of a place count.
    pub(crate) fn does_count(&self, name: &str) -> bool {
        let number = self.places.iter().position(|place| place.place == name);
        number.and_then(|number| self.counts.get(number)).is_some_and(|counts| *counts)
    }

    /// Takes over the data of all places, or notes that none count. Returns whether anything has changed.
    pub(crate) fn set_all(&mut self, data: Option<&[u8]>) -> bool {
        let counts = data.is_some();
        let mut is_changed = self.counts.contains(&!counts);
        self.counts.fill(counts);
        if let Some(data) = data {
            let len = data.len();
            is_changed |= self.bytes.get_mut(..len).is_some_and(|to| copy(to, data));
        }
        is_changed
    }

    pub(crate) fn place(&self, name: &str) -> Option<&DataPlace> {
        self.places.iter().find(|place| place.place == name)
    }

    /// Returns the bytes of a place that begins and ends with bytes.
    pub(crate) fn of_place(&self, name: &str) -> Option<&[u8]> {
        let place = self.place(name).filter(|place| place.bit % 8 == 0)?;
        self.bytes.get(place.bit / 8..(place.bit + place.bits).div_ceil(8))
    }

    /// Writes bits, the lowest first, from a bit on.
    pub(crate) fn write_bits(&mut self, bit: usize, bits: usize, value: &[u8]) {
        for index in 0..bits {
            let is_set = value.get(index / 8).is_some_and(|byte| byte & 1 << (index % 8) != 0);
            if let Some(byte) = self.bytes.get_mut((bit + index) / 8) {
                let mask = 1 << ((bit + index) % 8);
                *byte = if is_set { *byte | mask } else { *byte & !mask };
            }
        }
    }
}

/// Copies data of this length. Returns whether they differ.
pub(crate) fn copy(to: &mut [u8], from: &[u8]) -> bool {
    let is_changed = to.len() == from.len() && to != from;
    if is_changed {
        to.copy_from_slice(from);
    }
    is_changed
}
