//! How joints and tool change along a part of a path: first to third derivatives, from few samples.
//!
//! The part is sampled at Chebyshev points, and the polynomial through the samples is differentiated. Joints along a
//! path are smooth but at singular positions, so that few points say much; how fast the polynomial's last factors
//! fall off says how much they leave out.

use core::f64::consts::PI;
use std::sync::LazyLock;

use crate::arm::{AXES, Arm, Violation};

/// Samples of a part.
pub(super) const NODES: usize = 9;

/// Points at which the derivatives are known: the samples and one between each two of them.
pub(super) const POINTS: usize = 2 * NODES - 1;

/// How much more than found a joint may go between two points before it turns round.
const EXTREMUM: f64 = 1.25;

/// Six joints and the three coordinates of the tool.
pub(super) const CHANNELS: usize = AXES + 3;

/// Joints in degrees (mm), and the tool in mm.
pub(super) type Sample = [f64; CHANNELS];

/// Shares of a part at which it is sampled, from 0 to 1.
pub(super) static SHARES: LazyLock<[f64; NODES]> =
    LazyLock::new(|| core::array::from_fn(|node| (1.0 - chebyshev_point(node, NODES)) / 2.0));

/// By order: the first, second and third derivative.
type ByOrder<T> = [T; 3];

/// The derivatives of one joint, or of one coordinate of the tool, along a part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Channel {
    /// Itself at each point.
    values: [f64; POINTS],
    /// Its derivatives at each point.
    pub(super) at: ByOrder<[f64; POINTS]>,
    /// What they may be off.
    pub(super) off: ByOrder<f64>,
}

impl Channel {
    const NONE: Self = Self { values: [0.0; POINTS], at: [[0.0; POINTS]; 3], off: [0.0; 3] };

    /// Those of a polynomial through samples at [`SHARES`] of a part that is `width` long.
    fn find(&mut self, samples: &[f64; NODES], width: f64) {
        let operators = &*OPERATORS;
        let halves = Halves::of(samples);
        operators.values.apply(&halves, 1.0, &mut self.values);
        let mut scale = 1.0;
        let last = operators.factors.map(|factor| halves.sum(&factor));
        let (before, end) = (last[0].abs() + last[1].abs(), last[2].abs() + last[3].abs());
        // The factors fall off evenly. Those left out have the slope of their polynomial's end at most.
        let left_out = if end < before { end * end / before } else { end };
        for (order, operator) in operators.derivatives.iter().enumerate() {
            scale /= width;
            operator.apply(&halves, scale, &mut self.at[order]);
            self.off[order] = left_out * operators.ends[order] * scale;
        }
    }

    /// The lowest and the highest value along a part that is `width` long, also between the points.
    pub(super) fn range(&self, width: f64) -> (f64, f64) {
        let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
        let slopes = &self.at[0];
        for (point, value) in self.values.iter().enumerate() {
            (lowest, highest) = (lowest.min(*value), highest.max(*value));
            let (Some(next), Some(before)) = (slopes.get(point + 1), slopes.get(point)) else { break };
            if before * next < 0.0 {
                // It turns round in between: about where the slope, drawn straight, is 0.
                let step = width * OPERATORS.steps[point];
                let beyond = EXTREMUM * before * step / 2.0 * before / (before - next);
                (lowest, highest) = (lowest.min(value + beyond), highest.max(value + beyond));
            }
        }
        (lowest, highest)
    }
}

/// The derivatives along a part: of six joints, and of the tool's three coordinates if asked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Derivatives([Channel; CHANNELS]);

impl Derivatives {
    /// From samples at [`SHARES`] of a part that is `width` long.
    pub(super) fn of(samples: &[Sample; NODES], width: f64, axes: usize, with_tool: bool) -> Self {
        let mut found = Self([Channel::NONE; CHANNELS]);
        for (channel, slot) in found.0.iter_mut().enumerate() {
            if channel < axes || (with_tool && channel >= AXES) {
                slot.find(&samples.map(|sample| sample[channel]), width);
            }
        }
        found
    }

    /// Those of each joint.
    pub(super) fn joints(&self) -> &[Channel] {
        &self.0[..AXES]
    }

