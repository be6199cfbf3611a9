//! One motion of a spline: the piece between two targets of a curve that goes through all of them.
//!
//! A piece is a blend of two parabolas: one through the three poses around its start, one through the three around
//! its end. With the share τ of the piece, and both parabolas over the common parameter u:
//!
//! ```text
//! r(u) = p₀(u) + w(τ)·(p₁(u) − p₀(u)),  w(τ) = 3τ² − 2τ³,  u grows by √(distance) from target to target
//! ```
//!
//! Both parabolas go through both ends of the piece, so that p₁ − p₀ = c·τ·(1 − τ): at its ends r has position, first
//! and second derivative of one parabola alone. The next piece has that same parabola there, and so the curve is
//! continuous in its second derivative by u (C²), and in tangent and curvature on the path (G²).
//!
//! The scheme is local because the PLC shows five motions ahead at most, and often fewer: a piece depends on its two
//! targets, the one before and the one after, and on nothing else. A spline that is C² and of degree three would depend
//! on every target to come, and change behind the arm with each that is written. Without a target before or after, the
//! piece is the parabola of the other end; with neither, it is a straight line.
//!
//! Square roots of the distances (the centripetal parameter) keep a long piece beside a short one from swinging out.
//! The orientation goes through the same blend as a quaternion and is normalised, so it is as smooth as the position.

use super::flange::Flange;
use crate::arm::{Frame, Rotation, distance, dot, length};

/// Parts into which the piece is cut to measure its length.
const PARTS: usize = 8;

/// One of them, as a share of the piece.
const PART: f64 = 1.0 / PARTS as f64;

/// Largest number of intervals within a part whose ways are measured one by one: where the curve almost turns back.
const MOST_INTERVALS: u8 = 16;

/// Where the derivative of the position by the share changes within a part by no more than this share of it, one interval is
/// enough.
const STEADY: f64 = 0.75;

/// Largest share by which twice as many intervals may change the way of a part. The speed along it is off by some twenty times
/// as much.
const WELL_MEASURED: f64 = 1e-7;

/// A step of Newton's method that is smaller than this share of a part leaves an error of less than a hundred-millionth
/// of it: each step squares the error.
const LAST_STEP: f64 = 1e-4;

/// Largest number of steps: where the way hardly grows with τ, one is not enough.
const NEWTON_STEPS: usize = 4;

/// Position in mm and quaternion.
type Pose = [f64; 7];

/// Points and weights of Gauss-Legendre quadrature over 0…1.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// Chords that enclose more than this many degrees, counted from straight on, turn back: the arm stops there.
const TURNS_BACK_DEG: f64 = 160.0;

/// A piece of a spline of the tool in the root. Its parameter is the way in mm.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Spline {
    before: Option<Frame>,
    from: Frame,
    to: Frame,
    after: Option<Frame>,
    /// Factors of τ⁰ to τ⁵.
    factors: [Pose; 6],
    /// The way at the end of each part, in mm.
    ways: [f64; PARTS],
    /// How many intervals of each part are measured one by one.
    intervals: [u8; PARTS],
    /// How τ grows with the way where each part begins, and at the end: its first two derivatives, by mm.
    growth: [[f64; 2]; PARTS + 1],
    flange: Flange,
}

/// A guessed share: within a part from `start` to `end`, which begins after a way in mm and is measured in intervals.
#[derive(Clone, Copy)]
struct Guess {
    intervals: u8,
    start: f64,
    end: f64,
    start_way: f64,
    share: f64,
}

impl Spline {
    /// A piece without neighbours, a straight line, in mm.
    #[must_use]
    pub fn new(from: Frame, to: Frame, flange: Flange) -> Self {
        Self::between(None, from, to, None, flange)
    }

    /// This piece between the poses before its start and after its end, where they are known.
    #[must_use]
    pub fn with_neighbours(&self, before: Option<Frame>, after: Option<Frame>) -> Self {
        Self::between(before, self.from, self.to, after, self.flange)
    }

