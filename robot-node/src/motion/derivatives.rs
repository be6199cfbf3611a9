//! How joints and tool change along a part of a path: first to third derivatives, from few samples.
//!
//! The part is sampled at Chebyshev points, and the polynomial through the samples is differentiated. Joints along a
//! path are smooth except at singular positions, so a few points describe them well. How fast the polynomial's last
//! coefficients fall tells the error.

use core::f64::consts::PI;
use std::sync::LazyLock;

use crate::arm::{AXES, Arm, Joints, Violation};

/// Samples of a part.
pub(super) const NODES: usize = 9;

/// Points at which the derivatives are known: the samples and one between each two of them.
pub(super) const POINTS: usize = 2 * NODES - 1;

/// Factor for the extreme values of a joint between two points, which are found only approximately.
const EXTREMUM: f64 = 1.25;

/// Six joints and the three coordinates of the tool.
const CHANNELS: usize = AXES + 3;

/// Shares of a part at which it is sampled, from 0 to 1.
pub(super) static SHARES: LazyLock<[f64; NODES]> =
    LazyLock::new(|| core::array::from_fn(|node| (1.0 - chebyshev_point(node, NODES)) / 2.0));

/// Where joints and tool are at [`SHARES`] of a part: for each joint in degrees (mm), and for each coordinate of the
/// tool in mm, its samples.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Samples([[f64; NODES]; CHANNELS]);

impl Samples {
    pub(super) fn set(&mut self, node: usize, joints: &Joints, tool: &[f64; 3]) {
        for (channel, value) in self.0.iter_mut().zip(joints.iter().chain(tool)) {
            channel[node] = *value;
        }
    }

    /// The joints at one of the samples.
    pub(super) fn joints(&self, node: usize) -> Joints {
        core::array::from_fn(|axis| self.0[axis][node])
    }
}

/// By order: the first, second and third derivative.
type ByOrder<T> = [T; 3];

/// One value for each point, in the order in which they are computed. A point and its mirror image about the middle of
/// the part are computed together: the points from the start to the middle come first, then those from the end back to
/// the middle. Those in the middle come twice, which fills the processor's vector registers.
type AtPoints = [f64; PLACES];

/// Number of these values.
pub(super) const PLACES: usize = 2 * LANES;
const _: () = assert!(PLACES.is_multiple_of(4), "they are worked on four at a time");

/// The derivatives of one joint, or of one coordinate of the tool, along a part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Channel {
    samples: [f64; NODES],
    /// Its derivatives at each point.
    pub(super) at: ByOrder<AtPoints>,
    /// Largest errors of the derivatives.
    pub(super) off: ByOrder<f64>,
}

impl Channel {
    const NONE: Self = Self { samples: [0.0; NODES], at: [[0.0; PLACES]; 3], off: [0.0; 3] };

    /// Those of a polynomial through samples at [`SHARES`] of a part that is `width` long, from the order `first` on.
    fn find(&mut self, samples: &[f64; NODES], width: f64, first: usize, operators: &Operators) {
        self.samples = *samples;
        let halves = Halves::of(samples);
        let [even, odd] = operators.factors.apply(&halves);
        let [first_pair, before, end] = core::array::from_fn(|pair| odd[pair].abs() + even[pair].abs());
        let left_out = left_out(first_pair, before, end);
        let mut scale = 1.0;
        for (order, operator) in operators.derivatives.iter().enumerate() {
            scale /= width;
            if order < first {
                continue;
            }
            operator.apply(&halves, scale, &mut self.at[order]);
            self.off[order] = left_out * operators.ends[order] * scale;
        }
    }

    /// Returns bounds of all values along a part that is `width` long: quicker and wider than [`range`](Self::range).
    fn bounds(&self, width: f64) -> (f64, f64) {
        let steepest = largest(&self.at[0]);
        // From two samples toward each other, with the steepest slope of the part.
        let beyond = EXTREMUM * steepest * width * OPERATORS.longest_step / 2.0;
        let (lowest, highest) = lowest_and_highest(&self.samples);
        (lowest - beyond, highest + beyond)
    }

