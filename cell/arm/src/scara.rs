//! A SCARA: two links that turn in a plane, a vertical stroke, a rotation of the flange.
//!
//! ```text
//! x = l1·cos(q1) + l2·cos(q1 + q2)        z = height + q3
//! y = l1·sin(q1) + l2·sin(q1 + q2)        a = q1 + q2 + q4, b = 0, c = 180: the tool points down
//! ```

use super::angles::{degrees, sin_cos};
use super::{AxisLimits, Frame, Joints, Kinematics, Rotation, Skeleton, Violation, shortest_turn};

/// Largest deviation of the commanded orientation from straight down, in degrees: due to single precision.
const TILT_TOLERANCE_DEG: f64 = 0.01;

/// Half of the tolerance in radians, which equals its sine.
const HALF_TILT_TOLERANCE: f64 = TILT_TOLERANCE_DEG.to_radians() / 2.0;

/// Bit of the status: the second link is turned to the left of the first, or not at all.
const ELBOW_POSITIVE: u8 = 2;

/// The geometry of a SCARA. Joints 1, 2 and 4 are in degrees, joint 3 in mm upward.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Scara {
    /// First link, from axis 1 to axis 2, in mm.
    pub link_1_mm: f64,
    /// Second link, from axis 2 to the quill, in mm.
    pub link_2_mm: f64,
    /// Height of the flange above the root at joint 3 = 0, in mm.
    pub height_mm: f64,
}

impl Kinematics for Scara {
    fn axes(&self) -> usize {
        4
    }

    fn is_rotary(&self, axis: usize) -> bool {
        axis != 2
    }

    fn forward(&self, &[q1, q2, q3, q4, ..]: &Joints) -> Frame {
        let ([sin_1, sin_12], [cos_1, cos_12]) = sin_cos([q1, q1 + q2]);
        Frame {
            position: [
                self.link_1_mm * cos_1 + self.link_2_mm * cos_12,
                self.link_1_mm * sin_1 + self.link_2_mm * sin_12,
                self.height_mm + q3,
            ],
            rotation: Rotation::pointing_down(q1 + q2 + q4),
        }
    }

    /// The links lie above the highest stroke of the quill, which hangs from the second one.
    fn skeleton(&self, joints: &Joints, limits: &AxisLimits) -> Skeleton {
        let &[q1, _, q3, ..] = joints;
        let flange = self.forward(joints).position;
        let [x, y, _] = flange;
        let stroke = limits.upper.get(2).copied().filter(|upper| upper.is_finite()).unwrap_or(q3).max(q3);
        let plane = self.height_mm + stroke;
        let ([sin_1], [cos_1]) = sin_cos([q1]);
        let elbow = [self.link_1_mm * cos_1, self.link_1_mm * sin_1, plane];
        Skeleton::new(&[[0.0; 3], [0.0, 0.0, plane], elbow, [x, y, plane], flange])
    }

    fn inverse(&self, flange: &Frame, near: &Joints) -> Result<Joints, Violation> {
        self.inverse_with(flange, self.status(near), near)
    }

    fn status_bits(&self) -> u8 {
        ELBOW_POSITIVE
    }

    fn status(&self, joints: &Joints) -> u8 {
        if shortest_turn(joints[1]) < 0.0 { 0 } else { ELBOW_POSITIVE }
    }

