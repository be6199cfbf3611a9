//! What planning says of the arm's reach is what the robot node finds when it checks each motion before it runs.

use planning::{OutOfReach, plan};
use protocol::image::ErrorNumber;
use robot_node::RobotConfig;
use robot_node::arm::Joints;
use robot_node::motion::Segment;
use setup::Setup;

/// The number of the first motion that the robot node refuses, and its error; 0 is the motion to the start.
fn refused_by_the_robot(setup: &Setup, name: &str) -> Option<(usize, ErrorNumber)> {
    let application = planning::application(name, None).unwrap().application;
    let plan = plan(&application, setup).unwrap();
    let config =
        match RobotConfig::from_setup(setup).unwrap().in_cell_of(&application, &plan.wire_to_start(setup)) {
            Ok(config) => config,
            Err(start) => return Some((0, start.found.number())),
        };
    let to_start = plan.wire_to_start(setup).from_anywhere.unwrap();
    let mut here: Joints = Segment::prepare(&to_start, &config.home, &config).unwrap().end;
    for (index, motion) in plan.wire_motions(setup).iter().enumerate() {
        match Segment::prepare(motion, &here, &config) {
            Ok(segment) => here = segment.end,
            Err(violation) => return Some((index + 1, violation.number())),
        }
    }
    None
}

fn refused_by_planning(setup: &Setup, name: &str) -> Option<(usize, ErrorNumber)> {
    let application = planning::application(name, None).unwrap().application;
    match plan(&application, setup).unwrap().reach(&application, setup).err()? {
        error @ (OutOfReach::Arm(_) | OutOfReach::Joints { .. }) => panic!("{error}"),
        OutOfReach::Start { violation, .. } => Some((0, violation.number())),
        OutOfReach::Motion { number, violation, .. } => Some((number, violation.number())),
    }
}

#[test]
fn planning_refuses_the_motion_that_the_robot_refuses_and_by_the_same_error_wherever_the_cell_stands() {
    let mut verdicts = [0, 0];
    for (setup_name, name) in ["A", "B", "D"]
        .into_iter()
        .flat_map(|setup| ["pick-and-place", "gluing", "engraving"].map(|name| (setup, name)))
    {
        for step in 0..60_u16 {
            let mut setup = setup::setup(setup_name).unwrap();
            let base = &mut setup.robot.bases[0].mm_deg.value;
            let [x, y, z, turn] = [0, 1, 2, 3].map(|axis| f64::from(step * (7 + 4 * axis) % 23) / 11.0 - 1.0);
            (base[0], base[1]) = (base[0] + 350.0 * x, base[1] + 300.0 * y);
            (base[2], base[3]) = (base[2] + 120.0 * z, base[3] + 170.0 * turn);
            let (found, expected) = (refused_by_planning(&setup, name), refused_by_the_robot(&setup, name));
            assert_eq!(
                found, expected,
                "{name} on {setup_name}, base {:?}",
                setup.robot.bases[0].mm_deg.value
            );
            verdicts[usize::from(expected.is_some())] += 1;
        }
    }
    assert!(verdicts.iter().all(|count| *count > 100), "of each verdict there are many: {verdicts:?}");
}
