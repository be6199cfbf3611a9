//! The least time in which a given path can be driven within given limits: the reference that planned laws are held
//! against. It knows points of a path and limits, and nothing of how a path is planned.
//!
//! The path comes as points at even steps of some parameter u, half a step of [`STEP`] apart; u is any parameter that
//! stands still where the path is at rest and is smooth in between, such as the time of another law. With b = u̇² at
//! each whole step, joints (and the tool) have, by central differences over the step before and after,
//!
//! ```text
//! q̇² = q'²·b        q̈ = q''·b + q'·b'/2        q⃛ = Δq̈/Δu·√b
//! ```
//!
//! Speed and acceleration are linear in b, and the jerk is so but for the root. What is sought is the least sum of the
//! steps' times h/√b. It is found by a barrier: Newton's method on that sum and the logarithms of what is left of each
//! limit, which count less and less. The matrices have two bands beside the diagonal, so that some thousand steps take
//! a tenth of a second.
//!
//! What comes out is a law within all limits at the steps, and no law near it is faster: by the roots in the jerk the
//! task is not convex, so that this is a near-optimal value and no proven bound. Tests hold it against laws that are
//! known to be optimal, begin from other laws, and say how little a halved step changes.

#![expect(clippy::disallowed_methods, reason = "last bits of a reference decide nothing")]

use core::ops::Range;

use robot_node::arm::{AXES, Joints};

/// Limits at a point of a path; infinite where there is none.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Bounds {
    /// Of each joint, in degrees (mm) per second, second² and second³.
    pub(crate) joints: [Joints; 3],
    /// Of the tool, in mm per second, second² and second³.
    pub(crate) tool: [f64; 3],
}

/// A point of a path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    pub(crate) joints: Joints,
    /// In mm.
    pub(crate) tool: [f64; 3],
    /// In a corner: its number, and where on both of its motions the path is, as times in s at their programmed speeds.
    /// Neither motion is to be faster than that within its part of the corner.
    pub(crate) ways: Option<(usize, [f64; 2])>,
    pub(crate) bounds: Bounds,
}

/// What is left of a limit that is the barrier's doing, as a share of the time.
const ACCURACY: f64 = 1e-4;

/// How much less the barrier counts each time.
const SHARPER: f64 = 6.0;

/// Newton steps for each weight of the barrier.
const NEWTON_STEPS: usize = 40;

/// A law along a path from rest to rest.
pub(crate) struct Law {
    /// How long it takes, in s.
    pub(crate) duration: f64,
}

/// The fastest law along points that are `half` of a step of u apart; the first and the last one are rests.
#[must_use]
pub(crate) fn fastest(points: &[Point], half: f64) -> Law {
    fastest_from(points, half, |_| 1.0)
}

/// The same, sought from a slow law of another shape: what b is like at each step.
#[must_use]
pub(crate) fn fastest_from(points: &[Point], half: f64, shape: impl Fn(usize) -> f64) -> Law {
    let task = Task::new(points, half);
    let mut b = task.slow_start(shape);
    let mut weight = task.limits.len() as f64 / task.duration(&b);
    loop {
        task.improve(&mut b, weight);
        if task.limits.len() as f64 / weight < ACCURACY * task.duration(&b) {
            return Law { duration: task.duration(&b) };
        }
        weight *= SHARPER;
    }
}

/// One limit: the squares of some sums over three neighbouring b are at most 1, or for a jerk at most the square of a
/// time.
struct Limit {
    /// The first of the three steps.
    first: usize,
    /// Each sum's factors.
    sums: [[f64; 3]; 3],
    count: usize,
    /// For a jerk: how much the time of the step after the first b, and of the next one, counts.
    times: Option<[f64; 2]>,
}

struct Task {
    step: f64,
    nodes: usize,
    limits: Vec<Limit>,
}

/// A matrix with two bands beside the diagonal, symmetric: the diagonal, the next and the next but one.
type Banded = Vec<[f64; 3]>;

/// The channels that limits are kept for: each joint, and the tool's three coordinates together.
fn channels(point: &Point) -> [f64; CHANNELS] {
    core::array::from_fn(|channel| match channel.checked_sub(AXES) {
        None => point.joints[channel],
        Some(coordinate) => point.tool[coordinate],
    })
}

const CHANNELS: usize = AXES + 3;

/// Which channels have one limit of an order (0: speed) together, and that limit.
fn groups(bounds: &Bounds, order: usize) -> impl Iterator<Item = (Range<usize>, f64)> {
    let joints = (0..AXES).map(move |axis| (axis..axis + 1, bounds.joints[order][axis]));
    joints.chain([(AXES..CHANNELS, bounds.tool[order])])
}

/// For each channel, what b before and after a step counts to the acceleration in the middle of it.
type Accelerations = [[f64; 2]; CHANNELS];

