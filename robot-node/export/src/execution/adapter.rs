//! The functions of an adapter as the executed form calls them: byte order, REAL and bits, the clock.

use protocol::image::Order;

use crate::form::AdapterTest;

/// Functions of an adapter. The default ones are right; a test puts a wrong one in the place of one of them.
#[derive(Clone, Copy, Debug)]
pub struct AdapterFunctions {
    /// Two bytes in the order of the bus, or from it.
    pub word: fn(Order, u16) -> u16,
    /// Four bytes in the order of the bus, or from it.
    pub double_word: fn(Order, u32) -> u32,
    /// The REAL of 32 bits.
    pub real: fn(u32) -> f32,
    /// The 32 bits of a REAL.
    pub bits: fn(f32) -> u32,
    /// Bits that are an infinity or not a number.
    pub is_not_finite: fn(u32) -> bool,
    /// The clock of the stopwatches in ms, by the true time in ms.
    pub clock_ms: fn(u64) -> u64,
}

impl Default for AdapterFunctions {
    fn default() -> Self {
        Self {
            word: |order, value| if order == Order::BigEndian { value.swap_bytes() } else { value },
            double_word: |order, value| if order == Order::BigEndian { value.swap_bytes() } else { value },
            real: f32::from_bits,
            bits: f32::to_bits,
            is_not_finite: |bits| !f32::from_bits(bits).is_finite(),
            clock_ms: |now| now,
        }
    }
}

impl AdapterFunctions {
    /// Returns a number of so many bytes in the order of the bus, or from it.
    pub(super) fn in_order(&self, order: Order, len: usize, value: u32) -> u32 {
        match len {
            1 => value,
            2 => (self.word)(order, value as u16).into(),
            _ => (self.double_word)(order, value),
        }
    }

    /// Returns whether a test passes.
    pub(super) fn passes(&self, order: Order, test: AdapterTest) -> bool {
        let is_swapped = order == Order::BigEndian;
        let real = |literal: &str| literal.parse::<f32>().unwrap_or(f32::NAN);
        match test {
            AdapterTest::Word(value) => {
                (self.word)(order, value) == if is_swapped { value.swap_bytes() } else { value }
            }
            AdapterTest::DoubleWord(value) => {
                (self.double_word)(order, value) == if is_swapped { value.swap_bytes() } else { value }
            }
            AdapterTest::BitsOfReal(literal, bits) => (self.bits)(real(literal)) == bits,
            AdapterTest::RealOfBits(bits, literal) => (self.real)(bits) == real(literal),
            AdapterTest::Finite(bits, is_finite) => (self.is_not_finite)(bits) != is_finite,
        }
    }
}
