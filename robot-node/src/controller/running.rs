//! The running skill, cycle by cycle: its motions are accepted and executed until it ends.

use core::time::Duration;

use machine::Instant;
use protocol::image::{Command, ErrorNumber, State, Status};

use super::execution::{Execution, Phase};
use super::{Controller, Ending, RobotEvent, press};
use crate::arm::Violation;

impl Controller {
    /// Runs the skill for one cycle.
    pub(super) fn execute(&mut self, at: Instant, command: Option<&Command>) {
        let Some(mut execution) = self.execution else { return };
        self.account.note_override(self.feedback.override_percent, self.master.is_some());
        let waited_for_motions = self.interpolator.path().is_finished();
        let took_one = execution.takes_motions()
            && execution.bad.is_none()
            && self.take_motions(&mut execution, command);
        if let Phase::Dispatch { until } = execution.phase {
            if let Some(ending) = self.dispatch(at, until, took_one, command, &mut execution) {
                return self.finish(at, &execution, ending);
            }
        } else if execution.phase == Phase::Arriving {
            self.rest();
            self.account.waited += self.config.cycle;
            self.path_ended(at, &mut execution);
        } else if let Phase::Waiting { until } = execution.phase {
            self.rest();
            if at >= until && !self.hold {
                self.leave_stop(until, &mut execution, command);
            }
        } else if let Phase::Meeting(signal) = execution.phase {
            self.rest();
            let inputs = self.plc_outputs.unwrap_or_default();
            if signal.is_met_by(inputs) && !self.hold {
                self.leave_stop(at, &mut execution, command);
            } else {
                self.account.at_marks += self.config.cycle;
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
        self.report_law_time(&execution);
        let actual = self.drives.as_ref().map(|drives| &drives.joints);
        self.observer.look(&self.config.arm, &self.interpolator, actual);
        // The image shows a command that was refused meanwhile.
        if self.shows(execution.number) {
            self.feedback.executed = self.executed(&execution);
            self.feedback.accepted = execution.accepted;
        }
        match execution.phase {
            Phase::Settling { until } if at >= until && !self.hold && self.is_in_place() => {
                self.finish(at, &execution, Ending::Done)
            }
            Phase::Stopping(ending) if self.interpolator.is_at_rest() => self.finish(at, &execution, ending),
            // A wrong motion may come together with good ones, which are driven first.
            Phase::Driving
                if execution.bad.is_some()
                    && waited_for_motions
                    && self.interpolator.path().is_finished() =>
            {
                let (motion, violation) = execution.bad.unwrap_or((0, ErrorNumber::None.into()));
                self.finish(at, &execution, Ending::of(violation, motion));
            }
            _ => {
                if matches!(execution.phase, Phase::Settling { until } if at >= until && !self.hold) {
                    self.account.waited += self.config.cycle;
                }
                let held = self.hold && self.interpolator.is_at_rest();
                self.state = if held { State::Suspended } else { State::Running };
                self.execution = Some(execution);
            }
        }
    }

    /// Goes on after a statement of the program: with the next one at the same place, or with the motions that follow.
    fn leave_stop(&mut self, at: Instant, execution: &mut Execution, command: Option<&Command>) {
        self.path_ended(at, execution);
        if execution.takes_motions() {
            self.take_motions(execution, command);
        }
    }

    /// Checks all motions that are written, and begins to drive when the time `until` has come. Returns how the skill ends if a
    /// motion is wrong.
    fn dispatch(
        &mut self,
        at: Instant,
        until: Instant,
        took_one: bool,
        command: Option<&Command>,
        execution: &mut Execution,
    ) -> Option<Ending> {
        let checked =
            execution.bad.is_some() || execution.check_ahead(took_one, command, &self.config, &self.programs);
        if let Some((motion, violation)) = execution.bad {
            self.refuse(execution.number, motion, violation);
            return Some(Ending::of(violation, motion));
        }
        let meets_first = execution.accepted == 0 && execution.stops_here(&self.programs);
        let there =
            meets_first || !self.interpolator.path().is_finished() || self.is_pressing(press::Phase::Waiting);
        // All that is written is checked before anything moves.
        let may_be_more = execution.may_start_with_more(took_one, &self.config, &self.programs);
        if checked && there && !may_be_more && at >= until && !self.hold {
            match execution.cycles_to_start.checked_sub(1) {
                Some(left) => execution.cycles_to_start = left,
                None if at >= execution.start => {
                    execution.phase = Phase::Driving;
                    self.account.began = Some(at);
                    if meets_first {
                        self.path_ended(at, execution);
                    }
                }
                None => {}
            }
        }
        // The motion starts at this tick: at the next one the arm is a cycle further.
        self.rest();
        None
    }

    fn drive(&mut self, at: Instant, execution: &mut Execution) {
        let stopping = matches!(execution.phase, Phase::Stopping(_));
        let target = if stopping || self.hold { 0.0 } else { self.rate(at, execution) };
        match self.interpolator.drive(target) {
            Ok(step) => {
                if let Some(motion) = step.suppressed {
                    self.suppressed(execution.executed_before + motion);
                }
                if step.ended.is_some() {
                    self.take_last_frames();
                }
                if let (Some(left), None, false) = (step.ended, &self.press, stopping) {
                    self.path_ended(at - Duration::from_secs_f64(left.min(1.0)), execution);
                }
            }
            // The checks before the start found the path free; what is left is a plan that is wrong.
            Err(violation) => self.stop_for(violation, execution),
        }
    }

    /// Brakes an arm that cannot continue: the skill ends with an error once the arm stands.
    pub(super) fn stop_for(&mut self, violation: Violation, execution: &mut Execution) {
        let motion = self.executed(execution);
        self.refuse_motion(execution.number, motion, violation);
        if !matches!(execution.phase, Phase::Stopping(Ending::Fault { .. })) {
            execution.phase = Phase::Stopping(Ending::of(violation, motion));
        }
    }

    /// Stops the running skill on its path. Without a skill only the state changes, and after a cancel not even that.
    pub(super) fn give_up(&mut self, at: Instant, ending: Ending) {
        self.pending = None;
        let Some(mut execution) = self.execution else {
            self.press = None;
            if ending != Ending::Cancelled {
                (self.state, self.awaits_drives) = (State::Halted, None);
            }
            return;
        };
        match execution.phase {
            // An ending that needs a reset takes precedence over one that does not.
            Phase::Stopping(Ending::Cancelled) => {
                execution.phase = Phase::Stopping(ending);
                self.execution = Some(execution);
            }
            Phase::Stopping(_) => {}
            Phase::Dispatch { .. }
            | Phase::Arriving
            | Phase::Waiting { .. }
            | Phase::Meeting(_)
            | Phase::Settling { .. } => self.finish(at, &execution, ending),
            Phase::Driving => {
                execution.phase = Phase::Stopping(ending);
                self.execution = Some(execution);
            }
        }
    }

    pub(super) fn finish(&mut self, at: Instant, execution: &Execution, ending: Ending) {
        let Execution { number, skill, .. } = *execution;
        let execution_time = execution.elapsed(at);
        let executed = self.executed(execution);
        self.execution = None;
        self.hold = false;
        self.interpolator.clear();
        self.state = if ending.leads_to_ready() { State::Ready } else { State::Halted };
        if ending != Ending::Done {
            self.press = None;
        }
        if self.shows(number) {
            self.feedback.executed = executed;
            self.feedback.execution_ns = u64::try_from(execution_time.as_nanos()).unwrap_or(u64::MAX);
            match ending {
                Ending::Done => self.feedback.status.set(Status::DONE, true),
                Ending::Halted | Ending::Cancelled => self.feedback.status.set(Status::ABORTED, true),
                Ending::Fault { error, motion, finding } => self.set_error(error, motion, finding),
            }
        }
        let end = *if self.is_in_place() { self.interpolator.joints() } else { self.actual_joints() };
        let quality = self.observer.end(&self.config.arm, &end);
        let (execution, began) = (execution_time, self.account.began);
        let account = self.account.close(skill, self.accepted.sum(), *self.actual_joints(), at);
        self.event(RobotEvent::SkillFinished {
            number,
            skill,
            ending,
            executed,
            execution,
            began,
            quality,
            account,
        });
    }
}

#[cfg(test)]
mod tests {
    use protocol::image::{Control, Motion, MotionKind, Skill};

    use super::*;
    use crate::RobotConfig;
    use crate::arm::{AXES, Arm, AxisLimits, Joints, Scara};

    /// Returns Setup A's robot with a controller whose calls take no time.
    fn config() -> RobotConfig {
        RobotConfig {
            interpreter_quantum: Duration::ZERO,
            skill_overhead: Duration::ZERO,
            ..RobotConfig::from_setup(&setup::setup("A").unwrap()).unwrap()
        }
    }

    fn line(x: f32, y: f32) -> Motion {
        Motion {
            kind: MotionKind::LinCartesian,
            target: [x, y, 100.0, 0.0, 0.0, 180.0],
            velocity: 10_000,
            acceleration: 5_000,
            approximation: 5_000,
            base: 1,
            ..Motion::EMPTY
        }
    }

    fn scara(limits: AxisLimits) -> Arm {
        Arm::new(std::sync::Arc::new(Scara { link_1_mm: 225.0, link_2_mm: 275.0, height_mm: 0.0 }), limits)
    }

    /// Runs two lines with a corner on an arm that is checked against other limits while it moves than before. Returns
    /// the controller after the end, and the motions executed by each cycle. Each axis keeps its limits all the time.
    fn run(limits: AxisLimits) -> (Controller, Vec<u32>) {
        let (rated, cycle) = (config().arm.limits().to_owned(), Duration::from_millis(4));
        let mut controller = Controller::new(RobotConfig { arm: scara(limits), ..config() }, Vec::new(), 1);
        controller.config.arm = scara(rated);
        let mut command = Command { control: Control::ENABLE | Control::RESET, ..Command::default() };
        let mut at = Instant::ZERO;
        controller.tick(at, Some(&command));
        command.control = Control::ENABLE | Control::EXECUTE;
        (command.number, command.skill, command.total, command.written) = (1, Skill::MoveContinuous, 3, 3);
        [line(0.0, 50.0), line(150.0, 50.0), line(150.0, -50.0)]
            .into_iter()
            .zip(0..)
            .for_each(|(motion, index)| command.set_slot(index, motion));
        let (mut executed, mut history) = (Vec::new(), [*controller.joints(); 3]);
        let ended = Status::DONE.0 | Status::ERROR.0;
        while controller.feedback().status.0 & ended == 0 {
            at += cycle;
            controller.tick(at, Some(&command));
            executed.push(controller.feedback().executed);
            let [one, two, three] = history;
            let joints = *controller.joints();
            let cycle_s = cycle.as_secs_f64();
            let change: Joints = core::array::from_fn(|axis| joints[axis] - 2.0 * one[axis] + two[axis]);
            let jerk: Joints =
                core::array::from_fn(|axis| joints[axis] - 3.0 * (one[axis] - two[axis]) - three[axis]);
            let acceleration = rated.acceleration_load(&change.map(|change| change / (cycle_s * cycle_s)));
            let jerk = rated.jerk_load(&jerk.map(|jerk| jerk / (cycle_s * cycle_s * cycle_s)));
            assert!(acceleration.share < 1.001 && jerk.share < 1.001, "{acceleration:?}, {jerk:?}");
            history = [joints, one, two];
            assert!(executed.len() < 2_000, "it never ends: {:?}", controller.feedback());
        }
        (controller, executed)
    }

    #[test]
    fn what_the_checks_did_not_find_ends_with_braking_and_true_counts() {
        let limits = *config().arm.limits();
        let whole = run(limits);
        assert!(whole.0.feedback().status.contains(Status::DONE), "{:?}", whole.0.feedback());
        // Axis 1 goes from 32 to 71 degrees on the second line: the arm comes to a narrower range at speed.
        let mut narrower = limits;
        narrower.upper[0] = 55.0;
        let (controller, executed) = run(narrower);
        let feedback = controller.feedback();
        assert_eq!(
            (feedback.error, feedback.error_motion, feedback.executed),
            (ErrorNumber::AxisLimit, 1, 1)
        );
        assert_eq!((feedback.finding.index, feedback.finding.upper()), (1, 55.0));
        assert!(executed.is_sorted(), "a count never falls");
        assert!(controller.interpolator.is_at_rest());
        assert!(controller.joints()[0] > 55.0, "it takes a way to brake from full speed");
    }

    #[test]
    fn beyond_what_a_joint_is_rated_for_the_arm_does_not_go() {
        for (rate, error) in [
            (
                (|limits: &mut AxisLimits| &mut limits.speed) as fn(&mut AxisLimits) -> &mut Joints,
                ErrorNumber::JointSpeed,
            ),
            (|limits| &mut limits.acceleration, ErrorNumber::JointAcceleration),
            (|limits| &mut limits.jerk, ErrorNumber::JointJerk),
        ] {
            let mut limits = *config().arm.limits();
            *rate(&mut limits) = rate(&mut limits).map(|limit| limit / 20.0);
            let (controller, _) = run(limits);
            let feedback = controller.feedback();
            assert_eq!(feedback.error, error, "{feedback:?}");
            let (finding, axis) = (feedback.finding, usize::from(feedback.finding.index));
            assert!((1..=AXES).contains(&axis) && finding.value() > finding.upper(), "{finding:?}");
            assert!((f64::from(finding.upper()) - rate(&mut limits)[axis - 1]).abs() < 1e-2, "{finding:?}");
        }
    }
}
