//! Verifies what the joints did: where the drives brought the arm, and how long the robot took by its own clock.

use std::time::Duration;

use robot_node::quality::RatingExceeded;
use robot_node::rehearsal::Rehearsed;
use robot_node::{Account, Quality, RobotConfig};

use super::{Difference, JOINT_TOLERANCE, largest_difference};
use records::conditions::Measured;

/// How much farther than in the rehearsal drives may bring the tool off its path, in mm.
const OFF_PATH_MM: f64 = 0.1;

/// A repetition in which the drives did not do what the controller set. Something held or slowed an axis: the program is as
/// planned, the motion is not.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum DriveDeviation {
    /// The tool left its path.
    #[error(
        "the drives brought the tool {found_mm:.3} mm off its path, and at most {most_mm:.3} mm are allowed: look for what holds an axis"
    )]
    OffPath {
        /// Largest distance, in mm.
        found_mm: f64,
        /// Allowed distance.
        most_mm: f64,
    },
    /// A joint left its path, such as one that only turns the tool.
    #[error(
        "a drive brought its joint {found_deg:.4}° (mm) off its path, and at most {most_deg:.4} are allowed: look for what holds it"
    )]
    JointOffPath {
        /// Largest distance, in degrees (mm).
        found_deg: f64,
        /// Allowed distance.
        most_deg: f64,
    },
    /// A joint stood outside of the window of the exact stop at the end.
    #[error(
        "the drive of joint {joint} stood {found_deg:.4}° (mm) from the end of the motion, and the exact stop allows {most_deg}"
    )]
    End {
        /// Its number, counted from 1.
        joint: usize,
        /// Distance, in degrees (mm).
        found_deg: f64,
        /// Window of the exact stop.
        most_deg: f64,
    },
    /// The robot waited for its drives.
    #[error(
        "the robot took {found_ms:.1} ms for its motions, and {planned_ms:.1} ms in the rehearsal: it waited for its drives"
    )]
    Late {
        /// Time by the robot's clock, in ms.
        found_ms: f64,
        /// Rehearsed time, in ms.
        planned_ms: f64,
    },
    /// A joint exceeded its rating after the drives.
    #[error("after its drive {0}")]
    Rating(RatingExceeded),
}

/// Compares what the drives did with the rehearsal.
///
/// # Errors
///
/// The first deviation.
pub(super) fn check(
    robot: &RobotConfig,
    quality: &Quality,
    account: &Account,
    alone: &Rehearsed,
) -> Result<(), DriveDeviation> {
    let (found_mm, most_mm) = (quality.drive_deviation_mm, alone.quality.drive_deviation_mm + OFF_PATH_MM);
    // A value that is not a number is not within the limits.
    let is_within = found_mm <= most_mm;
    if !is_within {
        return Err(DriveDeviation::OffPath { found_mm, most_mm });
    }
    let (found_deg, most_deg) =
        (quality.drive_deviation_deg, alone.quality.drive_deviation_deg + JOINT_TOLERANCE);
    let is_within = found_deg <= most_deg;
    if !is_within {
        return Err(DriveDeviation::JointOffPath { found_deg, most_deg });
    }
    let (joint, found_deg) = largest_difference(&account.end, &alone.account.end);
    // Each of both ends may be off by the window.
    let most_deg = 2.0 * robot.servo.in_position;
    let is_within = found_deg <= most_deg;
    if !is_within {
        return Err(DriveDeviation::End { joint: joint + 1, found_deg, most_deg });
    }
    quality.check_ratings().map_err(DriveDeviation::Rating)
}

/// Compares the robot's own time from the first motion to the end with the rehearsal.
///
/// # Errors
///
/// They differ by more than a robot cycle: by a [`DriveDeviation`] if the robot waited for its drives, by a
/// [`Difference`] if not.
pub(super) fn check_time(
    robot: &RobotConfig,
    measured: &Measured,
    account: &Account,
    planned: &Account,
) -> anyhow::Result<()> {
    let [found_ms, planned_ms] = [account, planned].map(|account| account.motion_time.as_secs_f64() * 1e3);
    let late = Err(DriveDeviation::Late { found_ms, planned_ms }.into());
    if account.waited > planned.waited + robot.cycle {
        return late;
    }
    // The rehearsal has one override, and each motion in time.
    let [low, high] = account.whole_override_percent();
    let is_comparable = low == high && measured.execution.blends_suppressed == 0;
    let off = Duration::abs_diff(account.motion_time, planned.motion_time);
    if !is_comparable || off <= robot.cycle {
        return Ok(());
    }
    if account.waited > planned.waited {
        late
    } else {
        Err(Difference::RobotTime { found_ms, planned_ms }.into())
    }
}
