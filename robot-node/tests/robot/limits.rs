//! Random sequences of motions: the arm's limits, the corners and the counts hold for all of them.

use std::time::Duration;

use machine::Instant;
use proptest::prelude::*;
use protocol::image::{Command, Control, Feedback, Motion, MotionKind, SLOTS, Skill, State, Status};
use robot_node::arm::{AXES, AxisLimits, Joints, distance};
use robot_node::motion::{Blend, Curve, Segment};
use robot_node::{Controller, RobotConfig};

use crate::plc::config;

/// How much of a limit may be exceeded: what sampling and single precision leave.
const TOLERANCE: f64 = 1.001;

/// Any motion within the part of base 1 that the arm reaches along every line.
fn motion() -> impl Strategy<Value = Motion> {
    let place = (-80.0..350.0_f32, -60.0..120.0_f32, 10.0..150.0_f32, -60.0..60.0_f32);
    let kind = prop_oneof![Just(MotionKind::LinCartesian), Just(MotionKind::PtpCartesian)];
    let approximation = prop_oneof![Just(0_u16), 1..4_000_u16];
    (kind, place, 0.02..1.0_f64, 0.1..1.0_f64, approximation).prop_map(
        |(kind, (x, y, z, a), speed, acceleration, approximation)| {
            let point_to_point = kind.is_point_to_point();
            let (rated_speed, rated_acceleration) = if point_to_point { (1e4, 1e4) } else { (2e4, 5e3) };
            Motion {
                kind,
                target: [x, y, z, a, 0.0, 180.0],
                velocity: (speed * rated_speed) as u16,
                acceleration: (acceleration * rated_acceleration) as u16,
                approximation,
                base: 1,
                ..Motion::EMPTY
            }
        },
    )
}

/// A motion to a circle within that part, and the circle.
fn circle() -> impl Strategy<Value = Vec<Motion>> {
    let centre = (0.0..270.0_f32, 0.0..60.0_f32, 65.0..95.0_f32);
    let plane = (10.0..50.0_f32, 0.0..6.2_f32, 0.0..6.2_f32);
    let turns = (0.1..0.9_f32, 0.3..5.5_f32);
    (motion(), motion(), centre, plane, turns).prop_map(
        |(to_start, limits, (x, y, z), (radius, turn, tilt), (middle, end))| {
            let at = |angle: f32| {
                let (across, along) = (radius * libm::cosf(angle), radius * libm::sinf(angle));
                [
                    x + across * libm::cosf(turn) - along * libm::sinf(turn) * libm::cosf(tilt),
                    y + across * libm::sinf(turn) + along * libm::cosf(turn) * libm::cosf(tilt),
                    z + along * libm::sinf(tilt),
                ]
            };
            let with = |motion: Motion, [x, y, z]: [f32; 3]| {
                let [_, _, _, a, b, c] = motion.target;
                Motion { target: [x, y, z, a, b, c], ..motion }
            };
            let limits = if limits.kind.is_point_to_point() {
                Motion { velocity: limits.velocity * 2, acceleration: limits.acceleration / 2, ..limits }
            } else {
                limits
            };
            let circle = Motion { kind: MotionKind::Circular, auxiliary: at(middle * end), ..limits };
            vec![with(to_start, at(0.0)), with(circle, at(end))]
        },
    )
}

fn bare() -> RobotConfig {
    RobotConfig { interpreter_quantum: Duration::ZERO, skill_overhead: Duration::ZERO, ..config() }
}

/// A controller that is fed as a PLC would, and watched every cycle.
struct Watched {
    controller: Controller,
    command: Command,
    motions: Vec<Motion>,
    at: Instant,
    joints: Joints,
    step: Joints,
    limits: AxisLimits,
    /// The highest share of a rated speed, and of a rated acceleration, so far.
    loads: [f64; 2],
}

