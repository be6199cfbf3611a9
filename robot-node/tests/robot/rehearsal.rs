//! What the arm does alone is what the plan says.

use planning::setup_with_application;
use protocol::image::MotionKind;
use robot_node::RobotConfig;
use robot_node::rehearsal::{Calls, Rehearsed, rehearse};

/// Rehearses an application of a setup in every way, and returns what came of it with the arm's distance from the last
/// target, in mm.
fn rehearsed(setup: &str) -> ([Rehearsed; 3], f64) {
    let (setup, found) = setup_with_application(setup).unwrap();
    let plan = found.plan(&setup).unwrap();
    let (motions, to_start) = (plan.wire_motions(&setup), plan.wire_to_start(&setup));
    let robot = RobotConfig::from_setup(&setup).unwrap().in_cell_of(&found.application, &to_start).unwrap();
    let there: Vec<_> = to_start.from_anywhere.into_iter().collect();
    let start = rehearse(&robot, robot.home, &there, &[], Calls::Singles, 100).unwrap().account.end;
    let ways = [Calls::Program, Calls::Singles, Calls::Continuous]
        .map(|calls| rehearse(&robot, start, &motions, &plan.stops(), calls, 100).unwrap());
    let last = motions.last().unwrap();
    assert_ne!(last.kind, MotionKind::PtpJoint, "its target is joints");
    let base = robot.bases[usize::from(last.base)].unwrap();
    let flange = robot.arm.forward(&ways[0].account.end);
    let tool = flange.origin_of(&robot.tools[usize::from(last.tool)].unwrap());
    let target = base.point([0, 1, 2].map(|axis| f64::from(last.target[axis])));
    (ways, robot_node::arm::distance(tool, target))
}

#[test]
fn the_arm_ends_at_the_last_target_and_single_motions_take_the_longest_way() {
    for setup in ["A", "B"] {
        let ([program, singles, continuous], from_target_mm) = rehearsed(setup);
        assert!(from_target_mm < 1e-3, "{setup}: {from_target_mm} mm");
        for way in [&program, &singles, &continuous] {
            assert_eq!(way.account.motions, program.account.motions);
            let differs = |(one, other): (&f64, &f64)| (one - other).abs() > 1e-9;
            assert!(!way.account.end.iter().zip(&program.account.end).any(differs), "{setup}");
        }
        assert!((program.quality.path_length_mm - continuous.quality.path_length_mm).abs() < 1e-6, "{setup}");
        assert!(
            singles.quality.path_length_mm > program.quality.path_length_mm + 1.0,
            "{setup}: {} {}",
            singles.quality.path_length_mm,
            program.quality.path_length_mm
        );
        assert_ne!(program.account.digest, singles.account.digest);
    }
}
