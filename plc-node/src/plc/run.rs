//! Runs: the way to their start, their scans and their ends.

use machine::Instant;
use protocol::fieldbus::{ControllerBus, Counters};
use protocol::image::Control;

use super::{PlcNode, ScanMode};
use crate::function_blocks::BlockError;
use crate::program::{PlcProgram, Progress};
use crate::robot_clock::CLOCK_WAIT;
use crate::station::{Station, StationState};
use crate::{Commanded, Execution, ExecutionType, Failure, FailureCause, OverrideSchedule, PlcEvent, Seen};

/// The run under way, or the last one.
#[derive(Debug)]
pub(super) struct Run {
    pub(super) execution_type: ExecutionType,
    overrides: Option<OverrideSchedule>,
    /// Steps of them that are done.
    overridden: usize,
    /// Lowest and highest override so far, in %.
    override_percent: [u8; 2],
    started_at: Instant,
    started_in_scan: u64,
    /// Each station at the start.
    before: Vec<Before>,
    /// The first station that was lost while others went on, and why.
    lost: Option<(usize, FailureCause)>,
    /// Since when the next run waits for the estimates of clocks.
    waits_for_clocks: Option<Instant>,
}

/// A station at the start of a run.
#[derive(Clone, Debug)]
struct Before {
    /// The robot's joints and clock.
    robot: ([f32; 6], u64),
    frames: Counters,
    /// Number of the last command before the run.
    number: u16,
    /// Marks whose passage was reported in the run.
    reported: usize,
    is_lost: bool,
}

impl Run {
    /// Returns what stands for a run before the first one.
    pub(super) fn none(stations: usize) -> Self {
        let before = Before {
            robot: ([0.0; 6], 0),
            frames: Counters::default(),
            number: 0,
            reported: 0,
            is_lost: false,
        };
        Self {
            execution_type: ExecutionType::Rc,
            overrides: None,
            overridden: 0,
            override_percent: [u8::MAX, 0],
            started_at: Instant::ZERO,
            started_in_scan: 0,
            before: vec![before; stations],
            lost: None,
            waits_for_clocks: None,
        }
    }

    /// Returns whether the run goes on without a station.
    pub(super) fn is_lost(&self, station: usize) -> bool {
        self.before.get(station).is_some_and(|before| before.is_lost)
    }

    /// Notes that the run goes on without a station.
    pub(super) fn lose(&mut self, station: usize, cause: FailureCause) {
        self.lost.get_or_insert((station, cause));
        if let Some(before) = self.before.get_mut(station) {
            before.is_lost = true;
        }
    }
}

impl<B: ControllerBus, P: PlcProgram> PlcNode<B, P> {
    /// Begins the run once every arm is where it starts, and moves there those that are not.
    pub(super) fn start_when_ready(&mut self, now: Instant, execution_type: ExecutionType) {
        let leads = self.program.leads();
        for station in self.stations.iter_mut().filter(|station| station.is_ready()) {
            if !leads && !station.is_at_start() {
                station.move_to_start(false);
            }
        }
        if self.stations.iter().all(Station::is_ready) && self.knows_clocks(now) {
            self.begin_run(now, execution_type);
        }
    }

    /// Returns whether the clocks of all robots are known, of those that the PLC estimates; after some time in which a clock
    /// shows nothing that it can use, also without them.
    fn knows_clocks(&mut self, now: Instant) -> bool {
        let mut clocks = self.stations.iter().filter_map(Station::robot_clock);
        if clocks.all(|clock| clock.robot_time(now).is_some()) {
            return true;
        }
        now.since(*self.run.waits_for_clocks.get_or_insert(now)) >= CLOCK_WAIT
    }

    fn begin_run(&mut self, now: Instant, execution_type: ExecutionType) {
        for index in 0..self.stations.len() {
            let frames = self.counters_of(index);
            if let (Some(before), Some(station)) = (self.run.before.get_mut(index), self.stations.get(index))
            {
                let number = station.group().command().number;
                *before = Before { robot: station.robot(), frames, number, reported: 0, is_lost: false };
            }
        }
        self.run.execution_type = execution_type;
        (self.run.overrides, self.run.overridden) = (self.overrides, 0);
        self.run.override_percent = [u8::MAX, 0];
        (self.run.started_at, self.run.started_in_scan) = (now, self.scans);
        (self.run.lost, self.run.waits_for_clocks) = (None, None);
        // What resumed a skill of the run before has done so.
        self.stations.iter_mut().for_each(|station| station.group_mut().set_control(Control::RESUME, false));
        self.program.begin(now, execution_type);
        self.mode = ScanMode::Running;
        let after = self.command().number;
        self.events.push_for_all(PlcEvent::Started { execution_type, at: now, after });
        self.run(now);
    }

    /// Executes one scan of a run.
    pub(super) fn run(&mut self, now: Instant) {
        self.follow_overrides(now);
        for station in &self.stations {
            let percent = station.group().command().override_percent;
            let [lowest, highest] = self.run.override_percent;
            self.run.override_percent = [lowest.min(percent), highest.max(percent)];
        }
        let progress = self.program.scan(now, &mut self.stations);
        self.report_passages();
        match progress {
            Progress::Running => {}
            Progress::Done => match self.run.lost {
                None => self.finish(now),
                Some((station, cause)) => self.end_run(Some(station), cause),
            },
            Progress::Ended { station, cause } => self.fail(Some(station), cause),
            Progress::Aborted { station } => self.fail(Some(station), FailureCause::RobotHalted),
            Progress::Failed { station, motion, error } => {
                let cause = match error {
                    BlockError::Robot { number, finding, .. } => {
                        FailureCause::Robot { number, motion, finding }
                    }
                    error => FailureCause::Block { error, motion },
                };
                self.fail(Some(station), cause);
            }
        }
    }

