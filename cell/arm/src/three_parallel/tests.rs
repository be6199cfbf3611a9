use super::*;
use crate::{Arm, AxisLimits, Kinematics as _, distance};
use proptest::prelude::*;
use std::sync::Arc;

const UR5E: ThreeParallelParameters = ThreeParallelParameters {
    d1: 162.5,
    a2: -425.0,
    a3: -392.2,
    d4: 133.3,
    d5: 99.7,
    d6: 99.6,
    offsets: [0.0; 6],
    signs: [1; 6],
};
const UR10E: ThreeParallelParameters = ThreeParallelParameters {
    d1: 180.7,
    a2: -612.7,
    a3: -571.55,
    d4: 174.15,
    d5: 119.85,
    d6: 116.55,
    ..UR5E
};
const UR3E: ThreeParallelParameters =
    ThreeParallelParameters { d1: 151.85, a2: -243.55, a3: -213.2, d4: 131.05, d5: 85.35, d6: 92.1, ..UR5E };

/// A pose of the flange, in mm and as a quaternion, and all joints that lead to it, in degrees.
struct Known {
    arm: ThreeParallelParameters,
    position: [f64; 3],
    quaternion: [f64; 4],
    joints: [Joints; 8],
}

/// From another inverse kinematics of these arms: the package `ur-analytic-ik` 0.1.0.post3 from PyPI, which is in C++ and
/// gives all ways to reach a pose.
const KNOWN: [Known; 6] = [
    Known {
        arm: UR5E,
        position: [184.034457, -305.159894, -52.367465],
        quaternion: [0.589588834, -0.037909817, 0.770199311, -0.240293308],
        joints: [
            [81.0, -38.4278, 129.1572, -43.7295, 15.0, -161.0],
            [81.0, 81.0754, -129.1572, 95.0818, 15.0, -161.0],
            [81.0, -6.1967, 134.0, 99.1967, -15.0, 19.0],
            [81.0, 117.0, -134.0, -116.0, -15.0, 19.0],
            [-43.8098, 70.3319, 125.4476, -27.7364, 113.9837, 60.0884],
            [-43.8098, -173.1227, -125.4476, 106.6135, 113.9837, 60.0884],
            [-43.8098, 97.2233, 138.258, 112.5619, -113.9837, -119.9116],
            [-43.8098, -136.5373, -138.258, -97.1616, -113.9837, -119.9116],
        ],
    },
    Known {
        arm: UR5E,
        position: [234.941024, 151.626586, 282.250363],
        quaternion: [0.415952271, 0.492478008, 0.381304966, 0.662612739],
        joints: [
            [-176.4641, -123.2951, 147.476, -37.1418, 87.9585, 20.6023],
            [-176.4641, 8.5119, -147.476, 126.0032, 87.9585, 20.6023],
            [-176.4641, -67.4194, 156.5409, 77.9175, -87.9585, -159.3977],
            [-176.4641, 67.2395, -156.5409, -103.6594, -87.9585, -159.3977],
            [88.0, 125.8929, 146.442, -32.3349, 15.0, 141.0],
            [88.0, -102.83, -146.442, 129.272, 15.0, 141.0],
            [88.0, -179.6662, 158.0, 81.6662, -15.0, -39.0],
            [88.0, -45.0, -158.0, -97.0, -15.0, -39.0],
        ],
    },
    Known {
        arm: UR10E,
        position: [789.789012, -530.354438, 234.835315],
        quaternion: [0.841064672, 0.330758829, -0.343571233, -0.255279497],
        joints: [
            [141.0, -34.9482, 82.8197, -169.8714, 140.0, -100.0],
            [141.0, 44.3609, -82.8197, -83.5412, 140.0, -100.0],
            [141.0, -25.0, 46.0, 37.0, -140.0, 80.0],
            [141.0, 19.31, -46.0, 84.69, -140.0, 80.0],
            [-18.9919, 159.9493, 50.3262, 106.6072, 52.8961, 58.665],
            [-18.9919, -151.5948, -50.3262, 158.8038, 52.8961, 58.665],
            [-18.9919, 135.7697, 79.5583, -78.4452, -52.8961, -121.335],
            [-18.9919, -147.9862, -79.5583, 4.4272, -52.8961, -121.335],
        ],
    },
    Known {
        arm: UR10E,
        position: [-409.868606, -300.289746, 1015.254576],
        quaternion: [0.149600288, -0.911679557, -0.329597087, 0.194488814],
        joints: [
            [20.2253, -77.4143, 34.9149, 109.3919, 106.9984, -113.0269],
            [20.2253, -43.7515, -34.9149, 145.5589, 106.9984, -113.0269],
            [20.2253, -104.5479, 73.2423, -81.8019, -106.9984, 66.9731],
            [20.2253, -34.2644, -73.2423, -5.6009, -106.9984, 66.9731],
            [-117.0, -142.0, 68.0, 169.0, 62.0, 112.0],
            [-117.0, -76.6853, -68.0, -120.3147, 62.0, 112.0],
            [-117.0, -141.3858, 42.8008, 13.585, -62.0, -68.0],
            [-117.0, -100.1454, -42.8008, 57.9461, -62.0, -68.0],
        ],
    },
    Known {
        arm: UR3E,
        position: [98.658516, -219.400411, 530.777785],
        quaternion: [0.74873011, 0.059920873, -0.032260956, -0.659372384],
        joints: [
            [84.342, -110.4852, 92.8332, -68.9107, 97.0109, -76.8692],
            [84.342, -25.6395, -92.8332, 31.9101, 97.0109, -76.8692],
            [84.342, -70.3598, 55.9148, 107.8823, -97.0109, 103.1308],
            [84.342, -18.4847, -55.9148, 167.8368, -97.0109, 103.1308],
            [-30.0, -158.0, 51.0, 22.0, 84.0, 37.0],
            [-30.0, -110.6306, -51.0, 76.6306, 84.0, 37.0],
            [-30.0, -156.9693, 96.7954, 155.1739, -84.0, -143.0],
            [-30.0, -68.7335, -96.7954, -99.4711, -84.0, -143.0],
        ],
    },
    Known {
        arm: UR3E,
        position: [183.265442, -31.54404, -44.643652],
        quaternion: [0.185457529, 0.341648477, -0.453818758, 0.801829383],
        joints: [
            [140.2763, 11.7489, 139.9854, -174.6722, 114.4972, 120.0505],
            [140.2763, 131.05, -139.9854, -14.0025, 114.4972, 120.0505],
            [140.2763, 28.8375, 87.9697, 40.2549, -114.4972, -59.9495],
            [140.2763, 109.468, -87.9697, 135.5637, -114.4972, -59.9495],
            [75.0, 71.6181, 130.038, 132.3439, 54.0, 146.0],
            [75.0, -174.5776, -130.038, -81.3843, 54.0, 146.0],
            [75.0, 55.2951, 95.0, 3.7049, -54.0, -34.0],
            [75.0, 142.0, -95.0, 107.0, -54.0, -34.0],
        ],
    },
];

