//! Cyclic frames between the PLC and a robot, in the results.

use serde::{Deserialize, Serialize};

use crate::conditions::Health;

/// Cyclic frames counted by the PLC.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Frames {
    /// Sent to the robot.
    pub frames_sent: u64,
    /// Received from the robot and accepted.
    pub frames_received: u64,
    /// Cycles in which either node sent nothing because its host stalled it.
    pub skipped: u64,
    /// Sent by either node and never received.
    pub lost: u64,
    /// Well-formed frames of another connection that either node received and ignored.
    #[serde(default)]
    pub foreign: u64,
}

impl Frames {
    /// Returns the frames between the PLC and a robot.
    #[must_use]
    pub const fn of(health: &Health) -> Self {
        Self {
            frames_sent: health.bus.sent,
            frames_received: health.bus.received,
            skipped: health.bus.skipped + health.robot_bus.skipped,
            lost: health.frames_lost(),
            foreign: health.bus.foreign + health.robot_bus.foreign,
        }
    }
}
