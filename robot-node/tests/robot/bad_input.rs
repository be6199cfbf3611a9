//! Motions that cannot be run: they are refused before anything moves, or in a stream after the last good one, with
//! the motion's number, the quantity and its limit.

use std::fmt::Write;

use machine::wire::BigEndian;
use protocol::image::{
    Configuration, ErrorNumber, Feedback, IMAGE_LEN, Motion, MotionKind, Skill, State, Status,
};
use robot_node::{Program, RobotConfig};

use crate::driven::{Driven, bare, lin, press, ptp};

/// Returns a good motion, changed into a bad one.
fn but(good: Motion, change: impl FnOnce(&mut Motion)) -> Motion {
    let mut motion = good;
    change(&mut motion);
    motion
}

fn configured(motion: Motion, status: u8, turn: u8) -> Motion {
    Motion { configuration: Some(Configuration { status, turn: Some(turn) }), ..motion }
}

fn circle(x: f32, y: f32, through: [f32; 3]) -> Motion {
    Motion { kind: MotionKind::Circular, auxiliary: through, ..lin(x, y, 90.0) }
}

/// Returns motions from (0, 40, 90) in base 1 of Setup A that are bad in one way each.
fn cases() -> Vec<(&'static str, Motion, ErrorNumber)> {
    // Longer than a screen, because it is one table of cases.
    let good = lin(50.0, 40.0, 90.0);
    let down = |force| Motion { target: [0.0, 40.0, 60.0, 0.0, 0.0, 180.0], ..press(60.0, force) };
    vec![
        ("out of reach", lin(0.0, -900.0, 90.0), ErrorNumber::Unreachable),
        ("out of reach, point to point", ptp(0.0, -900.0, 90.0), ErrorNumber::Unreachable),
        ("tilted", but(good, |it| it.target[4] = 10.0), ErrorNumber::Unreachable),
        ("outside an axis limit", lin(0.0, 40.0, 176.0), ErrorNumber::AxisLimit),
        (
            "outside an axis limit by joints",
            Motion {
                kind: MotionKind::PtpJoint,
                target: [140.0, 0.0, 100.0, 0.0, 0.0, 0.0],
                ..ptp(0.0, 0.0, 0.0)
            },
            ErrorNumber::AxisLimit,
        ),
        ("of no length", lin(0.0, 40.0, 90.0), ErrorNumber::ZeroLength),
        (
            "a circle of collinear points",
            circle(100.0, 40.0, [50.0, 40.0, 90.0]),
            ErrorNumber::CollinearCircle,
        ),
        ("a circle back to its start", circle(0.0, 40.0, [50.0, 60.0, 90.0]), ErrorNumber::ZeroLength),
        (
            "a spline of no length",
            but(lin(0.0, 40.0, 90.0), |it| it.kind = MotionKind::Spline),
            ErrorNumber::ZeroLength,
        ),
        ("an unknown tool", but(good, |it| it.tool = 3), ErrorNumber::UnknownTool),
        ("an unknown base", but(good, |it| it.base = 7), ErrorNumber::UnknownBase),
        ("velocity 0", but(good, |it| it.velocity = 0), ErrorNumber::VelocityOutOfRange),
        ("velocity too high", but(good, |it| it.velocity = 20_001), ErrorNumber::VelocityOutOfRange),
        (
            "velocity too high, point to point",
            but(ptp(50.0, 40.0, 90.0), |it| it.velocity = 10_001),
            ErrorNumber::VelocityOutOfRange,
        ),
        ("acceleration 0", but(good, |it| it.acceleration = 0), ErrorNumber::AccelerationOutOfRange),
        (
            "acceleration too high",
            but(good, |it| it.acceleration = 5_001),
            ErrorNumber::AccelerationOutOfRange,
        ),
        (
            "deceleration too high",
            but(good, |it| it.deceleration = 5_001),
            ErrorNumber::DecelerationOutOfRange,
        ),
        (
            "deceleration too high, point to point",
            but(ptp(50.0, 40.0, 90.0), |it| it.deceleration = 10_001),
            ErrorNumber::DecelerationOutOfRange,
        ),
        ("jerk too high", but(good, |it| it.jerk = 50_001), ErrorNumber::JerkOutOfRange),
        (
            "jerk too high, point to point",
            but(ptp(50.0, 40.0, 90.0), |it| it.jerk = 10_001),
            ErrorNumber::JerkOutOfRange,
        ),
        (
            "a status that the arm does not have",
            configured(ptp(50.0, 40.0, 90.0), 4, 0),
            ErrorNumber::ConfigurationMismatch,
        ),
        (
            "a turn of a linear axis",
            configured(ptp(50.0, 40.0, 90.0), 2, 1 << 2),
            ErrorNumber::ConfigurationMismatch,
        ),
        ("a line that does not change the elbow", configured(good, 2, 0), ErrorNumber::ConfigurationMismatch),
        (
            "a configuration beside joints",
            configured(Motion { kind: MotionKind::PtpJoint, ..good }, 2, 0),
            ErrorNumber::ConfigurationMismatch,
        ),
        ("not a number", but(good, |it| it.target[1] = f32::NAN), ErrorNumber::TargetNotFinite),
        ("infinite", but(good, |it| it.target[5] = f32::INFINITY), ErrorNumber::TargetNotFinite),
        (
            "a circle through infinity",
            circle(100.0, 40.0, [f32::NEG_INFINITY, 0.0, 90.0]),
            ErrorNumber::TargetNotFinite,
        ),
        ("an empty slot", Motion::EMPTY, ErrorNumber::UnknownMotionKind),
        (
            "an unknown kind",
            but(good, |it| it.kind = MotionKind::Unknown(99)),
            ErrorNumber::UnknownMotionKind,
        ),
        ("force 0", down(0.0), ErrorNumber::ForceOutOfRange),
        ("force too high", down(100.5), ErrorNumber::ForceOutOfRange),
        ("force not a number", down(f32::NAN), ErrorNumber::TargetNotFinite),
        ("force against the line", down(-25.0), ErrorNumber::ForceDirection),
        (
            "force across the line",
            but(down(0.0), |it| it.auxiliary = [25.0, 0.0, 0.0]),
            ErrorNumber::ForceDirection,
        ),
        (
            "force approached too fast",
            but(down(25.0), |it| it.velocity = 2_500),
            ErrorNumber::VelocityOutOfRange,
        ),
        ("force of no length", but(down(25.0), |it| it.target[2] = 90.0), ErrorNumber::ZeroLength),
    ]
}

