//! Targets that name the arm's configuration. What status and turn mean is computed here from where the arm's parts are,
//! by the crate `rs-opw-kinematics` for six axes, which finds all eight configurations on its own.

#[path = "../../../cell/arm/src/opw/tests/reference.rs"]
mod reference;

use std::sync::Arc;

use proptest::prelude::*;
use protocol::image::{Configuration, ErrorNumber, Motion, MotionKind, Skill};
use reference::{IRB_1100, ODD, reference};
use robot_node::arm::{Arm, AxisLimits, Joints, Opw, Scara, distance};
use robot_node::{Program, RobotConfig};
use rs_opw_kinematics::glam::{DQuat, DVec3};
use rs_opw_kinematics::kinematic_traits::{Kinematics as _, Pose};
use rs_opw_kinematics::kinematics_impl::OPWKinematics;

use crate::driven::{Driven, bare, lin, ptp};

/// Status of joints in radians, from where the crate has the arm's parts. None near a border between two configurations,
/// where rounding chooses.
fn status(reference: &OPWKinematics, joints: &Joints) -> Option<u8> {
    let [base, shoulder, elbow, forearm, hand, _] = reference.forward_with_joint_poses(joints);
    let [shoulder, elbow, wrist] = [shoulder, elbow, hand].map(|pose| pose.translation);
    let forward = wrist.dot(base.rotation * DVec3::X);
    let (upper_arm, lower_arm) = ((elbow - shoulder).normalize(), (wrist - elbow).normalize());
    let elbow_bend = upper_arm.cross(lower_arm).dot(base.rotation * DVec3::Y);
    let hand_bend =
        (forearm.rotation * DVec3::Z).cross(hand.rotation * DVec3::Z).dot(forearm.rotation * DVec3::Y);
    let is_regular = forward.abs() > 5.0 && elbow_bend.abs() > 0.02 && hand_bend.abs() > 0.02;
    let bit = |set: bool, bit: u8| if set { bit } else { 0 };
    is_regular.then(|| bit(forward < 0.0, 1) + bit(elbow_bend > 0.0, 2) + bit(hand_bend > 0.0, 4))
}

/// Whether two joints are the same but for whole turns.
fn same_but_for_turns(a_deg: f64, b_deg: f64) -> bool {
    let turn = a_deg - b_deg;
    (turn - 360.0 * (turn / 360.0).round()).abs() < 1e-4
}

