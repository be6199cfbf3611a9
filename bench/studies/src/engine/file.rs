//! The format of a study's file.

use serde::{Deserialize, Serialize};

use plc_node::ExecutionType;
use records::schedule::REPETITIONS;

/// Version of the format.
pub const SCHEMA: u32 = 1;

/// A study: what is executed, what varies, what is recorded and what is looked for.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct StudyFile {
    /// Version of this file format: 1.
    #[serde(default = "this_version")]
    pub schema: u32,
    /// Execution of each job.
    pub study: StudySection,
    /// The varied keys. Lists and ranges form a grid; a distribution gives each seed a value of its own.
    #[serde(default)]
    pub vary: Vec<Variation>,
    /// Figures in the rows besides the usual ones.
    #[serde(default)]
    pub record: Record,
    /// Rows that the study looks for; each job that has one is listed with the command that executes it again.
    #[serde(default)]
    pub finding: Vec<StudyFinding>,
}

const fn this_version() -> u32 {
    SCHEMA
}

/// Execution of each job.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct StudySection {
    /// The setup: a built-in name, or a path relative to this file's directory.
    pub setup: String,
    /// An application in place of the setup's: a built-in name, or a path relative to this file's directory.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub application: Option<String>,
    /// Repetitions of each type in a job. If left out, 25 as in the paper.
    #[serde(default = "usual_reps")]
    pub reps: u32,
    /// Execution types: `rc`, `sm`, `cm`. If left out, all three.
    #[serde(default = "usual_types")]
    pub types: Vec<TypeName>,
    /// Seeds, one job each: `1..=1000`, or a single one. If left out, 1.
    #[serde(default = "usual_seeds")]
    pub seeds: String,
    /// Faults of each job, as in `bench --fault`. To vary them, give the key `faults` in `[[vary]]`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<String>,
}

const fn usual_reps() -> u32 {
    REPETITIONS
}

fn usual_types() -> Vec<TypeName> {
    vec![TypeName::Rc, TypeName::Sm, TypeName::Cm]
}

fn usual_seeds() -> String {
    "1".to_owned()
}

/// An execution type.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum TypeName {
    /// The robot's own program.
    Rc,
    /// Single skills from the PLC.
    Sm,
    /// One MoveContinuousSkill from the PLC.
    Cm,
}

impl From<TypeName> for ExecutionType {
    fn from(name: TypeName) -> Self {
        match name {
            TypeName::Rc => Self::Rc,
            TypeName::Sm => Self::Sm,
            TypeName::Cm => Self::Cm,
        }
    }
}

/// A varied key, with exactly one of `values`, `range`, `uniform` and `normal`.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Variation {
    /// A key of the setup, such as `robot.path_acceleration_mm_s2` (docs/keys.md), or `faults`. A key of one of several stations has its
    /// name: `station.left.robot.cycle_us`, and its place in the cell has components: `station.left.root_mm_deg.x`.
    pub key: String,
    /// These values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub values: Option<Vec<Scalar>>,
    /// Values at equal distances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<ValueRange>,
    /// A value for each seed, equally likely between two bounds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uniform: Option<Uniform>,
    /// A value for each seed, normally distributed and cut off at two bounds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal: Option<Normal>,
}

/// A value of a key.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum Scalar {
    /// True or false.
    Truth(bool),
    /// A whole number.
    Integer(i64),
    /// A number.
    Number(f64),
    /// A text, such as the name of a bus.
    Text(String),
    /// Numbers, such as the place of an arm in the cell.
    Numbers(Vec<f64>),
}

impl Scalar {
    /// Returns a text.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        if let Self::Text(text) = self { Some(text) } else { None }
    }
}

impl std::fmt::Display for Scalar {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Truth(value) => write!(f, "{value}"),
            Self::Integer(value) => write!(f, "{value}"),
            // The fewest digits that give the same number back.
            Self::Number(value) => write!(f, "{value}"),
            Self::Text(value) => f.write_str(value),
            Self::Numbers(numbers) => {
                let texts: Vec<String> = numbers.iter().map(ToString::to_string).collect();
                write!(f, "[{}]", texts.join(", "))
            }
        }
    }
}

/// Values at equal distances, the first and the last among them.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ValueRange {
    /// The first value.
    pub from: f64,
    /// The last value.
    pub to: f64,
    /// Number of values, from 2.
    pub steps: u64,
}

/// A uniform distribution.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Uniform {
    /// Lower bound.
    pub min: f64,
    /// Upper bound.
    pub max: f64,
}

/// A normal distribution between bounds.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Normal {
    /// Mean before the cut.
    pub mean: f64,
    /// Standard deviation before the cut.
    pub sd: f64,
    /// Lower bound.
    pub min: f64,
    /// Upper bound.
    pub max: f64,
}

/// Figures in the rows besides the usual ones.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// The figures, a column each.
    #[serde(default)]
    pub figures: Vec<RowFigure>,
}

