//! Runs of a cell with several stations in virtual time.

#[cfg(test)]
mod in_step;
#[cfg(test)]
mod restarts;
#[cfg(test)]
mod tests;
mod waits;

use std::time::Duration;

use ::node::report::LatenessReport;
use ::node::role::NodeRole;
use anyhow::{Context as _, bail};
use machine::Instant;
use plc_node::{Execution, PlcEvent, PlcProgram as _, PlcReport};
use protocol::fieldbus::{Fieldbus as _, LinkEvent};
use robot_node::RobotEvent;

use super::cell::{CellEvent, CellNode, RobotId, VirtualCell};
use super::cell_capture::CellCaptures;
use super::cell_faults::{self, CellFaults};
use super::cell_laws::{BrokenLaw, CellLaws};
use super::cell_watch::CellWatch;
use super::new_cell::{NewCell, address_of, restarted_plc, restarted_robot, switch_on};
use super::nodes::{LONGEST_RUN, NeverEnded, SILENCE};
use crate::Unreported;
use crate::cell_measured::{CellHealth, CellMeasured};
use crate::cell_stand::{CellConfig, CellFinished, CellStand};
use crate::cell_verification::CellVerification;
use crate::planned_station::PlannedStation;
use crate::under_faults;
use records::cell_sample::start_skew;
use records::conditions::{Health, Interference, Measured, MotionTotals};
use records::exit::{Exit, Failure};
use records::faults::{Change, Fault};
use records::schedule::{Schedule, Step};
use records::trace::Recording;
use setup::Cell;
use virtual_time::Side;

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
    /// Laws that are watched, if somebody asked for it.
    laws: Option<CellLaws>,
    /// What makes a node once more; `None` where no fault asks for it.
    again: Option<(Vec<PlannedStation>, u64)>,
}

