//! Suspend and resume: whenever they come, the arm goes on and ends where it should.

use std::time::Duration;

use protocol::image::{Control, Motion, MotionKind, Skill, State, Status};
use robot_node::{Program, RobotConfig};

use crate::driven::{Driven, bare, lin, ptp};

#[test]
fn a_resume_goes_on_in_whichever_cycle_of_a_stop_it_comes() {
    let slow = Motion {
        kind: MotionKind::PtpCartesian,
        target: [124.5356, 478.25, 76.0, 166.0, 0.0, 180.0],
        velocity: 1_386,
        acceleration: 5_480,
        ..Motion::EMPTY
    };
    let home = [100.641, -25.059, 82.8, -262.186, 0.0, 0.0];
    for suspended in (1..100).step_by(4) {
        for later in 1..30 {
            let mut robot = Driven::ready(RobotConfig { home, ..bare("A") }, Program::default());
            robot.call(Skill::MoveContinuous, vec![slow]);
            (0..suspended).for_each(|_| robot.tick());
            robot.control(Control::SUSPEND);
            (0..later).for_each(|_| robot.tick());
            robot.control(Control::RESUME);
            robot.wait_for_end();
            assert!(robot.is_done(), "after {suspended} and {later} cycles: {:?}", robot.feedback());
        }
    }
}

#[test]
fn a_skill_that_is_suspended_while_its_arm_settles_ends_only_when_it_is_resumed() {
    let config = RobotConfig { skill_overhead: Duration::from_millis(400), ..bare("A") };
    let mut robot = Driven::ready(config, Program::default());
    robot.call(Skill::MovePtpCartesian, vec![ptp(0.0, 0.0, 100.0)]);
    while robot.feedback().executed == 0 {
        robot.tick();
    }
    robot.control(Control::SUSPEND);
    (0..200).for_each(|_| robot.tick());
    let feedback = robot.feedback();
    assert_eq!((feedback.state, feedback.status.contains(Status::BUSY)), (State::Suspended, true));
    robot.control(Control::RESUME);
    robot.wait_for_end();
    assert!(robot.is_done());
}

/// From 200 mm/s, however the arm is stopped. The deceleration rises and falls with the jerk, which takes longer in a long cycle.
#[test]
fn a_stop_on_the_path_takes_the_time_of_the_programmed_deceleration() {
    type Stop = fn(&mut Driven);
    let stops: [(&str, Stop); 3] = [
        ("suspended", |robot| robot.control(Control::SUSPEND)),
        ("halted", |robot| robot.control(Control::HALT)),
        ("at override 0", |robot| robot.command.override_percent = 0),
    ];
    for cycle_ms in [1, 4, 12, 24] {
        for (acceleration, deceleration) in [(2_500, 2_500), (2_500, 500), (2_500, 200), (500, 2_500)] {
            for (how, stop) in stops {
                let cycle = Duration::from_millis(cycle_ms);
                let mut robot = Driven::ready(RobotConfig { cycle, ..bare("A") }, Program::default());
                robot.run(vec![ptp(0.0, 40.0, 90.0)]);
                let line = Motion { velocity: 2_000, acceleration, deceleration, ..lin(300.0, 40.0, 90.0) };
                robot.call(Skill::MoveContinuous, vec![line]);
                let place = |robot: &Driven| robot.controller.joints().map(f64::to_bits);
                robot.wait(|feedback| feedback.pose[0] > 120.0);
                stop(&mut robot);
                let (from, mut before) = (robot.at, None);
                while before.replace(place(&robot)) != Some(place(&robot)) || robot.at == from {
                    robot.tick();
                }
                let took_s = robot.at.since(from).as_secs_f64();
                let ideal_s = 200.0 / f64::from(deceleration);
                let most_s = 1.06 * ideal_s + 0.03 + 4.0 * cycle.as_secs_f64();
                assert!(
                    took_s <= most_s,
                    "{how} in cycles of {cycle_ms} ms, {acceleration} and {deceleration} mm/s²: {took_s:.3} s for {ideal_s:.3} s"
                );
            }
        }
    }
}

/// A deceleration far below the acceleration, in cycles in which the arm becomes much faster: the rate of its law has to fall at once,
/// and then slower and slower.
#[test]
fn a_stop_while_the_arm_speeds_up_takes_the_time_of_the_programmed_deceleration() {
    let arm = bare("A").arm;
    for (cycle_ms, jerk) in [1, 4, 12, 24].into_iter().flat_map(|ms| [(ms, 50_000.0), (ms, 1_400_000.0)]) {
        for (acceleration, deceleration) in
            [(2_500, 2_500), (2_500, 250), (1_500, 150), (1_500, 15), (300, 150)]
        {
            for cycles in [1, 2, 3, 5, 8] {
                let cycle = Duration::from_millis(cycle_ms);
                let config = RobotConfig { cycle, path_jerk_mm_s3: jerk, ..bare("A") };
                let mut robot = Driven::ready(config, Program::default());
                robot.run(vec![ptp(0.0, 40.0, 90.0)]);
                let line = Motion { velocity: 2_000, acceleration, deceleration, ..lin(300.0, 40.0, 90.0) };
                robot.call(Skill::MoveContinuous, vec![line]);
                let place = |robot: &Driven| arm.forward(robot.controller.joints()).position;
                robot.wait(|feedback| f64::from(feedback.pose[0]) > 1.0);
                (0..cycles).for_each(|_| robot.tick());
                robot.command.override_percent = 0;
                let (from, mut before, mut fastest) = (robot.at, place(&robot), 0.0_f64);
                loop {
                    robot.tick();
                    let now = place(&robot);
                    let speed = robot_node::arm::distance(before, now) / cycle.as_secs_f64();
                    (before, fastest) = (now, fastest.max(speed));
                    if speed == 0.0 {
                        break;
                    }
                }
                let took_s = robot.at.since(from).as_secs_f64();
                let [acceleration, deceleration] = [acceleration, deceleration].map(f64::from);
                // The acceleration falls, turns and comes back.
                let turns_s = 1.2 * (acceleration + 2.0 * deceleration) / jerk;
                let most_s = 1.06 * fastest / deceleration + turns_s + 0.03 + 6.0 * cycle.as_secs_f64();
                assert!(
                    took_s <= most_s,
                    "cycles of {cycle_ms} ms, {jerk} mm/s³, {acceleration} and {deceleration} mm/s², in cycle {cycles}: \
                     {took_s:.3} s from {fastest:.1} mm/s, at most {most_s:.3} s"
                );
            }
        }
    }
}
