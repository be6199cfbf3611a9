//! Runs of a cell with several stations in virtual time.

use std::path::PathBuf;
use std::time::Duration;

use ::node::report::LatenessReport;
use anyhow::Context as _;
use capture_file::Retention;
use machine::Instant;
use plc_node::{Execution, MarkPassage, PlcEvent, PlcReport};
use protocol::fieldbus::{Fieldbus as _, LinkEvent};
use robot_node::RobotEvent;

use super::cell::{CellEvent, CellNode, RobotId, VirtualCell};
use super::cell_capture::CellCaptures;
use super::cell_watch::CellWatch;
use super::new_cell::{NewCell, switch_on};
use super::nodes::{CONNECT, LONGEST_RUN, NeverEnded};
use crate::Unreported;
use crate::planned_station::PlannedStation;
use records::cell_sample::{CellSample, StationSample, start_skew};
use records::conditions::{Health, Interference, Measured, MotionTotals};
use records::not_ready::NotReady;
use records::schedule::Step;
use records::trace::Recording;

/// A finished run of a cell.
#[derive(Clone, Debug)]
pub struct CellMeasured {
    /// What is saved of it.
    pub sample: CellSample,
    /// The PLC's report and the robot's of each station, in the order of the setup.
    pub stations: Vec<Measured>,
}

/// Returns how long an arm stood at marks.
fn waited(passages: &[MarkPassage]) -> Duration {
    passages.iter().filter_map(|it| Some(it.passed?.since(it.came))).sum()
}

/// The nodes of a cell in virtual time.
pub struct CellRun {
    cell: VirtualCell,
    names: Vec<String>,
    watch: CellWatch,
    /// What each robot reported of the current run, or of the last one.
    moved: Vec<MotionTotals>,
    kill: Option<(usize, Instant)>,
    captures: CellCaptures,
}

impl CellRun {
    /// Switches on the nodes of a cell, and waits until they are connected and every robot is ready.
    ///
    /// # Errors
    ///
    /// The setup gives no bus endpoint, or a robot does not get ready.
    pub fn start(stations: &[PlannedStation], seed: u64) -> anyhow::Result<Self> {
        Self::start_captured(stations, seed, None)
    }

    /// Starts a cell like [`start`](Self::start), with captures of each station's cable in a directory.
    ///
    /// # Errors
    ///
    /// The same as for [`start`](Self::start), or a capture cannot be created.
    pub fn start_captured(
        stations: &[PlannedStation],
        seed: u64,
        capture: Option<(PathBuf, Retention)>,
    ) -> anyhow::Result<Self> {
        let NewCell { mut cell, clocks } = switch_on(stations, seed)?;
        let captures =
            capture.map(|capture| CellCaptures::start(&capture, stations, &mut cell)).transpose()?;
        let cycles_us = stations
            .iter()
            .flat_map(|station| [&station.setup.robot.cycle_us, &station.setup.plc.scan_cycle_us])
            .map(|cycle| u64::from(cycle.value));
        let shortest = Duration::from_micros(cycles_us.min().unwrap_or(1_000));
        let mut run = Self {
            cell,
            names: stations.iter().map(|station| station.name.clone()).collect(),
            watch: CellWatch::new(clocks, shortest),
            moved: vec![MotionTotals::default(); stations.len()],
            kill: None,
            captures: captures.unwrap_or_default(),
        };
        if let Err(error) = run.connect() {
            // Captures matter most when a run failed.
            run.end_capture(true)?;
            return Err(error);
        }
        Ok(run)
    }

    /// Ends the captures, if any. Captures held in memory are written only if `wanted`.
    ///
    /// # Errors
    ///
    /// They could not be written.
    pub fn end_capture(&self, wanted: bool) -> anyhow::Result<()> {
        self.captures.finish(wanted)
    }

    /// Kills a robot once this much of true time has passed: it neither receives nor sends any more.
    pub fn kill_robot_after(&mut self, station: usize, time: Duration) {
        self.kill = Some((station, self.cell.now() + time));
    }

    fn named(&self, station: Option<usize>) -> String {
        let name = station.and_then(|station| self.names.get(station));
        name.map_or_else(|| "the cell".to_owned(), |name| format!("station {name}"))
    }