    /// Whether the joints stay within their ranges along a part that is `width` long, also between the samples.
    pub(super) fn within_range(&self, width: f64, arm: &Arm) -> Result<(), Violation> {
        let (mut lowest, mut highest) = ([0.0; AXES], [0.0; AXES]);
        for (axis, joint) in self.joints().iter().enumerate().take(arm.axes()) {
            (lowest[axis], highest[axis]) = joint.range(width);
        }
        arm.within_range(&lowest)?;
        arm.within_range(&highest)
    }

    /// The tool's derivative of an order (0: the first) at a point.
    pub(super) fn tool(&self, order: usize, point: usize) -> [f64; 3] {
        let [.., x, y, z] = &self.0;
        [x.at[order][point], y.at[order][point], z.at[order][point]]
    }

    /// What the tool's derivative of an order may be off.
    pub(super) fn tool_off(&self, order: usize) -> [f64; 3] {
        let [.., x, y, z] = &self.0;
        [x.off[order], y.off[order], z.off[order]]
    }
}

/// Samples as what is alike before and after the middle of the part, and what is opposite. The points lie evenly about
/// the middle too, so each half of the samples counts for a point and for its mirror image at once.
struct Halves {
    even: [f64; HALF],
    odd: [f64; HALF],
    middle: f64,
}

/// Samples before the middle one.
const HALF: usize = NODES / 2;

/// Points up to the middle one.
const HALF_POINTS: usize = POINTS.div_ceil(2);

/// A place for each of them, and one more: an even number is worked on two at a time.
const LANES: usize = HALF_POINTS.next_multiple_of(2);

impl Halves {
    fn of(samples: &[f64; NODES]) -> Self {
        let mirrored = |node: usize| samples[NODES - 1 - node];
        Self {
            even: core::array::from_fn(|node| samples[node] + mirrored(node)),
            odd: core::array::from_fn(|node| samples[node] - mirrored(node)),
            middle: samples[HALF],
        }
    }

    /// The sum of the samples, each by its weight.
    fn sum(&self, Weights { even, odd, middle }: &Weights) -> f64 {
        let pairs = self.even.iter().zip(even).chain(self.odd.iter().zip(odd));
        pairs.map(|(value, weight)| value * weight).sum::<f64>() + self.middle * middle
    }
}

/// What each sample counts, as [`Halves`] have them.
#[derive(Clone, Copy)]
struct Weights {
    even: [f64; HALF],
    odd: [f64; HALF],
    middle: f64,
}

impl Weights {
    fn of(weights: [f64; NODES]) -> Self {
        let mirrored = |node: usize| weights[NODES - 1 - node];
        Self {
            even: core::array::from_fn(|node| (weights[node] + mirrored(node)) / 2.0),
            odd: core::array::from_fn(|node| (weights[node] - mirrored(node)) / 2.0),
            middle: weights[HALF],
        }
    }
}

/// From samples to what is found at the points: for each half of the samples the weights at all points up to the middle.
struct Operator {
    even: [[f64; LANES]; HALF],
    odd: [[f64; LANES]; HALF],
    middle: [f64; LANES],
    /// What is even in the samples comes out opposite at the mirror image of a point, as a slope does.
    turns: bool,
}

impl Operator {
    /// From the weight of a sample at a point.
    fn of(turns: bool, weight: impl Fn(usize, usize) -> f64) -> Self {
        let points: [Weights; LANES] =
            core::array::from_fn(|point| Weights::of(core::array::from_fn(|node| weight(point, node))));
        let rows = |of: fn(&Weights, usize) -> f64| {
            core::array::from_fn(|node| core::array::from_fn(|point| of(&points[point], node)))
        };
        Self {
            even: rows(|weights, node| weights.even[node]),
            odd: rows(|weights, node| weights.odd[node]),
            middle: points.map(|weights| weights.middle),
            turns,
        }
    }

    /// What it finds, times `scale`.
    fn apply(&self, samples: &Halves, scale: f64, found: &mut [f64; POINTS]) {
        let middle = self.middle.map(|weight| weight * samples.middle);
        let even = weighted(middle, &self.even, &samples.even);
        let odd = weighted([0.0; LANES], &self.odd, &samples.odd);
        let (kept, turned) = if self.turns { (odd, even) } else { (even, odd) };
        for point in 0..HALF_POINTS {
            found[point] = (kept[point] + turned[point]) * scale;
            found[POINTS - 1 - point] = (kept[point] - turned[point]) * scale;
        }
    }
}

