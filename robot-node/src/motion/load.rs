//! What passing a corner asks of joints and tool: at which rate, and how much is left to change it.
//!
//! Over the corner's share w a joint has at the rate v the acceleration q'·a + q''·v² and the jerk q'·j + 3·q''·v·a +
//! q'''·v³, and so has the tool, whose vectors are held against its limits: mostly the corner bends across the way.

use super::derivatives::{Channel, Derivatives, PLACES};
use super::profile::Limits;
use super::split::least;
use crate::arm::Arm;

/// What joint limits keep in reserve for what lies between the samples.
const RESERVE: f64 = 0.97;

/// The same of the tool's limits.
const TOOL_RESERVE: f64 = 0.99;

/// The shares of accelerations and of jerks that a corner takes at its highest rate. The rest is for braking in it.
const BENDING: f64 = 0.9;
const TWISTING: f64 = 0.8;

/// The share of the jerk left by the rate that may go into changing the rate where the corner bends. The rest begins and
/// ends the change.
const TURNING: f64 = 0.5;

/// A corner and what its motions allow.
pub(super) struct Load<'a> {
    /// The derivatives by the corner's share.
    pub(super) corner: &'a Derivatives,
    pub(super) arm: &'a Arm,
    /// The share of the axes' rated accelerations and jerks.
    pub(super) axis_share: f64,
    /// In mm/s² and mm/s³; infinite where no tool is led.
    pub(super) tool_acceleration: f64,
    pub(super) tool_jerk: f64,
}

/// A joint, and what it may do: speed, acceleration and jerk.
type Joint<'a> = (&'a Channel, [f64; 3]);

impl Load<'_> {
    /// The highest rate.
    pub(super) fn highest_rate(&self) -> f64 {
        let mut highest = f64::INFINITY;
        for (joint, [speed, acceleration, jerk]) in self.joints() {
            let [slope, bend, twist] = [0, 1, 2].map(|order| joint.largest(order, 1.0));
            highest = highest
                .min(speed / slope)
                .min((BENDING * acceleration / bend).sqrt())
                .min(libm::cbrt(TWISTING * jerk / twist));
        }
        if self.leads_tool() {
            let largest = |order: usize| {
                let squares = (0..PLACES).map(|at| self.corner.tool_product(order, order, at));
                squares.fold(0.0, f64::max).sqrt()
            };
            highest = highest
                .min((BENDING * self.tool_acceleration / largest(1)).sqrt())
                .min(libm::cbrt(TWISTING * self.tool_jerk / largest(2)));
        }
        highest
    }

    /// A rate, and how it may change there.
    pub(super) fn limits(&self, rate: f64) -> Limits {
        let (square, cube) = (rate * rate, rate * rate * rate);
        let (mut acceleration, mut jerk) = (f64::MAX, f64::MAX);
        for (joint, [_, most, most_jerk]) in self.joints() {
            let size = |order: usize, at: usize| joint.size(order, at, 1.0);
            least(&mut acceleration, |at| (most - size(1, at) * square, size(0, at)));
            least(&mut acceleration, |at| {
                (TURNING * (most_jerk - size(2, at) * cube), 3.0 * size(1, at) * rate)
            });
        }
        if self.leads_tool() {
            acceleration = acceleration.min(self.tool_acceleration_left(rate));
        }
        for (joint, [_, _, most]) in self.joints() {
            let size = |order: usize, at: usize| joint.size(order, at, 1.0);
            least(&mut jerk, |at| {
                let taken = size(2, at) * cube + 3.0 * size(1, at) * rate * acceleration;
                (most - taken, size(0, at))
            });
        }
        if self.leads_tool() {
            jerk = jerk.min(self.tool_jerk_left(rate, acceleration));
        }
        Limits { speed: rate, acceleration, jerk }
    }

    fn leads_tool(&self) -> bool {
        self.tool_acceleration.is_finite()
    }

    fn joints(&self) -> impl Iterator<Item = Joint<'_>> {
        let rated = self.arm.limits();
        let (reserve, share) = (RESERVE, RESERVE * self.axis_share);
        self.corner.joints().iter().enumerate().take(self.arm.axes()).map(move |(axis, joint)| {
            let speed = reserve * rated.speed[axis];
            (joint, [speed, share * rated.acceleration[axis], share * rated.jerk[axis]])
        })
    }

    /// How the rate may change so that the tool keeps its acceleration and does not spend more than a share of its jerk.
    fn tool_acceleration_left(&self, rate: f64) -> f64 {
        let mut least = f64::INFINITY;
        for at in 0..PLACES {
            let product = |one: usize, other: usize| self.corner.tool_product(one, other, at);
            let (bend, twist) = (product(1, 1).sqrt(), product(2, 2).sqrt());
            let across = bend * rate * rate;
            let whole = TOOL_RESERVE * self.tool_acceleration;
            let along = product(0, 1).abs() * rate * rate;
            let turning = TURNING * (self.tool_jerk - twist * rate * rate * rate) / (3.0 * bend * rate);
            least = least.min(left(whole * whole - across * across, along, product(0, 0))).min(turning);
        }
        least
    }

    /// How the change of the rate may change so that the tool keeps its jerk.
    fn tool_jerk_left(&self, rate: f64, acceleration: f64) -> f64 {
        let (turning, cube) = (3.0 * rate * acceleration, rate * rate * rate);
        let mut least = f64::INFINITY;
        for at in 0..PLACES {
            let product = |one: usize, other: usize| self.corner.tool_product(one, other, at);
            let taken = turning * product(1, 1).sqrt() + cube * product(2, 2).sqrt();
            let along = turning * product(0, 1).abs() + cube * product(0, 2).abs();
            let whole = TOOL_RESERVE * self.tool_jerk;
            least = least.min(left(whole * whole - taken * taken, along, product(0, 0)));
        }
        least
    }
}

/// The largest x with square·x² + 2·along·x ≤ rest.
fn left(rest: f64, along: f64, square: f64) -> f64 {
    let rest = rest.max(0.0);
    rest / (along + (along * along + square * rest).sqrt())
}