    fn inverse_with(&self, flange: &Frame, status: u8, _near: &Joints) -> Result<Joints, Violation> {
        if flange.rotation.half_tilt_square() > HALF_TILT_TOLERANCE * HALF_TILT_TOLERANCE {
            return Err(Violation::Tilt { tilt_deg: flange.rotation.tilt_from_down() });
        }
        let (l1, l2) = (self.link_1_mm, self.link_2_mm);
        let [x, y, z] = flange.position;
        let square = x * x + y * y;
        let cos_2 = (square - l1 * l1 - l2 * l2) / (2.0 * l1 * l2);
        if cos_2.is_nan() || cos_2.abs() > 1.0 + 1e-9 {
            return Err(Violation::Radius {
                radius_mm: square.sqrt(),
                nearest_mm: (l1 - l2).abs(),
                farthest_mm: l1 + l2,
            });
        }
        let cos_2 = cos_2.clamp(-1.0, 1.0);
        let elbow = if status & ELBOW_POSITIVE == 0 { -1.0 } else { 1.0 };
        let sin_2 = elbow * (1.0 - cos_2 * cos_2).sqrt();
        // One arc tangent of the rotated target instead of a difference of two arc tangents.
        let (along, across) = (l1 + l2 * cos_2, l2 * sin_2);
        let [half_cos, half_sin] = flange.rotation.half_yaw_pointing_down();
        let [q1, q2, half_yaw] =
            degrees([x * along + y * across, cos_2, half_cos], [y * along - x * across, sin_2, half_sin]);
        let q4 = 2.0 * half_yaw - q1 - q2;
        Ok([q1, q2, z - self.height_mm, q4, 0.0, 0.0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Arm, AxisLimits, distance};
    use proptest::prelude::*;
    use std::sync::Arc;

    const KR6_R500: Scara = Scara { link_1_mm: 225.0, link_2_mm: 275.0, height_mm: 0.0 };

    fn arm() -> Arm {
        let mut limits = AxisLimits::NONE;
        for (axis, limit) in [132.0, 145.0, 200.0, 355.0].into_iter().enumerate() {
            (limits.lower[axis], limits.upper[axis]) = (-limit, limit);
        }
        limits.lower[2] = 0.0;
        Arm::new(Arc::new(KR6_R500), limits)
    }

    #[test]
    fn the_straight_arm_reaches_half_a_metre_along_x() {
        let flange = KR6_R500.forward(&[0.0, 0.0, 120.0, 0.0, 0.0, 0.0]);
        assert!(distance(flange.position, [500.0, 0.0, 120.0]) < 1e-9);
    }

    #[test]
    fn a_target_out_of_reach_is_refused_with_the_reach() {
        let target = Frame::from_mm_deg([400.0, 400.0, 0.0, 0.0, 0.0, 180.0]);
        let error = arm().inverse(&target, &[0.0; 6]).unwrap_err();
        insta::assert_snapshot!(error, @"the target is 565.685 mm from axis 1; the arm reaches from 50.000 to 500.000 mm");
    }

    #[test]
    fn beyond_half_a_turn_the_second_link_stays_on_its_side() {
        let mut limits = *arm().limits();
        (limits.lower[1], limits.upper[1]) = (-200.0, 200.0);
        let arm = Arm::new(Arc::new(KR6_R500), limits);
        for joints in [[-60.0, 195.0, 100.0, 0.0, 0.0, 0.0], [60.0, -195.0, 100.0, 0.0, 0.0, 0.0]] {
            let found = arm.inverse(&KR6_R500.forward(&joints), &joints).unwrap();
            for (found, expected) in found.iter().zip(joints) {
                assert!((found - expected).abs() < 1e-9, "{found} is not {expected}");
            }
        }
    }

    #[test]
    fn a_tilted_tool_is_refused_with_the_tilt() {
        let target = Frame::from_mm_deg([300.0, 0.0, 0.0, 0.0, 5.0, 180.0]);
        let error = arm().inverse(&target, &[0.0; 6]).unwrap_err();
        insta::assert_snapshot!(error, @"the flange would be tilted by 5.000° from straight down; this arm cannot tilt it (c = 180)");
    }

    #[test]
    fn a_joint_out_of_its_range_is_refused_with_the_range() {
        let target = Frame::from_mm_deg([300.0, 0.0, 230.0, 0.0, 0.0, 180.0]);
        let error = arm().inverse(&target, &[0.0; 6]).unwrap_err();
        insta::assert_snapshot!(error, @"joint 3 would be at 230.000 mm, its range is 0.000 to 200.000 mm");
    }

    proptest! {
        #[test]
        fn inverse_undoes_forward_on_either_elbow_side(
            q1 in -131.0..131.0_f64,
            q2 in prop_oneof![-144.0..-1.0_f64, 1.0..144.0_f64],
            q3 in 0.0..200.0_f64,
            q4 in -170.0..170.0_f64,
        ) {
            let joints = [q1, q2, q3, q4, 0.0, 0.0];
            let near = joints.map(|joint| joint * 0.9);
            let found = arm().inverse(&KR6_R500.forward(&joints), &near).unwrap();
            for (found, expected) in found.iter().zip(joints) {
                prop_assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
            }
        }
    }
}
