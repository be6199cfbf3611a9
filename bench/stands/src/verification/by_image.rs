//! Verifies a repetition of a robot that is attached by its image only: its start, its end and the times of both sides. What
//! the image does not have is named, so that no check is skipped without a trace.

use plc_node::Seen;
use robot_node::arm::distance;

use super::{Difference, START_TOLERANCE_MM, Verification, compare_ends};
use records::conditions::Measured;

/// What only the robot node's own account shows.
const ONLY_OF_NODE: &str = "path, speed, override, ratings of the joints, and the motions one by one: the robot is attached by its image \
     only, `robot=HOST:PORT` in --attach verifies them of a robot node";

impl Verification {
    /// Compares what the PLC saw of the robot with the plan.
    pub(super) fn check_by_image(&mut self, measured: &Measured) -> anyhow::Result<()> {
        let execution = &measured.execution;
        let Some(Seen { start, end_pose, clock_ns }) = execution.seen else { return Ok(()) };
        let start = start.map(f64::from);
        if let Some(away_mm) = self.away_from_start(&start)
            // Not a number is not near.
            && !(0.0..=START_TOLERANCE_MM).contains(&away_mm)
        {
            return Err(Difference::Start { away_mm }.into());
        }
        let highest = execution.commanded.override_percent[1];
        let alone = self.rehearsed(execution.execution_type, &start, highest)?;
        compare_ends("by the PLC", &execution.commanded.end.map(f64::from), &alone.account.end)?;
        if has_pose(&end_pose) {
            let [found, planned] = [end_pose, alone.end_pose].map(|[x, y, z, ..]| [x, y, z].map(f64::from));
            let away_mm = distance(found, planned);
            if !(0.0..=START_TOLERANCE_MM).contains(&away_mm) {
                return Err(Difference::EndPose { away_mm, found, planned }.into());
            }
        }
        if execution.robot_execution_ns > 0 {
            self.times.check(measured, alone.account.skills)?;
        }
        if clock_ns > 0 {
            self.times.check_clock(measured, clock_ns)?;
        }
        Ok(())
    }

    /// Returns what of a repetition that passed was not verified, each with the reason.
    #[must_use]
    pub fn unverified(&self, measured: &Measured) -> Vec<String> {
        let mut unverified = Vec::new();
        if self.start_mm.is_none() {
            unverified.push("start: the application names none".to_owned());
        }
        if measured.account.is_some() {
            if measured.quality.is_none() {
                unverified.push("path and ratings of the joints: the robot did not report them".to_owned());
            }
            return unverified;
        }
        unverified.push(ONLY_OF_NODE.to_owned());
        match measured.execution.seen {
            None => unverified.push("start, end and times: the PLC is of an older version".to_owned()),
            Some(Seen { end_pose, clock_ns, .. }) => {
                if !has_pose(&end_pose) {
                    unverified.push("pose of the tool at the end: the robot's image has none".to_owned());
                }
                if measured.execution.robot_execution_ns == 0 {
                    unverified.push("the robot's time: its image has no execution time".to_owned());
                }
                if clock_ns == 0 {
                    unverified.push("the robot's clock: its image has none".to_owned());
                }
            }
        }
        unverified
    }
}

/// Returns whether a robot writes its pose into the image.
fn has_pose(pose: &[f32; 6]) -> bool {
    pose.iter().any(|value| *value != 0.0)
}
