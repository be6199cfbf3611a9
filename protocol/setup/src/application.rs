//! What an application file says.

use serde::{Deserialize, Serialize};

/// What the robot is to do.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Application {
    /// Version of this file format: 1.
    pub schema: u32,
    /// Short name.
    pub name: String,
    /// What happens in it.
    pub title: String,
    /// Tool frame of all motions.
    pub tool: u8,
    /// Base frame of all motions.
    pub base: u8,
    /// The motions in order. The first starts where the last ends.
    pub motion: Vec<Motion>,
}

/// How a motion gets to its target.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionKind {
    /// A straight line.
    Lin,
    /// All axes together.
    Ptp,
}

/// One motion.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// What it is for.
    pub name: String,
    /// How it gets there.
    pub kind: MotionKind,
    /// x, y, z in mm; a, b, c in degrees, in the application's base frame.
    pub target_mm_deg: [f64; 6],
    /// Whether it blends into the next one by the setup's approximation distance; otherwise it stops exactly.
    pub blend: bool,
    /// Velocity as a share of the setup's programmed one, in %.
    #[serde(default = "hundred")]
    pub velocity_percent: f64,
}

const fn hundred() -> f64 {
    100.0
}
