//! What disturbed a run without ending it, as in results.json: cycles that a stalled node missed, images that were
//! altered.

use serde::{Deserialize, Serialize};

use crate::records::conditions::{Health, Interference};

/// Cycles that the nodes missed during one repetition.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MissedCycles {
    /// The PLC's scans.
    pub plc: u64,
    /// The robot's cycles.
    pub robot: u64,
    /// Whether one of them is more than 1 % of that node's cycles: the repetition then measures the host as well.
    pub held_up: bool,
}

/// Share of missed cycles above which a repetition measures the host as well.
const HELD_UP: f64 = 0.01;

impl MissedCycles {
    /// Returns those of a repetition.
    #[must_use]
    pub fn of(interference: &Interference) -> Self {
        let Interference { missed, runs, .. } = *interference;
        let is_held_up = |(missed, runs): (u64, u64)| missed as f64 > HELD_UP * (missed + runs) as f64;
        let held_up = missed.into_iter().zip(runs).any(is_held_up);
        Self { plc: missed[0], robot: missed[1], held_up }
    }
}

/// Received images with a wrong check, without one, or with the life counter of an old one.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Images {
    /// Images of the PLC that the robot refused, because a byte was altered.
    pub plc_altered: u64,
    /// Images of the robot that the PLC refused, because a byte was altered.
    pub robot_altered: u64,
    /// Images of the PLC without a check: an altered byte in them is not found.
    pub plc_unchecked: u64,
    /// Images of the robot without a check.
    pub robot_unchecked: u64,
    /// Images of the PLC that the robot refused, because their life counter showed that they are old.
    #[serde(default)]
    pub plc_outdated: u64,
    /// Images of the robot that the PLC refused, because their life counter showed that they are old.
    #[serde(default)]
    pub robot_outdated: u64,
}

impl Images {
    pub(super) const fn of(health: &Health) -> Self {
        let [plc, robot] = health.images;
        Self {
            plc_altered: robot.altered,
            robot_altered: plc.altered,
            plc_unchecked: robot.unchecked,
            robot_unchecked: plc.unchecked,
            plc_outdated: robot.outdated,
            robot_outdated: plc.outdated,
        }
    }
}
