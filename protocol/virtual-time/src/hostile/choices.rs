//! The choices of a stranger: random, or from the bytes of a fuzzer.

use alloc::collections::VecDeque;
use alloc::vec::Vec;

use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

/// Source of a stranger's choices.
pub trait Choices {
    /// Returns a number below `limit`, or 0 if that is 0.
    fn below(&mut self, limit: usize) -> usize;

    /// Returns whether there are no more choices: the stranger falls silent.
    fn is_over(&self) -> bool {
        false
    }
}

/// Choices of a seeded random stream.
pub type Random = Pcg64Mcg;

impl Choices for Random {
    fn below(&mut self, limit: usize) -> usize {
        usize::try_from(self.next_u64() % limit.max(1) as u64).unwrap_or(0)
    }
}

/// Choices read from bytes, such as a fuzzer's: each choice reads as many bytes as its limit has.
#[derive(Clone, Debug)]
pub struct Script(VecDeque<u8>);

impl Script {
    /// Takes all choices from these bytes.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Self {
        Self(bytes.iter().copied().collect())
    }

    /// Takes the next `len` bytes unchanged, or all that are left.
    pub fn take(&mut self, len: usize) -> Vec<u8> {
        self.0.drain(..len.min(self.0.len())).collect()
    }
}

impl Choices for Script {
    fn below(&mut self, limit: usize) -> usize {
        let (mut value, mut most) = (0_usize, 0_usize);
        while most < limit.saturating_sub(1) {
            value = value << 8 | usize::from(self.0.pop_front().unwrap_or(0));
            most = most << 8 | 0xFF;
        }
        value % limit.max(1)
    }

    fn is_over(&self) -> bool {
        self.0.is_empty()
    }
}
