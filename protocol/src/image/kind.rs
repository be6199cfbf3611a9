//! The kinds of motion, and what each of them has: the one table that parser, PLC, planning and robot read.

use super::{Skill, codes};

codes! {
    /// The motion types of the paper's section 5.2. The skill of a single motion has the same code.
    MotionKind: u8 {
        /// An empty slot.
        None = 0,
        /// A straight line of the tool to a Cartesian target.
        LinCartesian = 1,
        /// Point to point, all axes synchronised, to a Cartesian target.
        PtpCartesian = 2,
        /// Point to point, all axes synchronised, to a joint target.
        PtpJoint = 3,
        /// A circle through the intermediate point to a Cartesian target.
        Circular = 4,
        /// A spline through the targets of consecutive spline motions.
        Spline = 5,
        /// A straight line that ends in contact and then holds a force, `auxiliary` in N along the base's axes: the
        /// force of the tool on the surface, so it points along the line.
        LinForceCartesian = 6,
    }
}

/// How a motion leads to its target. It sets the unit of velocity, acceleration and jerk, too.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PathForm {
    /// Point to point: shares of the axes' rated values.
    Axes,
    /// A straight line of the tool: mm and s.
    Line,
    /// A circle of the tool: mm and s.
    Circle,
    /// A piece of a spline of the tool: mm and s.
    Spline,
}

/// Content of a motion's target.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum TargetForm {
    /// Position and angles of the tool in the base.
    Pose,
    /// Joint values.
    Joints,
}

/// Content of a motion's auxiliary bytes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum AuxiliaryForm {
    /// Deceleration and jerk, and the configuration of a target that is a pose.
    Options,
    /// A point on the path, in mm.
    Point,
    /// The force in N that the tool reaches on its path and then holds.
    Force,
}

/// What a kind of motion has: one row of the table [`MotionKind::traits`].
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct KindTraits {
    /// Skill that executes a single motion of this kind. It has the same code.
    pub skill: Skill,
    /// Path to the target.
    pub path: PathForm,
    /// Content of the target.
    pub target: TargetForm,
    /// Content of the auxiliary bytes.
    pub auxiliary: AuxiliaryForm,
}

impl MotionKind {
    /// Returns what this kind has; none for an empty slot and an unknown kind.
    #[must_use]
    #[inline]
    pub const fn traits(self) -> Option<KindTraits> {
        use AuxiliaryForm::{Force, Options, Point};
        use PathForm::{Axes, Circle, Line, Spline};
        use TargetForm::{Joints, Pose};

        let (skill, path, target, auxiliary) = match self {
            Self::LinCartesian => (Skill::MoveLinCartesian, Line, Pose, Options),
            Self::PtpCartesian => (Skill::MovePtpCartesian, Axes, Pose, Options),
            Self::PtpJoint => (Skill::MovePtpJoint, Axes, Joints, Options),
            Self::Circular => (Skill::MoveCircular, Circle, Pose, Point),
            Self::Spline => (Skill::MoveSpline, Spline, Pose, Options),
            Self::LinForceCartesian => (Skill::MoveLinForceCartesian, Line, Pose, Force),
            Self::None | Self::Unknown(_) => return None,
        };
        Some(KindTraits { skill, path, target, auxiliary })
    }

    /// Returns the standard kinds: those in the table, by ascending code.
    pub fn standard() -> impl Iterator<Item = Self> {
        Self::NAMED.iter().copied().filter(|kind| kind.traits().is_some())
    }

    /// Returns the skill that executes a single motion of this kind; [`Skill::None`] if it is not a standard kind.
    #[must_use]
    #[inline]
    pub const fn skill(self) -> Skill {
        match self.traits() {
            Some(traits) => traits.skill,
            None => Skill::None,
        }
    }

    /// Returns the path to the target; none for an empty slot and an unknown kind.
    #[must_use]
    #[inline]
    pub const fn path(self) -> Option<PathForm> {
        match self.traits() {
            Some(traits) => Some(traits.path),
            None => None,
        }
    }

    /// Returns whether velocity and acceleration are shares of the axes' rated values instead of mm/s and mm/s².
    #[must_use]
    #[inline]
    pub const fn is_point_to_point(self) -> bool {
        match self.path() {
            Some(PathForm::Axes) => true,
            Some(PathForm::Line | PathForm::Circle | PathForm::Spline) | None => false,
        }
    }

    /// Returns whether the target is joint values instead of a pose.
    #[must_use]
    #[inline]
    pub const fn has_joint_target(self) -> bool {
        match self.traits() {
            Some(KindTraits { target: TargetForm::Joints, .. }) => true,
            Some(KindTraits { target: TargetForm::Pose, .. }) | None => false,
        }
    }

    /// Returns whether the auxiliary bytes are a point or a force, and so have no room for configuration, deceleration and
    /// jerk. Those of an empty slot and of an unknown kind are kept as such.
    #[must_use]
    #[inline]
    pub const fn has_auxiliary(self) -> bool {
        match self.traits() {
            Some(KindTraits { auxiliary: AuxiliaryForm::Options, .. }) => false,
            Some(KindTraits { auxiliary: AuxiliaryForm::Point | AuxiliaryForm::Force, .. }) | None => true,
        }
    }

    /// Returns whether a motion of this kind can ask for a configuration of the arm at its target.
    #[must_use]
    #[inline]
    pub const fn has_configuration(self) -> bool {
        !self.has_auxiliary() && !self.has_joint_target()
    }

    /// Returns whether a motion of this kind ends in contact, with a force.
    #[must_use]
    #[inline]
    pub const fn has_force(self) -> bool {
        match self.traits() {
            Some(KindTraits { auxiliary: AuxiliaryForm::Force, .. }) => true,
            Some(KindTraits { auxiliary: AuxiliaryForm::Options | AuxiliaryForm::Point, .. }) | None => false,
        }
    }
}

impl Skill {
    /// Returns the kind of motion that a skill of one motion executes; none for any other skill.
    #[must_use]
    pub const fn motion_kind(self) -> Option<MotionKind> {
        Some(match self {
            Self::MoveLinCartesian => MotionKind::LinCartesian,
            Self::MovePtpCartesian => MotionKind::PtpCartesian,
            Self::MovePtpJoint => MotionKind::PtpJoint,
            Self::MoveCircular => MotionKind::Circular,
            Self::MoveSpline => MotionKind::Spline,
            Self::MoveLinForceCartesian => MotionKind::LinForceCartesian,
            Self::None
            | Self::MoveContinuous
            | Self::RunProgram
            | Self::MoveTrajectory
            | Self::Unknown(_) => return None,
        })
    }
}
