//! A running digest of motions: shows whether two nodes handled the same motions in the same order.

use super::{MOTION_LEN, Motion};
use machine::wire::{BigEndian, Writer};

/// Offset basis and prime of the hash of Fowler, Noll and Vo, FNV-1a, with 64 bits.
const OFFSET_BASIS: u64 = 0xCBF2_9CE4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01B3;

/// Number of motions, and the digest of all of them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Sum {
    /// Motions so far.
    pub motions: u64,
    /// FNV-1a with 64 bits over their 44 bytes each, big-endian, one after another.
    pub value: u64,
}

impl Sum {
    /// Digest of no motions.
    pub const NONE: Self = Self { motions: 0, value: OFFSET_BASIS };
}

impl core::fmt::Display for Sum {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:016x} over {} motions", self.value, self.motions)
    }
}

/// A digest that is extended by one motion at a time.
///
/// A lost, duplicated, altered or misplaced motion changes every later value. Two nodes have seldom handled equally
/// many motions; so each also keeps its digest at the last multiple of [`Digest::INTERVAL`] motions, which is the
/// same multiple for both most of the time. It detects faults, not forgery.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Digest {
    sum: Sum,
    mark: Sum,
}

impl Default for Digest {
    fn default() -> Self {
        Self { sum: Sum::NONE, mark: Sum::NONE }
    }
}

impl Digest {
    /// Motions from one mark to the next.
    pub const INTERVAL: u64 = 1024;

    /// Adds a motion.
    pub fn add(&mut self, motion: &Motion) {
        let mut bytes = [0; MOTION_LEN];
        motion.emit(&mut Writer::<BigEndian>::new(&mut bytes));
        let value = fnv_1a(self.sum.value, &bytes);
        self.sum = Sum { motions: self.sum.motions + 1, value };
        if self.sum.motions.is_multiple_of(Self::INTERVAL) {
            self.mark = self.sum;
        }
    }

    /// Returns the digest of all motions so far.
    #[must_use]
    pub const fn sum(&self) -> Sum {
        self.sum
    }

    /// Returns the digest at the end of the last complete interval.
    #[must_use]
    pub const fn mark(&self) -> Sum {
        self.mark
    }
}

fn fnv_1a(start: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(start, |value, byte| (value ^ u64::from(*byte)).wrapping_mul(PRIME))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::MotionKind;
    use alloc::vec::Vec;
    use proptest::prelude::*;

    fn motions(count: u16) -> Vec<Motion> {
        let motion = |velocity| Motion { kind: MotionKind::LinCartesian, velocity, ..Motion::EMPTY };
        (1..=count).map(motion).collect()
    }

    fn digest(motions: &[Motion]) -> Digest {
        let mut digest = Digest::default();
        motions.iter().for_each(|motion| digest.add(motion));
        digest
    }

    #[test]
    fn the_hash_passes_the_published_vectors_of_fnv_1a() {
        for (text, value) in
            [("", 0xCBF2_9CE4_8422_2325), ("a", 0xAF63_DC4C_8601_EC8C), ("foobar", 0x8594_4171_F739_67E8)]
        {
            assert_eq!(fnv_1a(OFFSET_BASIS, text.as_bytes()), value, "{text}");
        }
    }

    #[test]
    fn a_mark_stays_until_the_next_interval_is_complete() {
        let all = motions(2_100);
        assert_eq!(digest(&all).mark(), digest(&all[..2_048]).sum());
        assert_eq!(digest(&all[..1_023]).mark(), Sum::NONE);
    }

    proptest! {
        #[test]
        fn a_lost_duplicated_altered_or_misplaced_motion_changes_the_digest(at in 0..29_usize) {
            let good = motions(30);
            let faults: [fn(&mut Vec<Motion>, usize); 4] = [
                |motions, at| { motions.remove(at); },
                |motions, at| motions.insert(at, motions[at]),
                |motions, at| motions[at].target[0] = -0.0,
                |motions, at| motions.swap(at, at + 1),
            ];
            for fault in faults {
                let mut bad = good.clone();
                fault(&mut bad, at);
                prop_assert_ne!(digest(&bad).sum().value, digest(&good).sum().value);
            }
        }
    }
}
