//! What happens at the end of a path: a LIN force begins, a program switches an output, or the skill ends.

use machine::Instant;

use super::Controller;
use super::event::Ending;
use super::execution::{Execution, Phase};
use super::press::{self, Outcome};
use super::program::StopStatement;

impl Controller {
    pub(super) fn is_pressing(&self, phase: press::Phase) -> bool {
        self.press.as_ref().is_some_and(|press| press.phase == phase)
    }

    /// Returns the number of executed motions of the skill.
    pub(super) fn executed(&self, execution: &Execution) -> u32 {
        execution.executed_before + self.interpolator.path().executed()
    }

    /// Keeps the arm where it is without a path: it stands still or holds its force; at override 0 it keeps the force
    /// that it has.
    pub(super) fn rest(&mut self) {
        if !self.is_pressing(press::Phase::Holding) || !self.interpolator.path().is_finished() {
            return self.interpolator.stand_still();
        }
        let is_held = self.hold || self.factor == 0.0;
        // A line that was driven before can be driven again; if not, the arm lets go of the force and brakes.
        if self.lead(if is_held { 0.0 } else { 1.0 }).is_err() {
            self.press = None;
        }
    }

    /// Moves one cycle along the line of the LIN force, with `share` of its speed.
    fn lead(&mut self, share: f64) -> Result<(), crate::arm::Violation> {
        let Some(press) = &mut self.press else { return Ok(()) };
        let joints = press.step(share, self.contact, &self.config.arm, self.interpolator.joints());
        let tool = press.tool;
        self.interpolator.lead(joints, &tool)
    }

    /// Begins the LIN force that waits, once the path before it is driven to its end.
    pub(super) fn start_to_press(&mut self, execution: &mut Execution) {
        if execution.phase != Phase::Driving
            || !self.is_pressing(press::Phase::Waiting)
            || !self.interpolator.path().is_finished()
        {
            return;
        }
        execution.executed_before = self.executed(execution);
        self.interpolator.clear();
        if let Some(press) = &mut self.press {
            press.phase = press::Phase::Pressing;
        }
        self.report_position();
        self.measure_contact_force();
    }

    /// Runs one cycle of the LIN force under way.
    pub(super) fn press_on(&mut self, at: Instant, execution: &mut Execution) {
        let stopping = matches!(execution.phase, Phase::Stopping(_));
        let held = stopping || self.hold;
        let share = if held { 0.0 } else { self.press_rate(at, execution) };
        if let Err(violation) = self.lead(share) {
            return self.stop_for(violation, execution);
        }
        self.measure_contact_force();
        let contact = self.contact;
        let Some(press) = &mut self.press else { return };
        if held {
            return press.unsettle();
        }
        match press.outcome(contact) {
            Outcome::Open => {}
            Outcome::Reached => {
                press.phase = press::Phase::Holding;
                execution.executed_before = self.executed(execution) + 1;
                self.interpolator.clear();
                self.path_ended(at, execution);
            }
            Outcome::Missed(violation) => {
                let motion = self.executed(execution);
                self.refuse_motion(execution.number, motion, violation);
                execution.phase = Phase::Stopping(Ending::of(violation, motion));
            }
        }
    }

    /// Handles the end of the path at the instant `ended_at`, when all accepted motions are executed: switches what the
    /// program switches there.
    /// Nothing is switched before the drives have arrived.
    pub(super) fn path_ended(&mut self, ended_at: Instant, execution: &mut Execution) {
        if execution.stops_here(&self.programs) && !self.is_in_place() {
            execution.phase = Phase::Arriving;
            return;
        }
        match execution.take_statement(&self.programs) {
            Some(StopStatement::Switch(switch)) => {
                self.outputs = switch.applied_to(self.outputs);
                execution.phase = Phase::Waiting { until: ended_at + switch.wait };
            }
            Some(StopStatement::Meet(signal)) => {
                self.outputs = signal.applied_to(self.outputs);
                execution.phase = Phase::Meeting(signal);
            }
            None => self.go_on(ended_at, execution),
        }
    }

