//! Waits: the PLC says what it waits for, and gives up a robot that owes progress and shows none.

use machine::Duration;
use planning::{Stop, Switch, ToStart};
use plc_node::ExecutionType::{self, Cm, Rc};
use plc_node::{DescribedArm, FailureCause, Override, PlcConfig, PlcEvent, PlcReport, WaitingFor};
use protocol::fieldbus::DownCause;
use protocol::image::State;
use virtual_time::Event;

use crate::scripted::{
    Cell, Fault, ScriptPhases, cell, cell_with, config, motions, pause, run, run_to_failure, start,
    until_ready,
};

/// Lets time pass; returns the PLC's reports of what it waits for, with their seconds, and whether a run failed.
fn reports(cell: &mut Cell, time: Duration) -> (Vec<(u32, WaitingFor)>, Option<FailureCause>) {
    let until = cell.now() + time;
    let (mut reports, mut failed) = (Vec::new(), None);
    while let Some(event) = cell.next_event(until) {
        match event {
            Event::A(PlcReport { event: PlcEvent::Waiting { for_what, seconds }, .. }) => {
                reports.push((seconds, for_what))
            }
            Event::A(PlcReport { event: PlcEvent::Failed(failure), .. }) => failed = Some(failure.cause),
            _ => {}
        }
    }
    (reports, failed)
}

/// Returns the text of a report, without the numbers in it.
fn text(report: &WaitingFor) -> String {
    report.to_string().chars().filter(|character| !character.is_ascii_digit()).collect()
}

#[test]
fn a_plc_without_a_robot_says_every_ten_seconds_that_it_waits_for_the_connection_and_why_there_is_none() {
    let mut cell = cell(13);
    cell.set_cut(true);
    let (said, _) = reports(&mut cell, Duration::from_secs(35));
    let seconds: Vec<_> = said.iter().map(|(seconds, _)| *seconds).collect();
    assert_eq!(seconds, [10, 20, 30]);
    assert!(said.iter().all(|(_, what)| *what == WaitingFor::Connection { last: None }), "{said:?}");
    cell.set_cut(false);
    until_ready(&mut cell);
    cell.set_cut(true);
    let (said, _) = reports(&mut cell, Duration::from_secs(15));
    let [(10, WaitingFor::Connection { last: Some(down) })] = said[..] else { panic!("{said:?}") };
    assert_eq!(down.cause, DownCause::Watchdog);
}

#[test]
fn a_robot_that_is_another_arm_than_the_setups_is_named_and_neither_enabled_nor_moved_until_it_is_replaced() {
    let to_start = ToStart { from_anywhere: Some(motions(1)[0]), from_end: Vec::new() };
    let arm = DescribedArm::from_setup(&setup::setup("A").unwrap());
    let mut cell =
        cell_with(PlcConfig { arm, to_start, ..config(motions(13)) }, ScriptPhases([0, 300, 700, 1_900]));
    cell.command_b(|robot, _| {
        robot.report([10.0, 20.0, 30.0, 40.0, 0.0, 0.0], [0.0, 0.0, 900.0, 0.0, 0.0, 0.0])
    });
    let (said, failed) = reports(&mut cell, Duration::from_secs(15));
    let [(2, WaitingFor::Arm(_)), (10, what)] = said[..] else { panic!("{said:?}") };
    assert!(what.to_string().contains("this robot is another one, 966 mm and 180° off"), "{what}");
    assert_eq!(failed, None);
    assert!(!cell.a().is_ready() && cell.b().taken.is_empty());
    assert!(!cell.b().is_enabled(), "{:?}", cell.b());
    cell.set_cut(true);
    pause(&mut cell, Duration::from_millis(100));
    cell.command_b(|robot, _| robot.report([0.0; 6], [0.0; 6]));
    cell.set_cut(false);
    until_ready(&mut cell);
    assert_eq!(cell.b().taken.len(), 1);
}

