//! Corners between a PTP and a motion of the tool: however far the PTP turns a joint, none jumps.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use protocol::image::{ErrorNumber, Motion, MotionKind, Skill, Status};
use robot_node::RobotConfig;
use robot_node::arm::{AXES, Joints};

use crate::driven::{Driven, bare};

/// How much of a limit may be exceeded: what rounding and single precision leave.
const TOLERANCE: f64 = 1.001;

/// A PTP to these joints.
fn ptp_to(joints: Joints) -> Motion {
    Motion {
        kind: MotionKind::PtpJoint,
        target: joints.map(|joint| joint as f32),
        velocity: 10_000,
        acceleration: 10_000,
        approximation: 3_000,
        ..Motion::EMPTY
    }
}

/// A line to a place that is off where the flange is at these joints.
fn line_from(joints: Joints, off: [f64; 3], config: &RobotConfig) -> Motion {
    let mut target = config.arm.forward(&joints).to_mm_deg();
    target.iter_mut().zip(off).for_each(|(coordinate, off)| *coordinate += off);
    Motion {
        kind: MotionKind::LinCartesian,
        target: target.map(|coordinate| coordinate as f32),
        velocity: 2_500,
        acceleration: 5_000,
        approximation: 3_000,
        ..Motion::EMPTY
    }
}

/// Runs the motions as one and returns the error, if there was one. In every cycle all joints are within their range
/// and limits, also where it ends with an error.
fn run_within_limits(
    config: RobotConfig,
    motions: Vec<Motion>,
) -> Result<Option<ErrorNumber>, TestCaseError> {
    let (arm, cycle_s, home) = (config.arm.clone(), config.cycle.as_secs_f64(), config.home);
    let mut robot = Driven::ready(config, Vec::new().into());
    robot.call(Skill::MoveContinuous, motions);
    let (mut before, mut step, mut change) = (home, [0.0; AXES], [0.0; AXES]);
    let ended = Status::DONE.0 | Status::ABORTED.0 | Status::ERROR.0;
    let mut cycles = 0;
    while robot.feedback().number != robot.command.number || robot.feedback().status.0 & ended == 0 {
        robot.tick();
        let joints = *robot.controller.joints();
        let next: Joints = core::array::from_fn(|axis| joints[axis] - before[axis]);
        let next_change: Joints = core::array::from_fn(|axis| next[axis] - step[axis]);
        let jerk: Joints = core::array::from_fn(|axis| next_change[axis] - change[axis]);
        let limits = arm.limits();
        let loads = [
            limits.speed_load(&next.map(|step| step / cycle_s)),
            limits.acceleration_load(&next_change.map(|change| change / (cycle_s * cycle_s))),
            limits.jerk_load(&jerk.map(|jerk| jerk / (cycle_s * cycle_s * cycle_s))),
        ];
        prop_assert!(loads.iter().all(|load| load.share <= TOLERANCE), "{loads:?}");
        prop_assert!(arm.within_range(&joints).is_ok(), "{joints:?}");
        (before, step, change) = (joints, next, next_change);
        cycles += 1;
        prop_assert!(cycles < 10_000, "it never ends: {:?}", robot.feedback());
    }
    let feedback = robot.feedback();
    Ok(feedback.status.contains(Status::ERROR).then_some(feedback.error))
}

#[test]
fn a_line_after_a_ptp_that_turns_the_tool_is_reached_without_a_jump() {
    let one = [-3.976_39, -89.217_84, 180.0, 81.948_63, 0.0, 0.0];
    let three = [-0.459_74, -97.230_12, 172.200_04, -274.303_96, 0.0, 0.0];
    let config = bare("A");
    let motions = vec![
        ptp_to(one),
        line_from(one, [10.5, -20.0, -6.2], &config),
        ptp_to(three),
        line_from(three, [-4.9, 42.5, -20.9], &config),
    ];
    assert_eq!(run_within_limits(config, motions).unwrap(), None);
}

fn joints(setup: &str) -> impl Strategy<Value = Joints> + use<> {
    let limits = *bare(setup).arm.limits();
    let axes = bare(setup).arm.axes();
    proptest::array::uniform6(0.02..0.98_f64).prop_map(move |shares| {
        core::array::from_fn(|axis| {
            let (lower, upper) = (limits.lower[axis], limits.upper[axis]);
            if axis < axes { lower + shares[axis] * (upper - lower) } else { 0.0 }
        })
    })
}

fn lists(setup: &str) -> impl Strategy<Value = Vec<(Joints, [f64; 3])>> + use<> {
    let off = (-60.0..60.0_f64, -60.0..60.0_f64, -60.0..60.0_f64);
    proptest::collection::vec((joints(setup), off.prop_map(|(x, y, z)| [x, y, z])), 1..4)
}

fn check(setup: &str, list: &[(Joints, [f64; 3])]) -> Result<(), TestCaseError> {
    let config = bare(setup);
    let motions = list.iter().flat_map(|(joints, off)| [ptp_to(*joints), line_from(*joints, *off, &config)]);
    let motions: Vec<_> = motions.collect();
    let error = run_within_limits(config, motions)?;
    // A line that the arm cannot follow is refused before the arm comes to it.
    let refused = [
        ErrorNumber::Unreachable,
        ErrorNumber::AxisLimit,
        ErrorNumber::ConfigurationChange,
        ErrorNumber::Singular,
    ];
    prop_assert!(error.is_none_or(|error| refused.contains(&error)), "{error:?}");
    Ok(())
}

proptest! {
    // The same lists every time; `bench judge` looks at as many others as one asks for.
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]

    #[test]
    fn however_far_a_ptp_turns_a_scara_no_corner_makes_a_joint_jump(list in lists("A")) {
        check("A", &list)?;
    }

    #[test]
    fn however_far_a_ptp_turns_six_axes_no_corner_makes_a_joint_jump(list in lists("B")) {
        check("B", &list)?;
    }
}
