//! Faults during a run: each ends the run with a reason, and the PLC brings the robot back to `Ready` if possible.

use machine::{Duration, Instant};
use plc_node::ExecutionType::{self, Cm, Rc, Sm};
use plc_node::{FailureCause, PlcEvent, PlcNode, PlcReport, StartError};
use protocol::direct::Direct;
use protocol::fieldbus::DownCause;
use protocol::image::{Control, ErrorNumber, Finding};
use protocol::one_station::OneStation;
use virtual_time::{Event, Side};

use crate::scripted::{
    BUS, Cell, Fault, ScriptPhases, WATCHDOG, cell, cell_with_watchdog, config, motions, pause, run,
    run_to_failure, start, until_ready, wait_for, wait_for_failure,
};

fn ready_cell(fault: Fault) -> Cell {
    let mut cell = cell(13);
    until_ready(&mut cell);
    cell.command_b(|robot, _| robot.fault = fault);
    cell
}

/// Removes the fault and checks that the next run of each type succeeds.
fn works_again(cell: &mut Cell) {
    cell.command_b(|robot, _| robot.fault = Fault::None);
    until_ready(cell);
    for execution_type in ExecutionType::ALL {
        assert_eq!(run(cell, execution_type).motions, 13);
    }
}

#[test]
fn a_cut_cable_fails_the_run_when_the_watchdog_expires_and_mending_it_makes_the_robot_ready_again() {
    for execution_type in ExecutionType::ALL {
        let mut cell = ready_cell(Fault::None);
        start(&mut cell, execution_type);
        pause(&mut cell, Duration::from_millis(550));
        let cut = cell.now();
        cell.set_cut(true);
        let failure = wait_for_failure(&mut cell);
        assert!(cell.now().since(cut) <= Duration::from_millis(22), "the watchdog is 20 ms");
        let FailureCause::ConnectionLost(down) = failure.cause else { panic!("{failure}") };
        assert_eq!((down.cause, failure.executed), (DownCause::Watchdog, 5));
        let refused = cell.command_a(|plc, now| plc.start(now, execution_type));
        assert_eq!(refused, Err(StartError::NotConnected));
        cell.set_cut(false);
        works_again(&mut cell);
        assert!(cell.b().halts > 0, "the robot went on by itself, so the PLC has to halt it");
    }
}

#[test]
fn data_that_the_robot_marks_as_bad_are_reported_within_a_scan_whether_a_run_is_under_way_or_not() {
    for runs in [false, true] {
        let mut cell = ready_cell(Fault::None);
        if runs {
            start(&mut cell, Cm);
        }
        pause(&mut cell, Duration::from_millis(100));
        cell.command_a(|plc, _| plc.buses_mut()[0].bus.set_input_bad(true));
        let bad_at = cell.now();
        wait_for(&mut cell, |event| (event == PlcEvent::ImageBad).then_some(()));
        assert!(cell.now().since(bad_at) <= Duration::from_millis(1));
        if runs {
            assert_eq!(wait_for_failure(&mut cell).cause, FailureCause::NoImage);
        }
        cell.command_a(|plc, _| plc.buses_mut()[0].bus.set_input_bad(false));
        wait_for(&mut cell, |event| (event == PlcEvent::ImageGood).then_some(()));
        works_again(&mut cell);
    }
}

#[test]
fn a_killed_robot_fails_the_run() {
    let mut cell = ready_cell(Fault::None);
    start(&mut cell, Cm);
    pause(&mut cell, Duration::from_millis(300));
    cell.kill(Side::B);
    let failure = wait_for_failure(&mut cell);
    assert!(matches!(failure.cause, FailureCause::ConnectionLost(_)), "{failure}");
}

#[test]
fn an_error_of_the_robot_is_reported_with_its_number_and_the_motion_of_the_sequence() {
    for execution_type in ExecutionType::ALL {
        let number = ErrorNumber::AxisLimit;
        let mut cell = ready_cell(Fault::Error { at: 8, number });
        let failure = run_to_failure(&mut cell, execution_type);
        assert_eq!(failure.cause, FailureCause::Robot { number, motion: 7, finding: Finding::NONE });
        assert_eq!(failure.execution_type, execution_type);
        works_again(&mut cell);
    }
}

