//! A robot whose axes are emulated CiA 402 drives on an EtherCAT segment of its controller, with a PLC, in virtual time.

use std::time::Duration;

use protocol::image::{Control, ErrorNumber, Feedback, Skill, State, Status};
use robot_node::controller::DriveError;
use robot_node::{Disturbance, Ending, Quality, RobotConfig, RobotEvent, ServoLimits};
use setup::Drives;

use crate::plc::{Cell, application, config};

/// Robot cycle of Setup A.
const CYCLE_NS: u64 = 4_000_000;

/// By how much the position that is reported may be off from what it is without drives, in degrees (mm): increments of
/// 0.00001, and the rounding of 32 bits.
const EXACT: f32 = 1e-4;

fn with_drives() -> RobotConfig {
    RobotConfig { drives: Some(Drives::Ethercat), ..config() }
}

/// A cell whose robot is `Ready`.
fn ready(config: RobotConfig) -> Cell {
    let mut cell = Cell::with(config, application(), 1);
    cell.control(Control::ENABLE | Control::RESET);
    cell.wait(|feedback| feedback.state == State::Ready);
    cell.control(Control::ENABLE);
    cell.run_ms(20);
    cell
}

/// Runs the application by a skill, from a cell that is ready; returns the feedback of the last one.
fn run(cell: &mut Cell, skill: Skill) -> Feedback {
    let motions = application();
    if skill == Skill::None {
        for motion in &motions {
            cell.call(u8::from(motion.kind).into(), vec![*motion]);
            cell.wait_for_end();
        }
    } else {
        cell.call(skill, motions);
        cell.wait_for_end();
    }
    *cell.feedback()
}

/// Moves, and disturbs the drive of this axis on the way.
fn disturbed(axis: usize, disturbance: Disturbance) -> Cell {
    let mut cell = ready(with_drives());
    cell.call(Skill::MoveContinuous, application());
    cell.wait(|feedback| feedback.executed == 2);
    disturb(&mut cell, axis, disturbance);
    cell
}

fn disturb(cell: &mut Cell, axis: usize, disturbance: Disturbance) {
    cell.pair.command_b(|robot, _| robot.drives_mut().unwrap().disturb(axis, disturbance).unwrap());
}

fn failures(cell: &Cell) -> Vec<DriveError> {
    let failed = cell.events.iter().filter_map(|(_, event)| match event {
        RobotEvent::DrivesFailed(error) => Some(*error),
        _ => None,
    });
    failed.collect()
}

/// Resets the robot, and waits until it is ready.
fn reset(cell: &mut Cell) {
    cell.control(Control::ENABLE | Control::RESET);
    cell.wait(|feedback| feedback.state == State::Ready);
    cell.control(Control::ENABLE);
    cell.run_ms(20);
    assert_eq!(cell.feedback().error, ErrorNumber::None);
}

