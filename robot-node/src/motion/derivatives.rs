//! How joints and tool change along a part of a path: first to third derivatives, from few samples.
//!
//! The part is sampled at Chebyshev points, and the polynomial through the samples is differentiated. Joints along a
//! path are smooth but at singular positions, so that few points say much; how fast the polynomial's last factors
//! fall off says how much they leave out.

use core::f64::consts::PI;
use std::sync::LazyLock;

use crate::arm::AXES;

/// Samples of a part.
pub(super) const NODES: usize = 9;

/// Points at which the derivatives are known: the samples and one between each two of them.
pub(super) const POINTS: usize = 2 * NODES - 1;

/// Six joints and the three coordinates of the tool.
pub(super) const CHANNELS: usize = AXES + 3;

/// Joints in degrees (mm), and the tool in mm.
pub(super) type Sample = [f64; CHANNELS];

/// Shares of a part at which it is sampled, from 0 to 1.
pub(super) static SHARES: LazyLock<[f64; NODES]> =
    LazyLock::new(|| core::array::from_fn(|node| (1.0 - chebyshev_point(node, NODES)) / 2.0));

/// The derivatives of one order at all points.
type OfOrder<T> = [T; 3];

/// The first, second and third derivatives along a part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Derivatives {
    /// By order, then by point.
    pub(super) at: OfOrder<[Sample; POINTS]>,
    /// What they may be off, by order.
    pub(super) off: OfOrder<Sample>,
}

impl Derivatives {
    /// From samples at [`SHARES`] of a part that is `width` long.
    pub(super) fn of(samples: &[Sample; NODES], width: f64) -> Self {
        let operators = &*OPERATORS;
        let mut scale = 1.0;
        let mut found = Self { at: [[[0.0; CHANNELS]; POINTS]; 3], off: [[0.0; CHANNELS]; 3] };
        let last = operators.factors.map(|weights| weighted(&weights, samples));
        for order in 0..3 {
            scale /= width;
            for (point, weights) in found.at[order].iter_mut().zip(&operators.derivatives[order]) {
                *point = weighted(weights, samples).map(|value| value * scale);
            }
            for (channel, off) in found.off[order].iter_mut().enumerate() {
                let before = last[0][channel].abs() + last[1][channel].abs();
                let end = last[2][channel].abs() + last[3][channel].abs();
                // The factors fall off evenly. Those left out have the slope of their polynomial's end at most.
                let fall = if end < before { end / before } else { 1.0 };
                *off = end * fall * operators.ends[order] * scale;
            }
        }
        found
    }
}

fn weighted(weights: &[f64; NODES], samples: &[Sample; NODES]) -> Sample {
    let mut sum = [0.0; CHANNELS];
    for (weight, sample) in weights.iter().zip(samples) {
        for (sum, value) in sum.iter_mut().zip(sample) {
            *sum += weight * value;
        }
    }
    sum
}

struct Operators {
    derivatives: OfOrder<[[f64; NODES]; POINTS]>,
    /// The polynomial's last four factors, in the order of their degrees.
    factors: [[f64; NODES]; 4],
    /// The derivatives at the end of the next but one Chebyshev polynomial.
    ends: OfOrder<f64>,
}

static OPERATORS: LazyLock<Operators> = LazyLock::new(|| {
    let degree = NODES - 1;
    let half = |index: usize| if index == 0 || index == degree { 0.5 } else { 1.0 };
    // Over the shares, the part begins at the far end of the Chebyshev points.
    let factor = |order: usize, node: usize| {
        let angle = PI * (order * (degree - node)) as f64 / degree as f64;
        2.0 / degree as f64 * half(order) * half(node) * angle.cos()
    };
    let mut derivatives = [[[0.0; NODES]; POINTS]; 3];
    for (point, x) in (0..POINTS).map(|point| (point, -chebyshev_point(point, POINTS))) {
        for polynomial in 0..NODES {
            let values = slopes(polynomial, x);
            for node in 0..NODES {
                for order in 0..3 {
                    derivatives[order][point][node] += values[order] * factor(polynomial, node);
                }
            }
        }
    }
    Operators {
        derivatives,
        factors: core::array::from_fn(|last| core::array::from_fn(|node| factor(NODES - 4 + last, node))),
        ends: slopes(NODES + 1, 1.0),
    }
});

fn chebyshev_point(index: usize, points: usize) -> f64 {
    (PI * index as f64 / (points - 1) as f64).cos()
}

/// The derivatives of a Chebyshev polynomial by the share, at `x` within −1…1, by its recurrence.
fn slopes(degree: usize, x: f64) -> OfOrder<f64> {
    // Value and derivatives of the polynomials of degree 0 and 1.
    let (mut before, mut now) = ([1.0, 0.0, 0.0, 0.0], [x, 1.0, 0.0, 0.0]);
    if degree == 0 {
        now = before;
    }
    for _ in 1..degree {
        let next = core::array::from_fn(|order| {
            let below = if order == 0 { 0.0 } else { 2.0 * order as f64 * now[order - 1] };
            2.0 * x * now[order] + below - before[order]
        });
        (before, now) = (now, next);
    }
    // x runs twice as fast as the share.
    [2.0 * now[1], 4.0 * now[2], 8.0 * now[3]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nine_samples_of_a_smooth_part_give_its_derivatives_everywhere() {
        let width = 3.0;
        let function = |s: f64| (0.4 * s).sin();
        let samples = SHARES.map(|share| [function(share * width); CHANNELS]);
        let found = Derivatives::of(&samples, width);
        for point in 0..POINTS {
            let s = width * (1.0 - chebyshev_point(point, POINTS)) / 2.0;
            let (sin, cos) = (0.4 * s).sin_cos();
            let expected = [0.4 * cos, -0.16 * sin, -0.064 * cos];
            for order in 0..3 {
                let off = (found.at[order][point][0] - expected[order]).abs();
                assert!(off < 1e-5, "order {order} at {s}: off by {off}");
                assert!(found.off[order][0] < 1e-4, "{:?}", found.off);
            }
        }
    }

    #[test]
    fn a_kink_is_seen_in_what_is_left_out() {
        let samples = SHARES.map(|share| [(share - 0.4).abs(); CHANNELS]);
        let found = Derivatives::of(&samples, 1.0);
        assert!(found.off[0][0] > 0.1, "{:?}", found.off);
    }
}