#[test]
fn an_unknown_error_number_is_reported_as_a_number() {
    let mut cell = ready_cell(Fault::Error { at: 1, number: ErrorNumber::Unknown(4_711) });
    let failure = run_to_failure(&mut cell, Rc);
    assert!(failure.to_string().contains("error number 4711"), "{failure}");
}

#[test]
fn a_robot_that_aborts_the_skill_by_itself_fails_the_run() {
    let mut cell = ready_cell(Fault::Abort { at: 3 });
    let failure = run_to_failure(&mut cell, Sm);
    assert_eq!(failure.cause, FailureCause::RobotHalted);
    works_again(&mut cell);
}

#[test]
fn a_life_counter_that_stands_still_fails_the_run_after_the_set_time() {
    let mut cell = ready_cell(Fault::LifeStandsStill { at: 2 });
    let failure = run_to_failure(&mut cell, Cm);
    assert_eq!(failure.cause, FailureCause::RobotSilent { scans: 50 });
    assert!(!cell.a().is_ready());
    works_again(&mut cell);
}

#[test]
fn a_cable_that_is_cut_for_less_than_the_watchdog_is_not_called_a_controller_that_does_not_run() {
    let mut cell = cell_with_watchdog(config(motions(13)), ScriptPhases([0, 300, 700, 1_900]), WATCHDOG * 20);
    until_ready(&mut cell);
    start(&mut cell, Cm);
    pause(&mut cell, Duration::from_millis(100));
    cell.set_cut(true);
    let failure = wait_for_failure(&mut cell);
    assert!(matches!(failure.cause, FailureCause::RobotUnheard { scans: 50 }), "{failure}");
    assert!(failure.to_string().contains("its cable is cut"), "{failure}");
}

#[test]
fn images_of_the_robot_that_are_all_altered_fail_the_run_and_are_called_so() {
    let mut cell = ready_cell(Fault::Altered { at: 2 });
    let failure = run_to_failure(&mut cell, Cm);
    assert_eq!(failure.cause, FailureCause::RobotAltered { scans: 50 });
    assert!(failure.to_string().contains("wrong check"), "{failure}");
    assert!(cell.a().checks().altered > 0 && cell.a().checks().unchecked > 0);
}

#[test]
fn old_images_of_the_robot_are_refused_and_the_run_goes_on() {
    for execution_type in ExecutionType::ALL {
        for images in [1, 3, 9] {
            let mut cell = ready_cell(Fault::Old { at: 2, images });
            assert_eq!(run(&mut cell, execution_type).motions, 13, "{execution_type}, {images}");
            assert_eq!(cell.a().checks().outdated, u64::from(images));
            works_again(&mut cell);
        }
    }
}

#[test]
fn images_of_the_robot_that_are_all_old_fail_the_run_and_then_set_a_new_start() {
    let mut cell = ready_cell(Fault::Old { at: 2, images: u32::MAX });
    let failure = run_to_failure(&mut cell, Cm);
    assert_eq!(failure.cause, FailureCause::RobotOutdated { scans: 50 });
    assert!(failure.to_string().contains("`robot.cycle_us` is not the robot's cycle"), "{failure}");
    works_again(&mut cell);
}

#[test]
fn a_robot_whose_life_counter_never_moves_is_named_once_for_each_connection() {
    let mut cell = cell(13);
    cell.command_b(|robot, _| robot.fault = Fault::LifeStandsStill { at: 0 });
    let named = |cell: &mut Cell| {
        let until = cell.now() + Duration::from_secs(4);
        core::iter::from_fn(|| cell.next_event(until))
            .filter(|event| matches!(event, Event::A(PlcReport { event: PlcEvent::LifeStill, .. })))
            .count()
    };
    assert_eq!(named(&mut cell), 1);
    assert_eq!(named(&mut cell), 0);
    cell.set_cut(true);
    pause(&mut cell, Duration::from_millis(100));
    cell.set_cut(false);
    assert_eq!(named(&mut cell), 1);
}

