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
    /// True if numbers have their highest byte first.
    pub(crate) is_big_endian: bool,
}

impl Image {
    /// Makes an image of zeros for these places.
    pub(crate) fn new(places: Vec<DataPlace>, is_big_endian: bool) -> Self {
        let bits = places.iter().map(|place| place.bit + place.bits).max().unwrap_or(0);
        Self { places, bytes: vec![0; bits.div_ceil(8)].into_boxed_slice(), is_big_endian }
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
