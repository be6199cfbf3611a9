//! How what joints and tool can do is best split between speed, acceleration and jerk along a curve.
//!
//! The faster a bent curve is driven, the less is left for speeding up: at a speed v along it a joint has
//!
//! ```text
//! acceleration: A − |q''|·v²        jerk: J − |q'''|·v³ − 3·|q''|·v·a
//! ```
//!
//! over |q'| left, and the tool likewise. A long curve is best driven at a high speed, a short one with a high acceleration:
//! the speed is sought at which the way takes the least time from rest to rest.

use super::derivatives::{Derivatives, most};
use super::profile::{Limits, reachable_speed};
use crate::arm::Arm;

/// Shares of the highest speed that are tried first.
const SHARES: [f64; 7] = [1.0, 0.92, 0.84, 0.75, 0.65, 0.54, 0.42];

/// By how much the best of them is changed then, to and fro.
const STEPS: [f64; 3] = [0.04, 0.02, 0.01];

/// The highest speed that is tried, as a share of that at which nothing is left for speeding up.
const BELOW_NOTHING: f64 = 0.99;

/// The share of what a speed leaves of the jerk that may go into speeding up where the path bends. The rest begins and ends
/// the speeding up.
const TURNING: f64 = 0.5;

/// A stretch of a curve: how joints and tool change along it.
pub(super) struct Stretch<'a> {
    pub(super) derivatives: &'a Derivatives,
    /// The share of what the derivatives may be off that counts as there.
    pub(super) off: f64,
}

/// How the tool's path bends: its curvature in 1/mm, and how that changes across the path, in 1/mm².
#[derive(Clone, Copy, PartialEq, Default, Debug)]
pub(super) struct Bend {
    pub(super) curvature: f64,
    pub(super) change: f64,
}

impl Bend {
    pub(super) const fn max(self, other: Self) -> Self {
        Self { curvature: self.curvature.max(other.curvature), change: self.change.max(other.change) }
    }
}

/// What limits the speed along a curve.
pub(super) struct Split<'a> {
    pub(super) stretches: &'a [Stretch<'a>],
    pub(super) bend: Bend,
    pub(super) programmed: Limits,
    pub(super) arm: &'a Arm,
    /// What is kept in reserve of the axes' limits.
    pub(super) reserve: f64,
}

impl Split<'_> {
    /// The limits with which a way takes the least time from rest to rest: `known` ones, or better ones that are `allowed`.
    pub(super) fn fastest(&self, way: f64, known: Limits, allowed: impl Fn(&Limits) -> bool) -> Limits {
        let highest = self.highest_speed();
        let mut best = (duration(way, &known), known, known.speed / highest);
        let mut attempt = |share: f64| {
            let limits = self.limits(share.min(1.0) * highest);
            let Some(limits) = limits else { return best.2 };
            let duration = duration(way, &limits);
            if duration < best.0 && allowed(&limits) {
                best = (duration, limits, share);
            }
            best.2
        };
        let mut share = 1.0;
        for next in SHARES {
            share = attempt(next);
        }
        for step in STEPS {
            let middle = share;
            attempt(middle + step);
            share = attempt(middle - step);
        }
        best.1
    }

    /// The highest speed that leaves something for speeding up.
    fn highest_speed(&self) -> f64 {
        let Bend { curvature, change } = self.bend;
        let Limits { acceleration, jerk, speed } = self.programmed;
        let mut highest = (acceleration / curvature)
            .sqrt()
            .min(libm::cbrt(jerk / change))
            .min(libm::cbrt(jerk / (curvature * curvature)));
        let rated = self.arm.limits();
        let mut speed = speed;
        for Stretch { derivatives, off } in self.stretches {
            for (axis, joint) in derivatives.joints().iter().enumerate().take(self.arm.axes()) {
                let [slope, bend, twist] = [0, 1, 2].map(|order| joint.largest(order, *off));
                speed = speed.min(self.reserve * rated.speed[axis] / slope);
                highest = highest
                    .min((self.reserve * rated.acceleration[axis] / bend).sqrt())
                    .min(libm::cbrt(self.reserve * rated.jerk[axis] / twist));
            }
        }
        speed.min(BELOW_NOTHING * highest)
    }

    /// What is left for speeding up at a speed; none where it is nothing.
    fn limits(&self, speed: f64) -> Option<Limits> {
        let Limits { acceleration: whole, jerk: whole_jerk, .. } = self.programmed;
        let Bend { curvature, change } = self.bend;
        let (square, cube) = (speed * speed, speed * speed * speed);
        let along = |whole: f64, across: f64| (whole * whole - across * across).max(0.0).sqrt();
        let changing = change * cube;
        let turning = TURNING * (whole_jerk - changing) / (3.0 * curvature * speed);
        let mut acceleration = along(whole, curvature * square).min(turning);
        let reserve = self.reserve;
        let rated = self.arm.limits();
        for (axis, joint, off) in self.joints() {
            let (most_acceleration, most_jerk) =
                (reserve * rated.acceleration[axis], reserve * rated.jerk[axis]);
            let size = |order: usize, at: usize| joint.size(order, at, off);
            least(&mut acceleration, |at| (most_acceleration - size(1, at) * square, size(0, at)));
            least(&mut acceleration, |at| {
                (TURNING * (most_jerk - size(2, at) * cube), 3.0 * size(1, at) * speed)
            });
        }
        let across = changing + 3.0 * curvature * speed * acceleration;
        let mut jerk = along(whole_jerk, across) - curvature * curvature * cube;
        for (axis, joint, off) in self.joints() {
            let most_jerk = reserve * rated.jerk[axis];
            let size = |order: usize, at: usize| joint.size(order, at, off);
            least(&mut jerk, |at| {
                let taken = size(2, at) * cube + 3.0 * size(1, at) * speed * acceleration;
                (most_jerk - taken, size(0, at))
            });
        }
        (acceleration > 0.0 && jerk > 0.0).then_some(Limits { speed, acceleration, jerk })
    }

    fn joints(&self) -> impl Iterator<Item = (usize, &super::derivatives::Channel, f64)> {
        let axes = self.arm.axes();
        self.stretches.iter().flat_map(move |Stretch { derivatives, off }| {
            derivatives.joints().iter().enumerate().take(axes).map(move |(axis, joint)| (axis, joint, *off))
        })
    }
}

/// How long a way takes from rest to rest, in s.
fn duration(way: f64, limits: &Limits) -> f64 {
    let Limits { speed, acceleration, jerk } = *limits;
    let peak = speed.min(reachable_speed(0.0, way / 2.0, limits));
    let with_hold = acceleration * acceleration / jerk;
    let ramp = if peak >= with_hold { (peak + with_hold) / acceleration } else { 2.0 * (peak / jerk).sqrt() };
    way / peak + ramp
}

/// Reduces a limit to what is left at each point divided by what it counts there.
#[inline]
pub(super) fn least(limit: &mut f64, left_and_count: impl Fn(usize) -> (f64, f64)) {
    // As a rule there is more at every point, and nothing to divide.
    let missing = most(0.0, |at| {
        let (left, count) = left_and_count(at);
        *limit * count - left
    });
    if missing > 0.0 {
        *limit = -most(-*limit, |at| {
            let (left, count) = left_and_count(at);
            -(left / count)
        });
    }
}
