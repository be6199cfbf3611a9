//! The shares of their limits that joints and tool use at a place of a law.

use super::extremes::larger;
use super::node::Ratings;
use super::slopes::Slopes;
use crate::arm::{AXES, Joints, dot};

/// Times in which the accelerations of joints and tool rise, in s, and the factors of the accelerations for slowing
/// down.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ramps {
    pub(super) ramp_s: Joints,
    pub(super) tool_ramp_s: f64,
    pub(super) deceleration: f64,
    pub(super) tool_deceleration: f64,
}

impl Ramps {
    pub(super) const fn of(ratings: &Ratings) -> Self {
        let Ratings { ramp_s, tool_ramp_s, deceleration, tool_deceleration, .. } = *ratings;
        Self { ramp_s, tool_ramp_s, deceleration, tool_deceleration }
    }

    /// The factor of the acceleration that the tool may have while it slows down, with what bends its path; see
    /// [`Slopes::along_path`].
    pub(super) const fn bent_tool_deceleration(&self) -> f64 {
        self.tool_deceleration.max(1.0)
    }
}

/// Accelerations and jerks as shares of the limits for speeding up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load {
    /// The joints' accelerations and jerks, with their signs.
    joints: [Joints; 2],
    /// The tool's.
    tool: [f64; 2],
    /// The tool's acceleration along its path, where its deceleration is lower than its acceleration; else not needed.
    tangential: f64,
}

impl Load {
    /// Those at a place with this square of the speed, this acceleration and this jerk along the part.
    pub(super) fn new(slopes: &Slopes, [square_speed, acceleration, jerk]: [f64; 3], ramps: &Ramps) -> Self {
        let Slopes { slope, bend, twist, tool: [along, across, around] } = slopes;
        let speed = square_speed.max(0.0).sqrt();
        let (bending, twisting) = (3.0 * acceleration * speed, square_speed * speed);
        let mut joints = [[0.0; AXES]; 2];
        for axis in 0..AXES {
            let jerk = slope[axis] * jerk + bend[axis] * bending + twist[axis] * twisting;
            joints[0][axis] = slope[axis] * acceleration + bend[axis] * square_speed;
            joints[1][axis] = jerk * ramps.ramp_s[axis];
        }
        let (mut accelerated, mut jerked) = (0.0, 0.0);
        for i in 0..3 {
            let one = along[i] * acceleration + across[i] * square_speed;
            let other = along[i] * jerk + across[i] * bending + around[i] * twisting;
            (accelerated, jerked) = (accelerated + one * one, jerked + other * other);
        }
        let tangential = match ramps.tool_deceleration < 1.0 {
            true => dot(slopes.along_path(), [square_speed, acceleration, 0.0]),
            false => 0.0,
        };
        Self { joints, tool: [accelerated.sqrt(), jerked.sqrt() * ramps.tool_ramp_s], tangential }
    }

    /// Returns the extreme values between the first and the last of three places, of which `self` is half-way, by the
    /// parabola through all three. That along the path is the one of `self`.
    pub(super) fn with_turns(mut self, before: &Self, after: &Self) -> Self {
        let turn = |before: f64, middle: &mut f64, after: f64| {
            let (slope, bend) = (0.5 * (after - before), before - 2.0 * *middle + after);
            if slope.abs() < bend.abs() {
                *middle -= 0.5 * slope * slope / bend;
            }
        };
        for order in 0..2 {
            for axis in 0..AXES {
                turn(before.joints[order][axis], &mut self.joints[order][axis], after.joints[order][axis]);
            }
            turn(before.tool[order], &mut self.tool[order], after.tool[order]);
        }
        self
    }

    /// Returns the largest share of an acceleration, and of a jerk.
    pub(super) fn most(&self, slows: bool, ramps: &Ramps) -> [f64; 2] {
        let [mut accelerated, jerked] =
            self.joints.map(|joints| joints.into_iter().fold(0.0, |most, load| larger(most, load.abs())));
        let [mut tool, tool_jerk] = self.tool;
        if slows {
            accelerated /= ramps.deceleration;
            tool /= ramps.bent_tool_deceleration();
        }
        let tool = larger(tool, -self.tangential / ramps.tool_deceleration);
        [larger(accelerated, tool), larger(jerked, tool_jerk)]
    }
}
