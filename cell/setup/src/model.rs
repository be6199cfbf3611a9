//! Content of a setup file.

use serde::{Deserialize, Serialize};

use crate::{Bus, LookAhead, Provenance, Refill, SlotForm, Sourced};

/// A PLC, a bus and a robot, with everything a user may change.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// Version of this file format: 1.
    pub schema: u32,
    /// Short name. It is part of the name of a run's directory.
    pub name: String,
    /// Description of the cell.
    pub title: String,
    /// The measured application: a built-in name, or a path relative to this file's directory.
    pub application: String,
    /// The paper's figures, if it measured this setup.
    pub paper: Option<Paper>,
    /// The PLC.
    pub plc: Plc,
    /// The fieldbus.
    pub bus: Bus,
    /// The robot and its controller.
    pub robot: Robot,
    /// How the application's motions are programmed.
    pub motions: Motions,
}

/// The published figures.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Paper {
    /// Programmed in the robot controller.
    pub rc: PaperRow,
    /// Single motions from the PLC.
    pub sm: PaperRow,
    /// One MoveContinuousSkill from the PLC.
    pub cm: PaperRow,
}

/// One row of the paper's Table 2.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct PaperRow {
    /// Average execution time in ms.
    pub aet_ms: f64,
    /// Mean absolute deviation from the mean in ms.
    pub mad_ms: f64,
}

/// The PLC.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Plc {
    /// Time from one scan to the next, in µs.
    pub scan_cycle_us: Sourced<u32>,
    /// Time from reading the inputs to writing the outputs, in µs. Simulated in virtual mode; in real mode the scan
    /// is not delayed.
    pub scan_cost_us: Sourced<u32>,
    /// Number of the image's slots that MoveContinuous keeps filled, 1 to 5: how many motions the PLC writes ahead of
    /// the motion that the robot executes. If left out, all five.
    pub queue_depth: Option<Sourced<u32>>,
    /// The count of the robot by which MoveContinuous refills slots. If left out, `executed`, as in the paper.
    pub refill: Option<Refill>,
    /// The form of the slots in which CM sends its motions. If left out, `full`, as in the paper.
    pub form: Option<SlotForm>,
}

impl Plc {
    /// Returns the count by which MoveContinuous refills slots.
    #[must_use]
    pub fn refills_by(&self) -> Refill {
        self.refill.unwrap_or_default()
    }

    /// Returns the number of slots that MoveContinuous keeps filled.
    #[must_use]
    pub fn slots_in_use(&self) -> u32 {
        self.queue_depth.as_ref().map_or(protocol::image::SLOTS as u32, |depth| depth.value)
    }
}

/// The robot and its controller.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// Its manufacturer's name.
    pub model: String,
    /// Interpolation cycle of the controller, in µs.
    pub cycle_us: Sourced<u32>,
    /// The controller's time quantum in µs: its interpreter notices a new command after a time evenly distributed
    /// between 0 and this.
    pub interpreter_quantum_us: Sourced<u32>,
    /// Additional time until the controller notices the start of a program or of a MoveContinuousSkill, evenly
    /// distributed between 0 and this, in µs; none if left out. A single motion does not need it.
    pub start_quantum_us: Option<Sourced<u32>>,
    /// Robot cycles between a MoveContinuousSkill's command and its first motion that a program of the robot does not
    /// need; none if left out.
    pub continuous_start_cycles: Option<Sourced<u32>>,
    /// Motions of a MoveContinuousSkill that the controller knows at most: those that it has accepted and not yet executed. If left
    /// out, five.
    pub queue_motions: Option<Sourced<u32>>,
    /// If true, the controller takes the compact points of a MoveTrajectorySkill. If left out, it does not.
    pub compact_points: Option<bool>,
    /// Motions of a stored program that the controller knows at most while it runs: a number, or `whole-spline`. If left out, five.
    pub program_look_ahead: Option<Sourced<LookAhead>>,
    /// Time of one skill call in the robot controller besides the motion, in µs: the paper's SM needs it per motion,
    /// RC and CM once. Interpreter dispatch and exact-stop settling.
    pub skill_overhead_us: Sourced<u32>,
    /// The arm's geometry.
    pub kinematics: Kinematics,
    /// Radius in mm of the arm about the lines from joint to joint and on to the tool, what it carries and its hoses included. Required
    /// where a `[[shared_zone]]` is listed.
    pub link_radius_mm: Option<Sourced<f64>>,
    /// The joints' limits.
    pub axes: Axes,
    /// Highest path velocity in mm/s.
    pub path_velocity_mm_s: Sourced<f64>,
    /// Highest path acceleration in mm/s².
    pub path_acceleration_mm_s2: Sourced<f64>,
    /// Highest path jerk in mm/s³.
    pub path_jerk_mm_s3: Sourced<f64>,
    /// What moves its joints. If left out, each joint follows the controller without a delay.
    pub drives: Option<Drives>,
    /// Limits and monitoring of these drives. If left out, assumed ones as soon as there are drives.
    pub servo: Option<Servo>,
    /// Its force controller; a robot without one does not run LIN force.
    pub force: Option<Force>,
    /// Tool frames by number, relative to the flange; number 0 is the flange and is not listed.
    #[serde(default)]
    pub tools: Vec<Frame>,
    /// Base frames by number, relative to the robot's root; number 0 is the root and is not listed.
    #[serde(default)]
    pub bases: Vec<Frame>,
}

