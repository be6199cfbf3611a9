//! Skills from the command image to the arm's rest, in virtual time.

use protocol::image::{Control, ErrorNumber, Feedback, Motion, MotionKind, Skill, State, Status};
use robot_node::RobotEvent;
use robot_node::motion::{Programmed, Segment};

use crate::plc::{self, Cell, application, lin, ptp};

#[test]
fn a_reset_leads_from_halted_to_ready_once_enabled() {
    let mut cell = Cell::new(Vec::new());
    assert_eq!(cell.feedback().state, State::Halted);
    cell.control(Control::RESET);
    cell.run_ms(20);
    assert_eq!(cell.feedback().state, State::Halted, "without `enable` nothing may move");
    cell.control(Control::ENABLE | Control::RESET);
    cell.run_ms(20);
    assert_eq!(cell.feedback().state, State::Ready);
}

#[test]
fn a_program_and_the_same_motions_from_the_plc_end_where_they_started() {
    let home = plc::config().home;
    for skill in [Skill::RunProgram, Skill::MoveContinuous] {
        let mut cell = Cell::ready(application());
        cell.call(skill, application());
        cell.wait_for_end();
        let feedback = *cell.feedback();
        assert!(feedback.status.contains(Status::DONE | Status::AT_REST), "{feedback:?}");
        assert_eq!((feedback.executed, feedback.accepted, feedback.blends_suppressed), (13, 13, 0));
        assert_eq!(feedback.state, State::Ready);
        for (joint, home) in feedback.joints.iter().zip(home) {
            assert!((f64::from(*joint) - home).abs() < 1e-3, "{joint} is not {home}");
        }
    }
}

#[test]
fn single_skills_run_one_motion_each() {
    let mut cell = Cell::ready(Vec::new());
    for motion in application() {
        let skill = u8::from(motion.kind).into();
        cell.call(skill, vec![motion]);
        cell.wait_for_end();
        assert!(cell.feedback().status.contains(Status::DONE), "{:?}", cell.feedback());
        assert_eq!(cell.feedback().executed, 1);
        for (is, target) in cell.feedback().pose.iter().zip(motion.target).take(3) {
            assert!((is - target).abs() < 1e-3);
        }
    }
}

#[test]
fn a_motion_without_length_in_another_base_shows_the_pose_in_that_base() {
    let mut cell = Cell::ready(Vec::new());
    let root = cell.feedback().pose;
    let here =
        Motion { kind: MotionKind::PtpJoint, target: cell.feedback().joints, ..ptp(0.0, 0.0, 90.0, 0) };
    cell.call(Skill::MovePtpJoint, vec![Motion { base: 1, ..here }]);
    cell.wait_for_end();
    assert!(cell.feedback().status.contains(Status::DONE), "{:?}", cell.feedback());
    // Base 1 of Setup A is turned by 90 degrees at (300, -150, 25).
    let in_base = [root[1] + 150.0, 300.0 - root[0], root[2] - 25.0];
    for (is, target) in cell.feedback().pose.iter().zip(in_base) {
        assert!((is - target).abs() < 1e-3, "{:?} is not {in_base:?}", cell.feedback().pose);
    }
}

#[test]
fn a_segment_has_what_its_motion_is_programmed_with_and_the_robots_own_where_nothing_is() {
    let config = plc::config();
    let programmed = |motion: Motion| Segment::prepare(&motion, &config.home, &config).unwrap().programmed;
    let line = Motion { velocity: 2_500, acceleration: 2_000, ..lin(0.0, 0.0, 90.0, 0) };
    let own = Programmed { speed: 250.0, acceleration: 2_000.0, deceleration: 2_000.0, jerk: 500_000.0 };
    assert_eq!(programmed(line), own);
    let soft = Motion { deceleration: 800, jerk: 4_000, ..line };
    assert_eq!(programmed(soft), Programmed { deceleration: 800.0, jerk: 40_000.0, ..own });
    let way = Motion { velocity: 5_000, acceleration: 4_000, ..ptp(0.0, 0.0, 90.0, 0) };
    let share = Programmed { speed: 0.5, acceleration: 0.4, deceleration: 0.4, jerk: 0.4 };
    assert_eq!(programmed(way), share);
    let soft = Motion { deceleration: 2_000, jerk: 1_000, ..way };
    assert_eq!(programmed(soft), Programmed { deceleration: 0.2, jerk: 0.1, ..share });
}

