//! The override while a skill runs: 0 stops the arm on its path, a higher one lets it go on, and one above 100 % is refused.

use protocol::image::{Control, ErrorNumber, Motion, Skill, State, Status};
use robot_node::{Program, RobotConfig, RobotEvent};

use crate::driven::{Driven, bare, lin, press, ptp, seat};

/// Setup A's robot at the start of a line.
fn at_the_lines_start() -> Driven {
    let mut robot = Driven::ready(bare("A"), Program::default());
    robot.run(vec![ptp(0.0, 0.0, 100.0)]);
    robot.events.clear();
    robot
}

/// A line, a corner and a line.
fn around_a_corner() -> Vec<Motion> {
    vec![Motion { approximation: 2_000, ..lin(100.0, 0.0, 100.0) }, lin(100.0, 80.0, 100.0)]
}

/// Joints in each cycle from the call of a skill to its end, without those in which the arm stands.
fn driven(robot: &mut Driven, mut each: impl FnMut(&mut Driven, usize)) -> Vec<[f64; 6]> {
    let mut places = Vec::new();
    let number = robot.command.number;
    while robot.feedback().number != number || !robot.is_done() {
        assert!(places.len() < 100_000, "it never ends: {:?}", robot.feedback());
        each(robot, places.len());
        robot.tick();
        places.push(*robot.controller.joints());
    }
    places
}

#[test]
fn at_override_0_the_arm_stands_on_its_path_and_goes_on_with_a_higher_one() {
    // On a straight part, and within the corner.
    for until in [50.0, 95.0] {
        let mut robot = at_the_lines_start();
        robot.call(Skill::MoveContinuous, around_a_corner());
        robot.wait(|feedback| feedback.pose[0] > until);
        robot.command.override_percent = 0;
        robot.wait(|feedback| feedback.status.contains(Status::AT_REST));
        let stopped = *robot.feedback();
        assert_eq!((stopped.state, stopped.override_percent), (State::Running, 0));
        assert!(stopped.status.contains(Status::BUSY) && stopped.pose[0] > until, "{stopped:?}");
        robot.run_ms(2_000);
        assert_eq!(robot.feedback().pose, stopped.pose);
        robot.command.override_percent = 30;
        robot.wait(|feedback| feedback.path_speed > 70.0);
        robot.wait_for_end();
        assert!(robot.is_done(), "{:?}", robot.feedback());
        assert_eq!((robot.feedback().executed, robot.feedback().blends_suppressed), (2, 0));
        assert!((robot.feedback().pose[1] - 80.0).abs() < 1e-3, "{:?}", robot.feedback().pose);
    }
}

#[test]
fn a_skill_that_is_started_at_override_0_waits_on_its_path_for_a_higher_one() {
    let mut robot = at_the_lines_start();
    let start = *robot.controller.joints();
    robot.command.override_percent = 0;
    robot.call(Skill::MoveContinuous, around_a_corner());
    robot.run_ms(1_000);
    let waiting = *robot.feedback();
    assert_eq!((waiting.state, waiting.accepted, waiting.executed), (State::Running, 2, 0));
    assert!(waiting.status.contains(Status::BUSY | Status::AT_REST) && *robot.controller.joints() == start);
    robot.command.override_percent = 100;
    robot.wait_for_end();
    assert!(robot.is_done());
    assert_eq!(robot.feedback().executed, 2);
}

