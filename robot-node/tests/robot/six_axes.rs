//! Setup B's six-axis arm: its application, its refusals, and its limits along random motions.

use std::time::Duration;

use machine::Instant;
use proptest::prelude::*;
use protocol::image::{Command, Control, ErrorNumber, Feedback, Motion, MotionKind, SLOTS, Skill, Status};
use robot_node::arm::{AXES, Joints};
use robot_node::motion::Segment;
use robot_node::{Controller, RobotConfig};

/// Largest allowed ratio to a limit: due to sampling and single precision.
const TOLERANCE: f64 = 1.001;

/// Returns Setup B with a controller whose skill calls take no time.
fn config() -> RobotConfig {
    RobotConfig {
        interpreter_quantum: Duration::ZERO,
        start_quantum: Duration::ZERO,
        continuous_start_cycles: 0,
        skill_overhead: Duration::ZERO,
        ..RobotConfig::from_setup(&setup::setup("B").unwrap()).unwrap()
    }
}

fn application() -> Vec<Motion> {
    let (setup, found) = planning::setup_with_application("B").unwrap();
    found.plan(&setup).unwrap().wire_motions(&setup)
}

/// Runs motions as one continuous motion and shows `watch` the joints of every cycle. Returns the last feedback.
fn run(config: RobotConfig, motions: &[Motion], mut watch: impl FnMut(&Joints)) -> Feedback {
    let cycle = config.cycle;
    let mut controller = Controller::new(config, Vec::new(), 1);
    let mut command = Command { control: Control::ENABLE | Control::RESET, ..Command::default() };
    let mut at = Instant::ZERO;
    controller.tick(at, Some(&command));
    command = Command {
        control: Control::ENABLE | Control::EXECUTE,
        number: 1,
        skill: Skill::MoveContinuous,
        total: motions.len() as u32,
        ..command
    };
    let ended = Status::DONE.0 | Status::ABORTED.0 | Status::ERROR.0;
    while controller.feedback().number != 1 || controller.feedback().status.0 & ended == 0 {
        let executed =
            if controller.feedback().number == 1 { controller.feedback().executed as usize } else { 0 };
        let written = command.written as usize;
        for (index, motion) in motions.iter().enumerate().take(executed + SLOTS).skip(written) {
            command.set_slot(index as u32, *motion);
            command.written += 1;
        }
        at += cycle;
        controller.tick(at, Some(&command));
        while controller.poll_event().is_some() {}
        watch(controller.joints());
        assert!(at < Instant::from_millis(200_000), "it never ends: {:?}", controller.feedback());
    }
    *controller.feedback()
}

/// Returns a motion to the pose of the flange at these joints.
fn to_joints(kind: MotionKind, joints: Joints) -> Motion {
    let target = config().arm.forward(&joints).to_mm_deg().map(|coordinate| coordinate as f32);
    Motion { kind, target, velocity: 1_000, acceleration: 2_000, ..Motion::EMPTY }
}

/// Returns the error, the number of its motion, and whether the arm has moved.
fn refused(home: Joints, motions: &[Motion]) -> (ErrorNumber, u32, bool) {
    let mut moved = false;
    let feedback = run(RobotConfig { home, ..config() }, motions, |joints| moved |= *joints != home);
    assert!(feedback.status.contains(Status::ERROR), "{feedback:?}");
    (feedback.error, feedback.error_motion, moved)
}

#[test]
fn the_arm_starts_where_the_application_ends_with_a_tenth_of_every_range_to_spare() {
    let limits = *config().arm.limits();
    let mut last = [0.0; AXES];
    let feedback = run(config(), &application(), |joints| {
        last = *joints;
        for (axis, joint) in joints.iter().enumerate() {
            let share = (joint - limits.lower[axis]) / (limits.upper[axis] - limits.lower[axis]);
            assert!((0.1..=0.9).contains(&share), "joint {} is at {joint}", axis + 1);
        }
    });
    assert!(feedback.status.contains(Status::DONE), "{feedback:?}");
    for (joint, home) in last.iter().zip(config().home) {
        assert!((joint - home).abs() < 1e-3, "home is {home}, the application ends at {joint}");
    }
}

