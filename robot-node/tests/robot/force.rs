//! LIN force against a simulated surface: the force is reached without overshoot and held, and the motion is stopped
//! in every way.

use protocol::image::{Control, ErrorNumber, Motion, Skill, State, Status};
use robot_node::{Program, RobotConfig, RobotEvent};

use crate::driven::{Driven, bare, lin, press, ptp, seat};

/// Returns Setup A's robot above a surface at z = 8 of 40 N/mm, with its tool at z = 20.
fn above_the_seat() -> Driven {
    above(40.0)
}

fn above(stiffness_n_per_mm: f64) -> Driven {
    let config = bare("A");
    let surfaces = vec![seat(&config, 8.0, stiffness_n_per_mm)];
    let mut robot = Driven::ready(RobotConfig { surfaces, ..config }, Program::default());
    robot.run(vec![ptp(100.0, 40.0, 20.0)]);
    robot.events.clear();
    robot
}

#[track_caller]
fn assert_force(robot: &Driven, wanted: f32) {
    let found = robot.feedback().contact_force;
    assert!((found - wanted).abs() <= 0.5, "{found} N instead of {wanted} N");
}

#[test]
fn as_a_single_skill_it_is_done_once_the_force_is_stable_and_then_holds_it() {
    let mut robot = above_the_seat();
    robot.call(Skill::MoveLinForceCartesian, vec![press(5.0, 25.0)]);
    robot.wait_for_end();
    assert!(robot.is_done(), "{:?}", robot.feedback());
    assert_eq!((robot.feedback().executed, robot.feedback().state), (1, State::Ready));
    assert!(robot.feedback().status.contains(Status::AT_REST));
    assert_force(&robot, 25.0);
    robot.run_ms(5_000);
    assert_force(&robot, 25.0);
    assert!((robot.feedback().pose[2] - (8.0 - 25.0 / 40.0)).abs() < 0.02, "{:?}", robot.feedback().pose);
    robot.call(Skill::MoveLinCartesian, vec![lin(100.0, 40.0, 20.0)]);
    robot.wait_for_end();
    assert!(robot.is_done());
    assert_eq!(robot.feedback().contact_force, 0.0);
}

#[test]
fn the_tool_moves_at_the_programmed_speed_and_never_faster() {
    for tenths_mm_s in [1, 10, 50, 73, 100] {
        for percent in [20, 100] {
            let mut robot = above_the_seat();
            robot.command.override_percent = percent;
            robot.call(
                Skill::MoveLinForceCartesian,
                vec![Motion { velocity: tenths_mm_s, ..press(5.0, 25.0) }],
            );
            let programmed = f64::from(tenths_mm_s) / 10.0 * f64::from(percent) / 100.0;
            let (mut fastest, mut before) = (0.0_f64, robot.controller.joints()[2]);
            // A second of the approach: for this arm, joint 3 is the height of the tool.
            for _ in 0..250 {
                robot.tick();
                let height = robot.controller.joints()[2];
                fastest = fastest.max((before - height) / 0.004);
                before = height;
            }
            let share = fastest / programmed;
            assert!((0.999..1.000_001).contains(&share), "{fastest} mm/s for {programmed} mm/s");
        }
    }
}

#[test]
fn on_any_surface_up_to_the_stiffest_the_force_settles_without_overshoot() {
    for stiffness in [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 35.0, 50.0] {
        for (force, tenths_mm_s) in [(2.0, 10), (2.0, 18), (25.0, 10), (25.0, 100), (100.0, 200)] {
            let mut robot = above(stiffness);
            if f64::from(force) / stiffness > 25.0 {
                continue;
            }
            robot.call(
                Skill::MoveLinForceCartesian,
                vec![Motion { velocity: tenths_mm_s, ..press(-20.0, force) }],
            );
            let mut highest = 0.0_f32;
            while !robot.is_done() || robot.feedback().number != robot.command.number {
                robot.tick();
                highest = highest.max(robot.feedback().contact_force);
                let failed = robot.feedback().status.contains(Status::ERROR);
                assert!(!failed, "{force} N at {tenths_mm_s}: {:?}", robot.feedback());
            }
            assert_force(&robot, force);
            assert!(highest <= force * 1.01, "{highest} N of {force} N on {stiffness} N/mm at {tenths_mm_s}");
        }
    }
}

#[test]
fn on_a_surface_far_stiffer_than_the_stiffest_it_settles_or_ends_with_an_error_and_never_swings_forever() {
    let mut unsteady = 0;
    for stiffness in [60.0, 100.0, 200.0, 500.0, 1_000.0, 10_000.0] {
        for (force, tenths_mm_s) in [(2.0, 10), (25.0, 100), (100.0, 200)] {
            let mut robot = above(stiffness);
            robot.call(
                Skill::MoveLinForceCartesian,
                vec![Motion { velocity: tenths_mm_s, ..press(5.0, force) }],
            );
            robot.wait_for_end();
            let feedback = *robot.feedback();
            if robot.is_done() {
                assert_force(&robot, force);
                continue;
            }
            unsteady += 1;
            assert_eq!((feedback.error, feedback.state), (ErrorNumber::ForceUnsteady, State::Halted));
            assert!(feedback.status.contains(Status::AT_REST), "{feedback:?}");
            if (stiffness, force) == (1_000.0, 25.0) {
                insta::assert_snapshot!(feedback.finding.in_words(feedback.error), @"the contact force swings and does not settle (up to 112.8 N for 25 N; the force controller is set for surfaces of up to 50 N/mm)");
            }
        }
    }
    assert!(unsteady > 0);
}