    /// The lowest and the highest value along a part that is `width` long, also between the points.
    fn range(&self, width: f64) -> (f64, f64) {
        let mut values = [0.0; PLACES];
        OPERATORS.values.apply(&Halves::of(&self.samples), 1.0, &mut values);
        let (mut lowest, mut highest) = lowest_and_highest(&values);
        for point in 0..POINTS - 1 {
            let slope = |point| self.at[0][place_of(point)];
            let (before, next) = (slope(point), slope(point + 1));
            if before * next < 0.0 {
                // It has an extreme value in between: about where the slope, taken as linear, is 0.
                let step = width * OPERATORS.steps[point];
                let beyond = EXTREMUM * before * step / 2.0 * before / (before - next);
                let value = values[place_of(point)];
                (lowest, highest) = (lowest.min(value + beyond), highest.max(value + beyond));
            }
        }
        (lowest, highest)
    }
}

/// Shares of a part at which its derivatives are known, from 0 to 1.
pub(super) static POINT_SHARES: LazyLock<[f64; POINTS]> =
    LazyLock::new(|| core::array::from_fn(|point| (1.0 - chebyshev_point(point, POINTS)) / 2.0));

/// Where a point is among [`AtPoints`].
pub(super) const fn place_of(point: usize) -> usize {
    if point < HALF_POINTS { point } else { LANES + POINTS - 1 - point }
}

/// Returns what a polynomial leaves out, from the sizes of the last three pairs of its factors.
///
/// The factors of a smooth joint fall at a rate that rises or falls slowly. Near a singular position the last pair can be small
/// by chance: it counts no less than half the rate of the pairs before lets expect.
fn left_out(first_pair: f64, before: f64, end: f64) -> f64 {
    let expected = if before < first_pair { before / first_pair / 2.0 } else { 0.5 };
    let end = end.max(expected * before);
    // The slope of a polynomial that is left out is largest at its end.
    if end < before { end * end / before } else { end }
}

/// Returns the largest absolute value; those that are no numbers do not count.
pub(super) fn largest(values: &AtPoints) -> f64 {
    most(0.0, |at| values[at].abs())
}

/// Returns the largest of `least` and of a figure at the places. What is no number does not count.
#[inline]
pub(super) fn most(least: f64, figure: impl Fn(usize) -> f64) -> f64 {
    // Several side by side, since each comparison waits for the one before.
    const LANES: usize = 4;
    let mut most = [least; LANES];
    for row in 0..PLACES / LANES {
        for (lane, most) in most.iter_mut().enumerate() {
            let figure = figure(row * LANES + lane);
            *most = if figure > *most { figure } else { *most };
        }
    }
    most.into_iter().fold(least, f64::max)
}

fn lowest_and_highest(values: &[f64]) -> (f64, f64) {
    let start = (f64::INFINITY, f64::NEG_INFINITY);
    values.iter().fold(start, |(lowest, highest), value| {
        (if *value < lowest { *value } else { lowest }, if *value > highest { *value } else { highest })
    })
}

/// The derivatives along a part: of six joints, and of the tool's three coordinates if asked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Derivatives([Channel; CHANNELS]);

impl Derivatives {
    /// Empty. They are so many that they are [computed](Self::find) in place.
    pub(super) const NONE: Self = Self([Channel::NONE; CHANNELS]);

    /// From samples at [`SHARES`] of a part that is `width` long. Of the tool's derivatives those from the order `tool_from`
    /// on are asked for.
    pub(super) fn find(&mut self, samples: &Samples, width: f64, axes: usize, tool_from: Option<usize>) {
        let operators = &*OPERATORS;
        for (channel, (slot, samples)) in self.0.iter_mut().zip(&samples.0).enumerate() {
            let first = if channel < AXES { (channel < axes).then_some(0) } else { tool_from };
            if let Some(first) = first {
                slot.find(samples, width, first, operators);
            }
        }
    }

    /// Those of each joint.
    pub(super) fn joints(&self) -> &[Channel] {
        &self.0[..AXES]
    }

