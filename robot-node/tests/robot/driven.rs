//! A bare controller, fed every robot cycle as a PLC would: without a bus, and so without a way between them.

use std::time::Duration;

use machine::Instant;
use plc_node::function_blocks::{
    GroupContinue, GroupDisable, GroupEnable, GroupHalt, GroupInterrupt, GroupReset, GroupStop,
};
use protocol::image::{Command, Control, Feedback, Motion, MotionKind, SLOTS, Skill, State, Status};
use robot_node::arm::Surface;
use robot_node::{Controller, Program, RobotConfig, RobotEvent};

pub(crate) struct Driven {
    pub(crate) controller: Controller,
    pub(crate) command: Command,
    pub(crate) events: Vec<RobotEvent>,
    /// Motions that are not written yet, however many slots are free.
    pub(crate) keep_back: usize,
    pub(crate) connected: bool,
    pub(crate) at: Instant,
    motions: Vec<Motion>,
    cycle: Duration,
}

/// One of the PLC's blocks for each command to the group.
#[derive(Default)]
pub(crate) struct GroupBlocks {
    pub(crate) enable: GroupEnable,
    pub(crate) disable: GroupDisable,
    pub(crate) reset: GroupReset,
    pub(crate) halt: GroupHalt,
    pub(crate) stop: GroupStop,
    pub(crate) interrupt: GroupInterrupt,
    pub(crate) go_on: GroupContinue,
}

/// A built-in setup's robot with a controller that costs nothing.
pub(crate) fn bare(setup: &str) -> RobotConfig {
    RobotConfig {
        interpreter_quantum: Duration::ZERO,
        start_quantum: Duration::ZERO,
        continuous_start_cycles: 0,
        skill_overhead: Duration::ZERO,
        ..RobotConfig::from_setup(&setup::setup(setup).unwrap()).unwrap()
    }
}

/// A surface in base 1 that faces up, its middle at x = 100, y = 40.
pub(crate) fn seat(config: &RobotConfig, z: f64, stiffness_n_per_mm: f64) -> Surface {
    let base = config.bases[1].unwrap();
    let point = base.point([100.0, 40.0, z]);
    Surface { point, normal: [0.0, 0.0, 1.0], radius_mm: 10.0, stiffness_n_per_mm }
}

/// A line in base 1 with the tool down: 250 mm/s, 5 m/s².
pub(crate) fn lin(x: f32, y: f32, z: f32) -> Motion {
    Motion {
        kind: MotionKind::LinCartesian,
        target: [x, y, z, 0.0, 0.0, 180.0],
        velocity: 2_500,
        acceleration: 5_000,
        base: 1,
        ..Motion::EMPTY
    }
}

/// Point to point in base 1 with the tool down.
pub(crate) fn ptp(x: f32, y: f32, z: f32) -> Motion {
    Motion { kind: MotionKind::PtpCartesian, acceleration: 10_000, ..lin(x, y, z) }
}

/// Straight down to `z` at 10 mm/s, pressing with `force_n`.
pub(crate) fn press(z: f32, force_n: f32) -> Motion {
    Motion {
        kind: MotionKind::LinForceCartesian,
        auxiliary: [0.0, 0.0, -force_n],
        velocity: 100,
        ..lin(100.0, 40.0, z)
    }
}

impl Driven {
    /// A robot that is `Ready`.
    pub(crate) fn ready(config: RobotConfig, program: Program) -> Self {
        let cycle = config.cycle;
        let mut driven = Self {
            controller: Controller::new(config, vec![(1, program)], 1),
            command: Command { control: Control::ENABLE | Control::RESET, program: 1, ..Command::default() },
            events: Vec::new(),
            keep_back: 0,
            connected: true,
            at: Instant::ZERO,
            motions: Vec::new(),
            cycle,
        };
        driven.tick();
        driven.command.control = Control::ENABLE;
        assert_eq!(driven.feedback().state, State::Ready);
        driven
    }

    pub(crate) fn tick(&mut self) {
        let executed =
            if self.feedback().number == self.command.number { self.feedback().executed } else { 0 };
        let there = self.motions.len() - self.keep_back;
        while (self.command.written as usize) < there.min(executed as usize + SLOTS) {
            let index = self.command.written;
            self.command.set_slot(index, self.motions[index as usize]);
            self.command.written += 1;
        }
        self.command.life = self.command.life.wrapping_add(1);
        self.at += self.cycle;
        self.controller.tick(self.at, self.connected.then_some(&self.command));
        self.events.extend(core::iter::from_fn(|| self.controller.poll_event()));
    }

    pub(crate) fn run_ms(&mut self, ms: u64) {
        let until = self.at + Duration::from_millis(ms);
        while self.at < until {
            self.tick();
        }
    }

    /// Calls a skill with a new command number.
    pub(crate) fn call(&mut self, skill: Skill, motions: Vec<Motion>) {
        self.command = Command {
            control: Control::ENABLE | Control::EXECUTE,
            number: self.command.number + 1,
            skill,
            total: motions.len() as u32,
            written: 0,
            ..self.command
        };
        self.motions = motions;
    }

    /// Runs motions as one skill and waits for its end.
    #[track_caller]
    pub(crate) fn run(&mut self, motions: Vec<Motion>) {
        self.call(Skill::MoveContinuous, motions);
        self.wait_for_end();
    }

    /// What the PLC wants besides `enable` and `execute`.
    pub(crate) fn control(&mut self, more: Control) {
        self.command.control = Control::ENABLE | Control::EXECUTE | more;
    }

    #[track_caller]
    pub(crate) fn wait(&mut self, condition: impl Fn(&Feedback) -> bool) {
        let until = self.at + Duration::from_secs(120);
        while !condition(self.feedback()) {
            assert!(self.at < until, "waited in vain: {:?}", self.feedback());
            self.tick();
        }
    }

    #[track_caller]
    pub(crate) fn wait_for_end(&mut self) {
        let number = self.command.number;
        let ended = Status::DONE.0 | Status::ABORTED.0 | Status::ERROR.0;
        self.wait(|feedback| feedback.number == number && feedback.status.0 & ended != 0);
    }

    pub(crate) fn feedback(&self) -> &Feedback {
        self.controller.feedback()
    }

    pub(crate) fn is_done(&self) -> bool {
        self.feedback().status.contains(Status::DONE)
    }
}