#[test]
fn a_lower_jerk_makes_a_line_and_a_ptp_take_longer() {
    for motion in [lin(100.0, 40.0, 90.0, 0), ptp(100.0, 40.0, 90.0, 0)] {
        let time = |jerk| {
            let mut cell = Cell::ready(Vec::new());
            cell.call(u8::from(motion.kind).into(), vec![Motion { jerk, ..motion }]);
            cell.wait_for_end();
            assert!(cell.feedback().status.contains(Status::DONE), "{:?}", cell.feedback());
            cell.feedback().execution_ns / 1_000_000
        };
        let (own, low) = (time(0), time(500));
        assert!(low > own + 50, "{:?}: {own} and {low} ms", motion.kind);
    }
}

#[test]
fn a_motion_with_a_lower_deceleration_slows_down_softly_and_speeds_up_as_before() {
    for motion in [lin(100.0, 40.0, 90.0, 0), ptp(100.0, 40.0, 90.0, 0)] {
        let time = |motion: Motion| {
            let mut cell = Cell::ready(Vec::new());
            cell.call(u8::from(motion.kind).into(), vec![motion]);
            cell.wait_for_end();
            assert!(cell.feedback().status.contains(Status::DONE), "{:?}", cell.feedback());
            cell.feedback().execution_ns / 1_000_000
        };
        let jerk = if motion.kind.is_point_to_point() { motion.acceleration } else { 0 };
        let low = motion.acceleration / 4;
        let [own, softly, both] = [
            motion,
            Motion { deceleration: low, jerk, ..motion },
            Motion { acceleration: low, jerk, ..motion },
        ]
        .map(time);
        assert!(own + 20 < softly && softly + 20 < both, "{:?}: {own}, {softly}, {both} ms", motion.kind);
    }
}

/// A half circle in base 1 around (50, 40) at z = 90, from x = 0 to x = 100.
fn half_circle(approximation_mm: u16) -> Motion {
    Motion {
        kind: MotionKind::Circular,
        auxiliary: [50.0, 90.0, 90.0],
        ..lin(100.0, 40.0, 90.0, approximation_mm)
    }
}

#[test]
fn a_circle_runs_as_a_single_skill_and_within_a_continuous_motion() {
    let start = ptp(0.0, 40.0, 90.0, 0);
    for (skill, motions) in [
        (Skill::MoveCircular, vec![half_circle(0)]),
        (Skill::MoveContinuous, vec![start, half_circle(10), lin(150.0, 40.0, 90.0, 0)]),
    ] {
        let mut cell = Cell::ready(Vec::new());
        cell.call(Skill::MovePtpCartesian, vec![start]);
        cell.wait_for_end();
        let target = motions.last().unwrap().target;
        cell.call(skill, motions);
        cell.wait(|feedback| feedback.pose[1] > 89.0);
        let [x, y, ..] = cell.feedback().pose;
        assert!((libm::hypotf(x - 50.0, y - 40.0) - 50.0).abs() < 1e-3, "({x}, {y}) is not on the circle");
        cell.wait_for_end();
        assert!(cell.feedback().status.contains(Status::DONE), "{:?}", cell.feedback());
        assert!((cell.feedback().pose[0] - target[0]).abs() < 1e-3);
    }
}

#[test]
fn a_spline_passes_its_targets_at_constant_speed() {
    let targets =
        [(0.0, 0.0), (40.0, 25.0), (85.0, 40.0), (130.0, 35.0), (170.0, 10.0), (215.0, 0.0), (260.0, 20.0)];
    let spline = |(x, y)| Motion { kind: MotionKind::Spline, ..lin(x, y, 90.0, 5) };
    let mut cell = Cell::ready(Vec::new());
    cell.call(Skill::MovePtpCartesian, vec![ptp(0.0, 0.0, 90.0, 0)]);
    cell.wait_for_end();
    cell.call(Skill::MoveContinuous, targets.into_iter().skip(1).map(spline).collect());
    cell.wait(|feedback| feedback.path_speed > 249.0);
    let mut slowest = f32::INFINITY;
    let mut nearest = targets.map(|_| f32::INFINITY);
    while cell.feedback().pose[0] < 245.0 {
        cell.run_ms(1);
        let Feedback { path_speed, pose: [x, y, ..], .. } = *cell.feedback();
        slowest = slowest.min(path_speed);
        for (nearest, target) in nearest.iter_mut().zip(targets) {
            *nearest = nearest.min(libm::hypotf(x - target.0, y - target.1));
        }
    }
    assert!(slowest > 249.0, "it slowed down to {slowest} mm/s");
    assert!(nearest[1..6].iter().all(|nearest| *nearest < 0.51), "a sample is 1 mm apart: {nearest:?}");
    cell.wait_for_end();
    assert!(cell.feedback().status.contains(Status::DONE), "{:?}", cell.feedback());
    assert_eq!(cell.feedback().blends_suppressed, 0);
}

