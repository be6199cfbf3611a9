//! Repetitions of a robot that is attached by its image only: what passes, what does not, and what was not verified.

use super::tests::{run, run_of};
use super::*;

/// Returns the repetition as it is without the robot node's own report.
fn by_image(measured: Measured) -> Measured {
    Measured { account: None, quality: None, ..measured }
}

#[test]
fn a_repetition_without_the_robots_report_passes_and_says_what_was_not_verified() {
    for execution_type in ExecutionType::ALL {
        let (mut verification, measured) = run(execution_type);
        assert_eq!(verification.unverified(&measured), Vec::<String>::new());
        let measured = by_image(measured);
        verification.check(&measured).unwrap();
        let said = verification.unverified(&measured);
        assert!(said.len() == 1 && said[0].starts_with("path, speed, override"), "{said:?}");
    }
}

#[test]
fn whatever_the_image_shows_otherwise_than_the_plan_has_it_fails_the_repetition() {
    for execution_type in [ExecutionType::Rc, ExecutionType::Sm] {
        let (mut verification, good) = run(execution_type);
        let mut said = |change: fn(&mut Measured)| {
            let mut measured = by_image(good);
            change(&mut measured);
            verification.check(&measured).unwrap_err().to_string()
        };
        for (change, words) in [
            ((|run| run.execution.motions = 12) as fn(&mut Measured), "the robot executed 12 motions"),
            (|run| seen(run).start[0] += 1.0, "from the application's start"),
            (|run| seen(run).start[0] = f32::NAN, "from the application's start"),
            (|run| run.execution.commanded.end[0] += 0.1, "by the PLC, joint 1 ended at"),
            (|run| seen(run).end_pose[1] += 60.0, "60.000 mm from the plan's"),
            (|run| run.execution.robot_execution_ns -= 400_000_000, "the PLC measured"),
            (|run| seen(run).clock_ns += 200_000_000, "by the robot's own clock the run took"),
            (|run| seen(run).clock_ns /= 1_000, "by the robot's own clock the run took"),
        ] {
            let said = said(change);
            assert!(said.contains(words), "{execution_type}: {said}");
        }
    }
}

fn seen(measured: &mut Measured) -> &mut plc_node::Seen {
    measured.execution.seen.as_mut().unwrap()
}

#[test]
fn what_an_image_does_not_have_is_not_judged_and_named() {
    let (mut verification, good) = run(ExecutionType::Cm);
    let mut measured = by_image(good);
    seen(&mut measured).end_pose = [0.0; 6];
    seen(&mut measured).clock_ns = 0;
    measured.execution.robot_execution_ns = 0;
    verification.check(&measured).unwrap();
    insta::assert_snapshot!(verification.unverified(&measured)[1..].join("\n"), @"
    pose of the tool at the end: the robot's image has none
    the robot's time: its image has no execution time
    the robot's clock: its image has none
    ");
    measured.execution.seen = None;
    verification.check(&measured).unwrap();
    assert!(verification.unverified(&measured)[1].contains("older version"));
}

#[test]
fn a_robot_with_another_last_target_fails_in_every_type() {
    let (setup, found) = planning::setup_with_application("A").unwrap();
    for execution_type in ExecutionType::ALL {
        let (_, measured) = run_of(&setup, &found, execution_type, None);
        let mut planned = PlannedCell::of(&setup, &found.application).unwrap();
        // The bench wants it 60 mm beside where the robot goes.
        planned.motions.last_mut().unwrap().target[1] += 60.0;
        let mut verification = Verification::of(&setup, planned, Mode::Virtual, &[]).unwrap();
        let mut measured = by_image(measured);
        measured.execution.commanded.digest = if execution_type == ExecutionType::Rc {
            Digest::default().sum().value
        } else {
            verification.sent.value
        };
        let said = verification.check(&measured).unwrap_err().to_string();
        assert!(said.contains("by the PLC, joint "), "{execution_type}: {said}");
    }
}
