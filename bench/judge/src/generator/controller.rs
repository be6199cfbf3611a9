//! Another controller of the same arm: its cycle, and the limits that it has for paths.

use setup::Setup;

use super::dice::Dice;
use crate::case::OtherController;

/// Robot cycles of real controllers, and longer ones.
const CYCLES_US: [u32; 7] = [1_000, 2_000, 4_000, 8_000, 12_000, 16_000, 24_000];

/// How far a random controller's speed and acceleration of a path are from the setup's, as a factor.
const FACTOR: [f64; 2] = [0.2, 4.0];

/// How long an acceleration of a path may take to rise, in s: acceleration over jerk.
const RISES_IN_S: [f64; 2] = [0.002, 0.2];

/// A controller with another cycle and other limits.
pub(super) fn another(dice: &mut Dice, setup: &Setup) -> OtherController {
    let robot = &setup.robot;
    let mut near = |value: f64| value * dice.scale(FACTOR[0], FACTOR[1]);
    let path_velocity_mm_s = near(robot.path_velocity_mm_s.value);
    let path_acceleration_mm_s2 = near(robot.path_acceleration_mm_s2.value);
    let force_jerk_mm_s3 = near(robot.force.as_ref().map_or(50_000.0, |force| force.jerk_mm_s3.value));
    OtherController {
        cycle_us: CYCLES_US[dice.below(CYCLES_US.len())],
        path_velocity_mm_s,
        path_acceleration_mm_s2,
        path_jerk_mm_s3: path_acceleration_mm_s2 / dice.scale(RISES_IN_S[0], RISES_IN_S[1]),
        force_jerk_mm_s3,
    }
}