/// Executes a whole schedule of a planned cell, with faults, verifies each repetition and passes it to `done`.
///
/// # Errors
///
/// The stations do not connect, a repetition fails or is not that of the plan, or `done` fails. Earlier repetitions were passed on.
pub fn execute_each_of_cell(
    (cell, planned, stations): (&Cell, &planning::PlannedCell, &[PlannedStation]),
    schedule: &Schedule,
    faults: &[Fault],
    mut done: impl FnMut(Step, &CellMeasured) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let mut verification = CellVerification::new(cell, planned, stations);
    let mut run = CellRun::start_with(stations, schedule.seed, faults)?;
    for step in schedule.steps() {
        let mut measured = run.execute(step)?;
        verification.check(step.execution_type, &mut measured, run.watch.recordings())?;
        done(step, &measured)?;
    }
    Ok(())
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
            laws: None,
            again: cell_faults::restart(faults).then(|| (stations.to_vec(), seed)),
        })
    }

    /// Watches from now on that no arm goes beyond a mark before the others have come, and that no two are in one shared zone.
    pub fn watch_laws(&mut self, stations: &[PlannedStation]) {
        self.laws = Some(CellLaws::new(stations));
    }

    /// Returns the first of these laws that was broken so far.
    #[must_use]
    pub fn broken_law(&self) -> Option<&BrokenLaw> {
        self.laws.as_ref().and_then(CellLaws::broken)
    }

    /// Returns how many frames were put into a station's cable towards the robot, and towards the PLC.
    #[must_use]
    pub fn frames_sent(&self, station: usize) -> [u64; 2] {
        [Side::A, Side::B].map(|side| self.cell.link_counters(RobotId(station), side).sent)
    }

    /// Returns the time since the robots were ready first; times of faults count from there.
    #[must_use]
    pub fn since_ready(&self) -> Duration {
        self.faults.ready().map(|ready| self.cell.now().since(ready)).unwrap_or_default()
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
            self.faults.stop_at_frames(&mut self.cell);
            let now = self.cell.now();
            let check_laws = self.laws.as_ref().map(|laws| laws.next_look(now));
            let stops = [self.watch.next_look(now), check_laws, self.faults.next()];
            let event = self.cell.next_event(stops.into_iter().flatten().fold(until, Instant::min));
            self.watch.look(&self.cell);
            if let Some(laws) = &mut self.laws {
                laws.look(&self.cell);
            }
            match event {
                Some(CellEvent::Plc(report)) => {
                    if let PlcEvent::Started { at, .. } = report.event {
                        // The motion to the start is not part of the run.
                        self.moved.fill(MotionTotals::default());
                        self.watch.begin(at);
                        if let Some(laws) = &mut self.laws {
                            laws.begin(&self.cell);
                        }
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
                None => match self.faults.take_due(&self.cell) {
                    Some((station, change)) => self.change(station.unwrap_or_default(), change),
                    None if self.cell.now() >= until => return None,
                    None => {}
                },
            }
        }
    }

    fn change(&mut self, station: usize, change: Change) {
        let robot = RobotId(station);
        match change {
            Change::Cut | Change::Mend => {
                let is_cut = self.faults.count_cut(station, change == Change::Cut);
                self.cell.set_cut(robot, is_cut);
            }
            Change::Kill(NodeRole::Plc) => {
                self.faults.note_plc(true);
                self.cell.kill(CellNode::Plc);
            }
            Change::Kill(NodeRole::Robot) => self.cell.kill(CellNode::Robot(robot)),
            Change::Restart(node) => self.restart(robot, node),
            Change::Drive(axis, disturbance) => {
                self.cell.command_robot(robot, |robot, _| robot.disturb_drive(axis, disturbance));
            }
        }
    }

    /// Starts a node again that was killed: the PLC, or this robot, with the address that it had at the start. The PLC keeps
    /// its addresses.
    fn restart(&mut self, robot: RobotId, node: NodeRole) {
        let Some((stations, seed)) = &self.again else { return };
        match node {
            NodeRole::Plc => {
                let now = self.cell.local_time(CellNode::Plc);
                let Ok(plc) = restarted_plc(stations, *seed, now) else { return };
                self.faults.note_plc(false);
                self.end_laws_of_run();
                self.cell.restart_plc(plc);
            }
            NodeRole::Robot => {
                let (RobotId(number), now) = (robot, self.cell.local_time(CellNode::Robot(robot)));
                // Nobody moves the arm while its robot is off.
                let joints = self.cell.robot(robot).sample().joints;
                let machine = restarted_robot(stations, number, *seed, now, joints);
                let Some((machine, station)) = machine.zip(stations.get(number)) else { return };
                self.cell.set_address(CellNode::Robot(robot), address_of(station));
                self.cell.restart_robot(robot, machine);
            }
        }
    }

    fn end_laws_of_run(&mut self) {
        if let Some(laws) = &mut self.laws {
            laws.end();
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
        let execution_type = step.execution_type;
        let started = self.cell.command_plc(|plc, now| {
            plc.schedule_overrides(step.overrides);
            plc.start(now, execution_type)
        });
        let station = self.cell.plc().stations().iter().position(|station| !station.is_ready());
        started.with_context(|| format!("{}: cannot start the run", self.named(station)))
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
                self.end_laws_of_run();
                self.measured(all.into_iter()).map(Some)
            }
            PlcEvent::Failed(failure) => {
                self.come_to_rest();
                Err(anyhow::Error::from(failure).context(self.named(station)))
            }
            // A PLC that executes a run says so only after its end: this one is another.
            PlcEvent::Ready => {
                self.come_to_rest();
                bail!("the plc-node was started again during the run and knows nothing of it")
            }
            _ => Ok(None),
        }
    }

    /// Goes on for some time after a failure: the recording shows how the other arms come to rest.
    fn come_to_rest(&mut self) {
        self.end_laws_of_run();
        let until = self.cell.now() + COMES_TO_REST;
        while self.next_event(until).is_some() {}
        self.watch.end();
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
