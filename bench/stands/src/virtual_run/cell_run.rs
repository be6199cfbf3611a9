//! Runs of a cell with several stations in virtual time.

#[cfg(test)]
mod in_step;
#[cfg(test)]
mod tests;
mod waits;

use std::time::Duration;

use ::node::report::LatenessReport;
use anyhow::Context as _;
use machine::Instant;
use plc_node::{Execution, PlcEvent, PlcProgram as _, PlcReport};
use protocol::fieldbus::{Fieldbus as _, LinkEvent};
use robot_node::RobotEvent;

use super::cell::{CellEvent, CellNode, RobotId, VirtualCell};
use super::cell_capture::CellCaptures;
use super::cell_faults::{self, CellFaults};
use super::cell_watch::CellWatch;
use super::new_cell::{NewCell, switch_on};
use super::nodes::{LONGEST_RUN, NeverEnded, SILENCE};
use crate::Unreported;
use crate::cell_measured::{CellHealth, CellMeasured};
use crate::cell_stand::{CellConfig, CellFinished, CellStand};
use crate::planned_station::PlannedStation;
use crate::under_faults;
use records::cell_sample::start_skew;
use records::conditions::{Health, Interference, Measured, MotionTotals};
use records::exit::{Exit, Failure};
use records::faults::Fault;
use records::schedule::Step;
use records::trace::Recording;

/// Time that is recorded after a failure: far longer than an arm needs to brake.
const COMES_TO_REST: Duration = Duration::from_secs(2);

/// The nodes of a cell in virtual time.
pub struct CellRun {
    cell: VirtualCell,
    names: Vec<String>,
    watch: CellWatch,
    /// Each robot's reports on the current run, or on the last one.
    moved: Vec<MotionTotals>,
    /// The PLC's report of each station in it.
    finished: Vec<Option<Execution>>,
    faults: CellFaults,
    captures: CellCaptures,
}

impl CellStand for CellRun {
    async fn start(config: &CellConfig<'_>) -> Result<Self, Failure> {
        Self::start_captured(config).map_err(|error| match config.faults {
            // In virtual time nothing but the setup keeps the stations from connecting.
            [] => Failure::new(Exit::Usage, error),
            faults => under_faults(error, faults),
        })
    }

    async fn execute(&mut self, step: Step) -> anyhow::Result<CellMeasured> {
        Self::execute(self, step)
    }

    fn health(&self) -> CellHealth {
        Self::health(self)
    }

    fn recordings(&self) -> &[Recording] {
        self.watch.recordings()
    }

    async fn finish(self, keeps_capture: bool) -> CellFinished {
        let captured = self.captures.finish(keeps_capture);
        CellFinished { trace: Ok(None), health: captured.map(|()| None).map_err(Failure::from) }
    }
}

impl CellRun {
    /// Switches on the nodes of a cell, and waits until they are connected and every robot is ready.
    ///
    /// # Errors
    ///
    /// The setup gives no bus endpoint, or a robot does not get ready.
    pub fn start(stations: &[PlannedStation], seed: u64) -> anyhow::Result<Self> {
        Self::start_with(stations, seed, &[])
    }

    /// Does the same with faults, which name their stations.
    ///
    /// # Errors
    ///
    /// The same.
    pub fn start_with(stations: &[PlannedStation], seed: u64, faults: &[Fault]) -> anyhow::Result<Self> {
        let mut run = Self::switch_on(stations, seed, faults)?;
        run.connect()?;
        Ok(run)
    }

    /// Switches on the nodes of a cell, with captures of each station's cable if requested, and connects them.
    fn start_captured(config: &CellConfig<'_>) -> anyhow::Result<Self> {
        let CellConfig { stations, seed, directory, capture, faults, .. } = *config;
        let mut run = Self::switch_on(stations, seed, faults)?;
        if let Some(keep) = capture {
            let of_station = |station: &PlannedStation| cell_faults::of_station(&station.name, faults);
            let faults: Vec<_> = stations.iter().map(of_station).collect();
            run.captures = CellCaptures::start((directory, keep), stations, &faults, &mut run.cell)?;
        }
        if let Err(error) = run.connect() {
            // Captures matter most when a run failed.
            run.captures.finish(true)?;
            return Err(error);
        }
        Ok(run)
    }

    /// Switches on the nodes of a cell with these faults; [`connect`](Self::connect) follows.
    ///
    /// # Errors
    ///
    /// The setup gives no bus endpoint.
    pub fn switch_on(stations: &[PlannedStation], seed: u64, faults: &[Fault]) -> anyhow::Result<Self> {
        let NewCell { cell, clocks } = switch_on(stations, seed, faults)?;
        let cycles_us = stations
            .iter()
            .flat_map(|station| [&station.setup.robot.cycle_us, &station.setup.plc.scan_cycle_us])
            .map(|cycle| u64::from(cycle.value));
        let shortest = Duration::from_micros(cycles_us.min().unwrap_or(1_000));
        Ok(Self {
            cell,
            names: stations.iter().map(|station| station.name.clone()).collect(),
            watch: CellWatch::new(clocks, shortest),
            moved: vec![MotionTotals::default(); stations.len()],
            finished: vec![None; stations.len()],
            faults: CellFaults::of(stations, faults),
            captures: CellCaptures::default(),
        })
    }

