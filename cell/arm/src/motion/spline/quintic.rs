//! The curve of a piece as polynomials of degree five, by the share τ of the piece.

use crate::{dot, length};

/// Position in mm and quaternion.
pub(super) type Pose = [f64; 7];

/// Factors of τ⁰ to τ⁵.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Quintic(pub(super) [Pose; 6]);

impl Quintic {
    /// How fast the way grows with the share, in mm.
    pub(super) fn speed(&self, share: f64) -> f64 {
        length(self.slope(share))
    }

    /// How the share grows with the way: its first two derivatives, by mm.
    pub(super) fn growth_at(&self, share: f64) -> [f64; 2] {
        let (slope, bend) = (self.slope(share), self.bend(share));
        let square = dot(slope, slope).max(1e-18);
        [1.0 / square.sqrt(), -dot(slope, bend) / (square * square)]
    }

    /// The position's second derivative by the way, in 1/mm.
    pub(super) fn bend_by_way(&self, share: f64) -> [f64; 3] {
        let (slope, bend) = (self.slope(share), self.bend(share));
        let square = dot(slope, slope).max(1e-18);
        let along = dot(slope, bend) / square;
        core::array::from_fn(|i| (bend[i] - along * slope[i]) / square)
    }

    /// The position's second derivative by the share, in mm.
    fn bend(&self, share: f64) -> [f64; 3] {
        let [_, _, c, d, e, f] = &self.0;
        core::array::from_fn(|i| {
            ((20.0 * f[i] * share + 12.0 * e[i]) * share + 6.0 * d[i]) * share + 2.0 * c[i]
        })
    }

    /// The position's derivative by the share, in mm.
    pub(super) fn slope(&self, share: f64) -> [f64; 3] {
        let [_, b, c, d, e, f] = &self.0;
        core::array::from_fn(|i| {
            (((5.0 * f[i] * share + 4.0 * e[i]) * share + 3.0 * d[i]) * share + 2.0 * c[i]) * share + b[i]
        })
    }

    /// The pose at a share τ, its quaternion of any length.
    pub(super) fn at(&self, share: f64) -> Pose {
        let [a, b, c, d, e, f] = &self.0;
        core::array::from_fn(|i| {
            ((((f[i] * share + e[i]) * share + d[i]) * share + c[i]) * share + b[i]) * share + a[i]
        })
    }
}
