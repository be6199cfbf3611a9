//! Random values of a seed, the same on every machine.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

#[derive(Debug)]
pub(super) struct Dice(Pcg64Mcg);

impl Dice {
    pub(super) fn new(seed: u64) -> Self {
        Self(Pcg64Mcg::seed_from_u64(seed))
    }

    pub(super) fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Evenly spread within 0..1.
    pub(super) fn share(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn chance(&mut self, of_one: f64) -> bool {
        self.share() < of_one
    }

    /// Evenly spread.
    pub(super) fn between(&mut self, lower: f64, upper: f64) -> f64 {
        lower + self.share() * (upper - lower)
    }

    /// Small and large values alike: its logarithm is evenly spread.
    pub(super) fn scale(&mut self, lower: f64, upper: f64) -> f64 {
        libm::exp(self.between(libm::log(lower), libm::log(upper)))
    }

    /// A whole number below `count`, which is above 0.
    pub(super) fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// One of these, by weight.
    pub(super) fn pick<T: Copy>(&mut self, weighted: &[(T, u32)]) -> Option<T> {
        let total: u32 = weighted.iter().map(|(_, weight)| weight).sum();
        let mut drawn = self.below(total.max(1) as usize) as u32;
        weighted.iter().find_map(|(value, weight)| {
            if drawn < *weight {
                return Some(*value);
            }
            drawn -= weight;
            None
        })
    }

    /// A unit vector of any direction.
    pub(super) fn direction(&mut self) -> [f64; 3] {
        let z = self.between(-1.0, 1.0);
        let (sin, cos) = libm::sincos(self.between(0.0, core::f64::consts::TAU));
        let level = (1.0 - z * z).sqrt();
        [level * cos, level * sin, z]
    }
}
