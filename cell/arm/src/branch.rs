//! What six-axis arms of both kinds have in common: the eight ways to reach a pose, and joints whose signs and zeros differ
//! from those of the model.

use core::fmt::Debug;

use crate::{AxisLimits, Frame, Joints, Kinematics, Skeleton, Violation};

/// Which of the eight ways to reach a pose.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Branch {
    /// The wrist is on the side of axis 1 to which the arm points at zero.
    pub(super) front: bool,
    /// The elbow of the model is bent toward positive angles.
    pub(super) elbow_positive: bool,
    /// Axis 5 of the model is at a positive angle.
    pub(super) wrist_positive: bool,
}

impl Branch {
    /// Bits of the status, see [`Configuration`](protocol::image::Configuration).
    const BEHIND: u8 = 1;
    const ELBOW_POSITIVE: u8 = 2;
    const WRIST_POSITIVE: u8 = 4;
    /// All bits of the status.
    pub(super) const STATUS_BITS: u8 = Self::BEHIND | Self::ELBOW_POSITIVE | Self::WRIST_POSITIVE;

    /// Returns the way with this status.
    pub(super) const fn with(status: u8) -> Self {
        Self {
            front: status & Self::BEHIND == 0,
            elbow_positive: status & Self::ELBOW_POSITIVE != 0,
            wrist_positive: status & Self::WRIST_POSITIVE != 0,
        }
    }

    /// Returns the status of this way.
    pub(super) const fn status(self) -> u8 {
        (if self.front { 0 } else { Self::BEHIND })
            | (if self.elbow_positive { Self::ELBOW_POSITIVE } else { 0 })
            | (if self.wrist_positive { Self::WRIST_POSITIVE } else { 0 })
    }
}

/// A six-axis arm by the equations of its model. The rest of [`Kinematics`] is the same for all of them.
pub(super) trait SixAxes: Debug + Send + Sync {
    /// Converts joints to the model's angles, in degrees.
    fn model(&self, joints: &Joints) -> Joints;

    /// Returns the pose of the flange at these angles of the model.
    fn pose(&self, model: &Joints) -> Frame;

    /// Returns the points along which the arm's bodies lie at these angles of the model, from the root to the flange.
    fn bodies(&self, model: &Joints) -> Skeleton;

    /// Returns the way in which the arm reaches its pose at these angles of the model.
    fn branch(&self, model: &Joints) -> Branch;

    /// Returns the joints for this pose of the flange in one of the eight ways, near the model's angles `near`.
    fn solve(&self, flange: &Frame, branch: Branch, near: &Joints) -> Result<Joints, Violation>;
}

impl<A: SixAxes> Kinematics for A {
    fn axes(&self) -> usize {
        6
    }

    fn is_rotary(&self, _axis: usize) -> bool {
        true
    }

    fn forward(&self, joints: &Joints) -> Frame {
        self.pose(&self.model(joints))
    }

    fn skeleton(&self, joints: &Joints, _limits: &AxisLimits) -> Skeleton {
        self.bodies(&self.model(joints))
    }

    fn inverse(&self, flange: &Frame, near: &Joints) -> Result<Joints, Violation> {
        let near = self.model(near);
        self.solve(flange, self.branch(&near), &near)
    }

    fn status_bits(&self) -> u8 {
        Branch::STATUS_BITS
    }

    fn status(&self, joints: &Joints) -> u8 {
        self.branch(&self.model(joints)).status()
    }

    fn inverse_with(&self, flange: &Frame, status: u8, near: &Joints) -> Result<Joints, Violation> {
        self.solve(flange, Branch::with(status), &self.model(near))
    }
}

/// Converts joints to the model's angles, in degrees: sign · joint − offset.
#[inline]
pub(super) fn to_model(joints: &Joints, offsets: &Joints, signs: &[i8; 6]) -> Joints {
    core::array::from_fn(|axis| joints[axis] * f64::from(signs[axis]) - offsets[axis])
}

/// Converts the model's angles to joints, in degrees.
#[inline]
pub(super) fn to_joints(model: &Joints, offsets: &Joints, signs: &[i8; 6]) -> Joints {
    core::array::from_fn(|axis| (model[axis] + offsets[axis]) * f64::from(signs[axis]))
}
