//! Verifies a repetition of a cell at each station, and measures the arms' relative pose in it.

use plc_node::ExecutionType;
use setup::Cell;

use crate::cell_measured::CellMeasured;
use crate::planned_station::PlannedStation;
use crate::relative_pose::RelativePose;
use crate::verification::StationVerification;
use records::trace::Recording;

/// The plans with which every repetition of a cell is compared.
#[derive(Clone, Debug)]
pub struct CellVerification {
    stations: Vec<StationVerification>,
    relative_pose: RelativePose,
}

impl CellVerification {
    /// Prepares the verification of a planned cell.
    #[must_use]
    pub fn new(cell: &Cell, planned: &planning::PlannedCell, stations: &[PlannedStation]) -> Self {
        Self {
            relative_pose: RelativePose::new(cell, &planned.marks, stations),
            stations: stations.iter().cloned().map(StationVerification::new).collect(),
        }
    }

    /// Compares a repetition with the plan of each station, and sets the relative pose in its sample if it was recorded.
    ///
    /// # Errors
    ///
    /// The first difference, with the station's name.
    pub fn check(
        &mut self,
        execution_type: ExecutionType,
        measured: &mut CellMeasured,
        recordings: &[Recording],
    ) -> anyhow::Result<()> {
        for (verification, of_station) in self.stations.iter_mut().zip(&measured.stations) {
            verification.check(of_station)?;
        }
        if !recordings.is_empty() {
            measured.sample.relative_pose_mm = self.relative_pose(execution_type, recordings)?;
        }
        Ok(())
    }

    /// Returns the largest difference of the arms' relative pose from the plan, in mm, as [`RelativePose::of`] does.
    ///
    /// # Errors
    ///
    /// The same.
    pub fn relative_pose(
        &mut self,
        execution_type: ExecutionType,
        recordings: &[Recording],
    ) -> anyhow::Result<Option<f64>> {
        self.relative_pose.of(execution_type, recordings)
    }
}