    fn between(before: Option<Frame>, from: Frame, to: Frame, after: Option<Frame>, flange: Flange) -> Self {
        let start = pose(&from, None);
        let end = pose(&to, Some(&start));
        let u = distance(from.position, to.position).sqrt();
        let slope: Pose = core::array::from_fn(|i| (end[i] - start[i]) / u);
        // The second derivative by u of the parabola through three poses, half of it.
        let bend = |other: Option<Frame>, near: &Frame, near_pose: &Pose, sign: f64| -> Option<Pose> {
            let other = other?;
            let other_pose = pose(&other, Some(near_pose));
            let other_u = distance(other.position, near.position).sqrt();
            Some(core::array::from_fn(|i| {
                let other_slope = sign * (other_pose[i] - near_pose[i]) / other_u;
                sign * (other_slope - slope[i]) / (u + other_u)
            }))
        };
        let at_start = bend(before, &from, &start, -1.0);
        let at_end = bend(after, &to, &end, 1.0);
        let at_start_or_end = (at_start.or(at_end), at_end.or(at_start));
        let (first, last) = (at_start_or_end.0.unwrap_or([0.0; 7]), at_start_or_end.1.unwrap_or([0.0; 7]));
        // p(τ) = start + τ·(end − start) − bend·u²·τ·(1 − τ); the difference of the two is (last − first) there.
        let mut factors = [[0.0; 7]; 6];
        for i in 0..7 {
            let (a, c) = (first[i] * u * u, (last[i] - first[i]) * u * u);
            let along = end[i] - start[i];
            let of_powers = [start[i], along - a, a, -3.0 * c, 5.0 * c, -2.0 * c];
            for (factor, value) in factors.iter_mut().zip(of_powers) {
                factor[i] = value;
            }
        }
        let (ways, intervals, growth) = ([0.0; PARTS], [1; PARTS], [[0.0; 2]; PARTS + 1]);
        let mut piece = Self { before, from, to, after, factors, ways, intervals, growth, flange };
        if before.is_none() && after.is_none() {
            let way = distance(from.position, to.position);
            piece.ways = core::array::from_fn(|part| way * (part + 1) as f64 * PART);
            piece.growth = [[1.0 / way, 0.0]; PARTS + 1];
            return piece;
        }
        let mut way = 0.0;
        for part in 0..PARTS {
            let (of_part, intervals) = piece.measured(part as f64 * PART, (part + 1) as f64 * PART);
            way += of_part;
            (piece.ways[part], piece.intervals[part]) = (way, intervals);
        }
        piece.growth = core::array::from_fn(|border| piece.growth_at(border as f64 * PART));
        piece
    }

    /// The way from start to target, in mm.
    #[must_use]
    pub const fn length(&self) -> f64 {
        self.ways[PARTS - 1]
    }

    /// Where it starts: the tool in the root.
    #[must_use]
    pub const fn from(&self) -> &Frame {
        &self.from
    }

    /// Its target: the tool in the root.
    #[must_use]
    pub const fn to(&self) -> &Frame {
        &self.to
    }

    /// Where the piece before it starts, if there is one.
    #[must_use]
    pub const fn before(&self) -> Option<Frame> {
        self.before
    }

    /// How the flange follows from the tool.
    #[must_use]
    pub const fn flange(&self) -> &Flange {
        &self.flange
    }

    /// Whether one curve can go through this piece and then to that one's target: the same tool, and no turn back.
    #[must_use]
    pub fn goes_on_to(&self, next: &Self) -> bool {
        let one = difference(self.to.position, self.from.position);
        let other = difference(next.to.position, next.from.position);
        let cos = dot(one, other) / (length(one) * length(other));
        self.flange == next.flange && cos > libm::cos(TURNS_BACK_DEG.to_radians())
    }

    /// The tool in the root after `way`.
    #[must_use]
    pub fn tool(&self, way: f64) -> Frame {
        let [tool] = self.tools(&[way]);
        tool
    }

    /// The tool in the root after each of some ways.
    #[must_use]
    pub fn tools<const N: usize>(&self, ways: &[f64; N]) -> [Frame; N] {
        let shares = self.shares(ways);
        core::array::from_fn(|i| {
            if ways[i] <= 0.0 {
                return self.from;
            }
            if ways[i] >= self.length() {
                return self.to;
            }
            let [x, y, z, quaternion @ ..] = self.at(shares[i]);
            Frame { position: [x, y, z], rotation: Rotation::from_quaternion(quaternion) }
        })
    }