fn any_joints() -> impl Strategy<Value = Joints> {
    proptest::array::uniform6(-180.0..180.0_f64)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn each_of_the_eight_solutions_of_another_kinematics_is_reached_by_its_status_and_turn(
        joints in any_joints(),
        near in any_joints(),
        signs in any::<u8>(),
    ) {
        for parameters in [IRB_1100, ODD] {
            let arm = Arm::new(Arc::new(Opw::new(parameters)), AxisLimits::NONE);
            let flange = arm.forward(&joints);
            let [w, x, y, z] = flange.rotation.quaternion();
            let pose = Pose::from_parts(DVec3::from_array(flange.position), DQuat::from_xyzw(x, y, z, w));
            let reference = reference(parameters);
            let solutions = reference.inverse(&pose);
            let statuses: Option<Vec<u8>> = solutions.iter().map(|joints| status(&reference, joints)).collect();
            let Some(statuses) = statuses else { continue };
            if parameters == IRB_1100 {
                prop_assert_eq!(statuses.len(), 8, "without a1 and b the wrist reaches as far behind as in front");
            }
            for wanted in 0..8 {
                let turn = signs & 0x3F;
                let found = arm.inverse_in(&flange, Configuration { status: wanted, turn: Some(turn) }, &near);
                let nearest = arm.inverse_in(&flange, Configuration { status: wanted, turn: None }, &near);
                let mut having = statuses.iter().zip(&solutions).filter(|(status, _)| **status == wanted);
                let Some((_, solution)) = having.next() else {
                    prop_assert!(found.is_err(), "{parameters:?} has no solution of status {wanted}: {found:?}");
                    continue;
                };
                prop_assert!(having.next().is_none(), "two solutions of status {wanted}: {solutions:?}");
                let (found, nearest) = (found.unwrap(), nearest.unwrap());
                for axis in 0..6 {
                    let expected = solution[axis].to_degrees();
                    prop_assert!(same_but_for_turns(found[axis], expected), "{found:?} is not {solution:?} rad");
                    prop_assert!(same_but_for_turns(nearest[axis], expected), "{nearest:?} is not {solution:?} rad");
                    prop_assert!((nearest[axis] - near[axis]).abs() < 180.0 + 1e-6, "{nearest:?} from {near:?}");
                    let is_negative = turn & 1 << axis != 0;
                    prop_assert!(found[axis].abs() < 0.01 || (found[axis] < 0.0) == is_negative, "{found:?}");
                    let way = (found[axis] - near[axis]).abs();
                    let others = [-360.0, 360.0].map(|turn| found[axis] + turn);
                    for other in others.into_iter().filter(|other| (*other < -0.01) == is_negative) {
                        prop_assert!(way < (other - near[axis]).abs() + 0.02, "{found:?} from {near:?}");
                    }
                }
                let itself = arm.configuration(&found);
                prop_assert_eq!(itself.status, wanted);
                prop_assert_eq!(arm.ends_in(&found, itself), Ok(()));
            }
        }
    }

    #[test]
    fn a_scara_reaches_a_pose_with_the_elbow_on_either_side(
        joints in (-131.0..131.0_f64, 1.0..144.0_f64, 0.0..200.0_f64, -170.0..170.0_f64),
        turn in prop::option::of(0..16_u8),
    ) {
        let scara = Scara { link_1_mm: 225.0, link_2_mm: 275.0, height_mm: 0.0 };
        let arm = Arm::new(Arc::new(scara), AxisLimits::NONE);
        let flange = arm.forward(&[joints.0, joints.1, joints.2, joints.3, 0.0, 0.0]);
        let turn = turn.map(|turn| turn & 0b1011);
        for status in [0, 2] {
            let found = arm.inverse_in(&flange, Configuration { status, turn }, &[0.0; 6]).unwrap();
            let again = arm.forward(&found);
            prop_assert!(distance(again.position, flange.position) < 1e-9);
            prop_assert!((again.rotation.inverse() * flange.rotation).axis_angle().1 < 1e-9);
            // Where the elbow is, seen from the line between axis 1 and the flange.
            let (sine, cosine) = libm::sincos(found[0].to_radians());
            let [x, y, _] = flange.position;
            prop_assert_eq!(cosine * y - sine * x > 0.0, status == 2, "{:?}", found);
            for axis in [0, 1, 3] {
                // Next to 0° rounding chooses the sign.
                let Some(turn) = turn.filter(|_| found[axis].abs() > 0.01) else { continue };
                prop_assert_eq!(turn & 1 << axis != 0, found[axis] < 0.0, "{:?} has turn {}", found, turn);
            }
        }
    }
}

/// Every configuration in which the arm can stand at the pose that it has in these joints.
fn configurations(config: &RobotConfig, joints: &Joints) -> Vec<(Configuration, Joints)> {
    let flange = config.arm.forward(joints);
    let all = (0..8).flat_map(|status| (0..64).map(move |turn| Configuration { status, turn: Some(turn) }));
    all.filter_map(|it| Some((it, config.arm.inverse_in(&flange, it, joints).ok()?))).collect()
}

/// A motion to the pose of the flange in these joints.
fn to(config: &RobotConfig, kind: MotionKind, joints: &Joints) -> Motion {
    let target = config.arm.forward(joints).to_mm_deg().map(|coordinate| coordinate as f32);
    Motion { kind, target, base: 0, ..lin(0.0, 0.0, 0.0) }
}

#[test]
fn a_ptp_goes_to_each_configuration_that_both_arms_have_at_a_pose() {
    let cases =
        [("A", [30.0, 60.0, 100.0, 0.0, 0.0, 0.0], 4), ("B", [20.0, 30.0, -20.0, 40.0, 50.0, 60.0], 8)];
    for (setup, joints, least) in cases {
        let config = bare(setup);
        let known = configurations(&config, &joints);
        assert!(known.len() >= least, "{setup} has {} configurations: {known:?}", known.len());
        let mut robot = Driven::ready(config.clone(), Program::default());
        for (configuration, expected) in known {
            let kind = MotionKind::PtpCartesian;
            let motion = Motion { configuration: Some(configuration), ..to(&config, kind, &joints) };
            robot.run(vec![Motion { velocity: 10_000, ..motion }]);
            assert!(robot.is_done(), "{setup}, {configuration}: {:?}", robot.feedback());
            for (joint, expected) in robot.controller.joints().iter().zip(expected) {
                assert!((joint - expected).abs() < 0.01, "{setup}, {configuration}: {joint}, not {expected}");
            }
        }
    }
}

