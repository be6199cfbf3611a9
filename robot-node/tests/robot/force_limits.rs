//! Random LIN forces, to and off a surface: every axis keeps its range, speed, acceleration and jerk.

use proptest::prelude::*;
use protocol::image::{Control, ErrorNumber, Motion, MotionKind, Skill, Status};
use robot_node::arm::{Joints, Surface};
use robot_node::{ForceControl, Program, RobotConfig};

use crate::driven::{Driven, bare, ptp};

/// How much of a limit may be exceeded: what sampling and single precision leave.
const TOLERANCE: f64 = 1.001;

/// Above what any axis of the arms allows, so that the axes' own limits are what holds.
const JERK_MM_S3: f64 = 1e7;

/// A line from one place to another, what it presses with, and the surface that it meets on its way.
#[derive(Clone, Debug)]
struct Pressing {
    from: [f32; 3],
    way: [f32; 3],
    velocity: u16,
    force_n: f32,
    stiffness_n_per_mm: f64,
    /// Where on the line the surface is, as a share of it; beyond 1 there is none.
    met_at: f64,
}

fn pressing() -> impl Strategy<Value = Pressing> {
    let from = (0.0..250.0_f32, -40.0..90.0_f32, 80.0..150.0_f32);
    let way = (-40.0..40.0_f32, -40.0..40.0_f32, -60.0..-15.0_f32);
    (from, way, 5..3_000_u16, 5.0..90.0_f32, 1.0..50.0_f64, 0.1..1.2_f64).prop_map(
        |((x, y, z), (dx, dy, dz), velocity, force_n, stiffness_n_per_mm, met_at)| Pressing {
            from: [x, y, z],
            way: [dx, dy, dz],
            velocity,
            force_n,
            stiffness_n_per_mm,
            met_at,
        },
    )
}

impl Pressing {
    fn config(&self, setup: &str) -> RobotConfig {
        let config = bare(setup);
        let base = config.bases[1].unwrap();
        let on_line =
            core::array::from_fn(|i| f64::from(self.from[i]) + self.met_at * f64::from(self.way[i]));
        let surface = Surface {
            point: base.point(on_line),
            normal: base.rotation.rotate(self.along(-1.0).map(f64::from)),
            radius_mm: f64::INFINITY,
            stiffness_n_per_mm: self.stiffness_n_per_mm,
        };
        let force = config.force.map(|force| ForceControl { jerk_mm_s3: JERK_MM_S3, ..force });
        RobotConfig { surfaces: vec![surface], force, ..config }
    }

    /// A vector along the line.
    fn along(&self, length: f32) -> [f32; 3] {
        let whole = self.way.iter().map(|part| part * part).sum::<f32>().sqrt();
        self.way.map(|part| part / whole * length)
    }

    fn motion(&self) -> Motion {
        let [x, y, z] = core::array::from_fn(|i| self.from[i] + self.way[i]);
        Motion {
            kind: MotionKind::LinForceCartesian,
            auxiliary: self.along(self.force_n),
            velocity: self.velocity,
            acceleration: 5_000,
            ..ptp(x, y, z)
        }
    }
}

/// The highest shares of rated speed, acceleration and jerk over a row of cycles.
struct Watched {
    robot: Driven,
    config: RobotConfig,
    last: [Joints; 4],
    loads: [f64; 3],
    is_within: bool,
}

impl Watched {
    fn tick(&mut self) {
        self.robot.tick();
        let joints = *self.robot.controller.joints();
        self.last.rotate_left(1);
        self.last[3] = joints;
        let ([a, b, c, d], dt) = (&self.last, self.config.cycle.as_secs_f64());
        let limits = self.config.arm.limits();
        let first = core::array::from_fn(|i| (d[i] - c[i]) / dt);
        let second = core::array::from_fn(|i| (d[i] - 2.0 * c[i] + b[i]) / (dt * dt));
        let third = core::array::from_fn(|i| (d[i] - 3.0 * (c[i] - b[i]) - a[i]) / (dt * dt * dt));
        let found = [limits.speed_load(&first), limits.acceleration_load(&second), limits.jerk_load(&third)];
        for (load, found) in self.loads.iter_mut().zip(found) {
            *load = load.max(found.share);
        }
        self.is_within &= self.config.arm.within_range(&joints).is_ok();
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn on_its_way_into_contact_and_off_it_every_axis_keeps_all_its_limits(
        pressing in pressing(),
        setup in prop_oneof![Just("A"), Just("B")],
        held_at in proptest::collection::vec(1..200_u32, 0..3),
        overrides in proptest::collection::vec((1..200_u32, prop_oneof![Just(0), 0..=100_u8]), 0..4),
    ) {
        let config = pressing.config(setup);
        let mut robot = Driven::ready(config.clone(), Program::default());
        let [x, y, z] = pressing.from;
        // The way there meets no surface: it is felt, and does not stop the arm.
        robot.run(vec![ptp(x, y, z)]);
        prop_assume!(robot.is_done());
        let joints = *robot.controller.joints();
        robot.call(Skill::MoveLinForceCartesian, vec![pressing.motion()]);
        let mut watched = Watched { robot, config, last: [joints; 4], loads: [0.0; 3], is_within: true };
        for ticks in held_at {
            (0..ticks).for_each(|_| watched.tick());
            watched.robot.control(Control::SUSPEND);
            (0..30).for_each(|_| watched.tick());
            watched.robot.control(Control::RESUME);
        }
        for (ticks, percent) in overrides {
            watched.robot.command.override_percent = percent;
            (0..ticks).for_each(|_| watched.tick());
        }
        watched.robot.command.override_percent = 100;
        let ended = Status::DONE.0 | Status::ERROR.0;
        let mut ticks = 0;
        while watched.robot.feedback().number != 2 || watched.robot.feedback().status.0 & ended == 0 {
            watched.tick();
            ticks += 1;
            prop_assert!(ticks < 100_000, "it never ends: {:?}", watched.robot.feedback());
        }
        let feedback = watched.robot.feedback();
        let expected = [ErrorNumber::None, ErrorNumber::ForceNotReached, ErrorNumber::VelocityOutOfRange];
        let refused = [ErrorNumber::Unreachable, ErrorNumber::Singular, ErrorNumber::AxisLimit];
        prop_assert!(expected.contains(&feedback.error) || refused.contains(&feedback.error), "{:?}", feedback);
        // The force is let go of by a motion that leaves it, and by a halt.
        watched.robot.command.control = Control::ENABLE | Control::HALT;
        (0..200).for_each(|_| watched.tick());
        prop_assert!(watched.is_within, "an axis left its range");
        for (load, rating) in watched.loads.iter().zip(["speed", "acceleration", "jerk"]) {
            prop_assert!(*load <= TOLERANCE, "{load} of a rated {rating}");
        }
    }
}