fn refused(motions: Vec<Motion>) -> (ErrorNumber, u32) {
    let mut cell = Cell::ready(Vec::new());
    let joints = *cell.robot().controller().joints();
    cell.call(Skill::MoveContinuous, motions);
    cell.wait_for_end();
    assert!(cell.feedback().status.contains(Status::ERROR));
    assert_eq!(cell.feedback().state, State::Halted);
    assert_eq!(*cell.robot().controller().joints(), joints, "refused before anything moves");
    cell.control(Control::ENABLE | Control::RESET);
    cell.run_ms(20);
    assert_eq!(cell.feedback().state, State::Ready, "a reset takes the error back");
    cell.events
        .iter()
        .find_map(|(_, event)| match event {
            RobotEvent::Refused { error, motion, .. } => Some((*error, *motion)),
            _ => None,
        })
        .unwrap()
}

#[test]
fn what_cannot_be_run_is_refused_with_its_number_before_anything_moves() {
    let good = lin(0.0, 40.0, 90.0, 10);
    let with = |change: fn(&mut Motion)| {
        let mut motion = good;
        change(&mut motion);
        refused(vec![good, lin(10.0, 40.0, 90.0, 10), motion])
    };
    assert_eq!(with(|motion| motion.kind = MotionKind::None), (ErrorNumber::UnknownMotionKind, 2));
    assert_eq!(with(|motion| motion.kind = MotionKind::Unknown(99)), (ErrorNumber::UnknownMotionKind, 2));
    assert_eq!(with(|motion| motion.target[0] = 10.0), (ErrorNumber::ZeroLength, 2));
    let circle = |motion: &mut Motion| {
        (motion.kind, motion.target[0], motion.auxiliary) = (MotionKind::Circular, 100.0, [50.0, 40.0, 90.0]);
    };
    assert_eq!(with(circle), (ErrorNumber::CollinearCircle, 2));
    assert_eq!(with(|motion| motion.kind = MotionKind::LinForceCartesian), (ErrorNumber::ForceOutOfRange, 2));
    assert_eq!(with(|motion| motion.tool = 3), (ErrorNumber::UnknownTool, 2));
    assert_eq!(with(|motion| motion.base = 3), (ErrorNumber::UnknownBase, 2));
    assert_eq!(with(|motion| motion.velocity = 0), (ErrorNumber::VelocityOutOfRange, 2));
    assert_eq!(with(|motion| motion.velocity = 20_001), (ErrorNumber::VelocityOutOfRange, 2));
    assert_eq!(with(|motion| motion.acceleration = 0), (ErrorNumber::AccelerationOutOfRange, 2));
    assert_eq!(with(|motion| motion.acceleration = 5_001), (ErrorNumber::AccelerationOutOfRange, 2));
    assert_eq!(with(|motion| motion.target[4] = f32::NAN), (ErrorNumber::TargetNotFinite, 2));
    assert_eq!(with(|motion| motion.target[1] = -900.0), (ErrorNumber::Unreachable, 2));
    assert_eq!(with(|motion| motion.target[4] = 10.0), (ErrorNumber::Unreachable, 2));
    assert_eq!(with(|motion| motion.target[2] = 176.0), (ErrorNumber::AxisLimit, 2));
}

#[test]
fn a_line_between_two_good_points_that_passes_too_close_to_axis_1_is_refused() {
    let motions = vec![ptp(-150.0, 180.0, 90.0, 0), lin(450.0, 180.0, 90.0, 0)];
    assert_eq!(refused(motions), (ErrorNumber::AxisLimit, 1));
}

