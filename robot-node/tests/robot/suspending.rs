//! Suspend and resume: whenever they come, the arm goes on and ends where it should.

use std::time::Duration;

use protocol::image::{Control, Motion, MotionKind, Skill, State, Status};
use robot_node::{Program, RobotConfig};

use crate::driven::{Driven, bare, ptp};

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
