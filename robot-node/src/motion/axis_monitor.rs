//! What the axes did in the last cycles, and what they may do in the next one.
//!
//! Every plan keeps the limits of the axes; this is the check that it does. The monitor knows nothing of paths: it holds
//! the differences of the joints from one robot cycle to the next against rated speed, acceleration and jerk, before the
//! joints are given out. Beyond them the arm does not go: it [brakes](AxisMonitor::braked) within the limits, on no path.

use super::settle::next_change;
use crate::arm::{AXES, Arm, AxisLimits, Joints, Rated, Violation};

/// What may be added to a limit before the arm does not go there, as a share of it.
const ROUNDING: f64 = 1e-3;

/// How far within a limit a shift leads, as a share of it: the way along a spline and the joints near a singular position are
/// known to some 10⁻¹¹ degrees only, of which a short robot cycle with a low jerk has few.
const AIM: f64 = 1e-5;

/// The axes of an arm from cycle to cycle. In degrees, mm on a linear axis, and cycles.
#[derive(Clone, Debug)]
pub(super) struct AxisMonitor {
    /// Where they are.
    joints: Joints,
    /// What the last cycle moved them by.
    step: Joints,
    /// By how much more than the cycle before.
    change: Joints,
    /// The most that one cycle may move them by.
    most_step: Joints,
    /// The most by which a cycle may move them more or less than the one before.
    most_change: Joints,
    /// The most by which that may change.
    most_jerk: Joints,
    cycle_s: f64,
}

impl AxisMonitor {
    /// Of axes that rest at `joints`.
    pub(super) fn at_rest(limits: &AxisLimits, joints: &Joints, cycle_s: f64) -> Self {
        let square = cycle_s * cycle_s;
        Self {
            joints: *joints,
            step: [0.0; AXES],
            change: [0.0; AXES],
            most_step: limits.speed.map(|speed| speed * cycle_s),
            most_change: limits.acceleration.map(|acceleration| acceleration * square),
            most_jerk: limits.jerk.map(|jerk| jerk * square * cycle_s),
            cycle_s,
        }
    }

    /// Where the axes are.
    pub(super) const fn joints(&self) -> &Joints {
        &self.joints
    }

    /// Whether the last cycle did not move them.
    pub(super) fn is_at_rest(&self) -> bool {
        self.step == [0.0; AXES]
    }

    /// Whether they stood in the last cycles: one more at rest changes nothing.
    pub(super) fn is_still(&self) -> bool {
        self.is_at_rest() && self.change == [0.0; AXES]
    }

    /// Whether the axes may be at `joints` in the next cycle.
    ///
    /// # Errors
    ///
    /// The first axis that would leave its range or go beyond what it is rated for, and by how much.
    pub(super) fn check(&self, joints: &Joints, arm: &Arm) -> Result<(), Violation> {
        self.keeps_ratings(joints, arm, ROUNDING)?;
        arm.within_range(joints)
    }

    /// Whether the axes keep their ratings if they are at `joints` in the next cycle; `share` of each may be added.
    ///
    /// # Errors
    ///
    /// The first axis that would not, and by how much.
    pub(super) fn keeps_ratings(&self, joints: &Joints, arm: &Arm, share: f64) -> Result<(), Violation> {
        for (axis, joint) in joints.iter().enumerate().take(arm.axes()) {
            for (rated, value, most, power) in self.rates(axis, *joint) {
                // What is no number is within no limit.
                let is_within = value.abs() <= most * (1.0 + share);
                if !is_within {
                    let per = (0..power).fold(1.0, |per, _| per * self.cycle_s);
                    let (value, limit) = (value.abs() / per, most / per);
                    return Err(Violation::Rated { axis: axis as u8 + 1, rated, value, limit });
                }
            }
        }
        Ok(())
    }

    /// Speed, acceleration and jerk of an axis that is at `joint` in the next cycle, each with its limit and with the
    /// power of the cycle that it is counted by.
    fn rates(&self, axis: usize, joint: f64) -> [(Rated, f64, f64, u8); 3] {
        let step = joint - self.joints[axis];
        let change = step - self.step[axis];
        let jerk = change - self.change[axis];
        [
            (Rated::Speed, step, self.most_step[axis], 1),
            (Rated::Acceleration, change, self.most_change[axis], 2),
            (Rated::Jerk, jerk, self.most_jerk[axis], 3),
        ]
    }

    /// Returns the least shift along `slopes`, in their unit, from `joints` to where the axes may be in the next cycle,
    /// [a little within](AIM) their limits; none where the limits of one axis contradict those of another.
    pub(super) fn least_shift(&self, joints: &Joints, slopes: &Joints, arm: &Arm) -> Option<f64> {
        let (mut least, mut most) = (f64::NEG_INFINITY, f64::INFINITY);
        for (axis, joint) in joints.iter().enumerate().take(arm.axes()) {
            for (_, value, limit, _) in self.rates(axis, *joint) {
                if slopes[axis] == 0.0 {
                    continue;
                }
                let aim = (1.0 - AIM) * limit;
                let ends = [-aim, aim].map(|end| (end - value) / slopes[axis]);
                least = least.max(ends[0].min(ends[1]));
                most = most.min(ends[0].max(ends[1]));
            }
        }
        (least <= most).then(|| 0.0_f64.clamp(least, most))
    }

