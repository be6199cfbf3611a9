//! Joints: in range, and their speed, acceleration and jerk by differences.

use super::{JOINT_NOISE, Law, SHARE, joint};
use crate::violation::Class;

/// How far a joint may be beyond its range, in degrees (mm): a target on the limit itself is allowed, and comes over the
/// wire in single precision.
const BEYOND_RANGE: f64 = 2e-6;

/// The classes and units of the differences, by order.
const ORDERS: [(Class, [&str; 2]); 3] = [
    (Class::JointSpeed, ["°/s", "mm/s"]),
    (Class::JointAcceleration, ["°/s²", "mm/s²"]),
    (Class::JointJerk, ["°/s³", "mm/s³"]),
];

impl Law {
    pub(super) fn check_joints(&mut self) {
        let joints = self.samples[0].joints;
        for (axis, place) in joints.into_iter().enumerate().take(self.axes) {
            let (lower, upper) = (self.lower[axis], self.upper[axis]);
            if place < lower - BEYOND_RANGE || place > upper + BEYOND_RANGE {
                let limit = if place < lower { lower } else { upper };
                self.report(Class::Range, joint(axis, place, limit, "° (mm)"));
            }
            for (order, difference) in self.joint_differences(axis).into_iter().enumerate() {
                let limit = self.differences[order][axis];
                let noise = f64::from(2 << order) * JOINT_NOISE;
                if difference.abs() > limit * (1.0 + SHARE) + noise {
                    let (class, [turning, linear]) = ORDERS[order];
                    let unit = if self.links.is_linear(axis) { linear } else { turning };
                    let per = self.powers[order];
                    self.report(class, joint(axis, difference / per, limit / per, unit));
                }
            }
        }
    }
}
