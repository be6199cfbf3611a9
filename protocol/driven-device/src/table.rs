//! Inputs or outputs of a device as bytes, and the signals in them.

use crate::signal::{Signal, SignalType, number_duplicates};
use crate::value::{SignalValue, ValueError};

/// Inputs or outputs of a device, and the signals in them.
#[derive(Clone, Default, Debug)]
pub struct SignalTable {
    signals: Vec<Signal>,
    parts: Box<[TablePart]>,
    bytes: Box<[u8]>,
    is_big_endian: bool,
}

/// Part of the data with its own provider status: a submodule of PROFINET.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct TablePart {
    /// Bytes.
    pub(crate) len: usize,
    /// True for data of PROFIsafe.
    pub(crate) is_safety: bool,
}

/// Change of the inputs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum InputChange {
    /// None come that count.
    Invalid,
    /// They are the same.
    Same,
    /// They changed.
    Changed,
}

/// Longest number in bytes.
const LONGEST_NUMBER: usize = 8;

impl SignalTable {
    /// Makes a table of zeros of this length. Signals of one name get numbers after it.
    pub(crate) fn new(mut signals: Vec<Signal>, len: usize, is_big_endian: bool) -> Self {
        signals.retain(|signal| signal.fits(len));
        number_duplicates(signals.iter_mut());
        Self { signals, parts: Box::default(), bytes: vec![0; len].into_boxed_slice(), is_big_endian }
    }

    /// Sets the parts of the data, in their order.
    pub(crate) fn with_parts(self, parts: Vec<TablePart>) -> Self {
        Self { parts: parts.into_boxed_slice(), ..self }
    }

    /// Returns the parts of the data.
    pub(crate) const fn parts(&self) -> &[TablePart] {
        &self.parts
    }

    /// Returns the signals by their places.
    #[must_use]
    pub fn signals(&self) -> &[Signal] {
        &self.signals
    }

    /// Returns all bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Replaces all bytes, as for a table that is printed by another thread.
    pub fn replace(&mut self, bytes: &[u8]) {
        self.copy(0, bytes.get(..self.bytes.len()).unwrap_or_default());
    }

    /// Copies new data. Returns whether they differ.
    pub(crate) fn copy(&mut self, at: usize, data: &[u8]) -> bool {
        match self.bytes.get_mut(at..at + data.len()) {
            Some(place) if place != data => {
                place.copy_from_slice(data);
                true
            }
            _ => false,
        }
    }

    /// Sets bytes to zero. Returns whether they changed.
    pub(crate) fn clear(&mut self, at: usize, len: usize) -> bool {
        let place = self.bytes.get_mut(at..at + len).filter(|place| place.iter().any(|byte| *byte != 0));
        place.map(|place| place.fill(0)).is_some()
    }

    /// Finds a signal by its name: the one of this spelling, else the only one that differs in upper and lower case.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<&Signal> {
        if let Some(exact) = self.signals.iter().find(|signal| signal.name == name) {
            return Some(exact);
        }
        // Without the place before it, or in other case, where only one signal has it.
        let is_alike = |signal: &&Signal| {
            let own = signal.name.rsplit_once('/').map_or(signal.name.as_str(), |(_, own)| own);
            own.eq_ignore_ascii_case(name) || signal.name.eq_ignore_ascii_case(name) || signal.place == name
        };
        let mut alike = self.signals.iter().filter(is_alike);
        alike.next().filter(|_| alike.next().is_none())
    }

    /// Returns the value of a signal.
    #[must_use]
    pub fn value(&self, signal: &Signal) -> SignalValue {
        if signal.kind == SignalType::Bytes {
            return SignalValue::Bytes(self.bytes_of(signal));
        }
        let mut number = 0;
        for (at, bit) in self.bit_numbers(signal).enumerate() {
            let is_set = self.bytes.get(bit / 8).is_some_and(|byte| byte & 1 << (bit % 8) != 0);
            number |= u64::from(is_set) << at;
        }
        SignalValue::from_bits(signal.kind, number, signal.bits)
    }

    /// Sets the value of a signal.
    ///
    /// # Errors
    ///
    /// The value is not of the signal's type, or does not fit into it.
    pub(crate) fn set(&mut self, signal: &Signal, value: &SignalValue) -> Result<(), ValueError> {
        if let (SignalType::Bytes, SignalValue::Bytes(bytes)) = (signal.kind, value) {
            let place = self.bytes.get_mut(signal.bit / 8..(signal.bit + signal.bits).div_ceil(8));
            if let Some(place) = place.filter(|place| place.len() == bytes.len()) {
                place.copy_from_slice(bytes);
            }
            return Ok(());
        }
        let number = value.to_bits(signal)?;
        for (at, bit) in self.bit_numbers(signal).enumerate() {
            if let Some(byte) = self.bytes.get_mut(bit / 8) {
                let mask = 1 << (bit % 8);
                *byte = if number >> at & 1 == 1 { *byte | mask } else { *byte & !mask };
            }
        }
        Ok(())
    }

    fn bytes_of(&self, signal: &Signal) -> Vec<u8> {
        self.bytes.get(signal.bit / 8..(signal.bit + signal.bits).div_ceil(8)).unwrap_or_default().to_vec()
    }

    /// Returns the places of a number's bits, from its lowest one.
    fn bit_numbers(&self, signal: &Signal) -> impl Iterator<Item = usize> + use<> {
        let (first, bits) = (signal.bit, signal.bits);
        let has_bytes = first.is_multiple_of(8) && bits.is_multiple_of(8) && bits <= 8 * LONGEST_NUMBER;
        let last_byte = (self.is_big_endian && has_bytes).then(|| first / 8 + bits / 8 - 1);
        (0..bits).map(move |at| match last_byte {
            Some(last) => 8 * (last - at / 8) + at % 8,
            None => first + at,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_both_byte_orders_and_of_any_bits_are_read_as_they_were_set() {
        for is_big_endian in [false, true] {
            let signals = vec![
                Signal::new("word", "1", SignalType::Unsigned, 0, 16),
                Signal::new("three", "1", SignalType::Signed, 17, 3),
                Signal::new("flag", "1", SignalType::Bool, 16, 1),
                Signal::new("real", "1", SignalType::Real, 24, 32),
            ];
            let mut table = SignalTable::new(signals, 7, is_big_endian);
            for (name, text) in [("word", "0x1234"), ("three", "-3"), ("flag", "1"), ("real", "1.5")] {
                let signal = table.find(name).unwrap().clone();
                let value = SignalValue::parse(&signal, text).unwrap();
                table.set(&signal, &value).unwrap();
                assert_eq!(table.value(&signal), value, "{name}");
            }
            let word = if is_big_endian { [0x12, 0x34] } else { [0x34, 0x12] };
            assert_eq!(table.bytes()[..3], [word[0], word[1], 0b1011]);
        }
    }

    #[test]
    fn signals_of_one_name_get_numbers_and_those_beyond_the_data_are_left_out() {
        let signal = |bit| Signal::new("Output", "1", SignalType::Unsigned, bit, 8);
        let table = SignalTable::new(vec![signal(0), signal(8), signal(16)], 2, false);
        let names: Vec<_> = table.signals().iter().map(|signal| signal.name.as_str()).collect();
        assert_eq!(names, ["Output", "Output#2"]);
        assert_eq!(table.find("OUTPUT").map(|signal| signal.bit), Some(0), "the only one but for its case");
    }
}
