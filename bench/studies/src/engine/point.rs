//! A point of a study's grid: the setup with its values, and the plan of its applications.

use planning::FoundCell;
use records::faults::Fault;
use setup::{Cell, Setup};
use sha2::Sha256;
use stands::planned_cell::PlannedCell;
use stands::planned_station::PlannedStation;

use super::file::Scalar;
use super::job::JobSubject;

/// Point of the grid, which the jobs of all seeds share.
pub struct GridPoint {
    pub(super) number: u128,
    /// The seed of drawn values; `None` where nothing is drawn.
    pub(super) seed: Option<u64>,
    /// Value of each varied key.
    pub values: Vec<Scalar>,
    /// Setup and plan, or the reason for the refusal.
    pub made: Result<MadePoint, String>,
    pub(super) digest: Sha256,
}

/// Setup and plan of a point.
pub struct MadePoint {
    /// The setup with the point's values.
    pub cell: Cell,
    /// The application of each station.
    pub application: FoundCell,
    /// Faults.
    pub faults: Vec<Fault>,
    plan: PointPlan,
}

enum PointPlan {
    /// One robot, with its setup.
    Robot(Box<(Setup, PlannedCell)>),
    /// Several stations.
    Cell(planning::PlannedCell, Vec<PlannedStation>),
}

impl MadePoint {
    /// Plans the applications on the setup.
    ///
    /// # Errors
    ///
    /// They cannot be planned, or an arm does not reach its start; the error is the reason in words.
    pub(super) fn new(cell: Cell, application: FoundCell, faults: Vec<Fault>) -> Result<Self, String> {
        let plan = match (cell.stations.as_slice(), application.stations.as_slice()) {
            ([station], [found]) if cell.is_one() => {
                let setup = cell.setup_of(station);
                let plan = found.plan(&setup).map_err(|error| error.to_string())?;
                let planned = PlannedCell::of_plan(&setup, &found.application, &plan);
                PointPlan::Robot(Box::new((setup, planned.map_err(|error| format!("{error:#}"))?)))
            }
            _ => {
                let planned = application.plan(&cell).map_err(|error| error.to_string())?;
                let stations = PlannedStation::all(&planned).map_err(|error| format!("{error:#}"))?;
                PointPlan::Cell(planned, stations)
            }
        };
        Ok(Self { cell, application, faults, plan })
    }

    /// Returns the subject of its jobs.
    #[must_use]
    pub(super) fn subject(&self) -> JobSubject<'_> {
        match &self.plan {
            PointPlan::Robot(planned) => JobSubject::Robot { setup: &planned.0, planned: &planned.1 },
            PointPlan::Cell(planned, stations) => JobSubject::Cell { cell: &self.cell, planned, stations },
        }
    }
}
