//! Arms that wait for each other at marks.

use machine::{Duration, Instant};
use planning::{Stop, Switch};
use plc_node::ExecutionType::{self, Cm, Rc, Sm};
use plc_node::{FailureCause, StationWork};
use protocol::image::Skill;

use crate::cell::{Cell, LEFT, MS, RIGHT, cell, meeting_by_outputs, motions, wait, work};

/// Marks, and the motions before each.
type Waits = &'static [(u32, usize)];

/// Four motions, and eight. Their stored programs meet by outputs.
fn marked(left: Waits, right: Waits) -> [StationWork; 2] {
    meeting_by_outputs(in_sections(left, right))
}

/// Four motions, and eight. Each robot has a program for each section between two marks.
fn in_sections(left: Waits, right: Waits) -> [StationWork; 2] {
    let waits =
        |waits: &[(u32, usize)]| waits.iter().map(|(mark, after)| wait(*mark, *after, false)).collect();
    [work(motions(LEFT, 4), waits(left), vec![]), work(motions(RIGHT, 8), waits(right), vec![])]
}

/// Returns when the arm has executed so many motions, and when it goes on.
fn passage(cell: &mut Cell, station: usize, after: usize) -> (Option<Instant>, Option<Instant>) {
    cell.robot(station, |robot| {
        let came = after.checked_sub(1).and_then(|last| robot.executed.get(last).copied());
        (came, robot.begun.get(after).copied())
    })
}

/// Checks that no arm went on before both had come.
fn assert_met(cell: &mut Cell, left: usize, right: usize, what: &str) {
    let (left, right) = (passage(cell, LEFT, left), passage(cell, RIGHT, right));
    let both = left.0.max(right.0);
    assert!(left.1.is_none_or(|went| Some(went) > both), "{what}: left {left:?}, right {right:?}");
    assert!(right.1.is_none_or(|went| Some(went) > both), "{what}: left {left:?}, right {right:?}");
}

#[test]
fn arms_wait_for_each_other_at_a_mark_whoever_comes_first_and_go_on_together() {
    for execution_type in ExecutionType::ALL {
        for slow in [LEFT, RIGHT] {
            let mut cell = cell(marked(&[(7, 2)], &[(7, 5)]));
            cell.robot(slow, |robot| robot.motion_cycles = 30);
            for _ in 0..2 {
                assert_eq!(cell.run(execution_type), [4, 8], "{execution_type}");
                assert_met(&mut cell, 2, 5, &execution_type.to_string());
                let went = [passage(&mut cell, LEFT, 2).1.unwrap(), passage(&mut cell, RIGHT, 5).1.unwrap()];
                let apart = went[0].max(went[1]).since(went[0].min(went[1]));
                // One scan, and with SM and RC the start of a skill, by the robots' cycles.
                assert!(apart <= MS * 12, "{execution_type}: {apart:?}");
                let skills = cell.robot(LEFT, |robot| robot.skills.clone());
                match execution_type {
                    Cm => assert_eq!(skills, [(Skill::MoveContinuous, 0)], "it keeps its place in the queue"),
                    Sm => assert_eq!(skills.len(), 4),
                    Rc => assert_eq!(skills, [(Skill::RunProgram, 1)], "its program waits itself"),
                }
            }
        }
    }
}

#[test]
fn marks_at_the_very_beginning_at_the_very_end_and_two_at_one_place_are_passed() {
    let places: [[Waits; 2]; 4] = [
        [&[(1, 0)], &[(1, 6)]],
        [&[(1, 4)], &[(1, 1)]],
        [&[(1, 0), (2, 4)], &[(1, 0), (2, 8)]],
        [&[(1, 2), (2, 2), (3, 4)], &[(1, 1), (2, 7), (3, 7)]],
    ];
    for execution_type in ExecutionType::ALL {
        for [left, right] in places {
            let mut cell = cell(marked(left, right));
            let what = format!("{execution_type} {left:?} {right:?}");
            assert_eq!(cell.run(execution_type), [4, 8], "{what}");
            for ((_, left), (_, right)) in left.iter().zip(right) {
                assert_met(&mut cell, *left, *right, &what);
            }
        }
    }
}

