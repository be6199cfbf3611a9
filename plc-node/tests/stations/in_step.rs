//! Robots of arms in step: their services and their clocks.

use machine::{Duration, Instant};
use plc_node::ExecutionType::{self, Cm, Rc, Sm};
use plc_node::robot_clock::StampDelay;
use plc_node::{ArmInStep, RobotTimes, StartError, StationWork, TogetherLeg, TogetherSection};
use protocol::image::Services;
use virtual_time::Impairment;

use crate::cell::{CABLE, CLOCKS, Cell, LEFT, MS, RIGHT, cell_in_step, motions, wait, work};
use crate::robot::CYCLE;

/// From the robots' stamp until their frames leave, by the phases of their cycles.
const SENDS_AFTER: [Duration; 2] = [Duration::from_micros(800), Duration::from_micros(150)];

fn works() -> [StationWork; 2] {
    let waits = |after| vec![wait(1, after, false), wait(2, after + 2, false)];
    [work(motions(LEFT, 4), waits(1), vec![]), work(motions(RIGHT, 8), waits(3), vec![])]
}

/// Two arms, which move together from mark 1 to mark 2 if they are to.
fn arms(moves_together: bool) -> Vec<ArmInStep> {
    let arm = |station: usize| {
        let stamp = StampDelay { least: CABLE + SENDS_AFTER[station], spread: Duration::ZERO };
        let times = RobotTimes { image: MS * 7, cycle: CYCLE, ..RobotTimes::default() };
        let legs = vec![TogetherLeg { end: if station == LEFT { 3 } else { 5 }, law: MS * 500 }];
        let section = TogetherSection { mark: 1, legs, has_force: false };
        ArmInStep { stamp, times, sections: if moves_together { vec![section] } else { vec![] } }
    };
    vec![arm(LEFT), arm(RIGHT)]
}

fn cable(jitter: Duration) -> Impairment {
    Impairment { delay: CABLE, jitter, ..Impairment::default() }
}

fn start(cell: &mut Cell, execution_type: ExecutionType) -> Result<(), StartError> {
    cell.until_ready();
    cell.plc(|plc, now| plc.start(now, execution_type))
}

#[test]
fn a_robot_that_cannot_move_together_with_others_is_refused_before_anything_moves_and_only_where_it_would_have_to()
 {
    for (serving, refused) in [([false, true], Some(LEFT)), ([true, false], Some(RIGHT)), ([true; 2], None)] {
        for execution_type in ExecutionType::ALL {
            let mut cell = cell_in_step(works(), arms(true), cable(Duration::ZERO));
            for (station, serves) in serving.into_iter().enumerate() {
                let services = if serves { Services::SYNC } else { Services::default() };
                cell.robot(station, |robot| robot.feedback.services = services);
            }
            let _ = cell.reports(MS * 50);
            let expected = refused.filter(|_| execution_type == Cm);
            let expected = expected.map_or(Ok(()), |station| Err(StartError::NoSync(station)));
            assert_eq!(start(&mut cell, execution_type), expected, "{execution_type} {serving:?}");
            if expected.is_err() {
                let _ = cell.reports(MS * 500);
                assert!(cell.robot(LEFT, |robot| robot.skills.is_empty()));
                assert!(cell.robot(RIGHT, |robot| robot.skills.is_empty()));
            }
        }
    }
}

#[test]
fn arms_that_do_not_move_together_need_no_service_and_run_to_their_ends() {
    for execution_type in [Rc, Sm, Cm] {
        let mut cell = cell_in_step(works(), arms(false), cable(Duration::ZERO));
        for _ in 0..2 {
            assert_eq!(cell.run(execution_type), [4, 8], "{execution_type}");
        }
    }
}

/// Returns the largest errors of the estimates of both clocks within this time, in ns.
fn largest_errors(cell: &mut Cell, from: Duration, to: Duration) -> [i64; 2] {
    let mut largest = [0_i64; 2];
    let _ = cell.reports(from.saturating_sub(cell.now().since(Instant::ZERO)));
    while cell.now() < Instant::ZERO + to {
        let _ = cell.reports(MS * 10);
        for (station, largest) in largest.iter_mut().enumerate() {
            let (offset_ns, drift_ppb) = CLOCKS[station];
            let estimate = cell.plc(|plc, now| {
                let clock = plc.stations()[station].robot_clock().unwrap();
                (now, clock.robot_time(now))
            });
            let (now, estimate) = (estimate.0.as_nanos(), estimate.1.unwrap().at_ns);
            let gained = now as i64 / 1_000 * i64::from(drift_ppb) / 1_000_000;
            let error = estimate as i64 - (offset_ns + now) as i64 - gained;
            *largest = if error.abs() > largest.abs() { error } else { *largest };
        }
    }
    largest
}

#[test]
fn by_the_frames_of_a_robot_its_clock_is_known_to_a_millisecond_after_a_second_and_to_20_us_after_40_s() {
    let mut cell = cell_in_step(works(), arms(true), cable(Duration::from_micros(100)));
    let errors = largest_errors(&mut cell, MS * 1_200, MS * 3_000);
    assert!(errors.iter().all(|error| error.abs() <= 1_000_000), "{errors:?}");
    let errors = largest_errors(&mut cell, MS * 40_000, MS * 50_000);
    assert!(errors.iter().all(|error| error.abs() <= 20_000), "{errors:?}");
}

#[test]
fn a_delay_that_the_setup_does_not_have_moves_the_estimate_by_as_much() {
    let more = Duration::from_micros(300);
    let link = Impairment { delay: CABLE + more, ..Impairment::default() };
    let mut cell = cell_in_step(works(), arms(true), link);
    let errors = largest_errors(&mut cell, MS * 3_000, MS * 5_000);
    assert!(errors.iter().all(|error| (error + 300_000).abs() <= 20_000), "{errors:?}");
}
