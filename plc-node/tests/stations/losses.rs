//! Stations that are lost and come back, and commands for both.

use machine::Instant;
use planning::ToStart;
use plc_node::{
    ExecutionType, FailureCause, Override, PlcEvent, PlcReport, Sequences, StartError, WaitingFor,
};
use protocol::fieldbus::LinkEvent;
use protocol::image::{ErrorNumber, Motion};

use crate::cell::{Cell, LEFT, MS, RIGHT, cell, cell_with, motions, placed, work};

fn alone() -> Cell {
    cell([work(motions(LEFT, 4), vec![], vec![]), work(motions(RIGHT, 8), vec![], vec![])])
}

#[test]
fn both_robots_run_at_once_and_each_gets_its_own_motions() {
    let mut cell = alone();
    cell.robot(RIGHT, |robot| robot.programs = vec![8]);
    for execution_type in ExecutionType::ALL {
        assert_eq!(cell.run(execution_type), [4, 8]);
        for (station, count) in [(LEFT, 4), (RIGHT, 8)] {
            let taken = cell.robot(station, |robot| robot.taken.clone());
            let expected = if execution_type == ExecutionType::Rc { vec![] } else { motions(station, count) };
            assert_eq!(taken, expected, "{execution_type}");
        }
        let begun = [LEFT, RIGHT].map(|station| cell.robot(station, |robot| robot.begun[0]));
        assert!(begun[0].max(begun[1]).since(begun[0].min(begun[1])) <= MS * 8, "{begun:?}");
    }
}

#[test]
fn a_station_lost_in_a_run_fails_it_by_name_once_the_other_is_done_and_waits_meanwhile() {
    for execution_type in ExecutionType::ALL {
        for comes_back in [false, true] {
            let mut cell = alone();
            cell.robot(RIGHT, |robot| (robot.motion_cycles, robot.programs) = (450, vec![8]));
            cell.robot(LEFT, |robot| robot.motion_cycles = 100);
            cell.start(execution_type);
            let _ = cell.reports(MS * 600);
            cell.set_cut(LEFT, true);
            let _ = cell.reports(MS * 100);
            cell.set_cut(LEFT, !comes_back);
            let mut waits = 0;
            let (station, failure) = cell.wait_for(|report| match report.event {
                PlcEvent::Failed(failure) => Some((report.station, failure)),
                PlcEvent::Finished(_) => panic!("finished"),
                PlcEvent::Waiting { for_what: WaitingFor::Connection { .. }, .. } => {
                    assert_eq!(report.station, Some(LEFT));
                    waits += 1;
                    None
                }
                PlcEvent::Waiting { .. } => panic!("{report:?}"),
                _ => None,
            });
            assert_eq!((station, failure.executed), (Some(LEFT), 1), "{execution_type}: {failure}");
            assert!(matches!(failure.cause, FailureCause::ConnectionLost(_)), "{failure}");
            assert_eq!(cell.robot(RIGHT, |robot| (robot.executed.len(), robot.halts)), (8, 0));
            // A robot that went on by itself is halted as soon as it is back.
            assert_eq!(cell.robot(LEFT, |robot| robot.halts > 0), comes_back);
            assert_eq!(waits > 0, !comes_back, "{execution_type}");
            cell.set_cut(LEFT, false);
            [LEFT, RIGHT]
                .into_iter()
                .for_each(|station| cell.robot(station, |robot| robot.motion_cycles = 5));
            assert_eq!(cell.run(execution_type), [4, 8]);
        }
    }
}

#[test]
fn an_error_of_one_robot_does_not_stop_the_other_and_two_errors_name_the_first() {
    for both in [false, true] {
        let mut cell = alone();
        cell.robot(LEFT, |robot| robot.error_at = Some(2));
        cell.robot(RIGHT, |robot| robot.error_at = both.then_some(6));
        cell.start(ExecutionType::Cm);
        let (station, failure) = cell.failure();
        let number = ErrorNumber::AxisLimit;
        assert_eq!(station, Some(LEFT));
        let FailureCause::Robot { number: found, motion, .. } = failure.cause else { panic!("{failure}") };
        assert_eq!((found, motion, failure.executed), (number, 1, 2));
        assert_eq!(cell.robot(RIGHT, |robot| robot.executed.len()), if both { 6 } else { 8 });
        [LEFT, RIGHT].into_iter().for_each(|station| cell.robot(station, |robot| robot.error_at = None));
        assert_eq!(cell.run(ExecutionType::Cm), [4, 8]);
    }
}

#[test]
fn without_one_of_two_robots_nothing_starts_and_the_other_gets_ready() {
    let mut cell = alone();
    cell.set_cut(RIGHT, true);
    let reports = cell.reports(MS * 500);
    assert!(reports.contains(&PlcReport { station: Some(LEFT), event: PlcEvent::Link(LinkEvent::Up) }));
    assert!(reports.iter().all(|report| report.event != PlcEvent::Ready), "{reports:?}");
    assert_eq!(
        cell.plc(|plc, _| plc.stations().iter().map(|it| it.is_ready()).collect::<Vec<_>>()),
        [true, false]
    );
    let refused = cell.plc(|plc, now| plc.start(now, ExecutionType::Cm));
    assert_eq!(refused, Err(StartError::NotConnected));
    cell.set_cut(RIGHT, false);
    assert_eq!(cell.run(ExecutionType::Cm), [4, 8]);
    assert_eq!(cell.robot(LEFT, |robot| robot.halts), 0);
}