/// What moves the joints of a robot.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Drives {
    /// Emulated CiA 402 drives in cyclic synchronous position, one an axis, on an EtherCAT segment of the robot controller.
    /// They exchange process data once in each robot cycle.
    Ethercat,
}

impl Drives {
    /// Increments of a drive per degree (mm) of its joint.
    pub const INCREMENTS: f64 = 1e5;
}

/// Limits and monitoring of the drives, the same for each axis.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Servo {
    /// Highest speed of a motor in % of its joint's rated speed.
    pub speed_percent: Sourced<f64>,
    /// Peak torque of a motor in % of the torque that its joint's rated acceleration takes.
    pub torque_percent: Sourced<f64>,
    /// Largest following error in degrees (mm), object 0x6065 of CiA 402.
    pub following_error_deg: Sourced<f64>,
    /// Time for which the following error may be larger, in ms, object 0x6066.
    pub following_error_ms: Sourced<u32>,
    /// Exact stop: largest distance of a joint from its set-point at which it has arrived, in degrees (mm).
    pub in_position_deg: Sourced<f64>,
    /// Time within which each joint must arrive after its set-points rest, in ms.
    pub settling_ms: Sourced<u32>,
    /// Time within which a reset must switch all drives on, in ms.
    pub switch_on_ms: Sourced<u32>,
}

impl Servo {
    /// Returns assumed numbers, for setups that give none.
    #[must_use]
    pub fn assumed() -> Self {
        fn assumed<T>(value: T, note: &str) -> Sourced<T> {
            Sourced { value, from: Provenance::Assumed, note: note.to_owned() }
        }
        Self {
            speed_percent: assumed(120.0, "a drive that lags must be able to catch up"),
            torque_percent: assumed(
                300.0,
                "usual peak current of a servo amplifier: 2 to 3 times the rated one",
            ),
            following_error_deg: assumed(
                1.0,
                "half of the 2 degrees with which TwinCAT CNC starts, P-AXIS-00169",
            ),
            following_error_ms: assumed(10, "some cycles of the position control"),
            in_position_deg: assumed(0.0005, "50 increments of an emulated drive"),
            settling_ms: assumed(500, "far longer than a healthy drive needs"),
            switch_on_ms: assumed(10_000, "start of the drives' EtherCAT included"),
        }
    }
}

/// A robot's force controller, for LIN force.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Force {
    /// Largest contact force that may be programmed, in N.
    pub max_n: Sourced<f64>,
    /// Stiffest surface that the controller is tuned for, in N/mm: on a stiffer one it may overshoot and oscillate.
    pub stiffest_n_per_mm: Sourced<f64>,
    /// Tolerance around the programmed force, in N.
    pub tolerance_n: Sourced<f64>,
    /// Time for which the force must stay within the tolerance until the motion is done, in ms.
    pub settling_ms: Sourced<u32>,
    /// Largest jerk of the tool while it approaches and presses, in mm/s³.
    pub jerk_mm_s3: Sourced<f64>,
}

/// A numbered frame.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Its number, 1..=15.
    pub number: u8,
    /// x, y, z in mm; a, b, c in degrees about z, y', x''.
    pub mm_deg: Sourced<[f64; 6]>,
}

/// The arm's geometry.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Kinematics {
    /// Two parallel links, a vertical stroke, a rotation: joints 1, 2 (degrees), 3 (mm, up), 4 (degrees).
    Scara(Scara),
    /// Six axes with a parallel base and a spherical wrist: joints 1 to 6 in degrees.
    Opw(Box<Opw>),
    /// Six axes of which 2, 3 and 4 are parallel, without a spherical wrist, as of Universal Robots: joints 1 to 6 in degrees.
    ThreeParallel(Box<ThreeParallel>),
}