    /// The axes are there now.
    pub(super) fn go_to(&mut self, joints: &Joints) {
        let step = core::array::from_fn(|axis| joints[axis] - self.joints[axis]);
        self.change = core::array::from_fn(|axis| step[axis] - self.step[axis]);
        (self.joints, self.step) = (*joints, step);
    }

    /// Where the axes are after one more cycle in which each of them comes to rest as fast as it may: where they are, if
    /// they rest.
    pub(super) fn braked(&self) -> Joints {
        core::array::from_fn(|axis| {
            let (step, most, jerk) = (self.step[axis], self.most_change[axis], self.most_jerk[axis]);
            if step == 0.0 && self.change[axis] == 0.0 {
                return self.joints[axis];
            }
            let next = step + next_change(-step, self.change[axis], most, jerk);
            // What rounding left is no motion.
            if next.abs() < f64::EPSILON * self.most_step[axis] {
                self.joints[axis]
            } else {
                self.joints[axis] + next
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::arm::Scara;

    const CYCLE_S: f64 = 0.004;

    fn arm() -> Arm {
        let limits = AxisLimits {
            lower: [-1_000.0; AXES],
            upper: [1_000.0; AXES],
            speed: [400.0; AXES],
            acceleration: [1_500.0; AXES],
            jerk: [150_000.0; AXES],
        };
        Arm::new(Arc::new(Scara { link_1_mm: 225.0, link_2_mm: 275.0, height_mm: 0.0 }), limits)
    }

    fn monitor() -> AxisMonitor {
        AxisMonitor::at_rest(arm().limits(), &[0.0; AXES], CYCLE_S)
    }

    fn only_the_second(value: f64) -> Joints {
        let mut joints = [0.0; AXES];
        joints[1] = value;
        joints
    }

    #[test]
    fn a_jump_is_found_with_its_axis_and_its_figure() {
        let error = monitor().check(&only_the_second(360.0), &arm()).unwrap_err();
        insta::assert_snapshot!(error, @"joint 2 would move at a speed of 90000.000, it is rated for 400.000 (degrees or mm, s)");
        let nowhere = monitor().check(&only_the_second(f64::NAN), &arm()).unwrap_err();
        assert!(matches!(nowhere, Violation::Rated { axis: 2, rated: Rated::Speed, .. }), "{nowhere}");
    }

    #[test]
    fn a_start_without_a_ramp_is_found() {
        let error = monitor().check(&only_the_second(1.0), &arm()).unwrap_err();
        insta::assert_snapshot!(error, @"joint 2 would move at an acceleration of 62500.000, it is rated for 1500.000 (degrees or mm, s)");
        let error = monitor().check(&only_the_second(0.02), &arm()).unwrap_err();
        insta::assert_snapshot!(error, @"joint 2 would move at a jerk of 312500.000, it is rated for 150000.000 (degrees or mm, s)");
    }

    #[test]
    fn the_least_shift_brings_an_axis_just_within_its_jerk() {
        let (monitor, slopes) = (monitor(), only_the_second(2.0));
        // 0.0096 degrees a cycle³ is the rated jerk.
        let shift = monitor.least_shift(&only_the_second(0.0106), &slopes, &arm()).unwrap();
        assert!((shift + 0.0005 + 0.0096 * AIM / 2.0).abs() < 1e-12, "{shift}");
        assert!(monitor.keeps_ratings(&only_the_second(0.0106 + 2.0 * shift), &arm(), 0.0).is_ok());
        assert_eq!(monitor.least_shift(&only_the_second(0.005), &slopes, &arm()), Some(0.0));
    }

    #[test]
    fn axes_that_must_be_shifted_apart_have_no_least_shift() {
        let (mut joints, mut slopes) = ([0.0; AXES], [0.0; AXES]);
        joints[..2].fill(0.0106);
        (slopes[0], slopes[1]) = (1.0, -1.0);
        assert_eq!(monitor().least_shift(&joints, &slopes, &arm()), None);
    }

    #[test]
    fn from_any_speed_the_axes_brake_to_rest_within_their_limits() {
        let (arm, mut monitor) = (arm(), monitor());
        // 0.0096 degrees a cycle³ is the rated jerk: up to speed with half of it, and then a stop at every moment.
        let mut joints = [0.0; AXES];
        let (mut step, mut change) = (0.0, 0.0_f64);
        for _ in 0..60 {
            change = (change + 0.004).min(0.02);
            step += change;
            joints[0] += step;
            joints[3] -= step / 3.0;
            monitor.check(&joints, &arm).unwrap();
            monitor.go_to(&joints);
            let mut braking = monitor.clone();
            let mut cycles = 0;
            while !braking.is_at_rest() {
                let next = braking.braked();
                braking.check(&next, &arm).unwrap();
                braking.go_to(&next);
                cycles += 1;
                assert!(cycles < 200, "{braking:?}");
            }
            assert_eq!(braking.braked(), *braking.joints());
        }
    }
}