    /// Whether the joints stay within their ranges along a part that is `width` long, also between the samples.
    pub(super) fn within_range(&self, width: f64, arm: &Arm) -> Result<(), Violation> {
        let within = |find: fn(&Channel, f64) -> (f64, f64)| {
            let (mut lowest, mut highest) = ([0.0; AXES], [0.0; AXES]);
            for (axis, joint) in self.joints().iter().enumerate().take(arm.axes()) {
                (lowest[axis], highest[axis]) = find(joint, width);
            }
            arm.within_range(&lowest).and_then(|()| arm.within_range(&highest))
        };
        // As a rule the joints are far from the ends of their ranges.
        within(Channel::bounds).or_else(|_| within(Channel::range))
    }

    /// The tool's derivative of an order (0: the first) at one of the places.
    pub(super) fn tool(&self, order: usize, place: usize) -> [f64; 3] {
        let [.., x, y, z] = &self.0;
        [x, y, z].map(|coordinate| coordinate.at[order][place])
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
}

/// What each sample counts for so many values, as [`Halves`] have the samples: for the even ones of them and the
/// middle one, and for the odd ones.
struct Weights<const N: usize> {
    even: [[f64; N]; HALF],
    middle: [f64; N],
    odd: [[f64; N]; HALF],
}

impl<const N: usize> Weights<N> {
    /// From the weights of a sample for the even and for the odd part of each value.
    fn of(even: impl Fn(usize, usize) -> f64, odd: impl Fn(usize, usize) -> f64) -> Self {
        let mirrored = |node: usize| NODES - 1 - node;
        Self {
            even: core::array::from_fn(|node| {
                core::array::from_fn(|value| (even(value, node) + even(value, mirrored(node))) / 2.0)
            }),
            middle: core::array::from_fn(|value| even(value, HALF)),
            odd: core::array::from_fn(|node| {
                core::array::from_fn(|value| (odd(value, node) - odd(value, mirrored(node))) / 2.0)
            }),
        }
    }

    /// What the even samples give, and what the odd ones give.
    #[inline]
    fn apply(&self, samples: &Halves) -> [[f64; N]; 2] {
        let middle = self.middle.map(|weight| weight * samples.middle);
        [weighted(middle, &self.even, &samples.even), weighted([0.0; N], &self.odd, &samples.odd)]
    }
}

/// Adds samples to sums, each by its weights. One half at a time, so that its sums stay in registers; called as a function
/// they do not, and the compiler's choice depends on what else the crate has.
#[inline(always)]
fn weighted<const N: usize>(
    mut sums: [f64; N],
    weights: &[[f64; N]; HALF],
    samples: &[f64; HALF],
) -> [f64; N] {
    for (row, sample) in weights.iter().zip(samples) {
        for (sum, weight) in sums.iter_mut().zip(row) {
            *sum += weight * sample;
        }
    }
    sums
}

/// From samples to what is found at the points.
struct Operator {
    /// To the points up to the middle.
    weights: Weights<LANES>,
    /// What is even in the samples comes out opposite at the mirror image of a point, as a slope does.
    turns: bool,
}

impl Operator {
    /// From the weight of a sample at a point.
    fn of(turns: bool, weight: impl Fn(usize, usize) -> f64) -> Self {
        Self { weights: Weights::of(&weight, &weight), turns }
    }

