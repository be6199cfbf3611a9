//! Silence of the robot: what the PLC waits for in a scan, when it says so, and when it gives the robot up.

use machine::Duration;
use protocol::fieldbus::Down;
use protocol::image::{ErrorNumber, State, Status};

use super::{Station, StationState};
use crate::event::Events;
use crate::waiting::{Patience, longest_silence};
use crate::{AxesGroup, FailureCause, PlcEvent, SetOut, WaitingFor};

/// Least change of a joint that counts as motion, in degrees (mm): more than the image rounds away.
const MOTION: f32 = 2e-4;

/// Watches over the progress of what the PLC waits for.
#[derive(Debug)]
pub(super) struct Silence {
    patience: Patience,
    /// Longest time without progress in a run: also a program of the robot may wait at a stop.
    longest: Duration,
    /// The robot at the last progress.
    progress: Option<Shown>,
    /// Whether the robot's skill stood in the scan before because somebody wants it to.
    is_paused: bool,
    /// Why the last attempt to connect failed.
    last_down: Option<Down>,
}

/// What a robot that executes a skill changes.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Shown {
    commanded: (u16, u32),
    number: u16,
    counts: [u32; 2],
    state: State,
    status: Status,
    joints: [f32; 6],
}

impl Shown {
    fn of(group: &AxesGroup) -> Option<Self> {
        let (command, feedback) = (group.command(), group.feedback()?);
        Some(Self {
            commanded: (command.number, command.written),
            number: feedback.number,
            counts: [feedback.executed, feedback.accepted],
            state: feedback.state,
            status: feedback.status,
            joints: feedback.joints,
        })
    }

    /// Returns whether this is the same, but for joints that did not move.
    fn is_still(&self, before: &Self) -> bool {
        let stand = self.joints.iter().zip(before.joints).all(|(now, before)| (now - before).abs() <= MOTION);
        stand && *self == Self { joints: self.joints, ..*before }
    }
}

impl Silence {
    pub(super) fn new(scan: Duration, answer: Duration, longest_stop: Duration) -> Self {
        let longest = longest_silence(answer, longest_stop);
        Self { patience: Patience::new(scan), longest, progress: None, is_paused: false, last_down: None }
    }

    pub(super) const fn connected(&mut self) {
        self.last_down = None;
        self.restart();
    }

    pub(super) const fn not_connected(&mut self, down: Down) {
        self.last_down = Some(down);
    }

    const fn restart(&mut self) {
        self.patience.restart();
        self.progress = None;
    }

    /// Takes the robot's image of a scan in which it owes progress. Returns whether it showed some.
    fn see(&mut self, group: &AxesGroup) -> bool {
        let shown = Shown::of(group);
        let is_still = matches!((&shown, &self.progress), (Some(now), Some(before)) if now.is_still(before));
        if !is_still {
            self.progress = shown;
        }
        !is_still
    }
}

/// What a station does in a scan, as far as its robot owes progress.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Work {
    /// A run is under way; the program waits there itself, or not.
    Run { waits: bool },
    /// A run is about to start, or none is wanted.
    None,
}

impl Station {
    /// Reports what the PLC waits for at this station. Returns the reason to fail the run, if the robot owes progress and shows none.
    pub(crate) fn watch_silence(
        &mut self,
        work: Work,
        received: u64,
        events: &mut Events,
    ) -> Option<FailureCause> {
        let is_running = matches!(work, Work::Run { .. });
        let is_commanded = is_running || self.state == StationState::MovingToStart;
        let is_progress = match (work, self.state) {
            (Work::Run { waits: true }, _) => true,
            // Another arm is on its way, or its robot is not connected, which is watched itself.
            (Work::None, StationState::MovingToStart) if self.kept == Some(SetOut::Wait) => true,
            (Work::Run { waits: false }, _) | (Work::None, StationState::MovingToStart) => {
                self.silence.see(&self.group)
            }
            (Work::None, StationState::Ready) => true,
            (Work::None, StationState::Preparing) => false,
        };
        if !is_running && self.state == StationState::Preparing {
            self.silence.progress = None;
        }
        if is_progress {
            self.silence.patience.restart();
            return None;
        }
        let for_what = if is_commanded { self.paused() } else { Some(self.unready(received)) };
        let is_paused = is_commanded && for_what.is_some();
        // The robot owes nothing for the time before: it may take some cycles to move again.
        if core::mem::replace(&mut self.silence.is_paused, is_paused) && !is_paused {
            self.silence.patience.restart();
        }
        let waited = self.silence.patience.count();
        match for_what {
            Some(for_what) if self.silence.patience.is_report_due(waited, &for_what) => {
                let seconds = u32::try_from(waited.as_secs()).unwrap_or(u32::MAX);
                events.push(self.index, PlcEvent::Waiting { for_what, seconds });
                None
            }
            None if waited >= self.silence.longest => Some(self.no_progress(waited)),
            _ => None,
        }
    }

    /// Returns what a robot that executes a skill may wait for as long as it likes, if it does.
    fn paused(&self) -> Option<WaitingFor> {
        let feedback = self.group.feedback()?;
        if feedback.state == State::Suspended {
            return Some(WaitingFor::Resume);
        }
        let is_zero = self.group.command().override_percent == 0 || feedback.override_percent == 0;
        is_zero.then_some(WaitingFor::Override)
    }

    /// Returns what is missing before a run may start.
    fn unready(&self, received: u64) -> WaitingFor {
        if !self.is_connected {
            return WaitingFor::Connection { last: self.silence.last_down };
        }
        let altered = self.checker.checks().altered;
        let Some(feedback) = self.group.feedback() else {
            return if self.image_bad {
                WaitingFor::GoodData
            } else {
                WaitingFor::Image { received, altered }
            };
        };
        if self.group.is_silent() && altered > self.altered_still {
            return WaitingFor::Image { received, altered };
        }
        if self.group.is_silent() {
            return WaitingFor::Life { received, life: feedback.life, altered };
        }
        if let Some(difference) = self.arm.other() {
            return WaitingFor::Arm(difference);
        }
        let is_error = feedback.status.contains(Status::ERROR) || feedback.status.contains(Status::WARNING);
        WaitingFor::Ready {
            state: feedback.state,
            error: if is_error { feedback.error } else { ErrorNumber::None },
            is_enabled: feedback.status.contains(Status::ENABLED),
        }
    }

    fn no_progress(&self, waited: Duration) -> FailureCause {
        let seconds = u32::try_from(waited.as_secs()).unwrap_or(u32::MAX);
        if self.state == StationState::MovingToStart && self.kept.is_some() {
            return FailureCause::ZoneTaken { seconds };
        }
        let state = self.group.feedback().map_or(State::Halted, |feedback| feedback.state);
        FailureCause::NoProgress { seconds, state }
    }
}