#[test]
fn a_call_that_makes_no_sense_is_refused() {
    let refuse = |skill: Skill, change: fn(&mut protocol::image::Command)| {
        let mut cell = Cell::ready(application());
        cell.call(skill, vec![ptp(0.0, 0.0, 60.0, 0)]);
        cell.command(change);
        cell.wait_for_end();
        cell.feedback().error
    };
    assert_eq!(refuse(Skill::Unknown(77), |_| {}), ErrorNumber::UnknownSkill);
    assert_eq!(refuse(Skill::None, |_| {}), ErrorNumber::UnknownSkill);
    assert_eq!(refuse(Skill::RunProgram, |command| command.program = 9), ErrorNumber::UnknownProgram);
    assert_eq!(refuse(Skill::MoveContinuous, |command| command.total = 0), ErrorNumber::NoMotions);
    assert_eq!(
        refuse(Skill::MovePtpCartesian, |command| command.override_percent = 101),
        ErrorNumber::OverrideOutOfRange
    );
    assert_eq!(
        refuse(Skill::MoveLinCartesian, |_| {}),
        ErrorNumber::UnknownMotionKind,
        "the slot holds a PTP"
    );
    assert_eq!(refuse(Skill::MoveContinuous, |command| command.written = 7), ErrorNumber::QueueOverrun);
}

#[test]
fn a_skill_of_one_motion_with_other_counts_is_refused_and_the_slot_of_the_one_before_stays() {
    let far = ptp(150.0, 60.0, 90.0, 0);
    for (total, written, index, value) in
        [(1, 0, 2, 0.0), (1, 2, 2, 2.0), (1, 7, 2, 7.0), (0, 1, 1, 0.0), (2, 1, 1, 2.0), (13, 5, 1, 13.0)]
    {
        for skill in [1, 2, 3, 4, 5, 6].map(Skill::from) {
            let mut cell = Cell::ready(Vec::new());
            cell.call(Skill::MovePtpCartesian, vec![far]);
            cell.wait_for_end();
            let joints = *cell.robot().controller().joints();
            cell.pair.command_a(|plc, _| {
                plc.motions.clear();
                (plc.command.number, plc.command.skill) = (plc.command.number + 1, skill);
                (plc.command.total, plc.command.written) = (total, written);
            });
            cell.wait_for_end();
            let feedback = *cell.feedback();
            assert_eq!((feedback.state, feedback.error), (State::Halted, ErrorNumber::NotOneMotion));
            assert_eq!((feedback.finding.index, feedback.finding.value()), (index, value), "{skill:?}");
            assert_eq!((feedback.finding.lower(), feedback.finding.upper()), (1.0, 1.0));
            assert_eq!(*cell.robot().controller().joints(), joints, "{skill:?}: nothing moves");
        }
    }
}

#[test]
fn a_continuous_motion_never_takes_more_than_is_written_nor_more_than_its_total() {
    let counts = |total, written| {
        let mut cell = Cell::ready(Vec::new());
        cell.call(Skill::MoveContinuous, Vec::new());
        cell.command(|command| {
            command.set_slot(0, ptp(0.0, 0.0, 60.0, 0));
            (command.total, command.written) = (total, written);
        });
        cell.run_ms(2_000);
        let feedback = cell.feedback();
        (feedback.state, feedback.error, feedback.accepted)
    };
    assert_eq!(counts(2, 3), (State::Halted, ErrorNumber::QueueOverrun, 0), "more than its total");
    assert_eq!(counts(9, 6), (State::Halted, ErrorNumber::QueueOverrun, 0), "more than five ahead");
    assert_eq!(counts(u32::MAX, u32::MAX), (State::Halted, ErrorNumber::QueueOverrun, 0));
    assert_eq!(counts(0, 1), (State::Halted, ErrorNumber::NoMotions, 0));
    assert_eq!(counts(2, 1), (State::Running, ErrorNumber::None, 1), "the second is not written yet");
}

#[test]
fn in_halted_a_call_is_refused_and_nothing_moves() {
    let mut cell = Cell::new(application());
    cell.call(Skill::RunProgram, Vec::new());
    cell.run_ms(100);
    assert_eq!(cell.feedback().error, ErrorNumber::NotReady);
    assert_eq!((cell.feedback().number, cell.feedback().state), (1, State::Halted));
    cell.control(Control::ENABLE | Control::RESET | Control::EXECUTE);
    cell.run_ms(100);
    assert_eq!(cell.feedback().state, State::Ready, "the refused number does not start later");
}
