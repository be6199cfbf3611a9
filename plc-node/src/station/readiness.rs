//! Leading the robot to `Ready`, whatever state it is found in.

use machine::Instant;
use protocol::image::{Control, ErrorNumber, State, Status};

use super::{Station, StationState};
use crate::event::Events;
use crate::function_blocks::{GroupReset, GroupStop, is_executing, is_ready};
use crate::program::Led;
use crate::sequence::SkillProgress;
use crate::{AxesGroup, FailureCause, PlcEvent, SetOut, StartError};

/// The part of the program that runs while no sequence does.
#[derive(Clone, Copy, Default, Debug)]
pub(super) struct Readiness {
    stop: GroupStop,
    reset: GroupReset,
    /// A run failed: whether or not the robot shows it yet, its skill must not go on.
    must_stop: bool,
    /// The first scan without a reset that did not help: robots that take a reset by its edge have to see it before the
    /// next one.
    reset_withdrawn: Option<u64>,
}

impl Readiness {
    /// Begins after a failed run.
    pub(super) fn after_failure() -> Self {
        Self { must_stop: true, ..Self::default() }
    }

    /// Returns whether a robot that was ready still is.
    pub(super) fn holds(group: &AxesGroup) -> bool {
        group.feedback().is_some_and(is_ready) && !group.is_silent()
    }

    /// Runs one scan: keeps the robot enabled, stops a skill that does not belong to a sequence, and resets the robot.
    /// Returns whether it has become ready.
    pub(super) fn scan(&mut self, group: &mut AxesGroup) -> bool {
        let Some(executing) = group.feedback().map(is_executing) else { return false };
        group.set_control(Control::ENABLE, true);

        let stopped = self.stop.call(executing || self.must_stop, group);
        if stopped.done || stopped.error {
            self.stop.call(false, group);
            self.must_stop &= stopped.error;
        }

        if self.reset_withdrawn.is_some_and(|scan| group.has_seen(scan)) {
            self.reset_withdrawn = None;
        }
        let wanted = !executing && !self.must_stop && !stopped.busy && self.reset_withdrawn.is_none();
        let reset = self.reset.call(wanted, group);
        if reset.done || reset.error {
            self.reset.call(false, group);
        }
        if reset.error {
            self.reset_withdrawn = Some(group.scans());
        }
        wanted && reset.done && !group.is_silent()
    }
}

/// How far a station is on its way to the start of a run.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum WayToStart {
    UnderWay,
    Reached,
    Failed(FailureCause),
}

impl Station {
    pub(crate) fn is_at_start(&self) -> bool {
        self.start_position.is_reached(self.group.feedback())
    }

    /// Has the arm move to where a run starts, once it may set out.
    pub(crate) fn move_to_start(&mut self, is_at_end: bool) {
        self.start_position.begin(is_at_end);
        self.state = StationState::MovingToStart;
    }

    /// Returns whether the arm is to set out for the start and has not yet.
    pub(crate) fn is_to_set_out(&self) -> bool {
        self.state == StationState::MovingToStart && !self.start_position.has_set_out()
    }

    /// Notes whether an arm that is to set out for the start does, or what keeps it in this scan. A robot that is not ready any more
    /// does not.
    pub(crate) fn keep(&mut self, set_out: SetOut) -> bool {
        self.kept = (set_out != SetOut::Now).then_some(set_out);
        self.kept.is_some()
    }

    /// Runs one scan of the way to the start; the first one reports that the arm sets out.
    pub(crate) fn go_on_to_start(&mut self, now: Instant, events: &mut Events) -> WayToStart {
        if self.is_to_set_out() {
            events.push(self.index, PlcEvent::MovingToStart);
        }
        match self.start_position.scan(now, &mut self.group) {
            SkillProgress::Running => WayToStart::UnderWay,
            SkillProgress::Done => WayToStart::Reached,
            SkillProgress::Aborted => WayToStart::Failed(FailureCause::RobotHalted),
            SkillProgress::Failed { error, .. } => WayToStart::Failed(FailureCause::StartNotReached(error)),
        }
    }

    /// Has the next scans lead the robot to `Ready` again.
    pub(crate) fn prepare_again(&mut self, start_not_reached: bool) {
        self.group.release(self.group.command().number, false);
        self.group.set_lead(None);
        self.state = StationState::Preparing;
        // What the program has set in this scan must not go out: it may execute.
        self.is_image_set = false;
        self.readiness = Readiness::after_failure();
        self.start_not_reached = start_not_reached;
    }

    /// Does the work of a scan outside of a run. Returns whether the station has become ready in it. An arm that may not move
    /// to where a run starts gets ready where it stands.
    pub(crate) fn prepare(&mut self, may_move: bool) -> bool {
        if self.state == StationState::Ready && Readiness::holds(&self.group) {
            return false;
        }
        self.state = StationState::Preparing;
        self.arm.look(self.group.feedback());
        if self.arm.other().is_some() {
            self.group.set_control(Control::ENABLE, false);
            return false;
        }
        if !self.readiness.scan(&mut self.group) {
            return false;
        }
        // What has just failed, or what somebody halted, is not repeated without being asked for.
        if core::mem::take(&mut self.start_not_reached) || self.is_at_start() || !may_move {
            self.state = StationState::Ready;
            return true;
        }
        self.move_to_start(false);
        false
    }

    /// Takes over how far a program that leads the station has come with it.
    pub(crate) fn follow(&mut self, led: Led, events: &mut Events) {
        let state = match led {
            Led::Preparing | Led::Ended(_) => StationState::Preparing,
            Led::MovingToStart => StationState::MovingToStart,
            Led::Ready => StationState::Ready,
        };
        let before = core::mem::replace(&mut self.state, state);
        if state == StationState::MovingToStart && before != state {
            events.push(self.index, PlcEvent::MovingToStart);
        }
    }

    /// Ends a run at a station that the program leads: what comes now is its own affair.
    pub(crate) const fn leave_run(&mut self) {
        self.state = StationState::Preparing;
    }

    pub(crate) fn not_ready(&self) -> StartError {
        let feedback = self.group.feedback();
        StartError::NotReady {
            state: feedback.map_or(State::Halted, |feedback| feedback.state),
            error: feedback
                .filter(|feedback| feedback.status.contains(Status::ERROR))
                .map_or(ErrorNumber::None, |feedback| feedback.error),
        }
    }
}