#[test]
fn a_program_that_counts_fewer_motions_than_its_section_does_not_pass_the_mark() {
    let mut cell = cell(in_sections(&[(7, 3)], &[(7, 5)]));
    cell.robot(LEFT, |robot| robot.programs[0] = 2);
    cell.robot(RIGHT, |robot| robot.motion_cycles = 40);
    cell.start(Rc);
    let _ = cell.reports(MS * 500);
    assert_eq!(cell.robot(LEFT, |robot| robot.skills.clone()), [(Skill::RunProgram, 1)]);
    let _ = cell.reports(MS * 1_000);
    assert_eq!(cell.robot(LEFT, |robot| robot.skills.len()), 2);
}

#[test]
fn a_mark_is_before_or_after_the_action_at_its_place() {
    for execution_type in ExecutionType::ALL {
        for after_action in [false, true] {
            for place in [2, 4] {
                let then = Some(Switch { output: 0, set: true, wait: Duration::from_millis(60) });
                let stops = vec![Stop { after: place, then }];
                let left = work(motions(LEFT, 4), vec![wait(1, place as usize, after_action)], stops);
                let right = work(motions(RIGHT, 8), vec![wait(1, 6, false)], vec![]);
                let mut cell = cell([left, right]);
                // The right arm comes first if the left one acts first, and otherwise last.
                cell.robot(RIGHT, |robot| robot.motion_cycles = if after_action { 1 } else { 20 });
                cell.run(execution_type);
                let what = format!("{execution_type} after {place}, {after_action}");
                let acted = cell.robot(LEFT, |robot| robot.outputs.clone());
                let [(acted, 1), ..] = acted[..] else { panic!("{what}: {acted:?}") };
                let (came, went) = passage(&mut cell, RIGHT, 6);
                if after_action {
                    assert!(went.unwrap() >= acted + MS * 55, "{what}: the action comes first");
                } else {
                    assert!(Some(acted) >= came, "{what}: the other arm comes first");
                }
            }
        }
    }
}

#[test]
fn an_arm_that_waits_at_a_mark_for_longer_than_any_silence_is_not_given_up() {
    for execution_type in ExecutionType::ALL {
        let mut cell = cell(marked(&[(7, 2)], &[(7, 8)]));
        cell.robot(RIGHT, |robot| robot.motion_cycles = 450);
        assert_eq!(cell.run(execution_type), [4, 8]);
    }
}

#[test]
fn an_arm_that_is_lost_ends_the_run_of_those_that_would_wait_for_it() {
    for execution_type in ExecutionType::ALL {
        let mut cell = cell(marked(&[(7, 2)], &[(7, 7)]));
        cell.robot(RIGHT, |robot| robot.motion_cycles = 25);
        cell.start(execution_type);
        let _ = cell.reports(MS * 250);
        cell.set_cut(LEFT, true);
        let (station, failure) = cell.failure();
        assert_eq!(station, Some(LEFT), "{execution_type}");
        assert!(matches!(failure.cause, FailureCause::ConnectionLost(_)), "{failure}");
        let _ = cell.reports(MS * 50);
        assert_eq!(cell.robot(RIGHT, |robot| robot.halts), 1, "{execution_type}: the other is halted");
        cell.set_cut(LEFT, false);
        cell.robot(RIGHT, |robot| robot.motion_cycles = 5);
        assert_eq!(cell.run(execution_type), [4, 8]);
    }
}

#[test]
fn an_arm_that_is_lost_after_the_last_common_mark_does_not_stop_the_other() {
    for execution_type in ExecutionType::ALL {
        let mut cell = cell(marked(&[(7, 1)], &[(7, 1)]));
        cell.robot(RIGHT, |robot| robot.motion_cycles = 25);
        cell.robot(LEFT, |robot| robot.motion_cycles = 30);
        cell.start(execution_type);
        let _ = cell.reports(MS * 350);
        cell.set_cut(LEFT, true);
        let (station, failure) = cell.failure();
        assert_eq!((station, failure.executed >= 1), (Some(LEFT), true), "{execution_type}: {failure}");
        assert_eq!(cell.robot(RIGHT, |robot| (robot.executed.len(), robot.halts)), (8, 0));
    }
}

