//! A case: an arm in its cell, the motions that it is asked for, and what happens on the way. As a TOML file it runs
//! again, to the bit.

mod arm;
mod points;
mod robot;

use protocol::image::{Motion, MotionKind};
use robot_node::ConfigError;
use serde::{Deserialize, Serialize};

use crate::kinematics::Vector;
pub use arm::{Arm, by_joint};
pub use points::RunPoints;

/// Version of the file format.
pub const SCHEMA: u32 = 1;

/// An arm in its cell, and what is asked of it.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// Version of this file format: 1.
    pub schema: u32,
    /// What the judge found when it wrote this file. A reader passes over it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub found: String,
    /// The setup that gives all that is not said here.
    pub setup: String,
    /// Seed of the controller's interpreter.
    #[serde(default)]
    pub seed: u64,
    /// What a skill call costs besides its motion, in ms.
    #[serde(default)]
    pub skill_overhead_ms: u32,
    /// The arm.
    pub arm: Arm,
    /// The robot's controller, if it is another one than the setup's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub controller: Option<OtherController>,
    /// Tool frames by number; 0 is the flange.
    #[serde(default, rename = "tool", skip_serializing_if = "Vec::is_empty")]
    pub tools: Vec<Frame>,
    /// Base frames by number; 0 is the root.
    #[serde(default, rename = "base", skip_serializing_if = "Vec::is_empty")]
    pub bases: Vec<Frame>,
    /// What the tool can press against.
    #[serde(default, rename = "surface", skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<Surface>,
    /// What the PLC commands, one after another.
    #[serde(rename = "run")]
    pub runs: Vec<Run>,
}

/// What another robot controller makes of the same arm.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OtherController {
    /// The robot's cycle.
    pub cycle_us: u32,
    /// Highest speed of a path.
    pub path_velocity_mm_s: f64,
    /// Highest acceleration of a path.
    pub path_acceleration_mm_s2: f64,
    /// Highest jerk of a path.
    pub path_jerk_mm_s3: f64,
    /// Highest jerk of a LIN force, where the setup has force control.
    pub force_jerk_mm_s3: f64,
}

/// A numbered frame.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Its number.
    pub number: u8,
    /// x, y, z in mm; a, b, c in degrees about z, y', x''.
    pub mm_deg: [f64; 6],
}

/// A flat elastic surface without border.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surface {
    /// A point on it in the root, in mm.
    pub point_mm: Vector,
    /// The unit vector out of it.
    pub normal: Vector,
    /// What it pushes back with, in N/mm.
    pub stiffness_n_per_mm: f64,
}

/// How motions are commanded.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Execution {
    /// As one MoveContinuousSkill.
    Continuous,
    /// As one MoveTrajectorySkill of compact points: on a robot that takes them, a list that has [this form](Run::points); else as
    /// a MoveContinuousSkill.
    Trajectory,
    /// Each as a skill of its own.
    Single,
    /// As a program of the robot.
    Program,
}

/// Motions that belong together, and events meanwhile.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// How they are commanded.
    pub execution: Execution,
    /// Events in the order of time.
    #[serde(default, rename = "event", skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<Event>,
    /// The motions.
    #[serde(rename = "motion")]
    pub motions: Vec<Programmed>,
}

/// What happens in a robot cycle of a run.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// In which robot cycle, counted from the command that starts the run.
    pub cycle: u32,
    /// What happens.
    pub what: Intervention,
}

/// What the PLC or the cable does during a run.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Intervention {
    /// Another override, in %.
    Override(u8),
    /// The PLC suspends.
    Suspend,
    /// The PLC resumes.
    Resume,
    /// The PLC halts.
    Halt,
    /// The PLC takes back `enable`.
    Disable,
    /// The connection is lost.
    Disconnect,
    /// A master leads the arm from where it is, with this share of its law's speed in %: 0 stands, more than 100 it cannot
    /// follow.
    Lead(u8),
    /// The master is at once so many ms of the law farther, or farther back.
    Jump(i32),
    /// Images with set-points come no more for so many cycles, or hold at times far away.
    Starve(u16),
    /// No master leads the arm any more.
    Free,
}