#[test]
fn a_line_that_turns_the_wrist_over_is_refused_before_anything_moves() {
    let at = |q5: f64| [10.0, 20.0, 0.0, 0.0, q5, 0.0];
    let there = to_joints(MotionKind::LinCartesian, at(20.0));
    let over = to_joints(MotionKind::LinCartesian, at(-30.0));
    assert_eq!(refused(at(30.0), &[there, over]), (ErrorNumber::ConfigurationChange, 1, false));
    let error = Segment::prepare(&over, &at(30.0), &config()).unwrap_err();
    assert!(error.to_string().contains("would turn by 180.0°"), "{error}");
}

#[test]
fn a_target_out_of_reach_is_refused_with_the_motions_number_before_anything_moves() {
    let home = config().home;
    let mut far = *application().first().unwrap();
    far.target[2] = 500.0;
    let there = *application().first().unwrap();
    assert_eq!(refused(home, &[there, there, far]), (ErrorNumber::Unreachable, 2, false));
}

#[test]
fn a_line_on_which_a_joint_leaves_its_range_is_refused() {
    let at = |q5: f64| [10.0, -40.0, 30.0, 0.0, q5, 0.0];
    let beyond = to_joints(MotionKind::LinCartesian, at(124.0));
    assert_eq!(refused(at(100.0), &[beyond]), (ErrorNumber::AxisLimit, 0, false));
}

fn motion() -> impl Strategy<Value = Motion> {
    let place = (-60.0..330.0_f32, -60.0..110.0_f32, 10.0..170.0_f32);
    let angles = (-60.0..60.0_f32, -12.0..12.0_f32, 168.0..192.0_f32);
    let kind = prop_oneof![2 => Just(MotionKind::LinCartesian), 1 => Just(MotionKind::PtpCartesian)];
    let approximation = prop_oneof![Just(0_u16), 1..4_000_u16];
    (kind, place, angles, 0.02..1.0_f64, 0.1..1.0_f64, approximation).prop_map(
        |(kind, (x, y, z), (a, b, c), speed, acceleration, approximation)| {
            let point_to_point = kind.is_point_to_point();
            let (rated_speed, rated_acceleration) = if point_to_point { (1e4, 1e4) } else { (2e4, 5e3) };
            Motion {
                kind,
                target: [x, y, z, a, b, c],
                velocity: (speed * rated_speed) as u16,
                acceleration: (acceleration * rated_acceleration) as u16,
                approximation,
                base: 1,
                ..Motion::EMPTY
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn along_random_motions_every_joint_keeps_its_range_speed_and_acceleration(
        motions in proptest::collection::vec(motion(), 1..8),
    ) {
        let config = config();
        let (limits, dt) = (*config.arm.limits(), config.cycle.as_secs_f64());
        let arm = config.arm.clone();
        let (mut before, mut step) = (config.home, [0.0; AXES]);
        let (mut speed, mut acceleration, mut within) = (0.0_f64, 0.0_f64, true);
        let feedback = run(config, &motions, |joints| {
            let next: Joints = core::array::from_fn(|axis| joints[axis] - before[axis]);
            let change = core::array::from_fn(|axis| (next[axis] - step[axis]) / dt / dt);
            speed = speed.max(limits.speed_load(&next.map(|step| step / dt)).share);
            acceleration = acceleration.max(limits.acceleration_load(&change).share);
            within &= arm.within_range(joints).is_ok();
            (before, step) = (*joints, next);
        });
        if feedback.status.contains(Status::ERROR) {
            // At the edge of the reach, or with an axis 6 that earlier motions turned far, a motion that cannot be
            // driven is refused, never tried.
            let reasons = [
                ErrorNumber::Unreachable,
                ErrorNumber::Singular,
                ErrorNumber::ConfigurationChange,
                ErrorNumber::AxisLimit,
            ];
            prop_assert!(reasons.contains(&feedback.error), "{:?}", feedback);
        } else {
            prop_assert!(feedback.status.contains(Status::DONE), "{:?}", feedback);
            prop_assert_eq!(feedback.executed as usize, motions.len());
        }
        prop_assert!(within, "a joint left its range");
        prop_assert!(speed <= TOLERANCE, "{speed} of a rated speed");
        prop_assert!(acceleration <= TOLERANCE, "{acceleration} of a rated acceleration");
    }
}