    /// What it finds, times `scale`.
    fn apply(&self, samples: &Halves, scale: f64, found: &mut AtPoints) {
        let [even, odd] = self.weights.apply(samples);
        let (kept, turned) = if self.turns { (odd, even) } else { (even, odd) };
        let (points, mirrored) = found.split_at_mut(LANES);
        for lane in 0..LANES {
            points[lane] = (kept[lane] + turned[lane]) * scale;
            mirrored[lane] = (kept[lane] - turned[lane]) * scale;
        }
    }
}

struct Operators {
    values: Operator,
    derivatives: ByOrder<Operator>,
    /// The polynomial's last six factors in the order of their degrees: the even ones from the even samples.
    factors: Weights<3>,
    /// From each point to the next one, as shares of the part.
    steps: [f64; POINTS - 1],
    /// The longest way from one sample to the next one, as a share of the part.
    longest_step: f64,
    /// The derivatives at the end of the next but one Chebyshev polynomial.
    ends: ByOrder<f64>,
}

static OPERATORS: LazyLock<Operators> = LazyLock::new(|| {
    let degree = NODES - 1;
    let half = |index: usize| if index == 0 || index == degree { 0.5 } else { 1.0 };
    // Over the shares, the part begins at the far end of the Chebyshev points.
    let factor = |order: usize, node: usize| {
        let angle = PI * (order * (degree - node)) as f64 / degree as f64;
        2.0 / degree as f64 * half(order) * half(node) * libm::cos(angle)
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
        factors: Weights::of(
            |pair, node| factor(NODES - 5 + 2 * pair, node),
            |pair, node| factor(NODES - 6 + 2 * pair, node),
        ),
        steps: core::array::from_fn(|point| place(point + 1) - place(point)),
        longest_step: SHARES.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max),
        ends,
    }
});

fn chebyshev_point(index: usize, points: usize) -> f64 {
    libm::cos(PI * index as f64 / (points - 1) as f64)
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

    /// The same for every joint and coordinate.
    fn samples(of_share: impl Fn(f64) -> f64) -> Samples {
        Samples([SHARES.map(of_share); CHANNELS])
    }

    fn derivatives(samples: &Samples, width: f64) -> Derivatives {
        let mut found = Derivatives::NONE;
        found.find(samples, width, AXES, Some(0));
        found
    }

    #[test]
    fn nine_samples_of_a_smooth_part_give_its_derivatives_everywhere() {
        let width = 3.0;
        let function = |s: f64| libm::sin(0.4 * s);
        let found = derivatives(&samples(|share| function(share * width)), width);
        for point in 0..POINTS {
            let s = width * (1.0 - chebyshev_point(point, POINTS)) / 2.0;
            let (sin, cos) = libm::sincos(0.4 * s);
            let expected = [0.4 * cos, -0.16 * sin, -0.064 * cos];
            for (order, expected) in expected.into_iter().enumerate() {
                let off = (found.joints()[0].at[order][place_of(point)] - expected).abs();
                assert!(off < 1e-5, "order {order} at {s}: off by {off}");
                assert!(found.joints()[0].off[order] < 1e-4, "{:?}", found.joints()[0].off);
            }
        }
    }

    #[test]
    fn a_turn_between_two_samples_counts_to_the_range() {
        let width = 2.0;
        let samples = samples(|share| (share * width - 0.7) * (share * width - 0.7));
        let found = derivatives(&samples, width).joints()[0];
        let (lowest, highest) = found.range(width);
        assert!((-0.01..1e-12).contains(&lowest), "{lowest}");
        assert!((highest - 1.69).abs() < 1e-9, "{highest}");
        let bounds = found.bounds(width);
        assert!(bounds.0 <= lowest && bounds.1 >= highest, "{bounds:?}");
    }

    #[test]
    fn a_bend_whose_last_factors_are_small_by_chance_is_seen_in_what_is_left_out() {
        // An elbow on half a circle that passes the border of the arm's reach.
        let elbow = [4.6, 0.382, 0.965, 13.976, 26.731, 37.486, 43.892, 46.395, 46.909];
        let found = derivatives(&Samples([elbow; CHANNELS]), 201.5);
        let slopes = [(4.6 - 0.382) / 7.67, (13.976 - 0.965) / 32.73];
        let off = found.joints()[0].off[0];
        assert!(
            off > 0.03,
            "the error of slopes of -{:.2} to {:.2} is said to be {off}",
            slopes[0],
            slopes[1]
        );
    }

    #[test]
    fn a_kink_is_seen_in_what_is_left_out() {
        let found = derivatives(&samples(|share| (share - 0.4).abs()), 1.0);
        assert!(found.joints()[0].off[0] > 0.1, "{:?}", found.joints()[0].off);
    }
}