    /// Reports the marks that arms have passed in this scan.
    fn report_passages(&mut self) {
        for (index, before) in self.run.before.iter_mut().enumerate() {
            let new = self.program.passages(index).get(before.reported..).unwrap_or_default();
            for passage in new.iter().take_while(|passage| passage.passed.is_some()) {
                before.reported += 1;
                self.events.push(index, PlcEvent::Passed(*passage));
            }
        }
    }

    /// Sets the override as the run's schedule says.
    fn follow_overrides(&mut self, now: Instant) {
        let Some(schedule) = &self.run.overrides else { return };
        let since = now.since(self.run.started_at);
        let due = schedule.steps().iter().skip(self.run.overridden).take_while(|step| step.after() <= since);
        for step in due {
            self.stations.iter_mut().for_each(|station| station.group_mut().set_override(step.to));
            self.run.overridden += 1;
        }
    }

    fn finish(&mut self, now: Instant) {
        self.mode = ScanMode::Idle;
        let measured = || now.as_nanos().saturating_sub(self.run.started_at.as_nanos());
        let by_program = self.program.execution_time_us().map(|micros| micros.saturating_mul(1_000));
        let execution_time_ns = by_program.unwrap_or_else(measured);
        for index in 0..self.stations.len() {
            let totals = self.program.totals(index);
            let frames_before = self.run.before.get(index).map(|before| before.frames).unwrap_or_default();
            let execution = Execution {
                execution_type: self.run.execution_type,
                execution_time_ns,
                robot_execution_ns: totals.robot_execution_ns,
                motions: totals.executed,
                blends_suppressed: totals.blends_suppressed,
                scans: self.scans - self.run.started_in_scan,
                frames: frames_between(frames_before, self.counters_of(index)),
                commanded: self.commanded(index),
                seen: self.seen(index),
                after: self.run.before.get(index).map(|before| before.number),
                zone_wait_ns: self
                    .program
                    .waited_for_zones(index)
                    .map(|waited| u64::try_from(waited.as_nanos()).unwrap_or(u64::MAX)),
            };
            self.events.push(index, PlcEvent::Finished(execution));
        }
        if self.program.leads() {
            return self.stations.iter_mut().for_each(Station::leave_run);
        }
        for station in &mut self.stations {
            if station.is_at_start() {
                station.state = StationState::Ready;
            } else {
                station.move_to_start(true);
            }
        }
        self.report_ready();
    }

    fn commanded(&self, index: usize) -> Commanded {
        let sent = self.program.sent(index);
        let feedback = self.stations.get(index).and_then(|station| station.group().feedback());
        Commanded {
            motions: sent.motions,
            digest: sent.value,
            override_percent: self.run.override_percent,
            end: feedback.map_or([0.0; 6], |feedback| feedback.joints),
        }
    }

    /// Returns what a robot's images show of the run that ends.
    fn seen(&self, index: usize) -> Option<Seen> {
        let feedback = self.stations.get(index)?.group().feedback()?;
        let (start, clock_before) = self.run.before.get(index)?.robot;
        let clock_ns = feedback.clock_ns.saturating_sub(clock_before);
        Some(Seen { start, end_pose: feedback.pose, clock_ns })
    }

    /// Ends a run as failed: the next scans halt the robots and lead them to `Ready` again.
    pub(super) fn end_run(&mut self, station: Option<usize>, cause: FailureCause) {
        self.mode = ScanMode::Idle;
        for index in 0..self.stations.len() {
            let is_lost = self.run.is_lost(index);
            let Some(station) = self.stations.get_mut(index) else { return };
            if !is_lost {
                station.prepare_again(false);
            } else if station.is_ready() && !station.is_at_start() {
                station.move_to_start(false);
            }
        }
        // The first station that was lost is why the run cannot be done, whatever ended it.
        let (station, cause) = match (station, self.run.lost) {
            (Some(_), Some((first, cause))) => (Some(first), cause),
            _ => (station, cause),
        };
        let executed_at = |index| self.program.totals(index).executed;
        let executed = match station {
            Some(station) => executed_at(station),
            None => (0..self.stations.len()).map(executed_at).fold(0, u32::saturating_add),
        };
        self.report_failure(station, self.run.execution_type, executed, cause);
    }

    pub(super) fn report_failure(
        &mut self,
        station: Option<usize>,
        execution_type: ExecutionType,
        executed: u32,
        cause: FailureCause,
    ) {
        let failed = PlcEvent::Failed(Failure { execution_type, executed, cause });
        match station {
            Some(station) => self.events.push(station, failed),
            None => self.events.push_for_all(failed),
        }
    }
}

fn frames_between(before: Counters, after: Counters) -> Counters {
    Counters {
        sent: after.sent.saturating_sub(before.sent),
        skipped: after.skipped.saturating_sub(before.skipped),
        received: after.received.saturating_sub(before.received),
        lost: after.lost.saturating_sub(before.lost),
        late: after.late.saturating_sub(before.late),
        malformed: after.malformed.saturating_sub(before.malformed),
        foreign: after.foreign.saturating_sub(before.foreign),
    }
}