/// Returns an arm whose joints have other signs and other zeros than the model.
fn odd() -> ThreeParallelParameters {
    ThreeParallelParameters {
        a2: 380.0,
        a3: 340.0,
        d4: -90.0,
        offsets: [10.0, -90.0, 30.0, -90.0, 5.0, 180.0],
        signs: [-1, 1, 1, -1, 1, -1],
        ..UR5E
    }
}

fn any_joints() -> impl Strategy<Value = Joints> {
    prop::array::uniform6(-360.0..360.0_f64)
}

/// Returns whether the joints are away from the places where two configurations meet; there, rounding decides between
/// them.
fn is_regular(arm: &ThreeParallel, joints: &Joints) -> bool {
    let model = arm.model(joints);
    let ([elbow, wrist], _) = sin_cos([model[2], model[4]]);
    let ([lift], _) = sin_cos([model[1] + model[2] + model[3]]);
    let (_, [along_2, along_3]) = sin_cos([model[1], model[1] + model[2]]);
    let radial = arm.0.a2 * along_2 + arm.0.a3 * along_3 + arm.0.d5 * lift;
    radial.abs() > 5.0 && elbow.abs() > 0.02 && wrist.abs() > 0.02
}

fn same(a: &Joints, b: &Joints, off_deg: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| {
        let turn = a - b;
        (turn - 360.0 * (turn / 360.0).round()).abs() < off_deg
    })
}

fn assert_at(found: &Frame, expected: &Frame, off_mm: f64, off_deg: f64) {
    assert!(distance(found.position, expected.position) < off_mm, "{found:?} is not {expected:?}");
    let (_, angle) = (found.rotation.inverse() * expected.rotation).axis_angle();
    assert!(angle < off_deg, "{found:?} is turned by {angle}° from {expected:?}");
}

