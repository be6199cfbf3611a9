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

use arrayvec::ArrayVec;

use super::derivatives::{Channel, Derivatives, most};
use super::profile::{Limits, reachable_speed};
use crate::arm::{AXES, Arm};

/// Shares of the highest speed that are tried one after the other, until the way takes longer again: so far apart, so many.
const STEP: f64 = 0.15;
const STEPS: u32 = 5;

/// The highest speed that is tried, as a share of that at which nothing is left for speeding up.
const BELOW_NOTHING: f64 = 0.99;

/// The share of what a speed leaves of the jerk that may go into speeding up where the path bends. The rest begins and ends
/// the speeding up.
const TURNING: f64 = 0.5;

/// A joint along a stretch of a curve, and what it may do.
struct Joint<'a> {
    channel: &'a Channel,
    /// The share of what its derivatives may be off that counts as there.
    off: f64,
    /// Its largest derivatives: slope, bend and twist.
    largest: [f64; 3],
    speed: f64,
    acceleration: f64,
    jerk: f64,
}

/// Joints along all stretches.
const JOINTS: usize = 2 * AXES;

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
    joints: ArrayVec<Joint<'a>, JOINTS>,
    bend: Bend,
    programmed: Limits,
}

impl<'a> Split<'a> {
    /// Of a tool that may do what is programmed, and so far without joints.
    pub(super) const fn new(bend: Bend, programmed: Limits) -> Self {
        Self { joints: ArrayVec::new_const(), bend, programmed }
    }

    /// Adds what an arm's joints do along a stretch of the curve, with the shares of their limits that they may use, and of
    /// what the derivatives may be off that counts as there.
    pub(super) fn add(&mut self, stretch: &'a Derivatives, arm: &Arm, share: f64, off: f64) {
        let rated = arm.limits();
        for (axis, channel) in stretch.joints().iter().enumerate().take(arm.axes()) {
            if self.joints.is_full() {
                return;
            }
            self.joints.push(Joint {
                channel,
                off,
                largest: [0, 1, 2].map(|order| channel.largest(order, off)),
                speed: share * rated.speed[axis],
                acceleration: share * rated.acceleration[axis],
                jerk: share * rated.jerk[axis],
            });
        }
    }

    /// The limits with which a way takes the least time from rest to rest: `known` ones, or better ones that are `allowed`.
    pub(super) fn fastest(&self, way: f64, known: Limits, allowed: impl Fn(&Limits) -> bool) -> Limits {
        let highest = self.highest_speed();
        let mut best = (duration(way, &known), known);
        let mut attempt = |share: f64| {
            let Some(limits) = self.limits(share * highest) else { return f64::INFINITY };
            let duration = duration(way, &limits);
            if duration < best.0 && allowed(&limits) {
                best = (duration, limits);
            }
            duration
        };
        // How long it takes at the last three shares.
        let mut last = [f64::INFINITY, f64::INFINITY, attempt(1.0)];
        for step in 1..STEPS {
            let share = 1.0 - STEP * f64::from(step);
            let [_, before, now] = last;
            last = [before, now, attempt(share)];
            if last[2] >= last[1] {
                // The least lies between: where the parabola through the three has it.
                let [above, middle, below] = last;
                let bend = above - 2.0 * middle + below;
                let off = if bend.is_finite() && bend > 0.0 { (below - above) / (2.0 * bend) } else { -0.5 };
                attempt((share + STEP + off * STEP).min(1.0));
                break;
            }
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
        let mut speed = speed;
        for joint in &self.joints {
            let [slope, bend, twist] = joint.largest;
            speed = speed.min(joint.speed / slope);
            highest = highest.min((joint.acceleration / bend).sqrt()).min(libm::cbrt(joint.jerk / twist));
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
        for joint in &self.joints {
            let [slope, bend, twist] = joint.largest;
            let size = |order: usize, at: usize| joint.channel.size(order, at, joint.off);
            // As a rule a joint has more left than others.
            if slope * acceleration + bend * square > joint.acceleration {
                least(&mut acceleration, |at| (joint.acceleration - size(1, at) * square, size(0, at)));
            }
            if 3.0 * bend * speed * acceleration > TURNING * (joint.jerk - twist * cube) {
                least(&mut acceleration, |at| {
                    (TURNING * (joint.jerk - size(2, at) * cube), 3.0 * size(1, at) * speed)
                });
            }
        }
        let across = changing + 3.0 * curvature * speed * acceleration;
        let mut jerk = along(whole_jerk, across) - curvature * curvature * cube;
        let turning = 3.0 * speed * acceleration;
        for joint in &self.joints {
            let [slope, bend, twist] = joint.largest;
            let size = |order: usize, at: usize| joint.channel.size(order, at, joint.off);
            if slope * jerk + bend * turning + twist * cube > joint.jerk {
                least(&mut jerk, |at| (joint.jerk - size(2, at) * cube - size(1, at) * turning, size(0, at)));
            }
        }
        (acceleration > 0.0 && jerk > 0.0).then_some(Limits { speed, acceleration, jerk })
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
