//! The marks of a cell's plan, in its results.

use planning::{PlannedStation, WaitAt};
use robot_node::arm::Frame;
use serde::{Deserialize, Serialize};

/// A mark at which arms wait for each other.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CellMark {
    /// Its number.
    pub number: u32,
    /// Event at the mark.
    pub name: String,
    /// Set if its arms move together from here to their next mark.
    pub together: bool,
}

/// Where an arm waits for others.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CellWait {
    /// Number of the mark.
    pub mark: u32,
    /// Motions that the arm has executed there.
    pub after: usize,
    /// Where the tool is there by the plan, in the root of the arm: x, y, z in mm; a, b, c in degrees about z, y', x''. Null after a motion
    /// to joints, and where the arm starts.
    #[serde(default)]
    pub tool_mm_deg: Option<[f64; 6]>,
}

/// Returns where a station waits.
pub(crate) fn waits(station: &PlannedStation) -> Vec<CellWait> {
    let tool_at = |after: usize| {
        let motion = station.plan.motions.get(after.checked_sub(1)?)?;
        if motion.joints_deg.is_some() {
            return None;
        }
        let base = station.setup.robot.bases.iter().find(|base| base.number == motion.base);
        let base = base.map_or(Frame::IDENTITY, |base| Frame::from_mm_deg(base.mm_deg.value));
        Some((base * Frame::from_mm_deg(motion.target.mm_deg())).to_mm_deg())
    };
    let wait =
        |wait: &WaitAt| CellWait { mark: wait.mark, after: wait.after, tool_mm_deg: tool_at(wait.after) };
    station.plan.waits.iter().map(wait).collect()
}