/// A figure of a repetition.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum RowFigure {
    /// Execution time by the PLC in ns; always in the rows.
    ExecutionNs,
    /// Execution time by the robot in ns, with several stations the longest; always in the rows.
    RobotExecutionNs,
    /// Motions that ended in a stop because the next one came too late, of all stations; always in the rows.
    BlendsSuppressed,
    /// Cyclic frames that one node sent and the other did not accept; one robot only.
    FramesLost,
    /// Images that a node refused because a byte was altered; one robot only.
    ImagesAltered,
    /// Length of the tool's path in mm, with several stations of all paths together.
    PathLengthMm,
    /// Farthest that a tool was from the programmed curves, in mm.
    PathDeviationMm,
    /// Highest speed of a joint as a share of its rated speed.
    JointSpeed,
    /// Highest acceleration of a joint as a share of its rated acceleration.
    JointAcceleration,
    /// Highest jerk of a joint as a share of its rated jerk.
    JointJerk,
    /// True time between the first motions of the arms, in µs; always in the rows of several stations.
    StartSkewUs,
    /// Longest time between the arrivals of the arms at a mark, in µs; always in the rows of several stations.
    MarkSkewUs,
    /// Largest distance of an arm's tool, seen from another arm's, from where the plan has it, in mm; always in the rows of several
    /// stations.
    RelativePoseMm,
}

impl RowFigure {
    /// Figures that are always in the rows.
    pub const USUAL: [Self; 3] = [Self::ExecutionNs, Self::RobotExecutionNs, Self::BlendsSuppressed];

    /// Figures that are always in the rows of several stations too.
    pub const OF_CELL: [Self; 3] = [Self::StartSkewUs, Self::MarkSkewUs, Self::RelativePoseMm];

    /// Returns whether only one robot has it, and not several stations.
    #[must_use]
    pub const fn is_of_one_robot(self) -> bool {
        matches!(self, Self::FramesLost | Self::ImagesAltered)
    }

    /// Returns its column.
    #[must_use]
    pub const fn column(self) -> &'static str {
        match self {
            Self::ExecutionNs => "execution_ns",
            Self::RobotExecutionNs => "robot_execution_ns",
            Self::BlendsSuppressed => "blends_suppressed",
            Self::FramesLost => "frames_lost",
            Self::ImagesAltered => "images_altered",
            Self::PathLengthMm => "path_length_mm",
            Self::PathDeviationMm => "path_deviation_mm",
            Self::JointSpeed => "joint_speed",
            Self::JointAcceleration => "joint_acceleration",
            Self::JointJerk => "joint_jerk",
            Self::StartSkewUs => "start_skew_us",
            Self::MarkSkewUs => "mark_skew_us",
            Self::RelativePoseMm => "relative_pose_mm",
        }
    }

    /// Returns its unit; empty for a count or a share.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::ExecutionNs | Self::RobotExecutionNs => "ns",
            Self::PathLengthMm | Self::PathDeviationMm | Self::RelativePoseMm => "mm",
            Self::StartSkewUs | Self::MarkSkewUs => "µs",
            _ => "",
        }
    }

    /// Returns whether it is a whole number.
    #[must_use]
    pub const fn is_whole(self) -> bool {
        matches!(
            self,
            Self::ExecutionNs
                | Self::RobotExecutionNs
                | Self::BlendsSuppressed
                | Self::FramesLost
                | Self::ImagesAltered
        )
    }
}

/// Rows that a study looks for, with exactly one of `above` and `below`.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct StudyFinding {
    /// The figure; one of the rows' columns.
    pub figure: RowFigure,
    /// Rows above this value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub above: Option<f64>,
    /// Rows below this value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub below: Option<f64>,
}

/// The commented examples, each with its name.
pub const EXAMPLES: [(&str, &str); 7] = [
    ("table-2", include_str!("../../examples/table-2.toml")),
    ("approximation-zones", include_str!("../../examples/approximation-zones.toml")),
    ("buses", include_str!("../../examples/buses.toml")),
    ("fault-campaign", include_str!("../../examples/fault-campaign.toml")),
    ("stations", include_str!("../../examples/stations.toml")),
    ("identification-a", include_str!("../../examples/identification-a.toml")),
    ("identification-b", include_str!("../../examples/identification-b.toml")),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::plan::StudyPlan;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    fn the_committed_schema_of_studies_is_that_of_the_types() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../schemas/study.schema.json");
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(StudyFile)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        assert!(
            std::fs::read_to_string(path).unwrap() == schema,
            "the keys of a study changed: INSTA_UPDATE=always cargo test -p studies the_committed_schema"
        );
    }

    #[test]
    fn every_example_is_a_study_whose_first_job_can_run() {
        for (name, text) in EXAMPLES {
            let file: StudyFile = setup::read(name, text).unwrap();
            let plan = StudyPlan::of(file, None, "test".to_owned());
            let plan = plan.unwrap_or_else(|failure| panic!("{name}: {:#}", failure.error));
            let job = plan.job(0);
            assert!(job.point.made.is_ok(), "{name}: {:?}", job.point.made.as_ref().err());
        }
    }
}
