//! A case: an arm in its cell, the motions that it is asked for, and what happens on the way. As a TOML file it runs
//! again, to the bit.

use protocol::image::{Motion, MotionKind};
use robot_node::{ConfigError, RobotConfig};
use serde::{Deserialize, Serialize};
use setup::{Provenance, Setup, Sourced};

use crate::kinematics::{AXES, Joints, Links, Vector};

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

/// The arm's links and limits, and its joints at the start.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Its links.
    pub links: Links,
    /// Lowest values of the joints, in degrees (mm).
    pub lower_deg: Vec<f64>,
    /// Highest values, in degrees (mm).
    pub upper_deg: Vec<f64>,
    /// Rated speeds, in degrees (mm) per second.
    pub speed_deg_s: Vec<f64>,
    /// Rated accelerations, in degrees (mm) per second².
    pub acceleration_deg_s2: Vec<f64>,
    /// Rated jerks, in degrees (mm) per second³.
    pub jerk_deg_s3: Vec<f64>,
    /// Joints at the start, in degrees (mm).
    pub home_deg: Vec<f64>,
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

/// Something that happens in a robot cycle of a run.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// In which robot cycle, counted from the command that starts the run.
    pub cycle: u32,
    /// What happens.
    pub what: Happening,
}

/// What can happen.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Happening {
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
        matches!(self, Self::Ptp | Self::PtpJoint)
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
    /// It is no TOML, or a key is wrong.
    #[error("the case cannot be read: {0}")]
    Format(#[from] toml::de::Error),
    /// It is of another version of the format.
    #[error("the case has schema {0}, this program reads schema {SCHEMA}")]
    Schema(u32),
    /// Its setup is not there or broken.
    #[error(transparent)]
    Setup(#[from] setup::Error),
    /// The figures of its arm contradict each other.
    #[error(transparent)]
    Arm(#[from] ConfigError),
}

impl Case {
    /// Reads a file's text.
    ///
    /// # Errors
    ///
    /// What is wrong with it, and where.
    pub fn parse(text: &str) -> Result<Self, CaseError> {
        let case: Self = toml::from_str(text)?;
        if case.schema == SCHEMA { Ok(case) } else { Err(CaseError::Schema(case.schema)) }
    }

    /// The text of its file.
    ///
    /// # Errors
    ///
    /// That of the serializer; none is known.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }

    /// The robot of this case; `setup` is the one that it names.
    ///
    /// # Errors
    ///
    /// Which number makes no sense.
    pub fn robot(&self, setup: &Setup) -> Result<RobotConfig, ConfigError> {
        let mut config = RobotConfig::from_setup(&self.setup_with_its_arm(setup))?;
        config.surfaces = self
            .surfaces
            .iter()
            .map(|surface| robot_node::arm::Surface {
                point: surface.point_mm,
                normal: surface.normal,
                radius_mm: f64::INFINITY,
                stiffness_n_per_mm: surface.stiffness_n_per_mm,
            })
            .collect();
        Ok(config)
    }

    fn setup_with_its_arm(&self, setup: &Setup) -> Setup {
        let mut setup = setup.clone();
        let robot = &mut setup.robot;
        robot.kinematics = kinematics(&self.arm.links);
        robot.axes.lower_deg.value.clone_from(&self.arm.lower_deg);
        robot.axes.upper_deg.value.clone_from(&self.arm.upper_deg);
        robot.axes.speed_deg_s.value.clone_from(&self.arm.speed_deg_s);
        robot.axes.acceleration_deg_s2.value.clone_from(&self.arm.acceleration_deg_s2);
        robot.axes.jerk_deg_s3.value.clone_from(&self.arm.jerk_deg_s3);
        robot.axes.home_deg = Some(drawn(self.arm.home_deg.clone()));
        robot.tools = frames(&self.tools);
        robot.bases = frames(&self.bases);
        robot.interpreter_quantum_us.value = 0;
        robot.start_quantum_us = None;
        robot.skill_overhead_us.value = self.skill_overhead_ms.saturating_mul(1_000);
        setup
    }
}

impl Arm {
    /// That of a setup.
    #[must_use]
    pub fn of(setup: &Setup) -> Self {
        let axes = &setup.robot.axes;
        let links = match &setup.robot.kinematics {
            setup::Kinematics::Scara(scara) => Links::Scara {
                link_1_mm: scara.link_1_mm.value,
                link_2_mm: scara.link_2_mm.value,
                height_mm: scara.height_mm.value,
            },
            setup::Kinematics::Opw(opw) => Links::SixAxes {
                a1_mm: opw.a1_mm.value,
                a2_mm: opw.a2_mm.value,
                b_mm: opw.b_mm.value,
                c1_mm: opw.c1_mm.value,
                c2_mm: opw.c2_mm.value,
                c3_mm: opw.c3_mm.value,
                c4_mm: opw.c4_mm.value,
                offsets_deg: opw.offsets_deg.value,
                signs: opw.signs.value,
            },
            setup::Kinematics::ThreeParallel(arm) => Links::ThreeParallel {
                d_mm: [&arm.d1_mm, &arm.d4_mm, &arm.d5_mm, &arm.d6_mm].map(|length| length.value),
                a_mm: [&arm.a2_mm, &arm.a3_mm].map(|length| length.value),
                offsets_deg: arm.offsets_deg.value,
                signs: arm.signs.value,
            },
        };
        let middles = || {
            let ranges = axes.lower_deg.value.iter().zip(&axes.upper_deg.value);
            ranges.map(|(lower, upper)| f64::midpoint(*lower, *upper)).collect()
        };
        Self {
            links,
            lower_deg: axes.lower_deg.value.clone(),
            upper_deg: axes.upper_deg.value.clone(),
            speed_deg_s: axes.speed_deg_s.value.clone(),
            acceleration_deg_s2: axes.acceleration_deg_s2.value.clone(),
            jerk_deg_s3: axes.jerk_deg_s3.value.clone(),
            home_deg: axes.home_deg.as_ref().map_or_else(middles, |home| home.value.clone()),
        }
    }

    /// Returns the joints at the start; joints that it lacks are 0.
    #[must_use]
    pub fn home(&self) -> Joints {
        by_joint(&self.home_deg, 0.0)
    }
}

/// One value a joint; those that a list lacks are `rest`.
#[must_use]
pub fn by_joint(values: &[f64], rest: f64) -> Joints {
    let mut joints = [rest; AXES];
    for (joint, value) in joints.iter_mut().zip(values) {
        *joint = *value;
    }
    joints
}

const fn drawn<T>(value: T) -> Sourced<T> {
    Sourced { value, from: Provenance::Assumed, note: String::new() }
}

fn kinematics(links: &Links) -> setup::Kinematics {
    match *links {
        Links::Scara { link_1_mm, link_2_mm, height_mm } => setup::Kinematics::Scara(setup::Scara {
            link_1_mm: drawn(link_1_mm),
            link_2_mm: drawn(link_2_mm),
            height_mm: drawn(height_mm),
        }),
        Links::SixAxes { a1_mm, a2_mm, b_mm, c1_mm, c2_mm, c3_mm, c4_mm, offsets_deg, signs } => {
            setup::Kinematics::Opw(Box::new(setup::Opw {
                a1_mm: drawn(a1_mm),
                a2_mm: drawn(a2_mm),
                b_mm: drawn(b_mm),
                c1_mm: drawn(c1_mm),
                c2_mm: drawn(c2_mm),
                c3_mm: drawn(c3_mm),
                c4_mm: drawn(c4_mm),
                offsets_deg: drawn(offsets_deg),
                signs: drawn(signs),
            }))
        }
        Links::ThreeParallel { d_mm: [d1, d4, d5, d6], a_mm: [a2, a3], offsets_deg, signs } => {
            setup::Kinematics::ThreeParallel(Box::new(setup::ThreeParallel {
                d1_mm: drawn(d1),
                a2_mm: drawn(a2),
                a3_mm: drawn(a3),
                d4_mm: drawn(d4),
                d5_mm: drawn(d5),
                d6_mm: drawn(d6),
                offsets_deg: drawn(offsets_deg),
                signs: drawn(signs),
            }))
        }
    }
}

fn frames(frames: &[Frame]) -> Vec<setup::Frame> {
    frames.iter().map(|frame| setup::Frame { number: frame.number, mm_deg: drawn(frame.mm_deg) }).collect()
}
