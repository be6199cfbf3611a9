//! A cell of several stations. Besides the plan of each, its runs are compared with the laws of a cell, and each failure has to name its
//! station.

use super::alone::moves_drives;
use super::{ExploredRun, FaultTarget, RunEnd};
use crate::explore::fault::Extent;
use records::faults::Fault;
use records::schedule::Step;
use stands::planned_station::PlannedStation;
use stands::verification::{DriveDeviation, StationVerification};
use stands::virtual_run::CellRun;

/// The stations of a cell, their motions, and what verifies their runs.
#[derive(Clone, Debug)]
pub(in crate::explore) struct ExploredCell {
    stations: Vec<PlannedStation>,
    verifications: Vec<StationVerification>,
}

impl ExploredCell {
    pub(in crate::explore) fn new(stations: Vec<PlannedStation>) -> Self {
        let verifications = stations.iter().cloned().map(StationVerification::new).collect();
        Self { stations, verifications }
    }
}

impl FaultTarget for ExploredCell {
    fn switch_on<'r>(&'r self, seed: u64, faults: &'r [Fault]) -> anyhow::Result<Box<dyn ExploredRun + 'r>> {
        let mut run = CellRun::switch_on(&self.stations, seed, faults)?;
        run.watch_laws(&self.stations);
        Ok(Box::new(RunOfCell { of: self, run, verifications: self.verifications.clone(), faults }))
    }

    /// A restart of the PLC is at no station.
    fn is_located(&self, reason: &str) -> bool {
        let names_station = |it: &PlannedStation| reason.contains(&format!("station {}", it.name));
        self.stations.iter().any(names_station) || reason.contains("the plc-node was started again")
    }
}

struct RunOfCell<'r> {
    of: &'r ExploredCell,
    run: CellRun,
    verifications: Vec<StationVerification>,
    faults: &'r [Fault],
}

impl ExploredRun for RunOfCell<'_> {
    fn connect(&mut self) -> anyhow::Result<()> {
        self.run.connect()
    }

    fn execute(&mut self, step: Step) -> RunEnd {
        let measured = match self.run.execute(step) {
            Ok(measured) => measured,
            Err(reason) => return RunEnd::failed(reason),
        };
        let mut stations = self.verifications.iter_mut().zip(&measured.stations);
        match stations.try_for_each(|(verification, of_station)| verification.check(of_station)) {
            Ok(()) => RunEnd::Passed(measured.sample.execution.as_nanos().try_into().unwrap_or(u64::MAX)),
            Err(deviation) if deviation.is::<DriveDeviation>() && moves_drives(self.faults) => {
                RunEnd::OffPath(deviation)
            }
            Err(difference) => RunEnd::Altered(difference),
        }
    }

    fn recover(&mut self) -> anyhow::Result<()> {
        self.run.recover()
    }

    fn extents(&self) -> Vec<Extent> {
        let run_us = self.run.since_ready().as_micros().try_into().unwrap_or(u64::MAX);
        let extent = |(index, station): (usize, &PlannedStation)| Extent {
            frames: self.run.frames_sent(index),
            run_us,
            axes: station.planned.robot.arm.axes() as u64,
            has_drives: station.planned.robot.drives.is_some(),
        };
        self.of.stations.iter().enumerate().map(extent).collect()
    }

    fn broken_law(&self) -> Option<String> {
        self.run.broken_law().map(ToString::to_string)
    }

    fn rehearsed(&self) -> Box<dyn FaultTarget> {
        Box::new(ExploredCell { verifications: self.verifications.clone(), ..self.of.clone() })
    }
}
