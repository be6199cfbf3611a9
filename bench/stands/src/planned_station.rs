//! A station of a planned cell: what its robot executes, section by section, and where it waits for others.

use planning::{ProgramSection, StationZones, WaitAt, ZoneVisit};
use plc_node::ArmInStep;
use setup::Setup;

use crate::planned_cell::PlannedCell;

/// A station of a cell and its motions.
#[derive(Clone, Debug)]
pub struct PlannedStation {
    /// Its name in the setup.
    pub name: String,
    /// The station as a setup of its own.
    pub setup: Setup,
    /// Its place in an EtherCAT line, if its setup gives one.
    pub position: Option<u16>,
    /// Its robot and motions.
    pub planned: PlannedCell,
    /// Where its arm waits for others, in order.
    pub waits: Vec<WaitAt>,
    /// Visits of its arm in shared zones, in order.
    pub visits: Vec<ZoneVisit>,
    /// Volume of its arm; `None` in a cell without shared zones.
    pub zones: Option<StationZones>,
    /// Programs that its robot stores for RC.
    pub programs: Vec<ProgramSection>,
    /// What it executes between these.
    pub sections: Vec<ProgramSection>,
    /// Properties by which the PLC has its arm start and move together with others; `None` where
    /// each arm is on its own.
    pub in_step: Option<ArmInStep>,
}

impl PlannedStation {
    /// Takes the stations of a planned cell.
    ///
    /// # Errors
    ///
    /// A setup describes no robot, or an arm does not reach its start or does not execute its motions.
    pub fn all(cell: &planning::PlannedCell) -> anyhow::Result<Vec<Self>> {
        let arms = ArmInStep::all(cell)?;
        let one = |(station, in_step): (&planning::PlannedStation, ArmInStep)| {
            let planning::PlannedStation { name, setup, position, application, plan, zones, .. } = station;
            Ok(Self {
                name: name.clone(),
                setup: setup.clone(),
                position: *position,
                planned: PlannedCell::of_plan(setup, application, plan)?,
                waits: plan.waits.clone(),
                visits: plan.visits.clone(),
                zones: zones.clone(),
                programs: plan.sections(),
                sections: plan.sections_between_rests(),
                in_step: Some(in_step),
            })
        };
        cell.stations.iter().zip(arms).map(one).collect()
    }
}