#[test]
fn without_one_of_two_robots_the_other_does_not_move_and_only_the_missing_one_is_reported() {
    let mut cell = away_from_their_starts();
    cell.set_cut(RIGHT, true);
    let reports = cell.reports(MS * 15_000);
    let link_up = PlcReport { station: Some(LEFT), event: PlcEvent::Link(LinkEvent::Up) };
    assert!(reports.contains(&link_up), "{reports:?}");
    let waits = |report: &&PlcReport| matches!(report.event, PlcEvent::Waiting { .. });
    assert!(reports.iter().filter(waits).count() > 0, "{reports:?}");
    assert!(reports.iter().filter(waits).all(|report| report.station == Some(RIGHT)), "{reports:?}");
    assert_eq!(cell.robot(LEFT, |robot| robot.taken.len()), 0, "the left arm was moved");
    cell.set_cut(RIGHT, false);
    cell.until_ready();
    assert_eq!([LEFT, RIGHT].map(|station| cell.robot(station, |robot| robot.taken.len())), [1, 1]);
    assert_eq!(cell.run(ExecutionType::Cm), [4, 8]);
}

#[test]
fn an_abort_and_a_disconnect_end_the_run_of_both() {
    for disconnects in [false, true] {
        let mut cell = alone();
        cell.start(ExecutionType::Cm);
        let _ = cell.reports(MS * 50);
        cell.plc(|plc, now| if disconnects { plc.disconnect(now) } else { plc.abort(now) });
        let (station, failure) = cell.failure();
        assert_eq!((station, failure.cause), (None, FailureCause::Aborted));
        let _ = cell.reports(MS * 100);
        if !disconnects {
            assert_eq!([LEFT, RIGHT].map(|station| cell.robot(station, |robot| robot.halts)), [1, 1]);
        }
        assert_eq!(cell.run(ExecutionType::Sm), [4, 8]);
    }
}

#[test]
fn the_override_is_that_of_both_robots() {
    let mut cell = alone();
    cell.start(ExecutionType::Cm);
    let _ = cell.reports(MS * 30);
    cell.plc(|plc, now| plc.set_override(now, Override::from_percent(0.0).unwrap()));
    let _ = cell.reports(MS * 10);
    let executed = |cell: &mut Cell| [LEFT, RIGHT].map(|it| cell.robot(it, |robot| robot.executed.len()));
    let before = executed(&mut cell);
    let stood = cell.reports(MS * 15_000);
    assert!(
        stood.iter().all(|it| matches!(it.event, PlcEvent::Waiting { for_what: WaitingFor::Override, .. })),
        "{stood:?}"
    );
    assert_eq!(executed(&mut cell), before, "both stand, and nobody gives them up");
    cell.plc(|plc, now| plc.set_override(now, Override::from_percent(50.0).unwrap()));
    let _ = cell.reports(MS * 1_000);
    assert_eq!(executed(&mut cell), [4, 8]);
    for station in [LEFT, RIGHT] {
        assert_eq!(cell.robot(station, |robot| robot.overrides.split_off(1)), [0, 50]);
    }
}

/// Returns a cell whose arms have to move to their starts before the first run.
fn away_from_their_starts() -> Cell {
    let work = [work(motions(LEFT, 4), vec![], vec![]), work(motions(RIGHT, 8), vec![], vec![])];
    let mut stations = [placed(0, 0, "left"), placed(1, 0, "right")];
    for (station, placed) in stations.iter_mut().enumerate() {
        let start = Motion { target: [7.0 + station as f32; 6], ..motions(station, 1)[0] };
        placed.config.to_start = ToStart { from_anywhere: Some(start), from_end: vec![] };
    }
    cell_with(Sequences::new(work.into()), stations)
}

#[test]
fn a_run_starts_once_both_arms_are_at_their_start() {
    let mut cell = away_from_their_starts();
    cell.until_ready();
    cell.robot(RIGHT, |robot| (robot.feedback.joints, robot.motion_cycles) = ([0.0; 6], 50));
    let _ = cell.reports(MS * 10);
    cell.start(ExecutionType::Cm);
    let moved = cell.wait_for(|report| match report.event {
        PlcEvent::MovingToStart => Some(report.station),
        PlcEvent::Started { .. } => panic!("started"),
        _ => None,
    });
    assert_eq!(moved, Some(RIGHT), "the left arm is at its start");
    let begun: Instant = cell.wait_for(|report| match report.event {
        PlcEvent::Started { at, .. } => Some(at),
        _ => None,
    });
    assert!(begun >= cell.robot(RIGHT, |robot| robot.executed[0]));
    assert_eq!(cell.robot(LEFT, |robot| robot.begun.len()), 0);
    cell.wait_for(|report| matches!(report.event, PlcEvent::Finished(_)).then_some(()));
}