/// Returns what the PLC reads from the image.
fn over_the_wire(feedback: &Feedback) -> Feedback {
    let mut image = [0; IMAGE_LEN];
    feedback.emit::<BigEndian>(&mut image);
    Feedback::parse::<BigEndian>(&image).unwrap()
}

fn at_the_start() -> Driven {
    let mut robot = Driven::ready(bare("A"), Program::default());
    robot.run(vec![ptp(0.0, 40.0, 90.0)]);
    robot
}

#[test]
fn each_is_refused_before_anything_moves_with_number_quantity_and_limit() {
    let mut words = String::new();
    for (what, motion, error) in cases() {
        let mut robot = at_the_start();
        let before = *robot.controller.joints();
        let way = [lin(20.0, 40.0, 90.0), lin(0.0, 40.0, 90.0)];
        robot.run(vec![way[0], way[1], motion]);
        let feedback = over_the_wire(robot.feedback());
        assert_eq!((feedback.error, feedback.error_motion), (error, 2), "{what}");
        assert_eq!((feedback.state, feedback.executed), (State::Halted, 0), "{what}");
        assert_eq!(*robot.controller.joints(), before, "{what}: it moved");
        let _ = writeln!(words, "{what}: {}", feedback.finding.in_words(feedback.error));
    }
    insta::assert_snapshot!("refused_in_words", words);
}

