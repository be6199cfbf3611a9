//! Frames that a cable held back for longer than a bus orders them: no node acts on one, on any bus, in either direction, in
//! the pause or in motion.

use std::time::Duration;

use plc_node::{ExecutionType, PlcEvent, PlcReport};
use robot_node::RobotEvent;
use virtual_time::Side;

use super::cell::{CellEvent, RobotId};
use super::{Extras, VirtualRun};
use records::faults::Fault;

/// Pause before each run: longer than the ages that are tried differ.
const PAUSE: Duration = Duration::from_millis(90);

/// What a run with one old frame came to.
#[derive(Default)]
struct Ended {
    /// Frames to the robot and to the PLC when the first run ended.
    frames: [u64; 2],
    /// Skills that the robot began although the PLC commanded another one then.
    strange: Vec<(u16, u16)>,
    /// Old images that PLC and robot refused.
    outdated: [u64; 2],
    failures: Vec<String>,
}

/// Runs SM and then RC, and compares each skill that the robot begins with what the PLC commands at that moment.
fn run(setup: &str, seed: u64, fault: Option<String>) -> Ended {
    let (setup, found) = planning::setup_with_application(setup).unwrap();
    let faults: Vec<Fault> = fault.iter().map(|fault| fault.parse().unwrap()).collect();
    let extras = Extras { faults, ..Extras::default() };
    let mut run = VirtualRun::start_with(&setup, &found.application, seed, &extras).unwrap();
    let mut ended = Ended::default();
    for execution_type in [ExecutionType::Sm, ExecutionType::Rc] {
        let nodes = &mut run.nodes;
        let start = nodes.cell.now() + PAUSE;
        let mut until = start;
        let mut is_started = false;
        loop {
            match nodes.cell.next_event(until) {
                Some(CellEvent::Plc(PlcReport { event: PlcEvent::Finished(_), .. })) => break,
                Some(CellEvent::Plc(PlcReport { event: PlcEvent::Failed(failure), .. })) => {
                    ended.failures.push(failure.to_string());
                    break;
                }
                Some(CellEvent::Robot(_, RobotEvent::SkillStarted { number, .. })) => {
                    let commanded = nodes.cell.plc().command().number;
                    if number != commanded {
                        ended.strange.push((number, commanded));
                    }
                }
                Some(_) => {}
                None if is_started => panic!("the run never ends: {fault:?}"),
                None if nodes.cell.plc().is_ready() => {
                    nodes.start_run(execution_type).unwrap();
                    (is_started, until) = (true, nodes.cell.now() + Duration::from_secs(120));
                }
                None => until += Duration::from_millis(1),
            }
        }
        if execution_type == ExecutionType::Sm {
            ended.frames = [Side::A, Side::B].map(|side| nodes.cell.link_counters(RobotId::FIRST, side).sent);
        }
    }
    let cell = &run.nodes.cell;
    ended.outdated = [cell.plc().checks().outdated, cell.robot(RobotId::FIRST).checks().outdated];
    ended
}

/// Tries frames that are held for each of these times so that they arrive in the pause after SM, and in its motions. Returns the
/// numbers of old images that PLC and robot refused.
fn refused(setup: &str, seed: u64, holds_us: impl Iterator<Item = u64> + Clone) -> [u64; 2] {
    let clean = run(setup, seed, None);
    assert_eq!(
        (&clean.strange[..], &clean.failures[..], clean.outdated),
        (&[][..], &[][..], [0, 0]),
        "{setup}"
    );
    let cycle_us = u64::from(setup::setup(setup).unwrap().bus.cycle_us.value);
    let mut outdated = [0; 2];
    for (direction, sent) in [("to-robot", clean.frames[0]), ("to-plc", clean.frames[1])] {
        for (index, hold_us) in holds_us.clone().enumerate() {
            let held = hold_us / cycle_us;
            let in_motion = held + 97 + 131 * index as u64 % 1_500;
            // The robot reads one image in four: only what arrives just before counts.
            for arrives in [sent + 20_000 / cycle_us + index as u64, in_motion] {
                let Some(frame) = arrives.checked_sub(held).filter(|frame| *frame > 60) else { continue };
                let fault = format!("{direction}:hold-frame={frame}@{hold_us}us");
                let ended = run(setup, seed, Some(fault.clone()));
                assert_eq!(ended.strange, [], "{setup}, {fault}: begun, and commanded");
                assert_eq!(ended.failures, [""; 0], "{setup}, {fault}");
                outdated = [0, 1].map(|node| outdated[node] + ended.outdated[node]);
            }
        }
    }
    outdated
}

#[test]
fn a_frame_that_profinet_takes_for_new_after_two_seconds_starts_no_skill_and_fails_no_run() {
    for setup in ["A", "D"] {
        let [plc, robot] = refused(setup, 3, (2_040_000..=2_050_000).step_by(1_000));
        assert!(plc > 0 && robot > 0, "{setup}: {plc} and {robot} old images came that far");
    }
}

#[test]
fn no_frame_that_was_held_back_for_two_seconds_starts_a_skill_on_the_other_buses() {
    let [plc, robot] = refused("B", 3, (2_040_000..=2_050_000).step_by(5_000));
    assert_eq!((plc, robot), (0, 0), "EtherNet/IP orders its frames by 32 bits");
    // Whether an old frame is the last one before a robot cycle depends on the phases, so several seeds.
    let old = (3..8).map(|seed| refused("C", seed, (2_040_000..=2_050_000).step_by(700)));
    let robot: u64 = old.map(|[_, robot]| robot).sum();
    assert!(robot > 0, "EtherCAT does not order frames");
}