    fn connect(&mut self) -> anyhow::Result<()> {
        let until = self.cell.now() + CONNECT;
        let mut waiting = None;
        while let Some(PlcReport { station, event }) = self.next_event(until) {
            match event {
                PlcEvent::Waiting { for_what, seconds } => {
                    let why = NotReady::Waiting { seconds, for_what: for_what.to_string() };
                    waiting = Some((station, why));
                }
                PlcEvent::Ready => return Ok(()),
                PlcEvent::Link(LinkEvent::Down(down)) => {
                    let mut words = String::new();
                    let explained = self.cell.plc().explain(station.unwrap_or_default(), &mut words);
                    if explained.is_err() || words.is_empty() {
                        words = down.to_string();
                    }
                    return Err(NotReady::NotConnected(words)).context(self.named(station));
                }
                _ => {}
            }
        }
        let silent = self.cell.plc().stations().iter().position(|station| !station.is_ready());
        let (station, why) = waiting.unwrap_or((silent, NotReady::Late(CONNECT)));
        Err(why).context(self.named(station))
    }

    /// Returns the PLC's next event up to `until` in true time.
    fn next_event(&mut self, until: Instant) -> Option<PlcReport> {
        loop {
            let look = self.watch.next_look(self.cell.now());
            let kill = self.kill.map(|(_, at)| at);
            let stop = [look, kill].into_iter().flatten().fold(until, Instant::min);
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
                    if let Some((station, _)) = self.kill.take_if(|(_, at)| *at <= self.cell.now()) {
                        self.cell.kill(CellNode::Robot(RobotId(station)));
                    } else if self.cell.now() >= until {
                        return None;
                    }
                }
            }
        }
    }

    /// Returns the recording of each station in the last run, in the order of the setup.
    #[must_use]
    pub fn recordings(&self) -> &[Recording] {
        self.watch.recordings()
    }

    /// Executes one step of a schedule.
    ///
    /// # Errors
    ///
    /// It failed; the error names the station.
    pub fn execute(&mut self, step: Step) -> anyhow::Result<CellMeasured> {
        self.execute_watched(step, |_| {})
    }

    /// Executes one step of a schedule like [`execute`](Self::execute), and has `look` look at the cell in each half robot cycle.
    ///
    /// # Errors
    ///
    /// It failed; the error names the station.
    pub fn execute_watched(
        &mut self,
        step: Step,
        mut look: impl FnMut(&Self),
    ) -> anyhow::Result<CellMeasured> {
        let until = self.cell.now() + CONNECT;
        while !self.cell.plc().is_ready() {
            if self.next_event(until).is_none() {
                return Err(NotReady::Late(CONNECT).into());
            }
        }
        let start = self.cell.now() + step.pause;
        while self.next_event(start).is_some() {}
        self.cell
            .command_plc(|plc, now| plc.start(now, step.execution_type))
            .context("cannot start the run")?;
        let longest = self.cell.now() + LONGEST_RUN;
        let mut finished: Vec<Option<Execution>> = vec![None; self.names.len()];
        while self.cell.now() < longest {
            let report = self.next_event(longest.min(self.cell.now() + self.watch.interval()));
            look(self);
            let Some(PlcReport { station, event }) = report else { continue };
            match event {
                PlcEvent::Finished(execution) => {
                    if let Some(place) = station.and_then(|station| finished.get_mut(station)) {
                        *place = Some(execution);
                    }
                    if finished.iter().all(Option::is_some) {
                        self.watch.end();
                        return self.measured(finished.into_iter().flatten());
                    }
                }
                PlcEvent::Failed(failure) => {
                    self.watch.end();
                    return Err(anyhow::Error::from(failure).context(self.named(station)));
                }
                _ => {}
            }
        }
        Err(NeverEnded::TooLong.into())
    }

    fn measured(&self, executions: impl Iterator<Item = Execution>) -> anyhow::Result<CellMeasured> {
        let (mut stations, mut samples) = (Vec::new(), Vec::new());
        let true_ns = |at: Instant| Duration::from_nanos(self.watch.true_time_of_plc(at).as_nanos());
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
            let passages = self.cell.plc().program().passages(index);
            samples.push(StationSample {
                robot_execution: Duration::from_nanos(measured.execution.robot_execution_ns),
                blends_suppressed: measured.execution.blends_suppressed,
                waited: waited(passages),
                came: passages.iter().map(|it| (it.mark, true_ns(it.came))).collect(),
            });
            stations.push(measured);
        }
        let execution_ns = stations.first().map_or(0, |first| first.execution.execution_time_ns);
        let sample = CellSample {
            execution: Duration::from_nanos(execution_ns),
            start_skew: start_skew(self.watch.recordings()),
            relative_pose_mm: None,
            stations: samples,
        };
        Ok(CellMeasured { sample, stations })
    }

    /// Returns how many motions a station's robot has put on its path in its current skill, and how many are executed in the
    /// run by the PLC's count.
    #[must_use]
    pub fn progress(&self, station: usize) -> (u32, u32) {
        use plc_node::PlcProgram as _;
        let accepted = self.cell.robot(RobotId(station)).sample().accepted;
        (accepted, self.cell.plc().program().totals(station).executed)
    }

    /// Returns the tool's speed along the path of a station, in mm/s.
    #[must_use]
    pub fn path_speed_mm_s(&self, station: usize) -> f32 {
        self.cell.robot(RobotId(station)).sample().path_speed_mm_s
    }

    /// Returns the conditions of the run so far, at each station.
    #[must_use]
    pub fn health(&self) -> Vec<Health> {
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
        (0..self.names.len()).map(station).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plc_node::ExecutionType;

    /// Half cycles within which a robot has reported the end of a motion, and the PLC has seen it.
    const SETTLED: u32 = 10;

    fn start(name: &str) -> (Vec<PlannedStation>, CellRun) {
        let (cell, found) = planning::cell_with_applications(name).unwrap();
        let stations = PlannedStation::all(&found.plan(&cell).unwrap()).unwrap();
        let run = CellRun::start(&stations, 1).unwrap();
        (stations, run)
    }

    fn step(execution_type: ExecutionType) -> Step {
        Step { execution_type, repetition: 1, pause: records::schedule::PAUSE, overrides: None }
    }

    #[test]
    fn an_arm_that_is_killed_in_a_run_fails_it_and_the_error_names_its_station() {
        for (killed, name) in ["station left", "station right"].into_iter().enumerate() {
            for execution_type in ExecutionType::ALL {
                let (_, mut run) = start("E");
                run.kill_robot_after(killed, Duration::from_millis(700));
                let error = format!("{:#}", run.execute(step(execution_type)).unwrap_err());
                assert!(error.starts_with(name), "{execution_type}: {error}");
            }
        }
    }

    #[test]
    fn no_arm_moves_beyond_a_mark_before_the_other_has_come_to_it() {
        for cell in ["E", "F"] {
            let (stations, mut run) = start(cell);
            for execution_type in ExecutionType::ALL {
                let (mut moving_beyond, mut moving, mut last) =
                    (0, vec![0; stations.len()], vec![0; stations.len()]);
                run.execute_watched(step(execution_type), |run| {
                    for (one, station) in stations.iter().enumerate() {
                        // The robot moves, and the PLC has seen it come to the end of the section.
                        let (_, executed) = run.progress(one);
                        // The last cycle of a motion still has a speed.
                        let is_moving = run.path_speed_mm_s(one) > 0.0 && executed == last[one];
                        moving[one] = if is_moving { moving[one] + 1 } else { 0 };
                        last[one] = executed;
                        for wait in &station.waits {
                            let is_beyond = executed as usize > wait.after
                                || executed as usize == wait.after && moving[one] > SETTLED;
                            if !is_beyond {
                                continue;
                            }
                            moving_beyond += 1;
                            for (other, others) in stations.iter().enumerate() {
                                let there = others.waits.iter().find(|there| there.mark == wait.mark);
                                let come = run.progress(other).1 as usize;
                                assert!(
                                    there.is_none_or(|there| come >= there.after),
                                    "{cell} {execution_type} {wait:?}"
                                );
                            }
                        }
                    }
                })
                .unwrap();
                assert!(moving_beyond > 0);
            }
        }
    }
}