#[test]
fn in_a_stream_the_run_stops_exactly_after_the_last_good_motion() {
    for (what, motion, error) in cases() {
        let mut robot = at_the_start();
        let mut motions: Vec<Motion> = (1..=8)
            .map(|step| Motion {
                approximation: 500,
                ..lin(if step % 2 == 1 { 20.0 } else { 0.0 }, 40.0, 90.0)
            })
            .collect();
        motions.push(motion);
        motions.push(lin(20.0, 40.0, 90.0));
        robot.run(motions);
        let feedback = over_the_wire(robot.feedback());
        assert_eq!((feedback.error, feedback.error_motion), (error, 8), "{what}");
        assert_eq!((feedback.state, feedback.executed), (State::Halted, 8), "{what}");
        assert!(feedback.status.contains(Status::AT_REST | Status::ERROR), "{what}");
        let [x, y, z, ..] = feedback.pose;
        assert!(
            x.abs() < 1e-3 && (y - 40.0).abs() < 1e-3 && (z - 90.0).abs() < 1e-3,
            "{what}: ({x}, {y}, {z})"
        );
    }
}

#[test]
fn a_bad_motion_behind_a_lin_force_is_also_refused_before_anything_moves() {
    let mut robot = at_the_start();
    let before = *robot.controller.joints();
    let down = Motion { target: [0.0, 40.0, 60.0, 0.0, 0.0, 180.0], ..press(60.0, 25.0) };
    robot.run(vec![down, lin(0.0, 40.0, 90.0), lin(0.0, -900.0, 90.0)]);
    assert_eq!((robot.feedback().error, robot.feedback().error_motion), (ErrorNumber::Unreachable, 2));
    assert_eq!(*robot.controller.joints(), before);
}

#[test]
fn a_bad_motion_in_a_program_is_refused_before_anything_moves_however_late_it_comes() {
    let mut motions = vec![ptp(0.0, 40.0, 90.0)];
    motions.extend((1..=30).map(|step| lin(if step % 2 == 1 { 20.0 } else { 0.0 }, 40.0, 90.0)));
    motions.push(lin(0.0, 40.0, 176.0));
    let mut robot = Driven::ready(bare("A"), motions.into());
    let before = *robot.controller.joints();
    robot.call(Skill::RunProgram, Vec::new());
    robot.wait_for_end();
    assert_eq!((robot.feedback().error, robot.feedback().error_motion), (ErrorNumber::AxisLimit, 31));
    assert_eq!(*robot.controller.joints(), before);
}

#[test]
fn a_robot_without_a_force_controller_refuses_lin_force_with_that_reason() {
    let mut robot = Driven::ready(RobotConfig { force: None, ..bare("A") }, Program::default());
    robot.run(vec![ptp(100.0, 40.0, 20.0), press(5.0, 25.0)]);
    assert_eq!(
        (robot.feedback().error, robot.feedback().error_motion),
        (ErrorNumber::MotionKindNotSupported, 1)
    );
}

#[test]
fn a_line_through_a_singular_position_is_refused_on_six_axes() {
    let mut config = bare("B");
    // The wrist is nearly stretched: on a line across it, joints 4 and 6 would have to turn in opposite directions at
    // once.
    config.home = [0.0, 0.0, 0.0, 0.0, 0.3, 0.0];
    let flange = config.arm.forward(&config.home).to_mm_deg().map(|coordinate| coordinate as f32);
    let mut target = flange;
    target[1] += 2.0;
    let mut robot = Driven::ready(config, Program::default());
    let before = *robot.controller.joints();
    robot.run(vec![Motion { target, base: 0, velocity: 20_000, ..lin(0.0, 0.0, 0.0) }]);
    let feedback = *robot.feedback();
    assert_eq!(feedback.error, ErrorNumber::Singular, "{feedback:?}");
    assert!(feedback.finding.value() < feedback.finding.lower(), "{:?}", feedback.finding);
    assert_eq!(*robot.controller.joints(), before);
}

/// A zone covers at most half of the shorter adjacent motion, as in common robot controllers: a larger one is not an
/// error but shrinks. The plan warns of it, and so does the bench before a run.
#[test]
fn a_blend_larger_than_its_motions_shrinks_and_the_run_succeeds() {
    let mut robot = at_the_start();
    let large = Motion { approximation: 60_000, ..lin(20.0, 40.0, 90.0) };
    robot.run(vec![large, lin(20.0, 60.0, 90.0)]);
    assert!(robot.is_done(), "{:?}", robot.feedback());
}