    /// Returns the time for which the cell has been on.
    #[must_use]
    pub const fn plant_time(&self) -> Duration {
        self.cell.now().since(Instant::ZERO)
    }

    fn named(&self, station: Option<usize>) -> String {
        let name = station.and_then(|station| self.names.get(station));
        name.map_or_else(|| "the cell".to_owned(), |name| format!("station {name}"))
    }

    /// Returns the PLC's next event up to `until` in true time.
    fn next_event(&mut self, until: Instant) -> Option<PlcReport> {
        loop {
            let look = self.watch.next_look(self.cell.now());
            let stop = [look, self.faults.next()].into_iter().flatten().fold(until, Instant::min);
            let event = self.cell.next_event(stop);
            self.watch.look(&self.cell);
            match event {
                Some(CellEvent::Plc(report)) => {
                    if let PlcEvent::Started { at, .. } = report.event {
                        // The motion to the start is not part of the run.
                        self.moved.fill(MotionTotals::default());
                        self.watch.begin(at);
                    }
                    return Some(report);
                }
                Some(CellEvent::Robot(id, RobotEvent::Link(LinkEvent::SetAddress { address, .. }))) => {
                    self.cell.set_address(CellNode::Robot(id), Some(address));
                    self.cell.command_robot(id, |robot, now| robot.bus_mut().address_set(now, true));
                }
                Some(CellEvent::Robot(
                    RobotId(number),
                    RobotEvent::SkillFinished { executed, quality, account, .. },
                )) => {
                    if let Some(moved) = self.moved.get_mut(number) {
                        moved.add(executed, quality, account);
                    }
                }
                Some(CellEvent::Robot(..)) => {}
                None => {
                    let is_change = self.faults.apply(&mut self.cell);
                    if !is_change && self.cell.now() >= until {
                        return None;
                    }
                }
            }
        }
    }

    /// Executes one step of a schedule.
    ///
    /// # Errors
    ///
    /// It failed; the error names the station.
    pub fn execute(&mut self, step: Step) -> anyhow::Result<CellMeasured> {
        self.begin(&step)?;
        let longest = self.cell.now() + LONGEST_RUN;
        while self.cell.now() < longest {
            let scans = self.cell.plc().scans();
            match self.next_event(self.cell.now() + SILENCE) {
                Some(report) => {
                    if let Some(measured) = self.take(report)? {
                        return Ok(measured);
                    }
                }
                None => self.check_scans(scans)?,
            }
        }
        Err(NeverEnded::TooLong.into())
    }

    /// Waits until the arms are where the run starts, and for the pause, and starts the run.
    fn begin(&mut self, step: &Step) -> anyhow::Result<()> {
        self.until_at_start()?;
        let start = self.cell.now() + step.pause;
        while self.next_event(start).is_some() {}
        self.finished.fill(None);
        self.cell.command_plc(|plc, now| plc.start(now, step.execution_type)).context("cannot start the run")
    }

    /// Takes an event of the PLC in a run; returns what the run was if it ends it.
    fn take(&mut self, PlcReport { station, event }: PlcReport) -> anyhow::Result<Option<CellMeasured>> {
        match event {
            PlcEvent::Finished(execution) => {
                if let Some(place) = station.and_then(|station| self.finished.get_mut(station)) {
                    *place = Some(execution);
                }
                let all: Option<Vec<_>> = self.finished.iter().copied().collect();
                let Some(all) = all else { return Ok(None) };
                self.watch.end();
                self.measured(all.into_iter()).map(Some)
            }
            PlcEvent::Failed(failure) => {
                // The recording shows how the other arms come to rest.
                let until = self.cell.now() + COMES_TO_REST;
                while self.next_event(until).is_some() {}
                self.watch.end();
                Err(anyhow::Error::from(failure).context(self.named(station)))
            }
            _ => Ok(None),
        }
    }

    fn measured(&self, executions: impl Iterator<Item = Execution>) -> anyhow::Result<CellMeasured> {
        let mut stations = Vec::with_capacity(self.names.len());
        for (index, (execution, moved)) in executions.zip(&self.moved).enumerate() {
            let Some(of_run) = moved.of(execution.motions) else {
                let unreported = Unreported { executed: execution.motions, reported: moved.motions };
                return Err(anyhow::Error::from(unreported).context(self.named(Some(index))));
            };
            let measured = Measured {
                execution,
                quality: Some(of_run.quality),
                account: Some(of_run.account),
                interference: Interference::default(),
            };
            stations.push((measured, self.cell.plc().program().passages(index)));
        }
        let start_skew = start_skew(self.watch.recordings());
        Ok(CellMeasured::of(stations, start_skew, |at| self.watch.true_time_of_plc(at)))
    }

    /// Returns the conditions of the run so far, at each station.
    #[must_use]
    pub fn health(&self) -> CellHealth {
        let plc = self.cell.plc();
        let station = |number: usize| {
            let robot = self.cell.robot(RobotId(number));
            Health {
                plc: (&LatenessReport::from(plc.lateness())).into(),
                robot: (&LatenessReport::from(robot.lateness())).into(),
                bus: plc.counters_of(number),
                robot_bus: robot.bus().counters(),
                ..Health::default()
            }
        };
        CellHealth {
            stations: (0..self.names.len()).map(station).collect(),
            faults: self.faults.report(&self.cell),
            ..CellHealth::default()
        }
    }
}
