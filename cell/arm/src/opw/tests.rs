use super::*;
use crate::{Arm, AxisLimits, Kinematics as _, distance};
use proptest::prelude::*;
use rs_opw_kinematics::glam::{DQuat, DVec3};
use rs_opw_kinematics::kinematic_traits::{Kinematics as _, Pose};
use std::sync::Arc;

mod reference;

use reference::{IRB_1100, ODD, reference};

const LOWER: Joints = [-230.0, -115.0, -205.0, -230.0, -125.0, -400.0];
const UPPER: Joints = [230.0, 113.0, 55.0, 230.0, 120.0, 400.0];

fn arm() -> Arm {
    let limits = AxisLimits { lower: LOWER, upper: UPPER, ..AxisLimits::NONE };
    Arm::new(Arc::new(Opw::new(IRB_1100)), limits)
}

fn any_joints() -> impl Strategy<Value = Joints> {
    (-230.0..230.0, -115.0..113.0, -205.0..55.0, -230.0..230.0, -125.0..120.0, -400.0..400.0)
        .prop_map(|(q1, q2, q3, q4, q5, q6): (f64, f64, f64, f64, f64, f64)| [q1, q2, q3, q4, q5, q6])
}

/// Returns whether the joints are away from the places where two configurations meet; there, rounding decides between
/// them.
fn is_regular(opw: &Opw, joints: &Joints) -> bool {
    let model = opw.model(joints);
    let elbow = model[2] + opw.lean;
    let ([upper_arm, forearm, elbow, wrist], _) = sin_cos([model[1], model[1] + elbow, elbow, model[4]]);
    let forward = opw.parameters.c2 * upper_arm + opw.forearm * forearm + opw.parameters.a1;
    forward.abs() > 5.0 && elbow.abs() > 0.02 && wrist.abs() > 0.02
}

#[test]
fn at_zero_the_flange_is_in_front_of_the_upright_arm() {
    let flange = Opw::new(IRB_1100).forward(&[0.0; 6]);
    assert!(distance(flange.position, [314.0, 0.0, 562.0]) < 1e-9, "{flange:?}");
    let forward = flange.rotation.rotate([0.0, 0.0, 1.0]);
    assert!(distance(forward, [1.0, 0.0, 0.0]) < 1e-12, "the flange looks along {forward:?}");
}

#[test]
fn what_it_cannot_reach_is_refused_with_the_reach_of_the_wrist() {
    let target = Frame::from_mm_deg([600.0, 0.0, 263.0, 0.0, 0.0, 180.0]);
    let error = arm().inverse(&target, &[0.0; 6]).unwrap_err();
    insta::assert_snapshot!(error, @"the wrist centre would be 600.000 mm from axis 2; the arm reaches from 25.200 to 475.200 mm");
}

#[test]
fn a_wrist_nearer_to_axis_1_than_the_plane_of_the_arm_is_refused_with_both_distances() {
    let beside = Opw::new(OpwParameters { b: 40.0, ..IRB_1100 });
    let target = Frame::from_mm_deg([30.0, 0.0, 400.0, 0.0, 0.0, 180.0]);
    let error = beside.inverse(&target, &[0.0; 6]).unwrap_err();
    insta::assert_snapshot!(error, @"the wrist would be 30.000 mm from axis 1; the arm lies beside that axis and reaches from 40.000 mm on");
    assert_eq!(error.missing(), Some((10.0, "mm")));
}

#[test]
fn a_wrist_right_above_axis_1_has_no_direction_and_is_reached_nevertheless() {
    let opw = Opw::new(IRB_1100);
    let target = Frame::from_mm_deg([0.0, 0.0, 691.0, 0.0, 0.0, 0.0]);
    let found = opw.inverse(&target, &[0.0, 10.0, 10.0, 0.0, 10.0, 0.0]).unwrap();
    let again = opw.forward(&found);
    assert!(distance(again.position, target.position) < 1e-9, "{found:?}");
    assert!((again.rotation.inverse() * target.rotation).axis_angle().1 < 1e-6, "{found:?}");
}