#[test]
fn an_override_above_100_is_refused_by_name_and_the_skill_that_runs_does_not_feel_it() {
    let mut undisturbed = at_the_lines_start();
    undisturbed.call(Skill::MoveContinuous, around_a_corner());
    let expected = driven(&mut undisturbed, |_, _| {});
    let mut robot = at_the_lines_start();
    robot.call(Skill::MoveContinuous, around_a_corner());
    let mut warnings = 0;
    let found = driven(&mut robot, |robot, cycle| {
        let is_wrong = (20..60).contains(&cycle);
        robot.command.override_percent = if is_wrong { 120 } else { 100 };
        let feedback = robot.feedback();
        assert!(!feedback.status.contains(Status::ERROR) && feedback.override_percent == 100);
        if feedback.status.contains(Status::WARNING) {
            warnings += 1;
            insta::allow_duplicates! {
                insta::assert_snapshot!(
                    feedback.finding.in_words(feedback.error),
                    @"the override is not within 0 to 100 % (it is 120 %, allowed is 0 to 100 %)"
                );
            }
        }
    });
    assert_eq!(found, expected);
    assert_eq!((warnings, robot.feedback().error), (40, ErrorNumber::None));
    let refused = |event: &&RobotEvent| {
        matches!(event, RobotEvent::Refused { number: 2, error: ErrorNumber::OverrideOutOfRange, .. })
    };
    assert_eq!(robot.events.iter().filter(refused).count(), 1, "{:?}", robot.events);
}

#[test]
fn no_skill_starts_with_an_override_above_100_and_the_next_one_does() {
    let mut robot = at_the_lines_start();
    robot.command.override_percent = 101;
    robot.run(around_a_corner());
    let refused = *robot.feedback();
    assert_eq!((refused.error, refused.state), (ErrorNumber::OverrideOutOfRange, State::Halted));
    assert_eq!((refused.finding.value(), refused.finding.upper()), (101.0, 100.0));
    assert!(refused.status.contains(Status::ERROR) && !refused.status.contains(Status::WARNING));
    (robot.command.override_percent, robot.command.control) = (0, Control::ENABLE | Control::RESET);
    robot.wait(|feedback| feedback.state == State::Ready);
    robot.command.override_percent = 100;
    robot.run(around_a_corner());
    assert!(robot.is_done());
}

#[test]
fn halt_suspend_and_a_lost_connection_end_in_rest_at_override_0_as_at_any_other() {
    let halt = |robot: &mut Driven| robot.command.control = Control::ENABLE | Control::HALT;
    let lose = |robot: &mut Driven| robot.connected = false;
    for (stop, by) in [(halt as fn(&mut Driven), Status::ABORTED), (lose, Status::ERROR)] {
        let mut robot = at_the_lines_start();
        robot.call(Skill::MoveContinuous, around_a_corner());
        robot.wait(|feedback| feedback.pose[0] > 50.0);
        robot.command.override_percent = 0;
        robot.run_ms(500);
        robot.control(Control::SUSPEND);
        robot.wait(|feedback| feedback.state == State::Suspended);
        stop(&mut robot);
        robot.wait(|feedback| feedback.state == State::Halted);
        assert!(robot.feedback().status.contains(by | Status::AT_REST), "{:?}", robot.feedback());
    }
}

#[test]
fn a_lin_force_stops_at_override_0_on_its_way_and_in_contact_and_goes_on() {
    let config = bare("A");
    let surfaces = vec![seat(&config, 8.0, 5.0)];
    let mut robot = Driven::ready(RobotConfig { surfaces, ..config }, Program::default());
    robot.run(vec![ptp(100.0, 40.0, 20.0)]);
    robot.call(Skill::MoveLinForceCartesian, vec![press(-10.0, 25.0)]);
    for force_n in [-1.0, 5.0] {
        robot.wait(|feedback| feedback.contact_force > force_n && !feedback.status.contains(Status::AT_REST));
        robot.command.override_percent = 0;
        robot.wait(|feedback| feedback.status.contains(Status::AT_REST));
        let stopped = *robot.feedback();
        robot.run_ms(1_000);
        assert_eq!((robot.feedback().pose, robot.feedback().state), (stopped.pose, State::Running));
        robot.command.override_percent = 60;
    }
    robot.wait_for_end();
    assert!(robot.is_done());
    assert!((robot.feedback().contact_force - 25.0).abs() <= 0.5, "{:?}", robot.feedback());
}