impl Watched {
    fn start(motions: Vec<Motion>) -> Self {
        let config = bare();
        let mut watched = Self {
            joints: config.home,
            limits: *config.arm.limits(),
            controller: Controller::new(config, Vec::new(), 1),
            command: Command { control: Control::ENABLE | Control::RESET, ..Command::default() },
            motions,
            at: Instant::ZERO,
            step: [0.0; AXES],
            loads: [0.0; 2],
        };
        watched.tick();
        watched.command = Command {
            control: Control::ENABLE | Control::EXECUTE,
            number: 1,
            skill: Skill::MoveContinuous,
            total: watched.motions.len() as u32,
            ..watched.command
        };
        watched
    }

    fn tick(&mut self) {
        let cycle = Duration::from_millis(4);
        let executed = if self.feedback().number == 1 { self.feedback().executed as usize } else { 0 };
        let written = self.command.written as usize;
        for (index, motion) in self.motions.iter().enumerate().take(executed + SLOTS).skip(written) {
            if self.command.number == 1 {
                self.command.set_slot(index as u32, *motion);
                self.command.written += 1;
            }
        }
        self.at += cycle;
        self.controller.tick(self.at, Some(&self.command));
        while self.controller.poll_event().is_some() {}
        let dt = cycle.as_secs_f64();
        let joints = *self.controller.joints();
        let step: Joints = core::array::from_fn(|axis| joints[axis] - self.joints[axis]);
        let change: Joints = core::array::from_fn(|axis| step[axis] - self.step[axis]);
        let limits = &self.limits;
        self.loads[0] = self.loads[0].max(limits.speed_load(&step.map(|step| step / dt)).share);
        self.loads[1] =
            self.loads[1].max(limits.acceleration_load(&change.map(|change| change / dt / dt)).share);
        (self.joints, self.step) = (joints, step);
    }

    fn feedback(&self) -> &Feedback {
        self.controller.feedback()
    }

    fn ended(&self) -> bool {
        let ended = Status::DONE.0 | Status::ABORTED.0 | Status::ERROR.0;
        self.feedback().number == 1 && self.feedback().status.0 & ended != 0
    }

    fn keeps_limits(&self) -> Result<(), TestCaseError> {
        let [speed, acceleration] = self.loads;
        prop_assert!(speed <= TOLERANCE, "{speed} of a rated speed");
        prop_assert!(acceleration <= TOLERANCE, "{acceleration} of a rated acceleration");
        Ok(())
    }
}