#[test]
fn within_a_continuous_motion_it_begins_and_ends_with_an_exact_stop() {
    let mut robot = above_the_seat();
    let blended = |motion: Motion| Motion { approximation: 500, ..motion };
    let motions = vec![
        blended(lin(100.0, 40.0, 60.0)),
        blended(lin(100.0, 40.0, 20.0)),
        blended(press(5.0, 25.0)),
        blended(lin(100.0, 40.0, 30.0)),
        blended(lin(100.0, 60.0, 60.0)),
        lin(150.0, 60.0, 60.0),
        lin(150.0, 60.0, 80.0),
    ];
    robot.call(Skill::MoveContinuous, motions);
    robot.wait(|feedback| feedback.executed == 2);
    assert!((robot.feedback().pose[2] - 20.0).abs() < 1e-3, "{:?}", robot.feedback().pose);
    robot.wait(|feedback| feedback.executed == 3);
    assert_force(&robot, 25.0);
    assert!(robot.feedback().status.contains(Status::AT_REST));
    robot.wait_for_end();
    assert!(robot.is_done());
    assert_eq!((robot.feedback().executed, robot.feedback().blends_suppressed), (7, 0));
    assert!((robot.feedback().pose[2] - 80.0).abs() < 1e-3);
}

#[test]
fn a_line_that_ends_without_contact_is_an_error_with_the_force_found() {
    let mut robot = above_the_seat();
    robot.run(vec![lin(100.0, 40.0, 30.0), press(8.0, 25.0), lin(100.0, 40.0, 60.0)]);
    let feedback = *robot.feedback();
    assert_eq!((feedback.error, feedback.error_motion), (ErrorNumber::ForceNotReached, 1));
    assert_eq!((feedback.state, feedback.executed), (State::Halted, 1));
    assert!(feedback.status.contains(Status::AT_REST) && (feedback.pose[2] - 8.0).abs() < 1e-2);
    insta::assert_snapshot!(
        feedback.finding.in_words(feedback.error),
        @"an end of the line was reached without the contact force (found 0 N of 25 N after 22 mm)"
    );
    let refused = |event: &&RobotEvent| matches!(event, RobotEvent::Refused { motion: 1, .. });
    assert_eq!(robot.events.iter().filter(refused).count(), 1);

    let mut robot = above_the_seat();
    robot.run(vec![press(7.8, 25.0)]);
    let found = robot.feedback().finding.value();
    assert!((found - 8.0).abs() < 0.2, "0.2 mm deep in 40 N/mm are 8 N, not {found} N");
}

#[test]
fn it_is_done_at_the_end_of_the_line_if_the_force_there_is_within_its_tolerance() {
    // At 8 − 25/40 mm it would come to rest: 0.4 N less are 0.01 mm.
    for short_mm in [0.0, 0.004, 0.008, 0.01] {
        let mut robot = above_the_seat();
        robot.run(vec![press(8.0 - 25.0 / 40.0 + short_mm, 25.0)]);
        assert!(robot.is_done(), "{short_mm}: {:?}", robot.feedback());
        assert_force(&robot, 25.0);
    }
}

#[test]
fn a_line_that_starts_with_too_much_force_is_an_error_since_it_cannot_move_back() {
    let mut robot = above_the_seat();
    robot.run(vec![press(5.0, 50.0)]);
    assert!(robot.is_done());
    robot.run(vec![press(5.0, 25.0)]);
    let feedback = *robot.feedback();
    assert_eq!((feedback.error, feedback.state), (ErrorNumber::ForceNotReached, State::Halted));
    assert!((feedback.contact_force - 50.0).abs() <= 0.5, "it stays: {feedback:?}");
}

#[test]
fn suspended_in_contact_it_stands_still_and_goes_on_to_the_force_when_resumed() {
    let mut robot = above(5.0);
    robot.call(Skill::MoveLinForceCartesian, vec![press(-10.0, 25.0)]);
    robot.wait(|feedback| feedback.contact_force > 5.0);
    robot.control(Control::SUSPEND);
    robot.wait(|feedback| feedback.state == State::Suspended);
    let stopped = *robot.feedback();
    assert!(stopped.status.contains(Status::AT_REST) && stopped.contact_force < 10.0, "{stopped:?}");
    robot.run_ms(1_000);
    assert_eq!(robot.feedback().pose, stopped.pose);
    robot.control(Control::RESUME);
    robot.wait_for_end();
    assert!(robot.is_done());
    assert_force(&robot, 25.0);
}