#[test]
fn axis_6_goes_on_past_a_full_half_turn_and_comes_back_where_it_must() {
    let arm = arm();
    let at = |q6: f64| [0.0, 0.0, 0.0, 0.0, 60.0, q6];
    let past = arm.inverse(&arm.forward(&at(200.0)), &at(150.0)).unwrap();
    assert!((past[5] - 200.0).abs() < 1e-9, "{past:?}");
    let back = arm.inverse(&arm.forward(&at(410.0 - 360.0)), &at(390.0)).unwrap();
    assert!((back[5] - 50.0).abs() < 1e-9, "410° is beyond the range: {back:?}");
    assert!(arm.follow(&arm.forward(&at(50.0)), &at(390.0)).is_err(), "a path cannot turn back");
}

#[test]
fn a_stretched_wrist_leaves_axis_4_where_it_is() {
    let arm = arm();
    let joints = [10.0, 20.0, -30.0, 35.0, 0.0, 15.0];
    let found = arm.follow(&arm.forward(&joints), &joints).unwrap();
    for (found, expected) in found.iter().zip(joints) {
        assert!((found - expected).abs() < 1e-5, "{found} is not {expected}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn inverse_undoes_forward_in_every_configuration(joints in any_joints()) {
        prop_assume!(is_regular(&Opw::new(IRB_1100), &joints));
        let arm = arm();
        let found = arm.inverse(&arm.forward(&joints), &joints).unwrap();
        for (found, expected) in found.iter().zip(joints) {
            prop_assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
        }
    }

    #[test]
    fn forward_undoes_inverse_for_an_arm_with_every_parameter(joints in any_joints(), near in any_joints()) {
        let opw = Opw::new(ODD);
        prop_assume!(is_regular(&opw, &joints) && is_regular(&opw, &near));
        let flange = opw.forward(&joints);
        if let Ok(found) = opw.inverse(&flange, &near) {
            let again = opw.forward(&found);
            prop_assert!(distance(again.position, flange.position) < 1e-6);
            prop_assert!((again.rotation.inverse() * flange.rotation).axis_angle().1 < 1e-6);
        }
    }

    #[test]
    fn the_crate_has_the_flange_at_the_same_pose(joints in any_joints()) {
        for parameters in [IRB_1100, ODD] {
            let found = Opw::new(parameters).forward(&joints);
            let expected = reference(parameters).forward(&joints.map(f64::to_radians));
            prop_assert!(distance(found.position, expected.translation.to_array()) < 1e-9);
            let DQuat { x, y, z, w } = expected.rotation;
            let between = found.rotation.inverse() * Rotation::from_quaternion([w, x, y, z]);
            prop_assert!(between.axis_angle().1 < 1e-9, "{between:?}");
        }
    }

    #[test]
    fn the_crate_finds_the_same_joints_among_all_configurations(joints in any_joints(), near in any_joints()) {
        for parameters in [IRB_1100, ODD] {
            let opw = Opw::new(parameters);
            prop_assume!(is_regular(&opw, &joints) && is_regular(&opw, &near));
            let flange = opw.forward(&joints);
            let [w, x, y, z] = flange.rotation.quaternion();
            let pose = Pose::from_parts(DVec3::from_array(flange.position), DQuat::from_xyzw(x, y, z, w));
            let Ok(found) = opw.inverse(&flange, &near) else { continue };
            let same = |other: &Joints| {
                other.iter().zip(found).all(|(other, found)| {
                    let turn = other.to_degrees() - found;
                    (turn - 360.0 * (turn / 360.0).round()).abs() < 1e-4
                })
            };
            let all = reference(parameters).inverse(&pose);
            prop_assert!(all.iter().any(same), "{found:?} is not among {all:?} rad");
        }
    }
}