    /// Where the tool is after `way`.
    pub(super) fn position(&self, way: f64) -> [f64; 3] {
        if way <= 0.0 {
            return self.from.position;
        }
        if way >= self.length() {
            return self.to.position;
        }
        let [share] = self.shares(&[way]);
        let [x, y, z, ..] = self.at(share);
        [x, y, z]
    }

    /// The shares τ of the piece after some ways: first guessed, then by Newton's method, of which one step is enough as a
    /// rule. Each step waits for roots and quotients, so all shares take it together.
    fn shares<const N: usize>(&self, ways: &[f64; N]) -> [f64; N] {
        let mut guesses = ways.map(|way| self.guess(way));
        // For a way outside of the piece no share is needed.
        let mut is_off = ways.map(|way| way > 0.0 && way < self.length());
        for _ in 0..NEWTON_STEPS {
            for ((guess, is_off), way) in guesses.iter_mut().zip(&mut is_off).zip(ways) {
                if *is_off {
                    let Guess { intervals, start, end, start_way, share } = *guess;
                    let off = start_way + self.way_between(start, share, intervals) - way;
                    let step = off / self.speed(share).max(1e-9);
                    guess.share = (share - step).clamp(start, end);
                    *is_off = step.abs() >= LAST_STEP * PART;
                }
            }
        }
        guesses.map(|guess| guess.share)
    }

    /// The share after `way` by the polynomial of degree five that has the part's ends and how τ grows with the way there.
    fn guess(&self, way: f64) -> Guess {
        let part = self.ways.partition_point(|end| *end < way).min(PARTS - 1);
        let (start, end) = (part as f64 * PART, (part + 1) as f64 * PART);
        let start_way = if part == 0 { 0.0 } else { self.ways[part - 1] };
        let width = (self.ways[part] - start_way).max(1e-12);
        let t = (way - start_way) / width;
        let [[slope, bend], [end_slope, end_bend]] = [self.growth[part], self.growth[part + 1]]
            .map(|[first, second]| [first * width, second * width * width]);
        // The differences from the parabola of the start at the end: of τ and of its derivatives.
        let [rest, of_slope, of_bend] =
            [PART - slope - bend / 2.0, end_slope - slope - bend, end_bend - bend];
        let cubic = 10.0 * rest - 4.0 * of_slope + of_bend / 2.0;
        let quartic = -15.0 * rest + 7.0 * of_slope - of_bend;
        let quintic = 6.0 * rest - 3.0 * of_slope + of_bend / 2.0;
        let grown = t * (slope + t * (bend / 2.0 + t * (cubic + t * (quartic + t * quintic))));
        let share = (start + grown).clamp(start, end);
        Guess { intervals: self.intervals[part], start, end, start_way, share }
    }

    /// The way in mm from one share to another, and the number of intervals that it takes to measure it well.
    fn measured(&self, from: f64, to: f64) -> (f64, u8) {
        let (mut way, mut intervals) = (self.way_between(from, to, 1), 1);
        let [start, end] = [from, to].map(|share| self.slope(share));
        if distance(start, end) <= STEADY * length(start).min(length(end)) {
            return (way, intervals);
        }
        while intervals < MOST_INTERVALS {
            let finer = self.way_between(from, to, 2 * intervals);
            if (finer - way).abs() <= WELL_MEASURED * finer {
                break;
            }
            (way, intervals) = (finer, 2 * intervals);
        }
        (way, intervals)
    }

    /// The way in mm from one share to another, in so many intervals.
    fn way_between(&self, from: f64, to: f64, intervals: u8) -> f64 {
        if intervals == 1 {
            return self.way_in_one(from, to);
        }
        let border = |interval| from + f64::from(interval) / f64::from(intervals) * (to - from);
        (0..intervals).map(|interval| self.way_in_one(border(interval), border(interval + 1))).sum()
    }

    fn way_in_one(&self, from: f64, to: f64) -> f64 {
        let sum: f64 = GAUSS.iter().map(|(at, weight)| weight * self.speed(from + at * (to - from))).sum();
        sum * (to - from)
    }

