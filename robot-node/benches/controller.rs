//! The controller's cycle at its largest load: motions are checked before a skill starts, and accepted while it runs.

#![expect(clippy::unwrap_used, reason = "a benchmark ends by panicking")]

use std::time::Duration;

use hot_path::{HotPaths, Steps};
use machine::Instant;
use planning::PROGRAM;
use protocol::image::{Command, Control, Motion, MotionKind, Skill, State};
use robot_node::{Controller, RobotConfig};

/// Motions of the program: more than are checked in one cycle, and more than fit into the queue.
const MOTIONS: usize = 16;

/// Passes over a run. For each cycle the fastest pass counts, which removes the influence of the host.
const PASSES: usize = 20;

fn main() {
    hot_path::main(|paths| {
        for (arm, setup) in [("SCARA", "A"), ("six axes", "B")] {
            for (name, kind) in [("LIN", MotionKind::LinCartesian), ("SPLINE", MotionKind::Spline)] {
                Cell::of(setup, kind).add(paths, &format!("{name}, {arm}"));
            }
        }
    });
}

/// A robot, and a program of motions to and fro.
#[derive(Clone)]
struct Cell {
    config: RobotConfig,
    motions: Vec<Motion>,
}

impl Cell {
    /// Builds a zigzag with rounded corners around the first line of the setup's application.
    fn of(setup: &str, kind: MotionKind) -> Self {
        let (setup, application) = planning::setup_with_application(setup).unwrap();
        let config = RobotConfig {
            interpreter_quantum: Duration::ZERO,
            start_quantum: Duration::ZERO,
            continuous_start_cycles: 0,
            skill_overhead: Duration::ZERO,
            ..RobotConfig::from_setup(&setup).unwrap()
        };
        let planned = application.plan(&setup).unwrap().wire_motions(&setup);
        let line = *planned.iter().find(|motion| motion.kind == MotionKind::LinCartesian).unwrap();
        let motions = (0..MOTIONS).map(|index| {
            let mut motion = Motion { kind, approximation: 300, ..line };
            motion.target[0] += 5.0 * index as f32;
            motion.target[1] += if index % 2 == 0 { 0.0 } else { 15.0 };
            motion
        });
        Self { config, motions: motions.collect() }
    }

    /// Runs the cycles of a whole run, one after another, from the one that accepts the command on.
    fn run(&self, mut cycle: impl FnMut(&mut Controller, Instant, &Command)) {
        let programs = vec![(PROGRAM, self.motions.clone().into())];
        let mut controller = Controller::new(self.config.clone(), programs, 1);
        let mut at = Instant::ZERO;
        let reset = Command { control: Control::ENABLE | Control::RESET, ..Command::default() };
        controller.tick(at, Some(&reset));
        let command = Command {
            control: Control::ENABLE | Control::EXECUTE,
            number: 1,
            skill: Skill::RunProgram,
            program: PROGRAM,
            ..Command::default()
        };
        while controller.feedback().number == 0 || controller.feedback().state == State::Running {
            at += self.config.cycle;
            cycle(&mut controller, at, &command);
            while controller.poll_event().is_some() {}
        }
        assert_eq!(controller.feedback().executed as usize, MOTIONS, "{:?}", controller.feedback());
    }

    /// Returns the controller before the cycle of this index, and that cycle's arguments.
    fn before(&self, index: usize) -> (Controller, Instant, Command) {
        let (mut found, mut next) = (None, 0);
        self.run(|controller, at, command| {
            if next == index {
                found = Some((controller.clone(), at, *command));
            }
            next += 1;
            controller.tick(at, Some(command));
        });
        found.unwrap()
    }

    /// Returns the first cycle after this index in which a motion is accepted while the arm moves.
    fn taking(&self) -> usize {
        let (mut index, mut found) = (0, None);
        self.run(|controller, at, command| {
            let before = controller.feedback().accepted;
            let moves = controller.feedback().path_speed > 0.0;
            controller.tick(at, Some(command));
            if found.is_none() && moves && controller.feedback().accepted > before {
                found = Some(index);
            }
            index += 1;
        });
        found.unwrap()
    }

    fn slowest(&self) -> usize {
        let mut steps = Steps::default();
        for _ in 0..PASSES {
            steps.begin();
            self.run(|controller, at, command| steps.time(|| controller.tick(at, Some(command))));
        }
        steps.slowest().unwrap()
    }

    fn add(&self, paths: &mut HotPaths, name: &str) {
        let group = "cycle of the controller";
        let tick = |(mut controller, at, command): (Controller, Instant, Command)| {
            controller.tick(at, Some(&command));
            controller
        };
        for (what, index) in [("checks motions", 0), ("takes a motion", self.taking())] {
            let ready = self.before(index);
            paths.add(group, format!("{what}, {name}"), move || ready.clone(), tick);
        }
        let ready = self.before(self.slowest());
        paths.add_timed(group, format!("worst, {name}"), move || ready.clone(), tick);
    }
}