/// Runs motions that are written in time to their end.
fn run_whole(motions: &[Motion]) -> Result<(), TestCaseError> {
    let mut watched = Watched::start(motions.to_vec());
    let mut executed = 0;
    while !watched.ended() {
        watched.tick();
        let feedback = watched.feedback();
        prop_assert!(feedback.executed >= executed && feedback.executed <= executed + 2);
        prop_assert!(feedback.accepted <= feedback.executed + SLOTS as u32);
        executed = feedback.executed;
        prop_assert!(watched.at < Instant::from_millis(200_000), "it never ends");
    }
    let feedback = watched.feedback();
    prop_assert!(feedback.status.contains(Status::DONE), "{:?}", feedback);
    prop_assert_eq!(feedback.executed as usize, motions.len());
    prop_assert_eq!(feedback.blends_suppressed, 0, "every motion was there in time");
    let target = motions.last().unwrap_or(&Motion::EMPTY).target;
    for (is, wanted) in feedback.pose.iter().zip(target).take(3) {
        prop_assert!((is - wanted).abs() < 1e-3, "{is} is not {wanted}");
    }
    watched.keeps_limits()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_sequence_ends_at_its_last_target_within_all_limits(
        motions in proptest::collection::vec(motion(), 1..12),
    ) {
        run_whole(&motions)?;
    }

    #[test]
    fn so_does_every_sequence_with_splines(
        motions in proptest::collection::vec((motion(), 0..4_u8), 2..12),
    ) {
        let motions: Vec<Motion> = motions
            .into_iter()
            .map(|(motion, kind)| match kind {
                0 => motion,
                _ if motion.kind.is_point_to_point() => Motion {
                    kind: MotionKind::Spline,
                    velocity: motion.velocity * 2,
                    acceleration: motion.acceleration / 2,
                    ..motion
                },
                _ => Motion { kind: MotionKind::Spline, ..motion },
            })
            .collect();
        run_whole(&motions)?;
    }

    #[test]
    fn so_does_every_sequence_with_circles(circles in proptest::collection::vec(circle(), 1..5)) {
        run_whole(&circles.concat())?;
    }

    #[test]
    fn suspend_override_and_halt_keep_the_limits_at_any_moment(
        motions in proptest::collection::vec(motion(), 2..8),
        events in proptest::collection::vec((1..80_u32, 0..5_u8), 1..12),
    ) {
        let mut watched = Watched::start(motions);
        for (ticks, event) in events {
            for _ in 0..ticks {
                watched.tick();
            }
            let control = Control::ENABLE | Control::EXECUTE;
            match event {
                0 => watched.command.control = control | Control::SUSPEND,
                1 => watched.command.control = control | Control::RESUME,
                2 => watched.command.override_percent = 30,
                3 => watched.command.override_percent = 0,
                _ => watched.command.override_percent = 100,
            }
        }
        watched.command.control = Control::ENABLE | Control::HALT;
        let halted_at = watched.at;
        while watched.feedback().state != State::Halted {
            watched.tick();
            prop_assert!(watched.at.since(halted_at) < Duration::from_secs(2), "it does not stop");
        }
        prop_assert_eq!(watched.step, [0.0; AXES]);
        watched.keeps_limits()?;
    }

    #[test]
    fn a_corner_stays_within_its_distance_and_does_not_dip(
        (first, second, start) in (motion(), motion(), motion()),
    ) {
        let config = bare();
        let arm = &config.arm;
        let prepare = |motion: &Motion, from: &Joints| Segment::prepare(motion, from, &config).unwrap_or_else(|violation| panic!("{violation}"));
        let start = prepare(&start, &config.home).end;
        let first = prepare(&first, &start);
        let second = prepare(&second, &first.end);
        let Some(blend) = Blend::between(&first, &second, 1.0, arm) else { return Ok(()) };
        prop_assert!(blend.distance_mm <= first.approximation_mm);
        prop_assert!(blend.from_zone <= first.curve.length() / 2.0 && blend.to_zone <= second.curve.length() / 2.0);

        let corner = arm.forward(&first.end).position;
        let steps = 400;
        let dt = 1.0 / f64::from(steps);
        let mut near = first.end;
        let mut places = Vec::new();
        for step in 0..=steps {
            near = blend.joints(&first, &second, f64::from(step) * dt, arm, &near).unwrap_or_else(|violation| panic!("{violation}"));
            let tool = arm.forward(&near).position;
            prop_assert!(distance(tool, corner) <= blend.distance_mm * TOLERANCE);
            places.push((near, tool));
        }
        let speeds: Vec<f64> = places.windows(2).map(|two| distance(two[0].1, two[1].1) / dt).collect();
        if let (Curve::Line(_), Curve::Line(_)) = (&first.curve, &second.curve) {
            // The velocity turns along the chord between both: it is never slower than where that comes nearest to a stop.
            let [one, other] = [0, speeds.len() - 1].map(|end| {
                let (a, b) = (places[end].1, places[end + 1].1);
                core::array::from_fn::<f64, 3, _>(|i| (b[i] - a[i]) / dt)
            });
            let chord = core::array::from_fn::<f64, 3, _>(|i| other[i] - one[i]);
            let along = |from: [f64; 3]| (0..3).map(|i| from[i] * chord[i]).sum::<f64>();
            let nearest = (-along(one) / along(chord).max(1e-9)).clamp(0.0, 1.0);
            let least = distance(core::array::from_fn(|i| one[i] + nearest * chord[i]), [0.0; 3]);
            prop_assert!(speeds.iter().all(|speed| *speed >= least * 0.98 - 1e-3), "{speeds:?} dips below {least}");
        }
    }
}
