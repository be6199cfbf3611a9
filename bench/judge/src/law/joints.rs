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
    pub(super) fn look_at_joints(&mut self) {
        let [q0, q1, q2, q3] = self.samples.map(|sample| sample.joints);
        for axis in 0..self.axes {
            let (lower, upper) = (self.lower[axis], self.upper[axis]);
            if q0[axis] < lower - BEYOND_RANGE || q0[axis] > upper + BEYOND_RANGE {
                let limit = if q0[axis] < lower { lower } else { upper };
                self.report(Class::Range, joint(axis, q0[axis], limit, "° (mm)"));
            }
            let first = q0[axis] - q1[axis];
            let second = first - (q1[axis] - q2[axis]);
            let third = second - (q1[axis] - 2.0 * q2[axis] + q3[axis]);
            for (order, difference) in [first, second, third].into_iter().enumerate() {
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
