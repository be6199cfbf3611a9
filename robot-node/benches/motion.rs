//! The robot's motions: the cost of appending one to the path, and of a tick of interpolation.

#![expect(clippy::unwrap_used, reason = "a benchmark ends by panicking")]

use std::hint::black_box;

use hot_path::{HotPaths, Steps};
use protocol::image::{Motion, MotionKind};
use robot_node::RobotConfig;
use robot_node::motion::Interpolator;

/// Number of motions already on the path: as many as the controller keeps.
const AHEAD: usize = 5;

/// Number of ticks of which the mean is measured: fewer than the shortest path takes.
const TICKS: usize = 500;

/// Passes over a path. For each tick the fastest pass counts, which removes the influence of the host.
const PASSES: usize = 20;

fn main() {
    hot_path::main(|paths| {
        for (arm, setup) in [("SCARA", "A"), ("six axes", "B")] {
            let cell = Cell::of(setup);
            for (name, kind) in [
                ("LIN", MotionKind::LinCartesian),
                ("PTP", MotionKind::PtpCartesian),
                ("CIRC", MotionKind::Circular),
                ("SPLINE", MotionKind::Spline),
            ] {
                cell.add_append(paths, format!("{name}, {arm}"), kind);
            }
            cell.add_ticks(paths, arm);
        }
        Cell::past_the_shoulder().add_run(paths, "past the shoulder, six axes");
    });
}

/// A robot and its path.
#[derive(Clone)]
struct Cell {
    config: RobotConfig,
    motions: Vec<Motion>,
}

impl Cell {
    /// Builds the robot of a setup with the paper's application, and one circle and two splines to and fro before its
    /// end.
    fn of(setup: &str) -> Self {
        let (setup, application) = planning::setup_with_application(setup).unwrap();
        let config = RobotConfig::from_setup(&setup).unwrap();
        let mut motions = application.plan(&setup).unwrap().wire_motions(&setup);
        let line = *motions.iter().find(|motion| motion.kind == MotionKind::LinCartesian).unwrap();
        let shifted = |by: f32| {
            let [x, y, z, a, b, c] = line.target;
            [x, y + by, z, a, b, c]
        };
        let [x, y, z, ..] = line.target;
        let circle = Motion {
            kind: MotionKind::Circular,
            target: shifted(20.0),
            auxiliary: [x + 10.0, y + 10.0, z],
            ..line
        };
        let spline = |by| Motion { kind: MotionKind::Spline, target: shifted(by), ..line };
        let after = motions.iter().position(|motion| motion.kind == MotionKind::LinCartesian).unwrap() + 1;
        motions.splice(after..after, [circle, spline(10.0), spline(0.0)]);
        Self { config, motions }
    }

    /// Builds the robot of Setup B with a line to and fro whose wrist passes 15 mm beside the axis of the shoulder: its law is
    /// refined while the arm drives.
    fn past_the_shoulder() -> Self {
        let mut config = RobotConfig::from_setup(&setup::setup("B").unwrap()).unwrap();
        config.home = [129.468_111, -74.105_949, 9.926_228, 41.132_742, -34.594_851, -211.373_507];
        let there = [-54.257_744, 62.464_966, 660.738_65, -46.499_63, 3.246_816, -21.758_856];
        let back = config.arm.forward(&config.home).to_mm_deg().map(|coordinate| coordinate as f32);
        let line = |target| Motion {
            kind: MotionKind::LinCartesian,
            target,
            velocity: 19_544,
            acceleration: 4_075,
            ..Motion::EMPTY
        };
        Self { config, motions: [there, back, there].map(line).to_vec() }
    }

    fn at_rest(&self) -> Interpolator {
        let config = &self.config;
        Interpolator::at_rest(config.arm.clone(), config.home, config.cycle.as_secs_f64())
    }

    fn append(&self, interpolator: &mut Interpolator, index: usize) {
        let segment = interpolator.path().prepare(&self.motions[index], &self.config).unwrap();
        black_box(interpolator.append(segment, index + 1 == self.motions.len()));
    }

    /// Returns a path with as many motions as fit before the one of this index.
    fn before(&self, index: usize) -> Interpolator {
        let mut interpolator = self.at_rest();
        for before in 0..index {
            while before > AHEAD && (interpolator.path().executed() as usize) < before - AHEAD {
                interpolator.drive(1.0).unwrap();
            }
            self.append(&mut interpolator, before);
        }
        interpolator
    }

    fn add_append(&self, paths: &mut HotPaths, name: String, kind: MotionKind) {
        let index = self.motions.iter().rposition(|motion| motion.kind == kind).unwrap();
        let (cell, ready) = (self.clone(), self.before(index));
        paths.add(
            "append a motion",
            name,
            move || ready.clone(),
            move |mut interpolator| {
                cell.append(&mut interpolator, index);
                interpolator
            },
        );
    }

    /// Drives along the path, or for this many ticks, each by `tick`. The path is kept full.
    fn drive(&self, ticks: usize, mut tick: impl FnMut(&mut Interpolator)) -> Interpolator {
        let mut interpolator = self.at_rest();
        let mut next = 0;
        for _ in 0..ticks {
            if next == self.motions.len() && interpolator.path().is_finished() {
                break;
            }
            while next < self.motions.len() && next < interpolator.path().executed() as usize + AHEAD {
                self.append(&mut interpolator, next);
                next += 1;
            }
            tick(&mut interpolator);
        }
        interpolator
    }

    /// The mean of a tick, including its share of the cost of appending motions.
    fn add_run(&self, paths: &mut HotPaths, name: &str) {
        let cell = self.clone();
        let run = move |()| {
            cell.drive(TICKS, |interpolator| {
                interpolator.drive(1.0).unwrap();
            })
        };
        paths.add("interpolation", format!("{TICKS} ticks of a run, {name}"), || (), run);
    }

    fn add_ticks(&self, paths: &mut HotPaths, arm: &str) {
        self.add_run(paths, arm);
        let worst = self.worst_tick();
        let cell = self.clone();
        let before_worst = move || {
            let mut ready = None;
            let mut tick = 0;
            cell.drive(usize::MAX, |interpolator| {
                if tick == worst {
                    ready = Some(interpolator.clone());
                }
                tick += 1;
                interpolator.drive(1.0).unwrap();
            });
            ready.unwrap()
        };
        let ready = before_worst();
        paths.add_timed(
            "interpolation",
            format!("worst tick, {arm}"),
            move || ready.clone(),
            |mut interpolator| {
                interpolator.drive(1.0).unwrap();
                interpolator
            },
        );
    }

    /// Returns the index of the tick that takes longest.
    fn worst_tick(&self) -> usize {
        let mut steps = Steps::default();
        for _ in 0..PASSES {
            steps.begin();
            self.drive(usize::MAX, |interpolator| {
                steps.time(|| interpolator.drive(1.0)).unwrap();
            });
        }
        steps.slowest().unwrap()
    }
}
