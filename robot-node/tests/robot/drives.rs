//! A robot whose axes are emulated CiA 402 drives on an EtherCAT segment of its controller, with a PLC, in virtual time.

use std::time::Duration;

use protocol::image::{Control, ErrorNumber, Feedback, Skill, State, Status};
use robot_node::controller::DriveError;
use robot_node::{Disturbance, RobotConfig, RobotEvent};
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
    assert_eq!(error, ErrorNumber::DriveFault);
    assert_eq!((finding.index, finding.value() as u16), (1, 0x8611));
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
