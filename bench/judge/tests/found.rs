//! What a law finds out about an arm that breaks it, seen cycle by cycle without a robot.
#![expect(clippy::unwrap_used, reason = "a test fails where there is nothing to unwrap")]

use judge::case::{Case, Execution, Kind, Programmed};
use judge::kinematics::Joints;
use judge::law::{Law, Seen};
use judge::{Broken, Class, generator};
use protocol::image::{Digest, Feedback, State, Status};

/// An arm that somebody moves by hand, and its judge.
struct WatchedRun {
    law: Law,
    joints: Joints,
    feedback: Feedback,
}

impl WatchedRun {
    /// Setup A's own arm, stretched half out, asked for two lines.
    fn new(class: Class) -> Self {
        Self::with_acceleration(class, 1_500.0)
    }

    /// The same with another rated acceleration of axis 1, in degrees/s².
    fn with_acceleration(class: Class, of_axis_1: f64) -> Self {
        let setup = setup::setup("A").unwrap();
        let mut case: Case = generator::case(&setup, 1, 0);
        case.arm = judge::case::Arm::of(&setup);
        case.arm.home_deg = vec![10.0, 60.0, 100.0, 0.0];
        case.arm.acceleration_deg_s2[0] = of_axis_1;
        let mut law = Law::new(&case, &setup, &[class]);
        let line = Programmed {
            kind: Kind::Lin,
            target: [300.0, 300.0, 100.0, 70.0, 0.0, 180.0],
            auxiliary: [0.0; 3],
            velocity: 1_000,
            acceleration: 1_000,
            deceleration: 0,
            jerk: 0,
            approximation: 0,
            tool: 0,
            base: 0,
            written_in_cycle: 0,
        };
        law.start(1, Execution::Continuous, &[line, line]);
        let feedback = Feedback { number: 1, state: State::Running, accepted: 2, ..Feedback::default() };
        Self { law, joints: case.arm.home(), feedback }
    }

    fn look(&mut self) -> Option<(Class, Broken)> {
        let accepted = Digest::default();
        let command = None;
        self.law.look(&Seen { command, feedback: &self.feedback, joints: &self.joints, accepted: &accepted });
        self.law.found().map(|violation| (violation.class, violation.what))
    }
}

#[test]
fn a_joint_that_jumps_is_found_with_its_figures() {
    let mut arm = WatchedRun::new(Class::JointSpeed);
    assert_eq!(arm.look(), None);
    arm.joints[3] += 360.0;
    let (class, what) = arm.look().unwrap();
    assert_eq!(class, Class::JointSpeed);
    let Broken::Joint { joint, figure, limit, unit } = what else { panic!("{what:?}") };
    assert_eq!((joint, limit, unit), (4, 2_400.0, "°/s"));
    assert!((figure - 90_000.0).abs() < 1e-6, "{figure}");
}

#[test]
fn an_arm_that_stops_dead_breaks_the_law_of_acceleration() {
    let mut arm = WatchedRun::new(Class::JointAcceleration);
    // 1500 °/s² are 0.024° a cycle and cycle; the arm speeds up with half of it, and then stands.
    for cycle in 0..10 {
        arm.joints[0] += 0.012 * f64::from(cycle);
        assert_eq!(arm.look(), None);
    }
    let (class, what) = arm.look().unwrap();
    assert_eq!(class, Class::JointAcceleration);
    assert!((what.ratio().unwrap() - 0.108 / 0.024).abs() < 1e-6, "{what:?}");
}

#[test]
fn a_limit_itself_is_kept_and_a_hundred_thousandth_more_is_not() {
    let limits =
        [(Class::JointSpeed, 420.0), (Class::JointAcceleration, 1_500.0), (Class::JointJerk, 150_000.0)];
    let cycle_s = 0.004;
    let powers = [cycle_s, cycle_s * cycle_s, cycle_s * cycle_s * cycle_s];
    for (power, (class, limit)) in powers.into_iter().zip(limits) {
        for (share, is_kept) in [(1.0, true), (1.00001, false)] {
            let mut arm = WatchedRun::new(class);
            // The difference of this order in the first cycle is the limit; the lower ones follow.
            arm.joints[0] += share * limit * power;
            assert_eq!(arm.look().is_none(), is_kept, "{class:?}, {share} of the limit");
        }
    }
}

