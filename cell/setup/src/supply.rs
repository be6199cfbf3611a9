//! Motions that the robot controller knows ahead of the arm, and the count by which the PLC sends more.

use protocol::image::SLOTS;
use serde::{Deserialize, Serialize};

use crate::{Plc, Robot};

/// Largest number of motions that our robot controller knows ahead.
pub const MOST_QUEUE_MOTIONS: u32 = 200;

/// The count of the robot by which MoveContinuous refills the slots of the image.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Refill {
    /// A slot is free when its motion is executed: the paper's update logic.
    #[default]
    Executed,
    /// A slot is free when its motion is accepted. Only for robots that keep what they accept.
    Accepted,
}

/// The form of the slots in which the PLC sends the motions of CM.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SlotForm {
    /// Five motions, by MoveContinuous.
    #[default]
    Full,
    /// Compact points, by MoveTrajectory. Only for robots that take them, and for motions that are alike but for their targets.
    Compact,
}

/// Look-ahead of a robot controller over a program of its own.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "a number of motions, or \"whole-spline\"")]
pub enum LookAhead {
    /// This many motions.
    Motions(u32),
    /// All of a spline, as for a block of splines that is planned as one; else five motions.
    Block(SplineBlock),
}

/// A block of consecutive SPLINE motions.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SplineBlock {
    /// Up to its last motion, or as far as our controller plans ahead.
    WholeSpline,
}

impl Plc {
    /// Returns the form in which the PLC sends the motions of CM.
    #[must_use]
    pub fn sends_in_form(&self) -> SlotForm {
        self.form.unwrap_or_default()
    }
}

impl Robot {
    /// Returns how many motions of a MoveContinuousSkill the controller knows at most.
    #[must_use]
    pub fn queue_holds(&self) -> u32 {
        self.queue_motions.as_ref().map_or(SLOTS as u32, |depth| depth.value)
    }

    /// Returns whether the controller takes compact points.
    #[must_use]
    pub fn takes_compact_points(&self) -> bool {
        self.compact_points.unwrap_or_default()
    }

    /// Returns the look-ahead over a stored program.
    #[must_use]
    pub fn looks_ahead(&self) -> LookAhead {
        self.program_look_ahead.as_ref().map_or(LookAhead::Motions(SLOTS as u32), |it| it.value)
    }
}