#[test]
fn a_robot_that_does_not_accept_the_command_fails_the_run_after_the_set_time() {
    let mut cell = ready_cell(Fault::Deaf);
    let started = cell.now();
    let failure = run_to_failure(&mut cell, Cm);
    assert!(failure.to_string().contains("did not take up command"), "{failure}");
    assert!(cell.now().since(started) <= Duration::from_millis(202));
    works_again(&mut cell);
}

#[test]
fn an_abort_fails_the_run_at_once_and_halts_the_robot() {
    for after_ms in [0, 1, 3, 5, 8, 500] {
        let mut cell = ready_cell(Fault::None);
        start(&mut cell, Cm);
        pause(&mut cell, Duration::from_millis(after_ms));
        cell.command_a(|plc, now| plc.abort(now));
        let aborted = cell.now();
        assert_eq!(wait_for_failure(&mut cell).cause, FailureCause::Aborted);
        assert_eq!(cell.now(), aborted);
        until_ready(&mut cell);
        assert!(cell.now().since(aborted) < Duration::from_millis(30));
        pause(&mut cell, Duration::from_millis(100));
        assert!(cell.a().is_ready(), "nothing started late");
        assert_eq!(run(&mut cell, Cm).motions, 13);
    }
}

#[test]
fn a_start_is_refused_with_a_reason_unless_the_robot_is_ready_and_idle() {
    let mut cell = cell(13);
    let refused = cell.command_a(|plc, now| plc.start(now, Rc));
    assert_eq!(refused, Err(StartError::NotConnected));
    wait_for(&mut cell, |event| matches!(event, PlcEvent::Link(_)).then_some(()));
    let refused = cell.command_a(|plc, now| plc.start(now, Rc)).unwrap_err();
    assert!(refused.to_string().contains("not ready"), "{refused}");
    until_ready(&mut cell);
    start(&mut cell, Rc);
    let refused = cell.command_a(|plc, now| plc.start(now, Cm));
    assert_eq!(refused, Err(StartError::Running(Rc)));
}

#[test]
fn a_sequence_without_motions_is_refused_but_the_robots_own_program_may_run() {
    let mut cell = cell(0);
    until_ready(&mut cell);
    for execution_type in [Sm, Cm] {
        let refused = cell.command_a(|plc, now| plc.start(now, execution_type));
        assert_eq!(refused, Err(StartError::NoMotions(execution_type)));
    }
    assert_eq!(run(&mut cell, Rc).motions, 13);
}

#[test]
fn a_plc_that_was_restarted_while_the_robot_moved_halts_it_and_finds_a_new_number() {
    let mut cell = ready_cell(Fault::None);
    cell.command_b(|robot, _| robot.motion_cycles = 1_000);
    start(&mut cell, Cm);
    pause(&mut cell, Duration::from_millis(100));
    let bus = Direct::new(cell.now(), BUS, WATCHDOG);
    let node = PlcNode::new(config(motions(13)), OneStation::new(bus), cell.now());
    cell.command_a(|plc, _| *plc = node);
    cell.command_b(|robot, _| robot.motion_cycles = 5);
    until_ready(&mut cell);
    assert!(cell.b().halts > 0);
    assert_eq!(run(&mut cell, Cm).motions, 13);
}

#[test]
fn a_disconnect_fails_the_run_and_leaves_nothing_to_execute_on_the_bus() {
    let mut cell = ready_cell(Fault::None);
    start(&mut cell, Cm);
    pause(&mut cell, Duration::from_millis(100));
    cell.command_a(|plc, now| plc.disconnect(now));
    assert_eq!(wait_for_failure(&mut cell).cause, FailureCause::Aborted);
    assert!(!cell.a().command().control.contains(Control::EXECUTE));
}

#[test]
fn a_reset_that_did_not_help_is_tried_again_as_an_edge() {
    let mut cell = cell(13);
    cell.command_b(|robot, _| robot.fault = Fault::IgnoresReset);
    pause(&mut cell, Duration::from_millis(50));
    cell.command_b(|robot, _| robot.fault = Fault::None);
    pause(&mut cell, Duration::from_millis(100));
    assert!(!cell.a().is_ready(), "this robot takes the reset by its edge");
    until_ready(&mut cell);
    assert!(cell.now() < Instant::from_millis(230), "one answer timeout and a robot cycle each way");
}
