//! Runs: the way to their start, their scans and their ends; and what leads the robot to `Ready` in between.

use machine::Instant;
use protocol::fieldbus::{Counters, Fieldbus};
use protocol::image::{ErrorNumber, State, Status};

use super::{Mode, PlcNode, Run};
use crate::function_blocks::BlockError;
use crate::readiness::Readiness;
use crate::sequence::{Progress, Sequence};
use crate::{Commanded, Execution, ExecutionType, Failure, FailureCause, PlcEvent, Seen, StartError};

impl<B: Fieldbus> PlcNode<B> {
    pub(super) fn is_at_start(&self) -> bool {
        self.start_position.is_reached(self.group.feedback())
    }

    pub(super) fn move_to_start(&mut self, is_at_end: bool, then: Option<ExecutionType>) {
        self.start_position.begin(is_at_end);
        self.mode = Mode::MovingToStart(then);
        self.push(PlcEvent::MovingToStart);
    }

    pub(super) fn go_on_to_start(&mut self, now: Instant, then: Option<ExecutionType>) {
        match (self.start_position.scan(now, &mut self.group), then) {
            (Progress::Running, _) => {}
            (Progress::Done, Some(execution_type)) => self.mode = Mode::Starting(execution_type),
            (Progress::Done, None) => self.become_idle(),
            (Progress::Aborted, _) => self.fail(FailureCause::RobotHalted),
            (Progress::Failed { error, .. }, _) => self.fail(FailureCause::StartNotReached(error)),
        }
    }

    pub(super) fn become_idle(&mut self) {
        self.mode = Mode::Idle;
        self.push(PlcEvent::Ready);
    }

    pub(super) fn begin_run(&mut self, now: Instant, execution_type: ExecutionType) {
        self.run = Run {
            sequence: Sequence::new(execution_type, self.program, self.queue_depth),
            overrides: self.overrides,
            overridden: 0,
            override_percent: [u8::MAX, 0],
            started_at: now,
            started_in_scan: self.scans,
            robot_before: self.group.feedback().map_or(([0.0; 6], 0), |robot| (robot.joints, robot.clock_ns)),
            frames_before: self.bus.counters(),
        };
        self.motions.restart();
        self.mode = Mode::Running;
        self.push(PlcEvent::Started { execution_type, at: now, after: self.group.command().number });
        self.run(now);
    }

    pub(super) fn run(&mut self, now: Instant) {
        self.follow_overrides(now);
        let percent = self.group.command().override_percent;
        let [lowest, highest] = self.run.override_percent;
        self.run.override_percent = [lowest.min(percent), highest.max(percent)];
        match self.run.sequence.scan(now, &mut self.motions, &self.stops, &mut self.group) {
            Progress::Running => {}
            Progress::Done => self.finish(now),
            Progress::Aborted => self.fail(FailureCause::RobotHalted),
            Progress::Failed { motion, error } => self.fail(match error {
                BlockError::Robot { number, finding, .. } => FailureCause::Robot { number, motion, finding },
                error => FailureCause::Block { error, motion },
            }),
        }
    }

    /// Sets the override as the run's schedule says.
    pub(super) fn follow_overrides(&mut self, now: Instant) {
        let Some(schedule) = &self.run.overrides else { return };
        let since = now.since(self.run.started_at);
        let due = schedule.steps().iter().skip(self.run.overridden).take_while(|step| step.after() <= since);
        for step in due {
            self.group.set_override(step.to);
            self.run.overridden += 1;
        }
    }

    pub(super) fn finish(&mut self, now: Instant) {
        let totals = self.run.sequence.totals();
        let execution_time_ns = now.as_nanos().saturating_sub(self.run.started_at.as_nanos());
        self.push(PlcEvent::Finished(Execution {
            execution_type: self.run.sequence.execution_type(),
            execution_time_ns,
            robot_execution_ns: totals.robot_execution_ns,
            motions: totals.executed,
            blends_suppressed: totals.blends_suppressed,
            scans: self.scans - self.run.started_in_scan,
            frames: frames_between(self.run.frames_before, self.bus.counters()),
            commanded: self.commanded(),
            seen: self.seen(),
        }));
        if self.is_at_start() { self.become_idle() } else { self.move_to_start(true, None) }
    }

    fn commanded(&self) -> Commanded {
        let sent = self.motions.given().sum();
        Commanded {
            motions: sent.motions,
            digest: sent.value,
            override_percent: self.run.override_percent,
            end: self.group.feedback().map_or([0.0; 6], |feedback| feedback.joints),
        }
    }

    /// Returns what the robot's images show of the run that ends.
    fn seen(&self) -> Option<Seen> {
        let feedback = self.group.feedback()?;
        let (start, clock_before) = self.run.robot_before;
        let clock_ns = feedback.clock_ns.saturating_sub(clock_before);
        Some(Seen { start, end_pose: feedback.pose, clock_ns })
    }

    /// Ends a run, if there is one, and has the next scans lead the robot to `Ready` again.
    pub(super) fn fail(&mut self, cause: FailureCause) {
        let (execution_type, executed) = match self.mode {
            Mode::Running => (self.run.sequence.execution_type(), self.run.sequence.totals().executed),
            Mode::Starting(execution_type) | Mode::MovingToStart(Some(execution_type)) => (execution_type, 0),
            // Nobody waits for it: the next run tries again and says what is wrong.
            Mode::MovingToStart(None) => return self.prepare_again(true),
            Mode::Idle | Mode::Preparing => return,
        };
        self.prepare_again(matches!(self.mode, Mode::MovingToStart(_)));
        self.push(PlcEvent::Failed(Failure { execution_type, executed, cause }));
    }

    /// Has the next scans lead the robot to `Ready` again.
    pub(super) fn prepare_again(&mut self, start_not_reached: bool) {
        self.group.release(self.group.command().number, false);
        self.mode = Mode::Preparing;
        self.readiness = Readiness::after_failure();
        self.start_not_reached = start_not_reached;
    }

    /// Does the work of a scan while no sequence runs.
    pub(super) fn prepare(&mut self) {
        if self.mode == Mode::Idle && Readiness::holds(&self.group) {
            return;
        }
        self.mode = Mode::Preparing;
        if !self.readiness.scan(&mut self.group) {
            return;
        }
        // What has just failed, or what somebody halted, is not repeated without being asked for.
        if core::mem::take(&mut self.start_not_reached) || self.is_at_start() {
            self.become_idle();
        } else {
            self.move_to_start(false, None);
        }
    }

    pub(super) fn not_ready(&self) -> StartError {
        let feedback = self.group.feedback();
        StartError::NotReady {
            state: feedback.map_or(State::Halted, |feedback| feedback.state),
            error: feedback
                .filter(|feedback| feedback.status.contains(Status::ERROR))
                .map_or(ErrorNumber::None, |feedback| feedback.error),
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
