//! How joints and tool change along a part of a path: first to third derivatives, from few samples.
//!
//! The part is sampled at Chebyshev points, and the polynomial through the samples is differentiated. Joints along a
//! path are smooth except at singular positions, so a few points describe them well. How fast the polynomial's last
//! coefficients fall tells the error.

use super::chebyshev::{AtPoints, ByOrder, Halves, NODES, OPERATORS, Operators, PLACES, POINTS, place_of};
use crate::{AXES, Arm, Joints, Violation};

/// Factor for the extreme values of a joint between two points, which are found only approximately.
const EXTREMUM: f64 = 1.25;

/// What rounding makes of a polynomial's factors, in degrees (mm): those of the highest degrees that are no larger are left out. On a
/// line of some hundredths of a millimetre their third derivatives would be larger than all that a joint does.
const NOISE: f64 = 1e-12;

/// Six joints and the three coordinates of the tool.
const CHANNELS: usize = AXES + 3;

/// Where joints and tool are at the [`SHARES`](super::chebyshev::SHARES) of a part: for each joint in degrees (mm), and for each coordinate of the
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
        let mut halves = Halves::of(samples);
        let [even, odd] = operators.factors.apply(&halves);
        let mut sizes: [f64; 3] = core::array::from_fn(|pair| odd[pair].abs() + even[pair].abs());
        for (pair, size) in sizes.iter_mut().enumerate().rev() {
            if *size > NOISE {
                break;
            }
            halves.take_away(&operators.pairs[pair], [even[pair], odd[pair]]);
            *size = 0.0;
        }
        let left_out = left_out(sizes);
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
        // A slope may be off by so much: near an extreme value at the border of a part it decides.
        let off = self.off[0];
        for point in 0..POINTS - 1 {
            let (before, next) = (self.at[0][place_of(point)], self.at[0][place_of(point + 1)]);
            let step = width * OPERATORS.steps[point];
            let value = values[place_of(point)];
            // Between points with slopes of opposite signs there is an extreme value: about where the slope, taken as
            // linear, is 0.
            let beyond = |before: f64, next: f64| EXTREMUM * before * step / 2.0 * before / (before - next);
            if before + off > 0.0 && next - off < 0.0 {
                highest = highest.max(value + beyond(before + off, next - off));
            }
            if before - off < 0.0 && next + off > 0.0 {
                lowest = lowest.min(value + beyond(before - off, next + off));
            }
        }
        (lowest, highest)
    }
}