impl Task {
    fn new(points: &[Point], half: f64) -> Self {
        let steps = (points.len() - 1) / 2;
        let mut task = Self { step: 2.0 * half, nodes: steps + 1, limits: Vec::new() };
        let accelerations: Vec<_> =
            (0..steps).map(|step| task.limit_step(step, &points[2 * step..=2 * step + 2])).collect();
        for node in 0..=steps {
            let before = node.checked_sub(1).map(|step| &accelerations[step]);
            task.limit_jerks(node, before, accelerations.get(node), &points[2 * node].bounds);
        }
        task.limits.retain(|limit| limit.sums.iter().flatten().any(|factor| *factor != 0.0));
        task
    }

    /// Limits speed and acceleration in the middle of a step, from the points at its ends and there.
    fn limit_step(&mut self, step: usize, points: &[Point]) -> Accelerations {
        let (width, half) = (self.step, self.step / 2.0);
        let [before, middle, after] = [0, 1, 2].map(|at| channels(&points[at]));
        let slopes: [f64; CHANNELS] = core::array::from_fn(|i| (after[i] - before[i]) / width);
        let accelerations: Accelerations = core::array::from_fn(|i| {
            let bend = (after[i] - 2.0 * middle[i] + before[i]) / (half * half);
            [bend / 2.0 - slopes[i] / (2.0 * width), bend / 2.0 + slopes[i] / (2.0 * width)]
        });
        let bounds = &points[1].bounds;
        // b is at most so much in the middle: as a square, since it is never negative.
        let mut one_over_most = 0.0_f64;
        for (channels, speed) in groups(bounds, 0) {
            let square: f64 = channels.map(|channel| slopes[channel].powi(2)).sum();
            one_over_most = one_over_most.max(square / (speed * speed));
        }
        if let (Some((corner, from)), Some((next, to))) = (points[0].ways, points[2].ways)
            && corner == next
        {
            for (from, to) in from.into_iter().zip(to) {
                one_over_most = one_over_most.max(((to - from) / width).powi(2));
            }
        }
        self.limits.push(Limit::new(step, 0..1, None, |_| [one_over_most / 2.0; 2]));
        for (channels, most) in groups(bounds, 1) {
            let factors = |channel: usize| accelerations[channel].map(|factor| factor / most);
            self.limits.push(Limit::new(step, channels, None, factors));
        }
        accelerations
    }

    /// Limits the change of the accelerations from the middle of the step before a node to that of the next one. At a
    /// rest the acceleration is 0.
    fn limit_jerks(
        &mut self,
        node: usize,
        before: Option<&Accelerations>,
        after: Option<&Accelerations>,
        bounds: &Bounds,
    ) {
        let is_inside = before.is_some() && after.is_some();
        let times = [self.step, if is_inside { self.step } else { 0.0 }];
        let first = node.saturating_sub(1);
        for (channels, jerk) in groups(bounds, 2) {
            let mut limit = Limit::new(first, channels.clone(), Some(times), |_| [0.0; 2]);
            for (sum, channel) in limit.sums.iter_mut().zip(channels) {
                if let Some(before) = before {
                    let [from, to] = before[channel];
                    *sum = [-from / jerk, -to / jerk, 0.0];
                }
                if let Some(after) = after {
                    let [from, to] = after[channel];
                    sum[node - first] += from / jerk;
                    sum[node - first + 1] += to / jerk;
                }
            }
            self.limits.push(limit);
        }
    }

    /// A b of some shape that keeps all limits with room.
    fn slow_start(&self, shape: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut square = 1.0;
        loop {
            let b: Vec<f64> = (0..self.nodes).map(|node| square * shape(node)).collect();
            if self.limits.iter().all(|limit| limit.left(&b) > 0.5 * limit.whole(&b)) {
                return b;
            }
            square /= 2.0;
        }
    }

    fn duration(&self, b: &[f64]) -> f64 {
        b.windows(2).map(|pair| 2.0 * self.step / (pair[0].sqrt() + pair[1].sqrt())).sum()
    }

    /// The time and the barrier, weighed; infinite beyond a limit.
    fn figure(&self, b: &[f64], weight: f64) -> f64 {
        if b.iter().any(|b| *b <= 0.0) {
            return f64::INFINITY;
        }
        let mut figure = weight * self.duration(b);
        for limit in &self.limits {
            let left = limit.left(b);
            if left <= 0.0 {
                return f64::INFINITY;
            }
            figure -= left.ln();
        }
        figure
    }

    /// Goes down to the least figure for this weight.
    fn improve(&self, b: &mut Vec<f64>, weight: f64) {
        let mut figure = self.figure(b, weight);
        for _ in 0..NEWTON_STEPS {
            let (gradient, mut matrix) = self.model(b, weight);
            let step = solve(&mut matrix, &gradient);
            let descent: f64 = step.iter().zip(&gradient).map(|(step, slope)| step * slope).sum();
            if descent < 1e-3 {
                return;
            }
            let mut share = 1.0;
            loop {
                let next: Vec<f64> = b.iter().zip(&step).map(|(b, step)| b - share * step).collect();
                let next_figure = self.figure(&next, weight);
                if next_figure < figure - 0.1 * share * descent {
                    (*b, figure) = (next, next_figure);
                    break;
                }
                share /= 2.0;
                if share < 1e-9 {
                    return;
                }
            }
        }
    }

