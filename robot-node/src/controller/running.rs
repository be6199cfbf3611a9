//! The skill that runs, cycle by cycle: its motions taken and driven, until it ends.

use core::time::Duration;

use protocol::Instant;
use protocol::image::{Command, ErrorNumber, Motion, State, Status};

use super::execution::{Execution, Phase};
use super::{Controller, Ending, RobotEvent, press};
use crate::motion::Appended;

impl Controller {
    /// Runs the skill for one cycle.
    pub(super) fn execute(&mut self, at: Instant, command: Option<&Command>) {
        let Some(mut execution) = self.execution else { return };
        let waited_for_motions = self.interpolator.path().is_finished();
        let takes = !matches!(execution.phase, Phase::Stopping(_) | Phase::Waiting { .. });
        let took_one = takes && execution.bad.is_none() && self.take_motion(&mut execution, command);
        if let Phase::Dispatch { until } = execution.phase {
            let checked = execution.bad.is_some()
                || execution.check_ahead(took_one, command, &self.config, &self.programs);
            if let Some((motion, violation)) = execution.bad {
                self.refuse(execution.number, motion, violation);
                return self.finish(at, &execution, Ending::of(violation, motion));
            }
            let there = !self.interpolator.path().is_finished() || self.is_pressing(press::Phase::Waiting);
            // All that is written is checked before anything moves.
            let may_be_more = took_one && !execution.is_complete();
            if checked && there && !may_be_more && at >= until && !self.hold {
                execution.phase = Phase::Driving;
            }
            // The motion starts at this tick: the next one finds the arm a cycle further.
            self.rest();
        } else if let Phase::Waiting { until } = execution.phase {
            self.rest();
            if at >= until && !self.hold {
                self.go_on(until, &mut execution);
                self.take_motion(&mut execution, command);
            }
        } else if self.is_pressing(press::Phase::Pressing)
            && !matches!(execution.phase, Phase::Settling { .. })
        {
            self.press_on(at, &mut execution);
        } else if waited_for_motions || matches!(execution.phase, Phase::Settling { .. }) {
            self.rest();
            self.start_to_press(&mut execution);
        } else {
            self.drive(at, &mut execution);
        }
        self.observer.look(&self.config.arm, &self.interpolator);
        self.feedback.executed = self.executed(&execution);
        self.feedback.accepted = execution.accepted;
        match execution.phase {
            Phase::Settling { until } if at >= until => self.finish(at, &execution, Ending::Done),
            Phase::Stopping(ending) if self.interpolator.is_at_rest() => self.finish(at, &execution, ending),
            Phase::Driving if execution.bad.is_some() && waited_for_motions => {
                let (motion, violation) = execution.bad.unwrap_or((0, ErrorNumber::None.into()));
                self.finish(at, &execution, Ending::of(violation, motion));
            }
            _ => {
                let held = self.hold && self.interpolator.is_at_rest();
                self.state = if held { State::Suspended } else { State::Running };
                self.execution = Some(execution);
            }
        }
    }

    /// Takes one motion that the PLC has written, or that comes next in the program, if the queue has room. One a cycle:
    /// checking it is what takes longest in a cycle, and motions last longer. Returns whether there was one.
    fn take_motion(&mut self, execution: &mut Execution, command: Option<&Command>) -> bool {
        // Where a LIN force ends is known when it has ended.
        if self.is_pressing(press::Phase::Waiting) || self.is_pressing(press::Phase::Pressing) {
            return false;
        }
        let executed = self.executed(execution);
        let next = execution.next_motion(command, executed, &self.programs);
        let prepared = next.and_then(|motion| {
            let prepare = |motion: Motion| {
                let segment = self.interpolator.path().prepare(&motion, &self.config)?;
                Ok((motion, segment, press::of(&motion, &segment, &self.config)?))
            };
            motion.map(prepare).transpose()
        });
        match prepared {
            Ok(None) => return false,
            Ok(Some((motion, segment, press))) => {
                execution.accepted += 1;
                self.accepted.add(&motion);
                if press.is_some() {
                    execution.check_from(segment.end);
                    self.press = press;
                    self.interpolator.close();
                    return true;
                }
                self.press = None;
                let last = execution.accepted == execution.section_end(&self.programs);
                let appended = self.interpolator.append(segment, last);
                if appended == Appended::Late {
                    self.suppressed(execution.accepted.saturating_sub(2));
                }
            }
            Err(violation) => {
                execution.bad = Some((execution.accepted, violation));
                if execution.phase == Phase::Driving {
                    self.refuse_motion(execution.number, execution.accepted, violation);
                }
                self.interpolator.close();
            }
        }
        true
    }

    fn drive(&mut self, at: Instant, execution: &mut Execution) {
        let stopping = matches!(execution.phase, Phase::Stopping(_));
        let target = if stopping || self.hold { 0.0 } else { self.factor };
        match self.interpolator.drive(target) {
            Ok(step) => {
                if let Some(motion) = step.suppressed {
                    self.suppressed(execution.executed_before + motion);
                }
                if let (Some(left), None, false) = (step.ended, &self.press, stopping) {
                    self.path_ended(at - Duration::from_secs_f64(left.min(1.0)), execution);
                }
            }
            Err(violation) => {
                // The checks before the start found the path free; what is left is a plan that is wrong.
                self.interpolator.clear();
                let motion = self.feedback.executed;
                execution.phase = Phase::Stopping(Ending::of(violation, motion));
            }
        }
    }

    /// Ends what runs, on the path; without a skill the state alone changes.
    pub(super) fn give_up(&mut self, at: Instant, ending: Ending) {
        self.pending = None;
        let Some(mut execution) = self.execution else {
            (self.state, self.press) = (State::Halted, None);
            return;
        };
        match execution.phase {
            Phase::Stopping(_) => {}
            Phase::Dispatch { .. } | Phase::Waiting { .. } | Phase::Settling { .. } => {
                self.finish(at, &execution, ending);
            }
            Phase::Driving => {
                execution.phase = Phase::Stopping(ending);
                self.execution = Some(execution);
            }
        }
    }

    fn finish(&mut self, at: Instant, execution: &Execution, ending: Ending) {
        let Execution { number, skill, .. } = *execution;
        let execution_time = execution.elapsed(at);
        let executed = self.executed(execution);
        self.execution = None;
        self.hold = false;
        self.interpolator.clear();
        self.feedback.executed = executed;
        self.feedback.execution_ns = u64::try_from(execution_time.as_nanos()).unwrap_or(u64::MAX);
        if ending == Ending::Done {
            self.state = State::Ready;
        } else {
            (self.state, self.press) = (State::Halted, None);
        }
        if self.feedback.number == number {
            match ending {
                Ending::Done => self.feedback.status.set(Status::DONE, true),
                Ending::Aborted => self.feedback.status.set(Status::ABORTED, true),
                Ending::Fault { error, motion, finding } => self.set_error(error, motion, finding),
            }
        }
        let quality = self.observer.end(&self.config.arm);
        let execution = execution_time;
        self.event(RobotEvent::SkillFinished { number, skill, ending, executed, execution, quality });
    }
}