#[test]
fn another_packages_poses_and_all_of_its_eight_ways_to_them_are_ours_one_for_each_status() {
    for Known { arm, position, quaternion, joints } in KNOWN {
        let arm = ThreeParallel::new(arm);
        let flange = Frame { position, rotation: Rotation::from_quaternion(quaternion) };
        let mut missing: Vec<u8> = (0..8).collect();
        for theirs in joints {
            // They are rounded to 0.0001°.
            assert_at(&arm.forward(&theirs), &flange, 5e-3, 5e-4);
            let status = arm.status(&theirs);
            missing.retain(|other| *other != status);
            for ours in [
                arm.inverse(&flange, &theirs).unwrap(),
                arm.inverse_with(&flange, status, &[0.0; 6]).unwrap(),
            ] {
                assert!(same(&ours, &theirs, 1e-3), "{ours:?} is not {theirs:?}");
                assert_at(&arm.forward(&ours), &flange, 1e-5, 1e-6);
            }
        }
        assert!(missing.is_empty(), "no way has status {missing:?}");
    }
}

#[test]
fn with_its_wrist_stretched_axis_6_stays_and_the_pose_is_reached() {
    let arm = ThreeParallel::new(UR5E);
    for wrist in [0.0, 180.0, -180.0] {
        let joints = [20.0, -70.0, 80.0, 40.0, wrist, 35.0];
        let flange = arm.forward(&joints);
        let found = arm.inverse(&flange, &joints).unwrap();
        assert!((found[5] - 35.0).abs() < 1e-6, "{found:?}");
        assert_at(&arm.forward(&found), &flange, 1e-6, 1e-6);
    }
}

#[test]
fn what_it_cannot_reach_is_refused_with_the_distance() {
    let arm = Arm::new(Arc::new(ThreeParallel::new(UR5E)), AxisLimits::NONE);
    let near = [0.0, -90.0, 90.0, -90.0, -90.0, 0.0];
    let far = Frame::from_mm_deg([-1100.0, 0.0, 300.0, 0.0, 0.0, 180.0]);
    insta::assert_snapshot!(arm.inverse(&far, &near).unwrap_err(), @"the wrist centre would be 1020.129 mm from axis 2; the arm reaches from 32.800 to 817.200 mm");
    let close = Frame::from_mm_deg([-60.0, 20.0, 300.0, 0.0, 0.0, 180.0]);
    insta::assert_snapshot!(arm.inverse(&close, &near).unwrap_err(), @"the wrist would be 63.246 mm from axis 1; the arm lies beside that axis and reaches from 133.300 mm on");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn inverse_undoes_forward_in_every_configuration(joints in any_joints()) {
        for parameters in [UR5E, odd()] {
            let arm = ThreeParallel::new(parameters);
            prop_assume!(is_regular(&arm, &joints));
            let found = arm.inverse(&arm.forward(&joints), &joints).unwrap();
            prop_assert!(same(&found, &joints, 1e-6), "{found:?} is not {joints:?}");
        }
    }

    #[test]
    fn however_little_the_wrist_is_bent_the_pose_is_reached(
        mut joints in any_joints(),
        exponent in -12.0..0.0_f64,
        stretched in prop::sample::select(vec![-180.0, 0.0, 180.0]),
        sign in prop::sample::select(vec![-1.0, 1.0]),
    ) {
        joints[4] = stretched + sign * libm::pow(10.0, exponent);
        for parameters in [UR5E, UR10E, odd()] {
            let arm = ThreeParallel::new(parameters);
            // Away from the arm's other singular positions.
            let bent: Joints = core::array::from_fn(|i| if i == 4 { 90.0 } else { joints[i] });
            prop_assume!(is_regular(&arm, &bent));
            let flange = arm.forward(&joints);
            let again = arm.forward(&arm.inverse(&flange, &joints).unwrap());
            prop_assert!(distance(again.position, flange.position) < 1e-7, "{again:?} is not {flange:?}");
            let turned = (again.rotation.inverse() * flange.rotation).axis_angle().1;
            prop_assert!(turned < 2e-7, "{again:?} is turned by {turned}° from {flange:?}");
        }
    }

    #[test]
    fn every_status_that_can_be_solved_leads_to_the_pose_and_has_that_status(joints in any_joints()) {
        for parameters in [UR5E, odd()] {
            let arm = ThreeParallel::new(parameters);
            let flange = arm.forward(&joints);
            for status in 0..8 {
                let Ok(found) = arm.inverse_with(&flange, status, &joints) else { continue };
                prop_assume!(is_regular(&arm, &found));
                prop_assert_eq!(arm.status(&found), status);
                let again = arm.forward(&found);
                prop_assert!(distance(again.position, flange.position) < 1e-6);
                prop_assert!((again.rotation.inverse() * flange.rotation).axis_angle().1 < 1e-6);
            }
        }
    }
}
