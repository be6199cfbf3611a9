//! The value of a row's figure in a repetition of one robot, or of a cell with several stations.

use std::time::Duration;

use records::conditions::Measured;
use robot_node::Quality;
use stands::cell_measured::CellMeasured;

use super::file::RowFigure;

/// Returns a figure of one robot; not a number for one that only several stations have.
pub(super) fn of_robot(figure: RowFigure, measured: &Measured) -> f64 {
    let quality = measured.quality.unwrap_or_default();
    match figure {
        RowFigure::ExecutionNs => measured.execution.execution_time_ns as f64,
        RowFigure::RobotExecutionNs => measured.execution.robot_execution_ns as f64,
        RowFigure::BlendsSuppressed => measured.execution.blends_suppressed.into(),
        RowFigure::FramesLost => measured.interference.lost as f64,
        RowFigure::ImagesAltered => measured.interference.altered.iter().sum::<u64>() as f64,
        RowFigure::PathLengthMm => quality.path_length_mm,
        RowFigure::PathDeviationMm => quality.path_deviation_mm,
        RowFigure::JointSpeed => quality.joint_speed.peak,
        RowFigure::JointAcceleration => quality.joint_acceleration.peak,
        RowFigure::JointJerk => quality.joint_jerk.peak,
        RowFigure::StartSkewUs | RowFigure::MarkSkewUs | RowFigure::RelativePoseMm => f64::NAN,
    }
}

/// Returns a figure of a cell: counts and lengths of all arms together, and the largest of the rest. Not a number where it was not
/// measured.
pub(super) fn of_cell(figure: RowFigure, measured: &CellMeasured) -> f64 {
    let CellMeasured { sample, stations } = measured;
    let nanos = |time: Duration| time.as_nanos() as f64;
    let micros = |time: Option<Duration>| time.map_or(f64::NAN, |time| nanos(time) / 1e3);
    let qualities = || stations.iter().map(|station| station.quality.unwrap_or_default());
    let largest = |of: fn(Quality) -> f64| qualities().map(of).fold(0.0, f64::max);
    match figure {
        RowFigure::ExecutionNs => nanos(sample.execution),
        RowFigure::RobotExecutionNs => {
            let longest = sample.stations.iter().map(|station| station.robot_execution).max();
            nanos(longest.unwrap_or_default())
        }
        RowFigure::BlendsSuppressed => {
            sample.stations.iter().map(|station| f64::from(station.blends_suppressed)).sum()
        }
        RowFigure::FramesLost | RowFigure::ImagesAltered => f64::NAN,
        RowFigure::PathLengthMm => qualities().map(|quality| quality.path_length_mm).sum(),
        RowFigure::PathDeviationMm => largest(|quality| quality.path_deviation_mm),
        RowFigure::JointSpeed => largest(|quality| quality.joint_speed.peak),
        RowFigure::JointAcceleration => largest(|quality| quality.joint_acceleration.peak),
        RowFigure::JointJerk => largest(|quality| quality.joint_jerk.peak),
        RowFigure::StartSkewUs => micros(sample.start_skew),
        RowFigure::MarkSkewUs => micros(sample.worst_mark_skew()),
        RowFigure::RelativePoseMm => sample.relative_pose_mm.unwrap_or(f64::NAN),
    }
}