/// The parameters of a six-axis arm with a parallel base and a spherical wrist, named as by Brandstötter, Angerer and
/// Hofbaur (2014).
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Opw {
    /// From axis 1 to axis 2, forward, in mm.
    pub a1_mm: Sourced<f64>,
    /// From axis 3 to axis 4, across the forearm, in mm; negative if axis 4 is above axis 3 when the forearm is
    /// level.
    pub a2_mm: Sourced<f64>,
    /// From the plane of the base to that of the arm, sideways, in mm.
    pub b_mm: Sourced<f64>,
    /// From the root to axis 2, upward, in mm.
    pub c1_mm: Sourced<f64>,
    /// From axis 2 to axis 3, in mm.
    pub c2_mm: Sourced<f64>,
    /// From axis 3 to the wrist centre along the forearm, in mm.
    pub c3_mm: Sourced<f64>,
    /// From the wrist centre to the flange, in mm.
    pub c4_mm: Sourced<f64>,
    /// Each joint's zero relative to that of the upright model, in degrees.
    pub offsets_deg: Sourced<[f64; 6]>,
    /// 1 if a joint turns in the model's direction, −1 if it turns in the opposite one.
    pub signs: Sourced<[i8; 6]>,
}

/// The parameters of a six-axis arm whose axes 2, 3 and 4 are parallel: the Denavit-Hartenberg ones that Universal Robots
/// publishes.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ThreeParallel {
    /// From the root to axis 2, upward, in mm.
    pub d1_mm: Sourced<f64>,
    /// From axis 2 to axis 3, in mm; negative if the arm points backward (−x) at zero.
    pub a2_mm: Sourced<f64>,
    /// From axis 3 to axis 4, in mm, with the sign of `a2_mm`.
    pub a3_mm: Sourced<f64>,
    /// From the plane of axis 1 to axis 5, across the arm, in mm.
    pub d4_mm: Sourced<f64>,
    /// From axis 4 to axis 6, along axis 5, in mm.
    pub d5_mm: Sourced<f64>,
    /// From axis 5 to the flange, in mm.
    pub d6_mm: Sourced<f64>,
    /// Each joint's zero relative to that of the model, in degrees.
    pub offsets_deg: Sourced<[f64; 6]>,
    /// 1 if a joint turns in the model's direction, −1 if it turns in the opposite one.
    pub signs: Sourced<[i8; 6]>,
}

/// The parameters of a SCARA.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Scara {
    /// First link, from axis 1 to axis 2, in mm.
    pub link_1_mm: Sourced<f64>,
    /// Second link, from axis 2 to the quill, in mm.
    pub link_2_mm: Sourced<f64>,
    /// Height of the flange above the root at joint 3 = 0, in mm.
    pub height_mm: Sourced<f64>,
}

/// The joints' limits, one entry per joint, in degrees; a linear joint in mm.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Axes {
    /// Lowest values, in degrees (mm).
    #[cfg_attr(test, schemars(with = "Sourced<PerJoint>"))]
    pub lower_deg: Sourced<Vec<f64>>,
    /// Highest values, in degrees (mm).
    #[cfg_attr(test, schemars(with = "Sourced<PerJoint>"))]
    pub upper_deg: Sourced<Vec<f64>>,
    /// Rated speeds in degrees (mm) per second.
    #[cfg_attr(test, schemars(with = "Sourced<PerJoint>"))]
    pub speed_deg_s: Sourced<Vec<f64>>,
    /// Rated accelerations in degrees (mm) per second².
    #[cfg_attr(test, schemars(with = "Sourced<PerJoint>"))]
    pub acceleration_deg_s2: Sourced<Vec<f64>>,
    /// Rated jerks in degrees (mm) per second³.
    #[cfg_attr(test, schemars(with = "Sourced<PerJoint>"))]
    pub jerk_deg_s3: Sourced<Vec<f64>>,
    /// Position at power-on, in degrees (mm). From there the PLC moves the arm to the application's start. If left out, the
    /// arm stands there already, in the configuration that leaves its joints most room.
    #[cfg_attr(test, schemars(with = "Option<Sourced<PerJoint>>"))]
    pub home_deg: Option<Sourced<Vec<f64>>>,
}

/// A number for each joint, as the schema describes it: a SCARA has four joints, the other arms have six.
#[cfg(test)]
#[derive(schemars::JsonSchema)]
#[schemars(inline)]
#[expect(dead_code, reason = "only its schema is used")]
struct PerJoint(#[schemars(length(min = 4, max = 6))] Vec<f64>);

/// How the application's motions are programmed on this setup.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Motions {
    /// Programmed velocity in % of the rated one: of `path_velocity_mm_s` for LIN, of the axes' speeds for PTP.
    pub velocity_percent: Sourced<f64>,
    /// Programmed acceleration in % of the rated one.
    pub acceleration_percent: Sourced<f64>,
    /// Approximation distance of blended motions, in mm.
    pub approximation_mm: Sourced<f64>,
}