#[test]
fn an_arm_that_becomes_faster_after_it_began_to_slow_down_is_found() {
    let found_when_turned_by = |faster_deg: f64| {
        let mut arm = WatchedRun::new(Class::ToolSpeed);
        // Without a command it is to stop.
        for cycle in 0..60 {
            arm.joints[0] += if cycle < 40 { 0.02 } else { faster_deg };
            if let Some(found) = arm.look() {
                return Some((cycle, found));
            }
        }
        None
    };
    assert_eq!(found_when_turned_by(0.0201), None);
    let (cycle, (class, what)) = found_when_turned_by(0.0204).unwrap();
    assert_eq!((cycle, class), (40, Class::ToolSpeed));
    let Broken::Figure { quantity, figure, limit, .. } = what else { panic!("{what:?}") };
    assert!(
        quantity.starts_with("while it slows down") && (figure / limit - 1.02 / 1.01).abs() < 1e-3,
        "{figure} {limit}"
    );
}

#[test]
fn a_tool_may_become_faster_while_a_joint_brakes_with_all_that_it_has() {
    // Axis 1 comes to rest while axis 2 swings out.
    let is_found = |braking_share: f64| {
        let mut arm = WatchedRun::with_acceleration(Class::ToolSpeed, 15.0);
        let (mut step, mut out) = (0.02, 0.0);
        for cycle in 0..60 {
            if cycle >= 40 {
                // The rated acceleration in degrees a cycle².
                step -= braking_share * 15.0 * 0.004 * 0.004;
                out += 0.001;
            }
            arm.joints[0] += step;
            arm.joints[1] += out;
            if arm.look().is_some() {
                return true;
            }
        }
        false
    };
    assert_eq!((is_found(0.0), is_found(0.5), is_found(0.95)), (true, true, false));
}

#[test]
fn a_joint_beyond_its_range_is_found() {
    let mut arm = WatchedRun::new(Class::Range);
    arm.joints[2] = 200.001;
    assert_eq!(arm.look().unwrap().0, Class::Range);
}

#[test]
fn a_tool_beside_its_line_is_found() {
    let mut arm = WatchedRun::new(Class::Course);
    assert_eq!(arm.look(), None, "at the start of the line");
    arm.joints[2] += 0.01;
    let (_, what) = arm.look().unwrap();
    let Broken::Figure { figure, .. } = what else { panic!("{what:?}") };
    assert!(figure > 0.0099 && figure < 0.0101, "{figure} mm");
}

#[test]
fn a_count_that_falls_is_found() {
    let mut arm = WatchedRun::new(Class::Count);
    arm.feedback.executed = 1;
    assert_eq!(arm.look(), None);
    arm.feedback.executed = 0;
    assert_eq!(arm.look().unwrap().0, Class::Count);
}

#[test]
fn a_target_that_the_tool_never_came_to_does_not_count_as_executed() {
    let mut arm = WatchedRun::new(Class::Executed);
    arm.feedback.executed = 1;
    assert_eq!(arm.look().unwrap().0, Class::Executed);
}

#[test]
fn done_without_all_motions_is_found() {
    let mut arm = WatchedRun::new(Class::Done);
    (arm.feedback.executed, arm.feedback.state) = (1, State::Ready);
    arm.feedback.status.set(Status::DONE, true);
    assert_eq!(arm.look().unwrap().0, Class::Done);
}

#[test]
fn an_error_in_the_middle_of_a_motion_is_found() {
    let mut arm = WatchedRun::new(Class::LateError);
    for _ in 0..3 {
        arm.joints[0] += 0.01;
        arm.look();
    }
    arm.feedback.state = State::Halted;
    arm.feedback.error = protocol::image::ErrorNumber::AxisLimit;
    arm.feedback.status.set(Status::ERROR, true);
    assert_eq!(arm.look().unwrap().0, Class::LateError);
}

#[test]
fn a_feedback_of_other_joints_is_found() {
    let mut arm = WatchedRun::new(Class::Feedback);
    arm.feedback.joints = [10.0, 60.0, 100.5, 0.0, 0.0, 0.0];
    assert_eq!(arm.look().unwrap().0, Class::Feedback);
}
