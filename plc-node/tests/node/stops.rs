//! A plan of several continuous motions: between them the PLC stops, switches its outputs and waits.

use crate::scripted::{
    Cell, Fault, SCAN, ScriptPhases, cell, cell_with, config, motions, run, run_to_failure, until_ready,
};
use machine::{Duration, Instant};
use planning::{Stop, Switch};
use plc_node::ExecutionType::{Cm, Rc, Sm};
use plc_node::{FailureCause, PlcConfig};
use protocol::image::ErrorNumber;

const GRIP: Duration = Duration::from_millis(150);
const RELEASE: Duration = Duration::from_millis(100);

/// Returns the stops of the paper's pick and place as planned: at the grip position, at the release position, at the
/// end.
fn stops() -> Vec<Stop> {
    let switch = |set, wait| Some(Switch { output: 2, set, wait });
    vec![
        Stop { after: 3, then: switch(true, GRIP) },
        Stop { after: 9, then: switch(false, RELEASE) },
        Stop { after: 13, then: None },
    ]
}

fn with_stops(stops: Vec<Stop>) -> Cell {
    let mut cell = cell_with(PlcConfig { stops, ..config(motions(13)) }, ScriptPhases([0, 300, 700, 1_900]));
    until_ready(&mut cell);
    cell
}

#[test]
fn cm_runs_several_move_continuous_skills_and_grips_and_releases_in_between() {
    let mut cell = with_stops(stops());
    let execution = run(&mut cell, Cm);
    assert_eq!(execution.motions, 13);
    let robot = cell.b();
    let taken: Vec<u16> = robot.taken.iter().map(|motion| motion.velocity).collect();
    assert_eq!(taken, (1..=13).collect::<Vec<_>>(), "every motion once and in order");
    let totals: Vec<u32> = robot.skills.iter().map(|(total, _)| *total).collect();
    assert_eq!(totals, [3, 6, 4]);
    let switched: Vec<(u32, u16)> =
        robot.outputs.iter().map(|(after, _, outputs)| (*after, *outputs)).collect();
    assert_eq!(switched, [(3, 1 << 2), (9, 0)]);
    let waits: Vec<Duration> = robot
        .outputs
        .iter()
        .zip(robot.skills.iter().skip(1))
        .map(|((_, at, _), (_, began)): (&(u32, Instant, u16), _)| began.since(*at))
        .collect();
    // The robot sees the switch and the start only once per cycle.
    let around = |wait: Duration| wait - 4 * SCAN..=wait + 6 * SCAN;
    assert!(around(GRIP).contains(&waits[0]) && around(RELEASE).contains(&waits[1]), "{waits:?}");
}

#[test]
fn sm_also_grips_and_releases_between_its_single_motions() {
    let mut cell = with_stops(stops());
    assert_eq!(run(&mut cell, Sm).motions, 13);
    assert_eq!(cell.b().skills.len(), 13);
    let switched: Vec<(u32, u16)> =
        cell.b().outputs.iter().map(|(after, _, outputs)| (*after, *outputs)).collect();
    assert_eq!(switched, [(3, 1 << 2), (9, 0)]);
}

#[test]
fn rc_leaves_the_gripper_to_the_robots_program() {
    let mut cell = with_stops(stops());
    assert_eq!(run(&mut cell, Rc).motions, 13);
    assert!(cell.b().outputs.is_empty(), "{:?}", cell.b().outputs);
}

#[test]
fn a_run_ends_only_after_the_wait_for_a_switch_at_its_end() {
    let switch = Switch { output: 0, set: true, wait: GRIP };
    let with = |then| {
        let mut cell = with_stops(vec![Stop { after: 13, then }]);
        run(&mut cell, Cm).execution_time_ns
    };
    let more = Duration::from_nanos(with(Some(switch)) - with(None));
    assert!((GRIP + SCAN..=GRIP + 2 * SCAN).contains(&more), "{more:?}");
}

#[test]
fn one_continuous_motion_takes_the_same_nanoseconds_with_or_without_a_listed_stop() {
    let mut plain = cell(13);
    until_ready(&mut plain);
    let mut named = with_stops(vec![Stop { after: 13, then: None }]);
    for execution_type in [Rc, Sm, Cm] {
        let (plain, named) = (run(&mut plain, execution_type), run(&mut named, execution_type));
        assert_eq!(plain.execution_time_ns, named.execution_time_ns, "{execution_type}");
    }
}

#[test]
fn a_motion_that_fails_after_a_stop_is_reported_with_its_number_in_the_sequence() {
    for execution_type in [Sm, Cm] {
        let mut cell = with_stops(stops());
        cell.command_b(|robot, _| robot.fault = Fault::Error { at: 8, number: ErrorNumber::AxisLimit });
        let failure = run_to_failure(&mut cell, execution_type);
        assert!(
            matches!(failure.cause, FailureCause::Robot { number: ErrorNumber::AxisLimit, motion: 7, .. }),
            "{execution_type}: {failure}"
        );
    }
}