#[test]
fn an_output_that_is_still_set_from_another_run_lets_no_arm_pass_a_mark() {
    let mut cell = cell(marked(&[(7, 2)], &[(7, 6)]));
    cell.robot(RIGHT, |robot| robot.motion_cycles = 40);
    for _ in 0..3 {
        // All outputs of both robots are set, as somebody left them.
        [LEFT, RIGHT]
            .into_iter()
            .for_each(|station| cell.robot(station, |robot| robot.feedback.inputs = 0xFFFF));
        assert_eq!(cell.run(Rc), [4, 8]);
        assert_met(&mut cell, 2, 6, "stale outputs");
    }
}

#[test]
fn the_plc_passes_on_what_a_robot_shows_at_a_mark_within_its_next_scan_and_nothing_else() {
    let mut cell = cell(marked(&[(7, 2)], &[(7, 6)]));
    cell.robot(RIGHT, |robot| robot.motion_cycles = 20);
    cell.run(Rc);
    let [left, right] = [LEFT, RIGHT].map(|station| cell.robot(station, |robot| robot.meetings[0].1));
    let came = passage(&mut cell, LEFT, 2).0.unwrap();
    let passed_on = cell.robot(RIGHT, |robot| robot.outputs.clone());
    let [(at, outputs)] = passed_on[..] else { panic!("once: {passed_on:?}") };
    assert_eq!(outputs, left.mask());
    // Robot, bus, scan, bus, robot.
    assert!(at > came && at.since(came) <= MS * 8, "{:?}", at.since(came));
    assert_eq!(cell.robot(LEFT, |robot| robot.outputs.last().unwrap().1), right.mask());
    // The other types do without, and clear what was passed on.
    cell.run(Cm);
    assert!(cell.robot(RIGHT, |robot| robot.outputs.iter().all(|(_, outputs)| *outputs == 0)));
}

#[test]
fn an_arm_that_never_comes_to_its_mark_is_given_up_by_name_and_the_one_that_waits_is_halted() {
    for execution_type in ExecutionType::ALL {
        let mut cell = cell(marked(&[(7, 2)], &[(7, 6)]));
        cell.robot(RIGHT, |robot| robot.motion_cycles = 1_000_000);
        cell.start(execution_type);
        let (station, failure) = cell.failure();
        assert_eq!(station, Some(RIGHT), "{execution_type}: {failure}");
        assert!(matches!(failure.cause, FailureCause::NoProgress { .. }), "{execution_type}: {failure}");
        let _ = cell.reports(MS * 50);
        // With SM no skill is under way at a mark.
        let halts = u32::from(execution_type != Sm);
        assert_eq!(cell.robot(LEFT, |robot| robot.halts), halts, "{execution_type}");
    }
}

#[test]
fn a_run_that_is_aborted_while_an_arm_waits_leaves_nothing_to_the_next_one() {
    let mut cell = cell(marked(&[(7, 2)], &[(7, 6)]));
    cell.robot(RIGHT, |robot| robot.motion_cycles = 40);
    cell.start(Rc);
    let _ = cell.reports(MS * 300);
    assert_ne!(cell.robot(LEFT, |robot| robot.feedback.inputs), 0, "it stands at its mark");
    cell.plc(|plc, now| plc.abort(now));
    assert_eq!(cell.failure().1.cause, FailureCause::Aborted);
    assert_eq!(cell.run(Rc), [4, 8]);
    assert_met(&mut cell, 2, 6, "after an abort");
}

#[test]
fn a_robot_whose_program_does_not_wait_at_its_mark_fails_the_run_by_its_name() {
    let places: [(Waits, usize); 3] = [(&[(7, 2)], RIGHT), (&[(7, 4)], RIGHT), (&[(7, 2)], LEFT)];
    for (left, slow) in places {
        let mut cell = cell(marked(left, &[(7, 6)]));
        cell.robot(slow, |robot| robot.motion_cycles = 40);
        // A robot that knows nothing of marks sends 0.
        let other = LEFT + RIGHT - slow;
        cell.robot(other, |robot| robot.meetings.clear());
        cell.start(Rc);
        let (station, failure) = cell.failure();
        assert_eq!(
            (station, failure.cause),
            (Some(other), FailureCause::MarkIgnored { mark: 7 }),
            "{failure}"
        );
        let _ = cell.reports(MS * 200);
        assert_eq!(cell.robot(slow, |robot| robot.halts), 1);
    }
}