#[test]
fn without_a_configuration_a_ptp_goes_to_the_one_that_the_arm_has() {
    let config = bare("B");
    let (there, joints) = ([20.0, 30.0, -20.0, 40.0, 50.0, 60.0], [25.0, 30.0, -20.0, 40.0, 50.0, 60.0]);
    for (configuration, start) in configurations(&config, &there) {
        let mut robot = Driven::ready(RobotConfig { home: start, ..config.clone() }, Program::default());
        let motion = to(&config, MotionKind::PtpCartesian, &joints);
        robot.run(vec![motion]);
        assert!(robot.is_done(), "{configuration}: {:?}", robot.feedback());
        let status = config.arm.configuration(robot.controller.joints()).status;
        assert_eq!(status, configuration.status, "{:?}", robot.controller.joints());
    }
}

#[test]
fn a_line_is_held_to_the_configuration_that_it_leads_to() {
    let config = bare("B");
    let start = [20.0, 30.0, -20.0, 40.0, 50.0, 60.0];
    let target = [22.0, 28.0, -18.0, 38.0, 52.0, 58.0];
    let line = to(&config, MotionKind::LinCartesian, &target);
    let own = config.arm.configuration(&target);
    let run = |configuration| {
        let mut robot = Driven::ready(RobotConfig { home: start, ..config.clone() }, Program::default());
        robot.run(vec![Motion { configuration: Some(configuration), ..line }]);
        robot
    };
    for good in [own, Configuration { turn: None, ..own }] {
        assert!(run(good).is_done());
    }
    for (bad, index) in [
        (Configuration { status: own.status ^ 2, ..own }, 9),
        (Configuration { status: own.status ^ 4, turn: None }, 9),
        (Configuration { turn: own.turn.map(|turn| turn ^ 1 << 3), ..own }, 10),
    ] {
        let robot = run(bad);
        let feedback = robot.feedback();
        assert_eq!((feedback.error, feedback.finding.index), (ErrorNumber::ConfigurationMismatch, index));
        assert_eq!(*robot.controller.joints(), start, "{bad}: it moved");
    }
}

#[test]
fn a_turn_that_a_joint_has_not_names_the_joint_its_range_and_the_bit() {
    // Axis 2 of Setup B reaches from -115° to 113°: -330° is 30° with the other sign.
    let config = bare("B");
    let joints = [20.0, 30.0, -20.0, 40.0, 50.0, 60.0];
    let own = config.arm.configuration(&joints);
    let configuration = Configuration { turn: own.turn.map(|turn| turn ^ 1 << 1), ..own };
    let mut robot = Driven::ready(RobotConfig { home: joints, ..config.clone() }, Program::default());
    let kind = MotionKind::PtpCartesian;
    robot.run(vec![Motion { configuration: Some(configuration), ..to(&config, kind, &joints) }]);
    let feedback = robot.feedback();
    insta::assert_snapshot!(
        feedback.finding.in_words(feedback.error),
        @"the arm cannot have this configuration at the target (by its turn joint 2 would be at -330, its range is -115 to 113; change bit 1 of the turn)"
    );
}

#[test]
fn a_running_skill_is_not_disturbed_by_one_whose_configuration_does_not_fit() {
    let way = |is_disturbed: bool| {
        let mut robot = Driven::ready(bare("A"), Program::default());
        robot.run(vec![ptp(0.0, 40.0, 90.0)]);
        robot.call(Skill::MoveLinCartesian, vec![lin(100.0, 40.0, 90.0)]);
        robot.run_ms(100);
        if is_disturbed {
            let configuration = Some(Configuration { status: 5, turn: Some(0xFF) });
            robot.call(Skill::MovePtpCartesian, vec![Motion { configuration, ..ptp(0.0, 40.0, 90.0) }]);
        }
        let mut joints = Vec::new();
        for _ in 0..200 {
            robot.tick();
            joints.push(*robot.controller.joints());
        }
        (joints, robot.feedback().error)
    };
    let (alone, disturbed) = (way(false), way(true));
    assert_eq!(disturbed, (alone.0, ErrorNumber::NotReady));
}