    /// How fast the way grows with the share, in mm.
    fn speed(&self, share: f64) -> f64 {
        length(self.slope(share))
    }

    /// How the share grows with the way: its first two derivatives, by mm.
    fn growth_at(&self, share: f64) -> [f64; 2] {
        let [_, _, c, d, e, f] = &self.factors;
        let bend = core::array::from_fn(|i| {
            ((20.0 * f[i] * share + 12.0 * e[i]) * share + 6.0 * d[i]) * share + 2.0 * c[i]
        });
        let slope = self.slope(share);
        let square = dot(slope, slope).max(1e-18);
        [1.0 / square.sqrt(), -dot(slope, bend) / (square * square)]
    }

    /// The position's derivative by the share, in mm.
    fn slope(&self, share: f64) -> [f64; 3] {
        let [_, b, c, d, e, f] = &self.factors;
        core::array::from_fn(|i| {
            (((5.0 * f[i] * share + 4.0 * e[i]) * share + 3.0 * d[i]) * share + 2.0 * c[i]) * share + b[i]
        })
    }

    /// The pose at a share τ, its quaternion of any length.
    fn at(&self, share: f64) -> Pose {
        let [a, b, c, d, e, f] = &self.factors;
        core::array::from_fn(|i| {
            ((((f[i] * share + e[i]) * share + d[i]) * share + c[i]) * share + b[i]) * share + a[i]
        })
    }
}

/// Position and quaternion; of the two quaternions of a rotation, the one that is nearer to that of `near`.
fn pose(frame: &Frame, near: Option<&Pose>) -> Pose {
    let [x, y, z] = frame.position;
    let [a, b, c, d] = frame.rotation.quaternion();
    let pose = [x, y, z, a, b, c, d];
    let along = near.map_or(1.0, |near| pose.iter().zip(near).skip(3).map(|(one, other)| one * other).sum());
    if along < 0.0 { [x, y, z, -a, -b, -c, -d] } else { pose }
}