    /// The figure's slope, and how it bends; where it bends down, because of the roots, it counts as straight.
    fn model(&self, b: &[f64], weight: f64) -> (Vec<f64>, Banded) {
        let (mut gradient, mut matrix) = (vec![0.0; self.nodes], vec![[0.0; 3]; self.nodes]);
        for (index, pair) in b.windows(2).enumerate() {
            let [p, q] = [pair[0].sqrt(), pair[1].sqrt()];
            let (sum, time) = (p + q, weight * 2.0 * self.step);
            let [slope, bend] = [time / (sum * sum), 2.0 * time / (sum * sum * sum)];
            for (at, root) in [(index, p), (index + 1, q)] {
                gradient[at] -= slope / (2.0 * root);
                matrix[at][0] += bend / (4.0 * root * root) + slope / (4.0 * root * root * root);
            }
            matrix[index][1] += bend / (4.0 * p * q);
        }
        for limit in &self.limits {
            limit.add_to(b, &mut gradient, &mut matrix);
        }
        (gradient, matrix)
    }
}

impl Limit {
    fn new(
        first: usize,
        channels: Range<usize>,
        times: Option<[f64; 2]>,
        factors: impl Fn(usize) -> [f64; 2],
    ) -> Self {
        let mut limit = Self { first, sums: [[0.0; 3]; 3], count: channels.len(), times };
        for (sum, channel) in limit.sums.iter_mut().zip(channels) {
            let [before, after] = factors(channel);
            *sum = [before, after, 0.0];
        }
        limit
    }

    fn sum(&self, sum: usize, b: &[f64]) -> f64 {
        self.sums[sum].iter().zip(&b[self.first..]).map(|(factor, b)| factor * b).sum()
    }

    /// What the squares may come to.
    fn whole(&self, b: &[f64]) -> f64 {
        let Some(times) = self.times else { return 1.0 };
        self.time(&times, b).powi(2)
    }

    fn time(&self, times: &[f64; 2], b: &[f64]) -> f64 {
        let roots = b[self.first..].windows(2).map(|pair| pair[0].sqrt() + pair[1].sqrt());
        times.iter().zip(roots).map(|(time, roots)| time / roots).sum()
    }

    fn left(&self, b: &[f64]) -> f64 {
        self.whole(b) - (0..self.count).map(|sum| self.sum(sum, b).powi(2)).sum::<f64>()
    }

    fn add_to(&self, b: &[f64], gradient: &mut [f64], matrix: &mut Banded) {
        let left = self.left(b);
        let mut slope = [0.0; 3];
        let places = 3.min(b.len() - self.first);
        let mut add = |factors: &[f64; 3], scale: f64| {
            for at in 0..places {
                for other in at..places {
                    matrix[self.first + at][other - at] += scale * factors[at] * factors[other];
                }
            }
        };
        for sum in 0..self.count {
            let value = self.sum(sum, b);
            for (slope, factor) in slope.iter_mut().zip(&self.sums[sum]) {
                *slope -= 2.0 * value * factor;
            }
            add(&self.sums[sum], 2.0 / left);
        }
        if let Some(times) = self.times {
            let time = self.time(&times, b);
            for (index, (pair, part)) in b[self.first..].windows(2).zip(times).enumerate() {
                let [one, other] = [pair[0].sqrt(), pair[1].sqrt()];
                let shorter = part / (one + other).powi(2);
                slope[index] -= time * shorter / one;
                slope[index + 1] -= time * shorter / other;
            }
        }
        add(&slope, 1.0 / (left * left));
        for at in 0..places {
            gradient[self.first + at] -= slope[at] / left;
        }
    }
}

/// Solves a banded system with a positive definite matrix, which it decomposes in place.
fn solve(matrix: &mut Banded, right: &[f64]) -> Vec<f64> {
    let count = matrix.len();
    let mut found = right.to_vec();
    for row in 0..count {
        let [diagonal, next, next_but_one] = matrix[row];
        for (distance, factor) in [(1, next / diagonal), (2, next_but_one / diagonal)] {
            if row + distance >= count {
                break;
            }
            matrix[row + distance][0] -= factor * matrix[row][distance];
            if distance == 1 {
                matrix[row + 1][1] -= factor * next_but_one;
            }
            found[row + distance] -= factor * found[row];
        }
    }
    for row in (0..count).rev() {
        let [diagonal, bands @ ..] = matrix[row];
        for (distance, band) in (1..).zip(bands) {
            if row + distance < count {
                found[row] -= band * found[row + distance];
            }
        }
        found[row] /= diagonal;
    }
    found
}