fn largest_difference(a: &[f32; 6], b: &[f32; 6]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn every_kind_of_run_is_that_without_drives_but_for_their_delay() {
    for skill in [Skill::RunProgram, Skill::None, Skill::MoveContinuous] {
        let without = run(&mut ready(config()), skill);
        let mut cell = ready(with_drives());
        let with = run(&mut cell, skill);
        assert!(without.status.contains(Status::DONE) && with.status.contains(Status::DONE), "{skill:?}");
        assert!(largest_difference(&with.joints, &without.joints) < EXACT, "{skill:?}: {:?}", with.joints);
        assert!(largest_difference(&with.pose, &without.pose) < 10.0 * EXACT, "{skill:?}: {:?}", with.pose);
        // The arm has settled long after its drives are there: they add nothing.
        let more = with.execution_ns.abs_diff(without.execution_ns);
        assert!(more <= 2 * CYCLE_NS, "{skill:?}: {more} ns");
        let counters = cell.robot().drives().unwrap().counters();
        assert!(counters.received > 500, "{counters:?}");
        assert_eq!((counters.lost, counters.late, counters.skipped), (0, 0, 0), "{counters:?}");
        assert_eq!(failures(&cell), []);
    }
}

#[test]
fn where_a_call_costs_nothing_a_skill_ends_two_cycles_later_once_the_drives_are_there() {
    let bare = |drives| RobotConfig {
        interpreter_quantum: Duration::ZERO,
        skill_overhead: Duration::ZERO,
        drives,
        ..config()
    };
    let without = run(&mut ready(bare(None)), Skill::RunProgram);
    let mut cell = ready(bare(Some(Drives::Ethercat)));
    let with = run(&mut cell, Skill::RunProgram);
    let later = with.execution_ns - without.execution_ns;
    assert!((CYCLE_NS..=2 * CYCLE_NS).contains(&later), "{later}");
    assert!(largest_difference(&with.joints, &without.joints) < EXACT);
}

#[test]
fn a_fault_of_any_drive_ends_the_skill_and_names_axis_and_code() {
    for axis in 1..=4 {
        let mut cell = disturbed(axis, Disturbance::Fault);
        cell.wait_for_end();
        let feedback = *cell.feedback();
        assert_eq!((feedback.state, feedback.error), (State::Halted, ErrorNumber::DriveFault));
        assert_eq!((usize::from(feedback.finding.index), feedback.finding.value()), (axis, 8976.0));
        let words = feedback.finding.in_words(feedback.error).to_string();
        assert_eq!(words, format!("the drive of an axis has a fault (axis {axis}, error code 0x2310)"));
        let code = 0x2310;
        assert_eq!(failures(&cell), [DriveError::Fault { axis: axis as u8, code }]);
    }
}

#[test]
fn after_a_reset_the_arm_goes_on_from_where_its_drives_stopped() {
    let mut cell = disturbed(1, Disturbance::Fault);
    cell.wait_for_end();
    cell.run_ms(500);
    let stopped = cell.feedback().joints;
    assert!(cell.feedback().status.contains(Status::AT_REST));
    reset(&mut cell);
    assert!(largest_difference(&cell.feedback().joints, &stopped) < EXACT, "a reset moves nothing");
    let planned = run(&mut ready(config()), Skill::RunProgram);
    let again = run(&mut cell, Skill::RunProgram);
    assert!(again.status.contains(Status::DONE), "{again:?}");
    assert!(largest_difference(&again.joints, &planned.joints) < EXACT);
    assert_eq!(failures(&cell).len(), 1);
}

#[test]
fn a_drive_that_stops_by_itself_stops_all_and_is_named() {
    let mut cell = disturbed(2, Disturbance::Stop);
    cell.wait_for_end();
    assert_eq!((cell.feedback().error, cell.feedback().finding.index), (ErrorNumber::DriveStopped, 2));
    cell.run_ms(300);
    let stopped = cell.feedback().joints;
    cell.run_ms(300);
    assert_eq!(cell.feedback().joints, stopped);
    reset(&mut cell);
    assert!(run(&mut cell, Skill::MoveContinuous).status.contains(Status::DONE));
}

#[test]
fn a_blocked_axis_is_a_following_error_and_a_reset_waits_until_the_drive_is_well() {
    let mut cell = disturbed(1, Disturbance::Block);
    cell.wait_for_end();
    let Feedback { error, finding, .. } = *cell.feedback();
    assert_eq!((error, finding.index, finding.upper()), (ErrorNumber::FollowingError, 1, 1.0));
    assert!((1.0..4.0).contains(&finding.value().abs()), "{finding:?}");
    let words = finding.in_words(error).to_string();
    assert!(words.starts_with("following error: ") && words.contains("(axis 1 is "), "{words}");
    disturb(&mut cell, 1, Disturbance::Release);
    reset(&mut cell);
    assert!(run(&mut cell, Skill::MoveContinuous).status.contains(Status::DONE));
}

#[test]
fn an_arm_at_rest_whose_drive_fails_is_halted_until_a_reset() {
    let mut cell = ready(with_drives());
    disturb(&mut cell, 3, Disturbance::Fault);
    cell.wait(|feedback| feedback.state == State::Halted);
    assert_eq!((cell.feedback().error, cell.feedback().finding.index), (ErrorNumber::DriveFault, 3));
    cell.call(Skill::RunProgram, application());
    cell.wait_for_end();
    assert_eq!(cell.feedback().error, ErrorNumber::NotReady);
    reset(&mut cell);
    assert!(run(&mut cell, Skill::RunProgram).status.contains(Status::DONE));
}

#[test]
fn a_cut_cable_to_the_drives_is_an_error_and_they_come_back_after_it_is_mended() {
    let cut = |cell: &mut Cell, cut| {
        cell.pair.command_b(|robot, _| robot.drives_mut().unwrap().set_cut(cut));
    };
    let mut cell = ready(with_drives());
    cell.call(Skill::RunProgram, application());
    cell.wait(|feedback| feedback.executed == 2);
    cut(&mut cell, true);
    cell.wait_for_end();
    assert_eq!((cell.feedback().state, cell.feedback().error), (State::Halted, ErrorNumber::DrivesLost));
    // A reset cannot help as long as there are no drives.
    cell.control(Control::ENABLE | Control::RESET);
    cell.run_ms(500);
    assert_eq!(cell.feedback().state, State::Halted);
    cut(&mut cell, false);
    cell.wait(|feedback| feedback.state == State::Ready);
    cell.control(Control::ENABLE);
    cell.run_ms(20);
    assert!(run(&mut cell, Skill::RunProgram).status.contains(Status::DONE));
}

#[test]
fn a_lost_plc_leaves_the_drives_on() {
    let mut cell = ready(with_drives());
    cell.call(Skill::RunProgram, application());
    cell.wait(|feedback| feedback.executed == 2);
    cell.pair.set_cut(true);
    cell.run_ms(500);
    cell.pair.set_cut(false);
    cell.run_ms(50);
    assert_eq!(cell.feedback().error, ErrorNumber::ConnectionLost);
    reset(&mut cell);
    assert_eq!(failures(&cell), []);
}

/// A robot whose drives may lag by any distance.
fn without_window() -> RobotConfig {
    let config = with_drives();
    RobotConfig { servo: ServoLimits { following_error: 300.0, ..config.servo }, ..config }
}

/// Moves, and holds this axis for ever on its way.
fn held(config: RobotConfig, axis: usize) -> Cell {
    let mut cell = ready(config);
    cell.call(Skill::MoveContinuous, application());
    let start = cell.feedback().joints[axis - 1];
    cell.wait(|feedback| (feedback.joints[axis - 1] - start).abs() > 5.0);
    disturb(&mut cell, axis, Disturbance::Block);
    cell
}

#[test]
fn a_drive_that_never_arrives_is_an_error_with_axis_and_distance_after_the_settling_time() {
    for axis in [1, 2] {
        let mut cell = held(without_window(), axis);
        cell.wait_for_end();
        let Feedback { error, finding, state, .. } = *cell.feedback();
        assert_eq!((state, error), (State::Halted, ErrorNumber::DriveNotArrived));
        assert_eq!(usize::from(finding.index), axis);
        assert!(finding.value().abs() > 1.0, "{finding:?}");
        let at = |wanted: fn(&RobotEvent) -> bool| {
            cell.events.iter().find(|(_, event)| wanted(event)).map(|(at, _)| *at)
        };
        assert!(
            at(|event| matches!(event, RobotEvent::DrivesFailed(DriveError::NotArrived { .. }))).is_some()
        );
        // The axis that comes free moves nothing, and after a reset the arm goes on from where it stands.
        let stood = cell.feedback().joints;
        disturb(&mut cell, axis, Disturbance::Release);
        cell.run_ms(200);
        assert!(largest_difference(&cell.feedback().joints, &stood) < EXACT);
        reset(&mut cell);
        assert!(run(&mut cell, Skill::MoveContinuous).status.contains(Status::DONE));
    }
}

#[test]
fn a_held_drive_ends_every_wait_for_it_whatever_the_plc_wants_meanwhile() {
    for wanted in [Control::SUSPEND, Control::HALT, Control::CANCEL] {
        let mut cell = held(without_window(), 1);
        cell.run_ms(40);
        cell.control(Control::ENABLE | Control::EXECUTE | wanted);
        cell.wait(|feedback| feedback.error == ErrorNumber::DriveNotArrived);
        cell.wait(|feedback| feedback.state == State::Halted && feedback.status.contains(Status::AT_REST));
        assert_eq!(cell.feedback().finding.index, 1, "{wanted:?}");
    }
    // At override 0 the set-points rest on the path.
    let mut cell = held(without_window(), 1);
    cell.pair.command_a(|plc, _| plc.command.override_percent = 0);
    cell.wait(|feedback| feedback.error == ErrorNumber::DriveNotArrived);
}

#[test]
fn a_reset_without_a_connection_to_the_drives_is_an_error_after_the_time_to_switch_on() {
    let mut cell = ready(with_drives());
    cell.pair.command_b(|robot, _| robot.drives_mut().unwrap().set_cut(true));
    cell.wait(|feedback| feedback.error == ErrorNumber::DrivesLost);
    cell.control(Control::ENABLE | Control::RESET);
    cell.run_ms(9_900);
    assert_eq!(cell.feedback().error, ErrorNumber::DrivesLost, "it still waits");
    cell.run_ms(200);
    assert_eq!((cell.feedback().state, cell.feedback().error), (State::Halted, ErrorNumber::DriveNotOn));
    cell.pair.command_b(|robot, _| robot.drives_mut().unwrap().set_cut(false));
    cell.control(Control::ENABLE);
    cell.run_ms(1_000);
    reset(&mut cell);
    assert!(run(&mut cell, Skill::RunProgram).status.contains(Status::DONE));
}

/// Returns the quality of the last skill that ended as commanded.
fn last_quality(cell: &Cell) -> Quality {
    let done = cell.events.iter().rev().find_map(|(_, event)| match event {
        RobotEvent::SkillFinished { ending: Ending::Done, quality, .. } => Some(*quality),
        _ => None,
    });
    done.unwrap()
}

#[test]
fn the_quality_is_that_of_the_drives_and_shows_what_a_short_block_does() {
    let mut cell = ready(with_drives());
    run(&mut cell, Skill::MoveContinuous);
    let healthy = last_quality(&cell);
    assert!(healthy.drive_deviation_mm < 1e-3 && healthy.drive_deviation_deg < 1e-4, "{healthy:?}");
    healthy.check_ratings().unwrap();
    let mut cell = held(without_window(), 1);
    cell.run_ms(100);
    disturb(&mut cell, 1, Disturbance::Release);
    cell.wait_for_end();
    let held = last_quality(&cell);
    assert!(held.drive_deviation_mm > 1.0, "{held:?}");
    assert!(held.path_deviation_mm >= held.drive_deviation_mm, "{held:?}");
    // It stops at once, and catches up with three times its rated acceleration at most.
    assert!(held.joint_acceleration.peak > 3.0, "{held:?}");
    assert!(held.joint_speed.peak <= 1.2 + 1e-6, "{held:?}");
    held.check_ratings().unwrap_err();
}
