//! Nodes of cells that end and are started again at any frame, and cables that are cut with one: the run fails with a reason, no law of
//! the cell is broken, and the next run passes.

use plc_node::ExecutionType;

use super::*;
use crate::verification::StationVerification;

fn stations(name: &str) -> Vec<PlannedStation> {
    let (cell, found) = planning::cell_with_applications(name).unwrap();
    PlannedStation::all(&found.plan(&cell).unwrap()).unwrap()
}

fn step(execution_type: ExecutionType) -> Step {
    Step { execution_type, repetition: 1, pause: records::schedule::PAUSE, overrides: None }
}

/// Runs once with a fault; returns why it failed, if it did. Then it runs until a run passes, at most the second one.
fn run_with(stations: &[PlannedStation], execution_type: ExecutionType, fault: &str) -> Option<String> {
    let mut run = CellRun::switch_on(stations, 1, &[fault.parse().unwrap()]).unwrap();
    run.watch_laws(stations);
    let first = run.connect().and_then(|()| run.execute(step(execution_type)));
    let said = first.as_ref().err().map(|error| format!("{error:#}"));
    let measured = first.unwrap_or_else(|_| {
        run.recover().unwrap_or_else(|error| panic!("{fault}, {said:?}: {error:#}"));
        let again = run.execute(step(execution_type));
        again.unwrap_or_else(|error| panic!("{execution_type} {fault}, {said:?}: {error:#}"))
    });
    for (station, measured) in stations.iter().zip(&measured.stations) {
        let checked = StationVerification::new(station.clone()).check(measured);
        checked.unwrap_or_else(|error| panic!("{execution_type} {fault}: {error:#}"));
    }
    assert_eq!(run.broken_law(), None, "{execution_type} {fault}: {said:?}");
    said
}

#[test]
fn a_node_of_a_cell_that_is_started_again_fails_the_run_by_its_name_and_the_next_one_passes() {
    for cell in ["E", "F", "G"] {
        let stations = stations(cell);
        for (index, execution_type) in ExecutionType::ALL.into_iter().enumerate() {
            let station = &stations[index % 2].name;
            let frame = 1_500 + 433 * index;
            let robot = format!("{station}/to-plc:restart-robot={frame}@100ms");
            let said = run_with(&stations, execution_type, &robot).unwrap();
            assert!(said.contains(&format!("station {station}")), "{cell} {robot}: {said}");
            let plc = format!("{station}/to-robot:restart-plc={frame}@100ms");
            let said = run_with(&stations, execution_type, &plc).unwrap();
            assert!(said.contains("the plc-node was started again during the run"), "{cell} {plc}: {said}");
        }
    }
}

#[test]
fn no_restart_at_any_frame_and_of_any_length_lets_two_arms_into_one_zone() {
    let stations = stations("G");
    let mut failed = 0;
    for index in 0..36 {
        let execution_type = ExecutionType::ALL[index % 3];
        let station = &stations[index / 3 % 2].name;
        let frame = 400 + 211 * index;
        let ms = [1, 30, 700, 3_000][index % 4];
        let node = ["restart-plc", "restart-robot", "restart-plc"][index / 2 % 3];
        let fault = format!("{station}/to-robot:{node}={frame}@{ms}ms");
        failed += u32::from(run_with(&stations, execution_type, &fault).is_some());
    }
    assert!(failed > 15, "{failed} runs failed");
}

#[test]
fn a_robot_that_is_started_again_stands_where_its_arm_was() {
    let stations = stations("G");
    let fault = "left/to-robot:restart-robot=3000@10s".parse().unwrap();
    let mut run = CellRun::start_with(&stations, 1, &[fault]).unwrap();
    run.execute(step(ExecutionType::Cm)).unwrap_err();
    let joints = |run: &CellRun| run.cell.robot(RobotId(0)).sample().joints;
    let stood = joints(&run);
    let until = run.cell.now() + Duration::from_secs(8);
    while run.cell.now() < until {
        run.next_event(until);
    }
    let apart =
        |from: [f64; 6], to: [f64; 6]| from.iter().zip(to).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let home = stations[0].planned.robot.home;
    assert!(apart(stood, home) > 1.0, "the arm was under way: {stood:?}");
    assert!(run.cell.robot(RobotId(0)).lateness().runs() < 2_500, "it was started again");
    run.recover().unwrap();
    assert!(apart(joints(&run), home) < 0.01);
    run.execute(step(ExecutionType::Cm)).unwrap();
}

#[test]
fn a_cable_of_a_cell_is_cut_with_a_frame_and_the_other_one_is_not() {
    let stations = stations("E");
    for (hit, name) in ["left", "right"].into_iter().enumerate() {
        let fault = format!("{name}/to-plc:cut-frame=900@10ms").parse().unwrap();
        let mut run = CellRun::start_with(&stations, 1, &[fault]).unwrap();
        run.execute(step(ExecutionType::Cm)).unwrap();
        let lost: Vec<_> = CellRun::health(&run).stations.iter().map(Health::frames_lost).collect();
        assert!(lost[hit] > 5 && lost[1 - hit] == 0, "{name}: {lost:?}");
    }
}

/// Has the program of the PLC grant nothing, and so give motions whenever it likes.
fn without(stations: &[PlannedStation], marks: bool, zones: bool) -> Vec<PlannedStation> {
    let mut stations = stations.to_vec();
    for station in &mut stations {
        if marks {
            station.waits.clear();
        }
        if zones {
            (station.visits, station.zones) = (Vec::new(), None);
        }
    }
    stations
}

#[test]
fn the_laws_notice_a_plc_that_heeds_no_mark_and_one_that_grants_no_zone() {
    for (cell, marks, word) in [("E", true, "went beyond mark"), ("G", false, "were both in shared zone 1")] {
        let stations = stations(cell);
        // Without its marks, RC would run the first section only.
        for execution_type in [ExecutionType::Sm, ExecutionType::Cm] {
            let mut run = CellRun::start(&without(&stations, marks, !marks), 1).unwrap();
            run.watch_laws(&stations);
            run.execute(step(execution_type)).unwrap();
            let said = run.broken_law().map(ToString::to_string);
            assert!(
                said.as_ref().is_some_and(|said| said.contains(word)),
                "{cell} {execution_type}: {said:?}"
            );
        }
    }
}