fn difference(to: [f64; 3], from: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| to[i] - from[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::cross;
    use proptest::prelude::*;

    fn pieces(targets: &[[f64; 6]]) -> Vec<Spline> {
        let frames: Vec<Frame> = targets.iter().map(|target| Frame::from_mm_deg(*target)).collect();
        let at = |index: usize| frames.get(index).copied();
        (1..frames.len())
            .map(|index| {
                let flange = Flange::of_tool(&Frame::IDENTITY);
                Spline::new(frames[index - 1], frames[index], flange)
                    .with_neighbours(index.checked_sub(2).and_then(at), at(index + 1))
            })
            .collect()
    }

    fn targets(count: usize) -> impl Strategy<Value = Vec<[f64; 6]>> {
        let step = (10.0..80.0_f64, -70.0..70.0_f64, -40.0..40.0_f64);
        let turn = (-40.0..40.0_f64, -30.0..30.0_f64, 150.0..210.0_f64);
        proptest::collection::vec((step, turn), count).prop_map(|steps| {
            let mut at = [0.0; 3];
            steps
                .into_iter()
                .map(|((dx, dy, dz), (a, b, c))| {
                    at = [at[0] + dx, at[1] + dy, at[2] + dz];
                    [at[0], at[1], at[2], a, b, c]
                })
                .collect()
        })
    }

    fn position(&[x, y, z, ..]: &Pose) -> [f64; 3] {
        [x, y, z]
    }

    /// The pose's derivative by τ of this order, 1 or 2.
    fn derivative(piece: &Spline, order: u32, share: f64) -> Pose {
        let mut sum = [0.0; 7];
        for (power, factor) in (0..6_u32).zip(&piece.factors).rev() {
            let Some(left) = power.checked_sub(order) else { break };
            let scale = f64::from((left + 1..=power).product::<u32>());
            for (sum, factor) in sum.iter_mut().zip(factor) {
                *sum = *sum * share + scale * factor;
            }
        }
        sum
    }

    /// The curvature vector in 1/mm at a share τ: where the tangent turns to.
    fn curvature(piece: &Spline, share: f64) -> [f64; 3] {
        let [first, second] = [1, 2].map(|order| position(&derivative(piece, order, share)));
        let square = dot(first, first);
        cross(cross(first, second), first).map(|part| part / (square * square))
    }

    fn apart(one: [f64; 3], other: [f64; 3]) -> f64 {
        distance(one, other)
    }

    #[test]
    fn points_of_a_line_give_that_line() {
        let pieces = pieces(&[[0.0; 6], [10.0, 0.0, 0.0, 0.0, 0.0, 0.0], [50.0, 0.0, 0.0, 0.0, 0.0, 0.0]]);
        assert!((pieces[1].length() - 40.0).abs() < 1e-9);
        assert!(apart(pieces[1].tool(13.0).position, [23.0, 0.0, 0.0]) < 1e-9);
    }

    #[test]
    fn points_of_a_circle_give_nearly_that_circle() {
        let on_circle = |index: usize| {
            let (sin, cos) = libm::sincos((index as f64 * 20.0).to_radians());
            [100.0 * cos, 100.0 * sin, 0.0, 0.0, 0.0, 0.0]
        };
        let targets: Vec<_> = (0..10).map(on_circle).collect();
        for piece in &pieces(&targets)[1..8] {
            for step in 0..=100 {
                let place = piece.tool(piece.length() * f64::from(step) / 100.0).position;
                assert!((length(place) - 100.0).abs() < 0.05, "{} mm", length(place));
            }
        }
    }

    #[test]
    fn a_turn_back_is_no_part_of_a_curve() {
        let back = pieces(&[[0.0; 6], [10.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]]);
        assert!(!back[0].goes_on_to(&back[1]));
    }

    proptest! {
        #[test]
        fn tangent_and_curvature_are_continuous_at_every_target(targets in targets(6)) {
            let pieces = pieces(&targets);
            for pair in pieces.windows(2) {
                let (one, other) = (&pair[0], &pair[1]);
                prop_assert!(apart(one.tool(one.length()).position, other.tool(0.0).position) < 1e-9);
                let [one_tangent, other_tangent] = [derivative(one, 1, 1.0), derivative(other, 1, 0.0)].map(|first| {
                    let first = position(&first);
                    first.map(|part| part / length(first))
                });
                prop_assert!(apart(one_tangent, other_tangent) < 1e-9);
                let (bend, other_bend) = (curvature(one, 1.0), curvature(other, 0.0));
                prop_assert!(apart(bend, other_bend) < 1e-9 + 1e-6 * length(bend));
                // And numerically, on the path itself, by the way.
                let h = 0.02;
                let place = |way: f64| {
                    let end = one.length();
                    if way <= 0.0 { one.tool(end + way).position } else { other.tool(way).position }
                };
                let second = |at: f64| -> [f64; 3] {
                    core::array::from_fn(|i| (place(at - h)[i] - 2.0 * place(at)[i] + place(at + h)[i]) / (h * h))
                };
                let (left, right) = (second(-h), second(h));
                prop_assert!(apart(left, right) < 0.02 * (1.0 + 30.0 * length(bend)), "{left:?} {right:?}");
            }
        }

        #[test]
        fn the_parameter_is_the_way(targets in targets(5), share in 0.0..0.99_f64) {
            for piece in pieces(&targets) {
                let way = share * piece.length();
                let step = piece.length() * 1e-4;
                let speed = apart(piece.tool(way).position, piece.tool(way + step).position) / step;
                prop_assert!((speed - 1.0).abs() < 1e-3, "{speed}");
            }
        }

        #[test]
        fn the_tool_turns_as_smoothly_as_it_moves(targets in targets(6)) {
            for pair in pieces(&targets).windows(2) {
                let (one, other) = (&pair[0], &pair[1]);
                let h = 0.01;
                let turn = |from: Frame, to: Frame| {
                    let (axis, angle) = (from.rotation.inverse() * to.rotation).axis_angle();
                    axis.map(|part| part * angle / h)
                };
                let left = turn(one.tool(one.length() - h), *one.to());
                let right = turn(*other.from(), other.tool(h));
                prop_assert!(apart(left, right) < 0.02 * (1.0 + length(left)), "{left:?} {right:?} °/mm");
            }
        }
    }
}
