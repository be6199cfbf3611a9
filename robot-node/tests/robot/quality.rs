//! The robot's figures of its motion's quality, compared with known figures of the motion.

use protocol::image::{Control, Motion, Skill};
use robot_node::{Quality, RobotEvent};

use crate::plc::{self, Cell, application, lin, ptp};

/// Start of the tests, in mm.
const START: [f32; 3] = [0.0, 40.0, 40.0];

fn cell_at_start() -> Cell {
    let mut cell = Cell::ready(application());
    let [x, y, z] = START;
    cell.call(Skill::MovePtpCartesian, vec![ptp(x, y, z, 0)]);
    cell.wait_for_end();
    cell
}

fn last_quality(cell: &Cell) -> Quality {
    let finished = cell.events.iter().rev().find_map(|(_, event)| match event {
        RobotEvent::SkillFinished { quality, .. } => Some(*quality),
        _ => None,
    });
    finished.unwrap()
}

fn quality_of(motions: Vec<Motion>) -> Quality {
    let mut cell = cell_at_start();
    cell.call(Skill::MoveContinuous, motions);
    cell.wait_for_end();
    last_quality(&cell)
}

#[test]
fn a_straight_line_has_no_deviation_no_stop_and_the_programmed_acceleration() {
    let up = lin(0.0, 40.0, 140.0, 0);
    let quality = quality_of(vec![up]);
    assert_eq!((quality.stops(), quality.rests, quality.path_deviation_mm), (0, 1, 0.0));
    let share = quality.tool_acceleration.peak / up.acceleration_mm_s2();
    assert!((0.95..1.001).contains(&share), "{share} of the programmed acceleration");
    // Only the linear joint moves: it accelerates once to the programmed speed, and brakes once.
    let limits = *plc::config().arm.limits();
    let velocity = up.velocity_mm_s();
    let expected = velocity * velocity / (limits.speed[2] * limits.acceleration[2]);
    let share = quality.energy_proxy_s / expected;
    assert!((share - 1.0).abs() < 0.01, "{share} of the work of one start and one stop");
}

#[test]
fn a_blended_corner_is_cut_without_a_stop_and_costs_less_than_an_exact_one() {
    let corner =
        |approximation_mm| vec![lin(100.0, 40.0, 40.0, approximation_mm), lin(160.0, 100.0, 40.0, 0)];
    let (blended, exact) = (quality_of(corner(10)), quality_of(corner(0)));
    assert_eq!((blended.stops(), exact.stops()), (0, 1));
    assert_eq!(exact.path_deviation_mm, 0.0);
    let deviation = blended.path_deviation_mm;
    assert!((1.0..5.0).contains(&deviation), "a corner rounded by 10 mm is {deviation} mm off its lines");
    assert!(blended.energy_proxy_s < exact.energy_proxy_s);
    assert!(blended.moving_s < exact.moving_s);
}

#[test]
fn a_reversal_counts_as_a_stop_although_the_arm_stands_still_in_no_cycle() {
    let quality =
        quality_of(vec![lin(0.0, 40.0, 140.0, 0), lin(0.0, 40.0, 50.0, 0), lin(0.0, 40.0, 120.0, 0)]);
    assert_eq!(quality.stops(), 2);
}

#[test]
fn the_program_stops_only_where_it_reverses_and_single_skills_stop_after_each_motion() {
    let mut cell = Cell::ready(application());
    cell.call(Skill::RunProgram, Vec::new());
    cell.wait_for_end();
    // Into the carrier and out of it; into the assembly and out of it.
    assert_eq!(last_quality(&cell).stops(), 2);
    let mut single = Quality::default();
    for motion in application() {
        cell.call(u8::from(motion.kind).into(), vec![motion]);
        cell.wait_for_end();
        single = single.then(last_quality(&cell));
    }
    assert_eq!(single.stops(), 12);
    assert!(single.energy_proxy_s > last_quality(&cell).energy_proxy_s);
}

#[test]
fn a_suspended_motion_counts_as_a_stop() {
    let mut cell = cell_at_start();
    cell.call(Skill::MoveLinCartesian, vec![lin(0.0, 40.0, 140.0, 0)]);
    cell.wait(|feedback| feedback.pose[2] > 80.0);
    cell.control(Control::ENABLE | Control::EXECUTE | Control::SUSPEND);
    cell.run_ms(500);
    cell.control(Control::ENABLE | Control::EXECUTE | Control::RESUME);
    cell.wait_for_end();
    assert_eq!(last_quality(&cell).stops(), 1);
}
