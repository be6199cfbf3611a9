//! Where the arm stands before a run: the PLC moves it there, and counts that in nothing.

use crate::scripted::{
    Cell, Fault, ROBOT, ScriptPhases, cell, cell_with, config, motions, pause, run, run_to_failure, start,
    until_ready, wait_for,
};
use planning::ToStart;
use plc_node::ExecutionType::{self, Cm, Rc, Sm};
use plc_node::{FailureCause, PlcConfig, PlcEvent, StartError};
use protocol::image::{ErrorNumber, Motion, MotionKind};

const START: [f32; 6] = [10.0, 20.0, 30.0, 0.0, 0.0, 0.0];
const VIA: [f32; 6] = [50.0, 0.0, 90.0, 0.0, 0.0, 0.0];
const END: [f32; 6] = [90.0, 20.0, 30.0, 0.0, 0.0, 0.0];

/// Which tells these motions from those of a run.
const ACCELERATION: u16 = 7;

fn point_to_point(target: [f32; 6]) -> Motion {
    Motion { kind: MotionKind::PtpCartesian, target, acceleration: ACCELERATION, ..Motion::EMPTY }
}

/// Runs end in `end`; from there the way to the start is free by these positions.
fn cell_that_ends_at(end: [f32; 6], way_back: &[[f32; 6]]) -> Cell {
    let mut sequence = motions(13);
    sequence[12].target = end;
    let from_end = way_back.iter().copied().map(point_to_point).collect();
    let to_start = ToStart { from_anywhere: Some(point_to_point(START)), from_end };
    let mut cell = cell_with(PlcConfig { to_start, ..config(sequence) }, ScriptPhases([0, 300, 700, 1_900]));
    cell.command_b(|robot, _| robot.program_end = end);
    cell
}

/// Returns the motions of the arm outside of runs.
fn moves(cell: &Cell) -> Vec<(MotionKind, [f32; 6])> {
    let moves = cell.b().taken.iter().filter(|motion| motion.acceleration == ACCELERATION);
    moves.map(|motion| (motion.kind, motion.target)).collect()
}

#[test]
fn the_arm_is_moved_to_the_start_before_the_first_run_which_counts_nothing_of_it() {
    for execution_type in ExecutionType::ALL {
        let mut without = cell(13);
        until_ready(&mut without);
        let expected = run(&mut without, execution_type);
        let mut cell = cell_that_ends_at(START, &[]);
        until_ready(&mut cell);
        assert_eq!(moves(&cell), [(MotionKind::PtpCartesian, START)]);
        let execution = run(&mut cell, execution_type);
        assert_eq!(
            (execution.motions, execution.robot_execution_ns),
            (expected.motions, expected.robot_execution_ns),
            "{execution_type}"
        );
        let later = execution.execution_time_ns.abs_diff(expected.execution_time_ns);
        assert!(later <= 4_000_000, "{execution_type}: the start edge only meets another phase: {later} ns");
    }
}

#[test]
fn an_arm_that_stands_at_the_start_is_not_moved() {
    let mut cell = cell_that_ends_at(START, &[]);
    until_ready(&mut cell);
    for execution_type in [Rc, Sm, Cm, Rc] {
        run(&mut cell, execution_type);
        until_ready(&mut cell);
    }
    assert_eq!(moves(&cell).len(), 1);
}

#[test]
fn an_arm_that_is_switched_on_at_the_start_is_moved_there_once_for_the_tool_and_the_base_of_its_pose() {
    let there = Motion { kind: MotionKind::PtpJoint, ..point_to_point(START) };
    let to_start = ToStart { from_anywhere: Some(there), from_end: Vec::new() };
    let mut sequence = motions(13);
    sequence[12].target = START;
    let mut cell = cell_with(PlcConfig { to_start, ..config(sequence) }, ScriptPhases([0, 300, 700, 1_900]));
    cell.command_b(|robot, _| {
        robot.program_end = START;
        robot.place_at(START);
    });
    for execution_type in [Sm, Cm] {
        until_ready(&mut cell);
        run(&mut cell, execution_type);
    }
    assert_eq!(moves(&cell), [(MotionKind::PtpJoint, START)]);
}

#[test]
fn from_an_end_that_is_not_the_start_it_goes_back_by_the_planned_way_to_the_joints_of_the_first_time() {
    let mut cell = cell_that_ends_at(END, &[VIA, START]);
    until_ready(&mut cell);
    for execution_type in ExecutionType::ALL {
        run(&mut cell, execution_type);
        until_ready(&mut cell);
    }
    let back = [(MotionKind::PtpCartesian, VIA), (MotionKind::PtpJoint, START)];
    let expected = [&[(MotionKind::PtpCartesian, START)], &back[..], &back, &back].concat();
    assert_eq!(moves(&cell), expected);
}

#[test]
fn a_run_that_is_wanted_while_the_arm_is_moving_to_the_start_follows() {
    let mut cell = cell_that_ends_at(END, &[VIA, START]);
    until_ready(&mut cell);
    run(&mut cell, Rc);
    assert!(!cell.a().is_ready());
    start(&mut cell, Cm);
    assert_eq!(cell.command_a(|plc, now| plc.start(now, Sm)), Err(StartError::Running(Cm)));
    let execution = wait_for(&mut cell, |event| match event {
        PlcEvent::Finished(execution) => Some(execution),
        PlcEvent::Failed(failure) => panic!("{failure}"),
        _ => None,
    });
    assert_eq!((execution.execution_type, moves(&cell).len()), (Cm, 3));
}

#[test]
fn an_arm_that_somebody_moved_is_brought_back_before_the_run() {
    let mut cell = cell_that_ends_at(START, &[]);
    until_ready(&mut cell);
    cell.command_b(|robot, _| robot.place_at(END));
    pause(&mut cell, ROBOT * 2);
    run(&mut cell, Sm);
    assert_eq!(moves(&cell), [(MotionKind::PtpCartesian, START), (MotionKind::PtpJoint, START)]);
}

#[test]
fn a_start_that_the_robot_refuses_fails_the_run_and_is_tried_again_with_the_next_one_only() {
    let mut cell = cell_that_ends_at(START, &[]);
    let number = ErrorNumber::AxisLimit;
    cell.command_b(|robot, _| robot.fault = Fault::Error { at: 1, number });
    until_ready(&mut cell);
    assert_eq!(moves(&cell).len(), 1);
    cell.command_b(|robot, _| robot.fault = Fault::Error { at: 2, number });
    let failure = run_to_failure(&mut cell, Cm);
    assert!(matches!(failure.cause, FailureCause::StartNotReached(_)), "{failure}");
    let words = failure.to_string();
    assert!(
        words.starts_with(
            "cm failed with 0 motions executed: the arm did not get to the application's `start`"
        )
    );
    until_ready(&mut cell);
    run(&mut cell, Cm);
    assert_eq!(moves(&cell).len(), 3);
}