/// A motion as the PLC programs it. Units are those of the image: see `protocol::image::Motion`.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Programmed {
    /// Its kind.
    pub kind: Kind,
    /// x, y, z in mm and a, b, c in degrees in the base; joints of a PTP to joints.
    pub target: [f32; 6],
    /// A circle's intermediate point in mm, a LIN force's force in N.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub auxiliary: [f32; 3],
    /// In 0.1 mm/s; point to point in 0.01 %.
    pub velocity: u16,
    /// In 1 mm/s²; point to point in 0.01 %.
    pub acceleration: u16,
    /// For slowing down, in the unit of the acceleration; 0 as that.
    #[serde(default, skip_serializing_if = "is_none")]
    pub deceleration: u16,
    /// In 10 mm/s³; point to point in 0.01 % of the rated jerks. 0 as the robot has it.
    #[serde(default, skip_serializing_if = "is_none")]
    pub jerk: u16,
    /// In 0.01 mm.
    #[serde(default, skip_serializing_if = "is_none")]
    pub approximation: u16,
    /// Tool number.
    #[serde(default, skip_serializing_if = "is_flange")]
    pub tool: u8,
    /// Base number.
    #[serde(default, skip_serializing_if = "is_flange")]
    pub base: u8,
    /// The PLC writes it in this robot cycle of its run at the earliest.
    #[serde(default, skip_serializing_if = "is_at_once")]
    pub written_in_cycle: u32,
}

fn is_zero(auxiliary: &[f32; 3]) -> bool {
    *auxiliary == [0.0; 3]
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
const fn is_none(value: &u16) -> bool {
    *value == 0
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
const fn is_flange(value: &u8) -> bool {
    *value == 0
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
const fn is_at_once(value: &u32) -> bool {
    *value == 0
}

/// The kinds of motion.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// A straight line of the tool.
    Lin,
    /// Point to point to a place of the tool.
    Ptp,
    /// Point to point to joints.
    PtpJoint,
    /// A circle of the tool.
    Circ,
    /// A piece of a spline of the tool.
    Spline,
    /// A straight line into contact.
    LinForce,
}

impl Kind {
    /// Whether only the joints' way is given.
    #[must_use]
    pub const fn is_point_to_point(self) -> bool {
        match self {
            Self::Ptp | Self::PtpJoint => true,
            Self::Lin | Self::Circ | Self::Spline | Self::LinForce => false,
        }
    }

    /// Whether it ends in contact, with a force.
    #[must_use]
    pub const fn has_force(self) -> bool {
        match self {
            Self::LinForce => true,
            Self::Lin | Self::Ptp | Self::PtpJoint | Self::Circ | Self::Spline => false,
        }
    }
}

impl From<Kind> for MotionKind {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Lin => Self::LinCartesian,
            Kind::Ptp => Self::PtpCartesian,
            Kind::PtpJoint => Self::PtpJoint,
            Kind::Circ => Self::Circular,
            Kind::Spline => Self::Spline,
            Kind::LinForce => Self::LinForceCartesian,
        }
    }
}

impl Programmed {
    /// As the image holds it.
    #[must_use]
    pub fn motion(&self) -> Motion {
        Motion {
            kind: self.kind.into(),
            target: self.target,
            auxiliary: self.auxiliary,
            velocity: self.velocity,
            acceleration: self.acceleration,
            deceleration: self.deceleration,
            jerk: self.jerk,
            approximation: self.approximation,
            tool: self.tool,
            base: self.base,
            ..Motion::EMPTY
        }
    }
}

/// Why the case of a file cannot run.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    /// It is of another version of the format.
    #[error("{origin}: the case has schema {found}, this program reads schema {SCHEMA}")]
    Schema {
        /// The file.
        origin: String,
        /// The version found.
        found: u32,
    },
    /// A list has another length than the arm has joints.
    #[error("{origin}: `arm.{key}`: found {found} numbers, expected {joints}, one for each joint")]
    Joints {
        /// The file.
        origin: String,
        /// The list.
        key: &'static str,
        /// Its length.
        found: usize,
        /// Joints of the arm.
        joints: usize,
    },
    /// It is not TOML, a key is wrong, or its setup cannot be used.
    #[error(transparent)]
    Setup(#[from] setup::Error),
    /// The figures of its arm contradict each other.
    #[error(transparent)]
    Arm(#[from] ConfigError),
}

impl Case {
    /// Reads a file's text; `origin` names the file in messages.
    ///
    /// # Errors
    ///
    /// What is wrong with it, and where.
    pub fn parse(origin: &str, text: &str) -> Result<Self, CaseError> {
        let case: Self = setup::read(origin, text)?;
        if case.schema != SCHEMA {
            return Err(CaseError::Schema { origin: origin.to_owned(), found: case.schema });
        }
        let joints = case.arm.links.axes();
        let lengths = case.arm.lists().map(|(key, list)| (key, list.len()));
        match lengths.into_iter().find(|(_, found)| *found != joints) {
            None => Ok(case),
            Some((key, found)) => Err(CaseError::Joints { origin: origin.to_owned(), key, found, joints }),
        }
    }

    /// The text of its file.
    ///
    /// # Errors
    ///
    /// That of the serializer; none is known.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }
}
