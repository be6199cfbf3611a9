//! A station of a planned cell: what its robot executes, section by section, and where it waits for others.

use planning::{ProgramSection, StationZones, WaitAt, ZoneVisit};
use setup::Setup;

use crate::planned_cell::PlannedCell;

/// A station of a cell and its motions.
#[derive(Clone, Debug)]
pub struct PlannedStation {
    /// Its name in the setup.
    pub name: String,
    /// The station as a setup of its own.
    pub setup: Setup,
    /// Its robot and motions.
    pub planned: PlannedCell,
    /// Where its arm waits for others, in order.
    pub waits: Vec<WaitAt>,
    /// Visits of its arm in shared zones, in order.
    pub visits: Vec<ZoneVisit>,
    /// Volume of its arm; `None` in a cell without shared zones.
    pub zones: Option<StationZones>,
    /// What it executes between these.
    pub sections: Vec<ProgramSection>,
}

impl PlannedStation {
    /// Takes the stations of a planned cell.
    ///
    /// # Errors
    ///
    /// A setup describes no robot, or an arm does not reach its start.
    pub fn all(cell: &planning::PlannedCell) -> anyhow::Result<Vec<Self>> {
        let one = |station: &planning::PlannedStation| {
            let planning::PlannedStation { name, setup, application, plan, zones, .. } = station;
            let planned = PlannedCell::of_plan(setup, application, plan)?;
            let (name, setup) = (name.clone(), setup.clone());
            let (waits, visits, sections) = (plan.waits.clone(), plan.visits.clone(), plan.sections());
            Ok(Self { name, setup, planned, waits, visits, zones: zones.clone(), sections })
        };
        cell.stations.iter().map(one).collect()
    }
}