/// Adds samples to sums, each by its weights. One half at a time, so that its sums stay in registers.
fn weighted(mut sums: [f64; LANES], weights: &[[f64; LANES]; HALF], samples: &[f64; HALF]) -> [f64; LANES] {
    for (row, sample) in weights.iter().zip(samples) {
        for (sum, weight) in sums.iter_mut().zip(row) {
            *sum += weight * sample;
        }
    }
    sums
}

struct Operators {
    values: Operator,
    derivatives: ByOrder<Operator>,
    /// The polynomial's last four factors, in the order of their degrees.
    factors: [Weights; 4],
    /// From each point to the next one, as shares of the part.
    steps: [f64; POINTS - 1],
    /// The derivatives at the end of the next but one Chebyshev polynomial.
    ends: ByOrder<f64>,
}

static OPERATORS: LazyLock<Operators> = LazyLock::new(|| {
    let degree = NODES - 1;
    let half = |index: usize| if index == 0 || index == degree { 0.5 } else { 1.0 };
    // Over the shares, the part begins at the far end of the Chebyshev points.
    let factor = |order: usize, node: usize| {
        let angle = PI * (order * (degree - node)) as f64 / degree as f64;
        2.0 / degree as f64 * half(order) * half(node) * angle.cos()
    };
    let operator = |order: usize| {
        Operator::of(order % 2 == 1, |point, node| {
            let x = -chebyshev_point(point, POINTS);
            (0..NODES).map(|polynomial| polynomial_at(polynomial, x)[order] * factor(polynomial, node)).sum()
        })
    };
    let place = |point| (1.0 - chebyshev_point(point, POINTS)) / 2.0;
    let [_, ends @ ..] = polynomial_at(NODES + 1, 1.0);
    Operators {
        values: operator(0),
        derivatives: [operator(1), operator(2), operator(3)],
        factors: core::array::from_fn(|last| {
            Weights::of(core::array::from_fn(|node| factor(NODES - 4 + last, node)))
        }),
        steps: core::array::from_fn(|point| place(point + 1) - place(point)),
        ends,
    }
});

fn chebyshev_point(index: usize, points: usize) -> f64 {
    (PI * index as f64 / (points - 1) as f64).cos()
}

/// A Chebyshev polynomial and its derivatives by the share, at `x` within −1…1, by its recurrence.
fn polynomial_at(degree: usize, x: f64) -> [f64; 4] {
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
    [now[0], 2.0 * now[1], 4.0 * now[2], 8.0 * now[3]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nine_samples_of_a_smooth_part_give_its_derivatives_everywhere() {
        let width = 3.0;
        let function = |s: f64| (0.4 * s).sin();
        let samples = SHARES.map(|share| [function(share * width); CHANNELS]);
        let found = Derivatives::of(&samples, width, AXES, true);
        for point in 0..POINTS {
            let s = width * (1.0 - chebyshev_point(point, POINTS)) / 2.0;
            let (sin, cos) = (0.4 * s).sin_cos();
            let expected = [0.4 * cos, -0.16 * sin, -0.064 * cos];
            for (order, expected) in expected.into_iter().enumerate() {
                let off = (found.joints()[0].at[order][point] - expected).abs();
                assert!(off < 1e-5, "order {order} at {s}: off by {off}");
                assert!(found.joints()[0].off[order] < 1e-4, "{:?}", found.joints()[0].off);
            }
        }
    }

    #[test]
    fn a_turn_between_two_samples_counts_to_the_range() {
        let width = 2.0;
        let samples = SHARES.map(|share| [(share * width - 0.7_f64).powi(2); CHANNELS]);
        let (lowest, highest) = Derivatives::of(&samples, width, AXES, false).joints()[0].range(width);
        assert!((-0.01..1e-12).contains(&lowest), "{lowest}");
        assert!((highest - 1.69).abs() < 1e-9, "{highest}");
    }

    #[test]
    fn a_kink_is_seen_in_what_is_left_out() {
        let samples = SHARES.map(|share| [(share - 0.4).abs(); CHANNELS]);
        let found = Derivatives::of(&samples, 1.0, AXES, true);
        assert!(found.joints()[0].off[0] > 0.1, "{:?}", found.joints()[0].off);
    }
}
