//! RC, SM and CM in virtual time against a robot whose skills take the times that the test sets.

use crate::scripted::{
    BUS, CABLE, COST, ROBOT, SCAN, ScriptPhases, cell, cell_with, config, motions, pause, run, until_ready,
};
use machine::Duration;
use plc_node::ExecutionType::{self, Cm, Rc, Sm};

/// Returns the least and the most that the handshake adds to a skill: the command waits for the bus and for the
/// robot's cycle, the end waits for the bus and for the scan.
fn handshake() -> (Duration, Duration) {
    let fixed = COST + 2 * CABLE;
    (fixed, fixed + 2 * BUS + ROBOT + SCAN)
}

#[test]
fn each_execution_type_takes_the_robots_time_and_the_handshake_in_every_phase() {
    let skill = 25 * ROBOT;
    let (least, most) = handshake();
    let mut seen = Vec::new();
    for phase in 0..40 {
        let phases = ScriptPhases([
            phase * 137 % 1_000,
            phase * 311 % 1_000,
            phase * 613 % 1_000,
            phase * 977 % 4_000,
        ]);
        let mut cell = cell_with(config(motions(13)), phases);
        until_ready(&mut cell);
        for execution_type in ExecutionType::ALL {
            // Without a pause, every start would have the phase in the robot's cycle at which the previous run ended.
            pause(&mut cell, Duration::from_micros(phase * 523 % 4_000));
            let execution = run(&mut cell, execution_type);
            let took = Duration::from_nanos(execution.execution_time_ns);
            let skills = if execution_type == Sm { 13 } else { 1 };
            // Between two single motions, the step sequence takes one scan.
            let fixed = 13 * skill + (skills - 1) * SCAN;
            let (from, to) = (fixed + skills * least, fixed + skills * most);
            assert!(
                (from..=to).contains(&took),
                "{execution_type}, {phases:?}: {took:?} not in {from:?}..={to:?}"
            );
            assert_eq!(execution.motions, 13);
            if execution_type == Cm {
                seen.push(took);
            }
        }
    }
    seen.sort();
    let spread = seen.last().copied().zip(seen.first().copied()).map(|(most, least)| most - least);
    assert!(spread >= Some(ROBOT - SCAN), "the phases must show: {seen:?}");
}

#[test]
fn with_known_phases_the_execution_time_is_known_to_the_nanosecond() {
    let mut cell = cell_with(config(motions(13)), ScriptPhases([0, 300, 700, 1_900]));
    until_ready(&mut cell);
    let execution = run(&mut cell, Rc);
    // The scan that reports `Ready` is at 3 ms, so the one with the start edge is at 4 ms. Its outputs are written at
    // 4.15, sent at 4.3 and received at 4.325. The robot's tick at 5.9 starts the command, and the one 13 × 25 ticks
    // later, at 1305.9, is the end. It is sent at 1306.7, received at 1306.725 and seen by the scan at 1307.
    assert_eq!(execution.execution_time_ns, 1_303_000_000);
    assert_eq!(execution.scans, 1_303);
    assert_eq!((execution.frames.sent, execution.frames.received), (1_303, 1_303));
    assert_eq!(execution.robot_execution_ns, 1_300_000_000);
}

#[test]
fn the_robot_gets_every_motion_once_and_in_order() {
    for count in [1, 2, 5, 6, 13, 40] {
        for execution_type in [Sm, Cm] {
            let mut cell = cell(count);
            until_ready(&mut cell);
            let execution = run(&mut cell, execution_type);
            assert_eq!(execution.motions, u32::from(count));
            let taken: Vec<u16> = cell.b().taken.iter().map(|motion| motion.velocity).collect();
            assert_eq!(taken, (1..=count).collect::<Vec<_>>(), "{execution_type} of {count}");
        }
    }
}