#[test]
fn suspended_with_a_stable_force_it_is_not_done_before_it_is_resumed() {
    let mut robot = above_the_seat();
    robot.call(Skill::MoveLinForceCartesian, vec![press(5.0, 25.0)]);
    robot.wait(|feedback| feedback.contact_force > 24.6);
    robot.control(Control::SUSPEND);
    robot.run_ms(2_000);
    assert_eq!((robot.feedback().state, robot.is_done()), (State::Suspended, false));
    robot.control(Control::RESUME);
    robot.wait_for_end();
    assert!(robot.is_done());
}

#[test]
fn halted_while_pressing_it_keeps_its_position_and_the_next_motion_leads_away() {
    let mut robot = above(5.0);
    robot.call(Skill::MoveLinForceCartesian, vec![press(-10.0, 25.0)]);
    robot.wait(|feedback| feedback.contact_force > 5.0);
    robot.command.control = Control::ENABLE | Control::HALT;
    robot.wait_for_end();
    let halted = *robot.feedback();
    assert_eq!(halted.state, State::Halted);
    assert!(halted.status.contains(Status::ABORTED | Status::AT_REST));
    robot.run_ms(1_000);
    assert_eq!(robot.feedback().pose, halted.pose);
    robot.command.control = Control::ENABLE | Control::RESET;
    robot.wait(|feedback| feedback.state == State::Ready);
    robot.run(vec![lin(100.0, 40.0, 30.0)]);
    assert!(robot.is_done());
}

#[test]
fn a_halt_and_a_lost_connection_end_the_holding_of_the_force() {
    for lose in [false, true] {
        let mut robot = above_the_seat();
        robot.run(vec![press(5.0, 25.0)]);
        assert!(robot.is_done());
        robot.connected = !lose;
        robot.command.control = Control::ENABLE | Control::HALT;
        robot.run_ms(20);
        assert_eq!(robot.feedback().state, State::Halted);
        let joints = *robot.controller.joints();
        robot.run_ms(500);
        assert_eq!(*robot.controller.joints(), joints);
    }
}

#[test]
fn with_the_connection_lost_while_pressing_it_stops_and_can_be_led_away_later() {
    let mut robot = above(5.0);
    robot.call(Skill::MoveLinForceCartesian, vec![press(-10.0, 25.0)]);
    robot.wait(|feedback| feedback.contact_force > 5.0);
    robot.connected = false;
    robot.run_ms(200);
    let feedback = *robot.feedback();
    assert_eq!((feedback.state, feedback.error), (State::Halted, ErrorNumber::ConnectionLost));
    assert!(feedback.status.contains(Status::AT_REST) && feedback.contact_force < 10.0, "{feedback:?}");
    robot.connected = true;
    robot.command.control = Control::ENABLE | Control::RESET;
    robot.wait(|feedback| feedback.state == State::Ready);
    robot.run(vec![lin(100.0, 40.0, 30.0)]);
    assert!(robot.is_done());
}

#[test]
fn the_override_slows_the_approach_and_does_not_change_the_force() {
    let mut times = Vec::new();
    for percent in [100, 50] {
        let mut robot = above_the_seat();
        robot.command.override_percent = percent;
        let start = robot.at;
        robot.run(vec![press(5.0, 25.0)]);
        assert_force(&robot, 25.0);
        times.push(robot.at.since(start).as_secs_f64());
    }
    assert!(times[1] > times[0] * 1.5, "{times:?}");
}

#[test]
fn a_program_of_the_robot_presses_switches_its_output_waits_and_moves_away() {
    let config = bare("A");
    let surfaces = vec![seat(&config, 8.0, 40.0)];
    let motions = vec![ptp(100.0, 40.0, 20.0), press(5.0, 25.0), lin(100.0, 40.0, 30.0)];
    let wait = std::time::Duration::from_millis(100);
    let switch = |set| Some(planning::Switch { output: 3, set, wait });
    let stops =
        [planning::Stop { after: 2, then: switch(true) }, planning::Stop { after: 3, then: switch(false) }];
    let mut robot = Driven::ready(RobotConfig { surfaces, ..config }, Program::new(motions, &stops));
    robot.call(Skill::RunProgram, Vec::new());
    robot.wait(|feedback| feedback.inputs == 1 << 3);
    assert_eq!(robot.feedback().executed, 2);
    let switched = robot.at;
    robot.wait(|feedback| !feedback.status.contains(Status::AT_REST));
    let waited = robot.at.since(switched);
    assert!((wait..wait + 3 * std::time::Duration::from_millis(4)).contains(&waited), "{waited:?}");
    robot.wait(|feedback| feedback.inputs == 0);
    assert_eq!((robot.feedback().executed, robot.is_done()), (3, false));
    robot.wait_for_end();
    assert!(robot.is_done());
}