/// Returns what a polynomial leaves out, from the sizes of the last three pairs of its factors.
///
/// The factors of a smooth joint fall at a rate that rises or falls slowly. Near a singular position the last pair can be small
/// by chance: it counts no less than half the rate of the pairs before lets expect.
fn left_out([first_pair, before, end]: [f64; 3]) -> f64 {
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

#[cfg(test)]
impl Derivatives {
    /// Of a piece on which nothing moves, but whose derivatives of a joint, or from [`AXES`] on of a coordinate of the tool, are
    /// off by this.
    pub(super) fn with_errors(channel: usize, off: ByOrder<f64>) -> Self {
        let mut found = Self::NONE;
        found.0[channel].off = off;
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::chebyshev::{SHARES, chebyshev_point};

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
    #[test]
    fn a_kink_in_the_middle_is_seen_too() {
        let found = derivatives(&samples(|share| (share - 0.5).abs()), 1.0);
        assert!(found.joints()[0].off[0] > 0.1, "{:?}", found.joints()[0].off);
    }

    #[test]
    fn the_range_of_a_joint_reaches_a_little_beyond_its_extreme_values_and_the_bounds_beyond_that() {
        let (width, amplitude) = (2.0, 40.0);
        for number in 0..200 {
            let (often, phase) = (0.2 + 0.01 * f64::from(number), 0.7 * f64::from(number));
            let function = |s: f64| amplitude * libm::sin(often * s + phase);
            let found = derivatives(&samples(|share| function(share * width)), width).joints()[0];
            let all = || (0..=2_000).map(|step| function(width * f64::from(step) / 2_000.0));
            let (least, most) =
                (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
            let (lowest, highest) = found.range(width);
            let near = 0.02 * amplitude;
            assert!((least - near..=least + 1e-4).contains(&lowest), "{lowest} for {least}, number {number}");
            assert!((most - 1e-4..=most + near).contains(&highest), "{highest} for {most}, number {number}");
            let bounds = found.bounds(width);
            assert!(bounds.0 <= lowest && bounds.1 >= highest, "{bounds:?}, number {number}");
            // Between two samples, from both towards each other.
            let steepest = found.at[0].iter().fold(0.0, |most: f64, slope| most.max(slope.abs()));
            let step = SHARES.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
            let beyond = EXTREMUM * steepest * width * step / 2.0;
            let (lowest, highest) = lowest_and_highest(&found.samples);
            assert!((lowest - bounds.0 - beyond).abs() < 1e-9 && (bounds.1 - highest - beyond).abs() < 1e-9);
        }
    }

    #[test]
    fn near_an_end_of_a_part_the_error_of_a_slope_decides_whether_there_is_an_extreme_value() {
        // It rises to its end, or falls, or comes from there: with the error of the slope it may turn beside it.
        for (sign, is_mirrored) in [(1.0, false), (-1.0, false), (1.0, true), (-1.0, true)] {
            let function = |share: f64| sign * share * (2.02 - share);
            let of_share = |share: f64| function(if is_mirrored { 1.0 - share } else { share });
            let mut found = derivatives(&samples(of_share), 1.0).joints()[0];
            assert!((found.range(1.0).1 - f64::max(1.02 * sign, 0.0)).abs() < 1e-9);
            assert!((found.range(1.0).0 - f64::min(1.02 * sign, 0.0)).abs() < 1e-9);
            found.off[0] = 0.05;
            let (lowest, highest) = found.range(1.0);
            let beyond = if sign > 0.0 { highest - 1.02 } else { -1.02 - lowest };
            assert!((1e-5..2e-3).contains(&beyond), "{beyond} beyond the end");
            let kept = if sign > 0.0 { lowest } else { highest };
            assert!(kept.abs() < 1e-9, "{kept} at the start");
        }
    }

    #[test]
    fn a_joint_that_leaves_its_range_between_two_samples_is_found_with_its_value() {
        let limits = crate::AxisLimits { lower: [-1.0; AXES], upper: [1.0; AXES], ..crate::AxisLimits::NONE };
        let scara = crate::Scara { link_1_mm: 200.0, link_2_mm: 200.0, height_mm: 0.0 };
        let arm = Arm::new(std::sync::Arc::new(scara), limits);
        // The first two samples are at 0 and 0.04.
        for (most, sign, is_within) in
            [(0.999, 1.0, true), (1.001, 1.0, false), (0.999, -1.0, true), (1.001, -1.0, false)]
        {
            let function = |share: f64| sign * (most - (share - 0.02) * (share - 0.02));
            let found = derivatives(&samples(function), 1.0);
            assert_eq!(found.within_range(1.0, &arm).is_ok(), is_within, "{most} to the side {sign}");
        }
    }

    #[test]
    fn what_is_left_out_falls_on_as_the_factors_do_but_no_faster_than_twice_the_rate_before() {
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found}");
        near(left_out([1.0, 0.1, 0.01]), 0.001);
        near(left_out([1.0, 0.1, 0.0]), 0.005 * 0.005 / 0.1);
        near(left_out([1.0, 2.0, 0.0]), 0.5);
        near(left_out([4.0, 2.0, 0.0]), 0.125);
        near(left_out([1.0, 0.1, 0.2]), 0.2);
    }

    #[test]
    fn the_largest_value_may_be_at_any_place_and_is_none_that_is_no_number() {
        for place in 0..PLACES {
            let mut values = [0.25; PLACES];
            values[place] = -0.75;
            values[(place + 1) % PLACES] = f64::NAN;
            assert_eq!(largest(&values), 0.75, "at {place}");
        }
    }

    #[test]
    fn the_errors_of_the_tool_are_those_of_its_coordinates() {
        let found = Derivatives::with_errors(AXES + 1, [0.1, 0.2, 0.3]);
        assert_eq!([0, 1, 2].map(|order| found.tool_off(order)[1]), [0.1, 0.2, 0.3]);
        assert_eq!(found.tool_off(0), [0.0, 0.1, 0.0]);
    }
}