    /// Goes on with the motions that follow, or ends the skill.
    pub(super) fn go_on(&mut self, at: Instant, execution: &mut Execution) {
        execution.phase = if execution.is_complete() {
            Phase::Settling { until: at + self.config.skill_overhead / 2 }
        } else {
            Phase::Driving
        };
    }
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use protocol::image::{Command, Control, Motion, MotionKind, Skill, State, Status};

    use super::*;
    use crate::RobotConfig;
    use crate::arm::Surface;

    #[test]
    fn a_held_force_follows_a_surface_that_moves_and_is_let_go_at_the_lines_end() {
        // Longer than a screen, because it follows one press from its approach to its end.
        let mut config = RobotConfig {
            interpreter_quantum: Duration::ZERO,
            skill_overhead: Duration::ZERO,
            ..RobotConfig::from_setup(&setup::setup("A").unwrap()).unwrap()
        };
        let home = config.arm.forward(&config.home);
        let [x, y, z] = home.position;
        config.surfaces = vec![Surface {
            point: [x, y, z - 10.0],
            normal: [0.0, 0.0, 1.0],
            radius_mm: f64::INFINITY,
            stiffness_n_per_mm: 40.0,
        }];
        let mut target = home.to_mm_deg().map(|coordinate| coordinate as f32);
        target[2] -= 15.0;
        let press = Motion {
            kind: MotionKind::LinForceCartesian,
            target,
            auxiliary: [0.0, 0.0, -25.0],
            velocity: 100,
            acceleration: 5_000,
            ..Motion::EMPTY
        };
        let mut controller = Controller::new(config, Vec::new(), 1);
        let mut at = Instant::ZERO;
        let mut tick = |controller: &mut Controller, command: &Command| {
            at += Duration::from_millis(4);
            controller.tick(at, Some(command));
        };
        let mut command = Command { control: Control::ENABLE | Control::RESET, ..Command::default() };
        tick(&mut controller, &command);
        command.control = Control::ENABLE | Control::EXECUTE;
        (command.number, command.skill, command.total, command.written) =
            (1, Skill::MoveLinForceCartesian, 1, 1);
        command.set_slot(0, press);
        (0..2_000).for_each(|_| tick(&mut controller, &command));
        assert!(controller.feedback().status.contains(Status::DONE), "{:?}", controller.feedback());
        // 1 mm/s, up and then down past the line's end.
        for (step_mm, ticks) in [(0.004, 400), (-0.004, 1_200)] {
            for _ in 0..ticks {
                controller.config.surfaces[0].point[2] += step_mm;
                tick(&mut controller, &command);
                let force = f64::from(controller.feedback().contact_force);
                assert!((force - 25.0).abs() < 4.0, "{force} N");
            }
        }
        // While it is suspended it does not follow the surface, and only as long.
        let ready = command.control;
        command.control = ready | Control::SUSPEND;
        (0..5).for_each(|_| tick(&mut controller, &command));
        let joints = *controller.joints();
        controller.config.surfaces[0].point[2] += 0.01;
        (0..50).for_each(|_| tick(&mut controller, &command));
        assert_eq!(*controller.joints(), joints);
        command.control = ready;
        (0..50).for_each(|_| tick(&mut controller, &command));
        assert_ne!(*controller.joints(), joints);
        // At override 0 it stops and does not follow the surface.
        command.override_percent = 0;
        (0..50).for_each(|_| tick(&mut controller, &command));
        let joints = *controller.joints();
        for step_mm in [0.01, -0.01] {
            controller.config.surfaces[0].point[2] += step_mm;
            (0..50).for_each(|_| tick(&mut controller, &command));
            assert_eq!(*controller.joints(), joints);
        }
        command.override_percent = 100;
        (0..2_000).for_each(|_| {
            controller.config.surfaces[0].point[2] -= 0.004;
            tick(&mut controller, &command);
        });
        let low = controller.config.arm.forward(controller.joints()).position[2];
        assert!((z - 15.0 - low).abs() < 1e-2, "it stops at the line's end, not at {low}");
        assert_eq!((controller.feedback().state, controller.feedback().contact_force), (State::Ready, 0.0));
    }
}