#[test]
fn a_robot_that_is_connected_and_not_usable_is_reported_within_seconds_with_what_was_seen() {
    for (fault, expected) in [
        (
            Fault::Altered { at: 0 },
            "an image of the robot:  frames came, and in  scans the image had a wrong check",
        ),
        (Fault::LifeStandsStill { at: 0 }, "the robot's life counter: it stands at , "),
        (Fault::IgnoresReset, "the robot's state Ready: it is Halted, drives on, error: no error"),
    ] {
        let mut cell = cell(13);
        cell.command_b(|robot, _| robot.fault = fault);
        let (said, _) = reports(&mut cell, Duration::from_secs(13));
        let seconds: Vec<_> = said.iter().map(|(seconds, _)| *seconds).collect();
        assert_eq!(seconds, [2, 10], "{fault:?}: {said:?}");
        assert!(said.iter().all(|(_, what)| text(what).starts_with(expected)), "{fault:?}: {said:?}");
        cell.command_b(|robot, _| robot.fault = Fault::None);
        until_ready(&mut cell);
        assert_eq!(
            reports(&mut cell, Duration::from_secs(30)),
            (Vec::new(), None),
            "a ready robot owes nothing"
        );
        assert_eq!(run(&mut cell, Cm).motions, 13);
    }
}

#[test]
fn data_that_are_bad_from_the_first_frame_are_reported_within_seconds() {
    let mut cell = cell(13);
    cell.command_a(|plc, _| plc.buses_mut()[0].bus.set_input_bad(true));
    let (said, _) = reports(&mut cell, Duration::from_secs(5));
    assert!(matches!(said[..], [(2, WaitingFor::GoodData)]), "{said:?}");
}

#[test]
fn a_robot_that_stands_in_a_skill_for_ten_seconds_fails_the_run_and_its_state_is_named() {
    for (execution_type, at) in [(Rc, 0), (Cm, 5), (ExecutionType::Sm, 12)] {
        let mut cell = cell(13);
        until_ready(&mut cell);
        cell.command_b(|robot, _| robot.fault = Fault::Stands { at, state: State::Running });
        start(&mut cell, execution_type);
        let (said, failed) = reports(&mut cell, Duration::from_secs(15));
        assert_eq!(failed, Some(FailureCause::NoProgress { seconds: 10, state: State::Running }), "{said:?}");
        cell.command_b(|robot, _| robot.fault = Fault::None);
        pause(&mut cell, Duration::from_secs(1));
        assert_eq!(run(&mut cell, execution_type).motions, 13);
    }
}

#[test]
fn an_override_of_zero_and_a_suspended_skill_last_as_long_as_they_like_and_are_named_every_ten_seconds() {
    for (state, expected) in [(State::Suspended, WaitingFor::Resume), (State::Running, WaitingFor::Override)]
    {
        let mut cell = cell(13);
        until_ready(&mut cell);
        cell.command_b(|robot, _| robot.fault = Fault::Stands { at: 7, state });
        start(&mut cell, Cm);
        if expected == WaitingFor::Override {
            let zero = Override::from_percent(0.0).unwrap();
            cell.command_a(|plc, now| plc.set_override(now, zero));
        }
        let (said, failed) = reports(&mut cell, Duration::from_secs(125));
        assert_eq!(failed, None);
        assert_eq!(said.len(), 13, "{said:?}");
        assert!(said.iter().all(|(_, what)| *what == expected), "{said:?}");
        cell.command_b(|robot, _| robot.fault = Fault::None);
    }
}

#[test]
fn a_program_that_waits_at_a_stop_of_the_plan_is_not_given_up_and_one_that_waits_longer_is() {
    let ten_at_a_stop = |cycles| {
        let switch = Switch { output: 0, set: true, wait: Duration::from_secs(10) };
        let stops = vec![Stop { after: 7, then: Some(switch) }];
        let config = PlcConfig { stops, ..config(motions(13)) };
        let mut cell = cell_with(config, ScriptPhases([0, 300, 700, 1_900]));
        until_ready(&mut cell);
        cell.command_b(|robot, _| robot.fault = Fault::Pauses { cycles });
        cell
    };
    let mut cell = ten_at_a_stop(4_500);
    start(&mut cell, Rc);
    assert_eq!(reports(&mut cell, Duration::from_secs(60)).1, None, "18 s are within both");
    let mut cell = ten_at_a_stop(7_500);
    start(&mut cell, Rc);
    let (_, failed) = reports(&mut cell, Duration::from_secs(60));
    assert_eq!(failed, Some(FailureCause::NoProgress { seconds: 20, state: State::Running }));
    // The PLC's own wait counts for nothing, however long it is.
    let mut cell = ten_at_a_stop(0);
    start(&mut cell, Cm);
    assert_eq!(reports(&mut cell, Duration::from_secs(60)), (Vec::new(), None));
    let mut deaf = ten_at_a_stop(0);
    deaf.command_b(|robot, _| robot.fault = Fault::Deaf);
    assert!(matches!(run_to_failure(&mut deaf, Cm).cause, FailureCause::Block { .. }));
}
