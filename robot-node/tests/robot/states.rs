//! The state machine against what happens in a cell: suspend, halt, a lost connection, late data, a stalled host.

use std::fmt::Write;
use std::time::Duration;

use machine::wire::BigEndian;
use machine::{Instant, Machine, Port, Source};
use protocol::direct::Direct;
use protocol::image::{Command, Control, ErrorNumber, IMAGE_LEN, Motion, Skill, State, Status};
use robot_node::{Ending, RobotEvent, RobotNode};
use virtual_time::Side;

use crate::plc::{self, Cell, application, lin, ptp};

/// Back and forth along a line of 100 mm, at 250 mm/s.
fn back_and_forth(motions: usize) -> Vec<Motion> {
    let mut all = vec![ptp(0.0, 0.0, 100.0, 0)];
    all.extend((1..motions).map(|index| lin(if index % 2 == 1 { 100.0 } else { 0.0 }, 0.0, 100.0, 0)));
    all
}

fn ready_at_the_lines_start() -> Cell {
    let mut cell = Cell::ready(Vec::new());
    cell.call(Skill::MoveContinuous, back_and_forth(1));
    cell.wait_for_end();
    cell.events.clear();
    cell
}

#[test]
fn a_readable_run() {
    let mut cell = Cell::ready(Vec::new());
    let mut motions = vec![ptp(0.0, 0.0, 100.0, 10), lin(0.0, 0.0, 50.0, 10), lin(0.0, 0.0, 20.0, 0)];
    motions.extend([lin(0.0, 0.0, 100.0, 10), ptp(150.0, 0.0, 140.0, 10), ptp(300.0, 0.0, 100.0, 10)]);
    motions.extend([lin(300.0, 0.0, 50.0, 10), lin(300.0, 0.0, 20.0, 0)]);
    cell.call(Skill::MoveContinuous, motions);
    let start = cell.pair.now();
    let mut text = String::new();
    let mut before = None;
    while !cell.feedback().status.contains(Status::DONE) {
        cell.run_ms(1);
        let sample = cell.robot().sample();
        let now = (sample.state, sample.executed, sample.accepted);
        if before.replace(now) != Some(now) {
            let (state, executed, accepted) = now;
            let ms = cell.pair.now().since(start).as_millis();
            let _ = writeln!(text, "{ms:>5} ms  {state:?}  executed {executed:>2}  accepted {accepted:>2}");
        }
    }
    insta::assert_snapshot!(text);
}

#[test]
fn suspended_it_stops_on_its_path_and_goes_on_from_there() {
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, vec![lin(200.0, 0.0, 100.0, 0)]);
    cell.wait(|feedback| feedback.path_speed > 240.0);
    cell.control(Control::ENABLE | Control::EXECUTE | Control::SUSPEND);
    cell.wait(|feedback| feedback.state == State::Suspended);
    let stopped = *cell.feedback();
    assert!(stopped.status.contains(Status::AT_REST | Status::BUSY));
    assert!(stopped.pose[0] > 1.0 && stopped.pose[0] < 199.0 && stopped.pose[1].abs() < 1e-3);
    cell.run_ms(500);
    assert_eq!(cell.feedback().pose, stopped.pose);
    cell.control(Control::ENABLE | Control::EXECUTE);
    cell.run_ms(100);
    assert_eq!(cell.feedback().state, State::Suspended, "only `resume` lets it go on");
    cell.control(Control::ENABLE | Control::EXECUTE | Control::RESUME);
    cell.wait_for_end();
    assert!(cell.feedback().status.contains(Status::DONE));
    assert!((cell.feedback().pose[0] - 200.0).abs() < 1e-3);
}

#[test]
fn halted_it_stops_on_its_path_and_gives_the_skill_up() {
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, back_and_forth(20));
    cell.wait(|feedback| feedback.path_speed > 240.0);
    cell.control(Control::ENABLE | Control::HALT);
    cell.wait_for_end();
    let feedback = *cell.feedback();
    assert_eq!(feedback.state, State::Halted);
    assert!(
        feedback.status.contains(Status::ABORTED | Status::AT_REST)
            && !feedback.status.contains(Status::BUSY)
    );
    assert_eq!(feedback.error, ErrorNumber::None);
    assert!(feedback.pose[1].abs() < 1e-3, "on the path");
    cell.control(Control::ENABLE | Control::HALT | Control::RESET);
    cell.run_ms(50);
    assert_eq!(cell.feedback().state, State::Halted, "of `halt` and `reset`, the one that stops wins");
    cell.control(Control::ENABLE | Control::RESET);
    cell.run_ms(50);
    assert_eq!(cell.feedback().state, State::Ready);
}

#[test]
fn cancelled_it_stops_on_its_path_and_is_ready_for_the_next_skill_without_a_reset() {
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, back_and_forth(20));
    cell.wait(|feedback| feedback.path_speed > 240.0);
    cell.control(Control::ENABLE | Control::CANCEL);
    cell.wait_for_end();
    let feedback = *cell.feedback();
    assert_eq!((feedback.state, feedback.error), (State::Ready, ErrorNumber::None));
    assert!(feedback.status.contains(Status::ABORTED | Status::AT_REST) && feedback.pose[1].abs() < 1e-3);
    let cancelled =
        |event: &RobotEvent| matches!(event, RobotEvent::SkillFinished { ending: Ending::Cancelled, .. });
    assert_eq!(cell.count(cancelled), 1);

    cell.call(Skill::MoveContinuous, back_and_forth(2));
    cell.control(Control::ENABLE | Control::EXECUTE | Control::CANCEL);
    cell.run_ms(200);
    assert_eq!(cell.feedback().state, State::Ready, "no skill starts while it is set");
    cell.control(Control::ENABLE | Control::EXECUTE);
    cell.wait_for_end();
    assert!(cell.feedback().status.contains(Status::DONE));
}

#[test]
fn what_needs_a_reset_wins_over_a_cancel_while_the_arm_still_brakes() {
    for (control, error) in
        [(Control::ENABLE | Control::HALT, ErrorNumber::None), (Control::CANCEL, ErrorNumber::Disabled)]
    {
        let mut cell = ready_at_the_lines_start();
        cell.call(Skill::MoveContinuous, back_and_forth(20));
        cell.wait(|feedback| feedback.path_speed > 240.0);
        cell.control(Control::ENABLE | Control::CANCEL);
        cell.run_ms(12);
        cell.control(control);
        cell.wait_for_end();
        assert_eq!((cell.feedback().state, cell.feedback().error), (State::Halted, error));
    }
}

#[test]
fn a_path_stop_takes_no_longer_than_the_limits_ask_for() {
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, vec![lin(200.0, 0.0, 100.0, 0)]);
    cell.wait(|feedback| feedback.path_speed > 249.0);
    let from = cell.robot().sample();
    cell.control(Control::ENABLE | Control::HALT);
    cell.wait(|feedback| feedback.state == State::Halted);
    let way = cell.robot().sample().pose[0] - from.pose[0];
    // 250 mm/s at 5 m/s² take 50 ms, and reaching and leaving that acceleration takes the joints up to 20 ms: 7.5 to
    // 8.75 mm. The command is up to three bus cycles and one robot cycle on its way.
    assert!((7.4..8.75 + 0.25 * 12.0).contains(&way), "{way} mm");
}

#[test]
fn with_enable_taken_back_it_stops_and_says_so() {
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, back_and_forth(20));
    cell.wait(|feedback| feedback.executed == 2);
    cell.control(Control::EXECUTE);
    cell.wait_for_end();
    assert_eq!((cell.feedback().error, cell.feedback().state), (ErrorNumber::Disabled, State::Halted));
}

#[test]
fn with_the_connection_lost_it_stops_on_its_path() {
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, back_and_forth(20));
    cell.wait(|feedback| feedback.path_speed > 240.0);
    cell.pair.set_cut(true);
    cell.run_ms(200);
    let sample = cell.robot().sample();
    assert_eq!((sample.state, sample.path_speed_mm_s), (State::Halted, 0.0));
    assert!(sample.pose[1].abs() < 1e-3);
    let ended_so = |event: &RobotEvent| {
        matches!(
            event,
            RobotEvent::SkillFinished {
                ending: Ending::Fault { error: ErrorNumber::ConnectionLost, .. },
                ..
            }
        )
    };
    assert_eq!(cell.count(ended_so), 1);
    assert_eq!(cell.count(|event| matches!(event, RobotEvent::Link(_))), 1);
    cell.pair.set_cut(false);
    cell.run_ms(100);
    assert_eq!(cell.feedback().error, ErrorNumber::ConnectionLost, "and the PLC learns why when it is back");
    assert_eq!(cell.feedback().state, State::Halted);
    cell.control(Control::ENABLE | Control::RESET);
    cell.run_ms(50);
    assert_eq!(cell.feedback().state, State::Ready);
}

#[test]
fn a_killed_plc_stops_the_robot_as_well() {
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, back_and_forth(20));
    cell.wait(|feedback| feedback.path_speed > 240.0);
    cell.pair.kill(Side::A);
    cell.run_ms(200);
    assert_eq!(cell.robot().sample().state, State::Halted);
}

#[test]
fn late_data_costs_a_blend_but_never_the_run() {
    let motions: Vec<Motion> = (1..=4_u8).map(|index| lin(50.0 * f32::from(index), 0.0, 100.0, 10)).collect();
    let mut cell = ready_at_the_lines_start();
    cell.call_keeping_back(Skill::MoveContinuous, motions, 2);
    cell.wait(|feedback| feedback.executed == 2);
    cell.run_ms(100);
    let waiting = *cell.feedback();
    assert!(waiting.status.contains(Status::AT_REST | Status::BUSY) && waiting.state == State::Running);
    assert!((waiting.pose[0] - 100.0).abs() < 1e-3, "exactly at the last target that is known");
    assert_eq!(waiting.blends_suppressed, 1);
    cell.pair.command_a(|plc, _| plc.keep_back = 0);
    cell.wait_for_end();
    let feedback = *cell.feedback();
    assert!(feedback.status.contains(Status::DONE));
    assert_eq!((feedback.executed, feedback.blends_suppressed), (4, 1));
    assert_eq!(cell.count(|event| *event == RobotEvent::BlendSuppressed { motion: 1 }), 1);
}

#[test]
fn data_that_comes_before_braking_blends_at_full_speed() {
    let motions: Vec<Motion> =
        (1..=2_u8).map(|index| lin(100.0 * f32::from(index), 0.0, 100.0, 10)).collect();
    let mut cell = ready_at_the_lines_start();
    cell.call_keeping_back(Skill::MoveContinuous, motions, 1);
    cell.wait(|feedback| feedback.pose[0] > 50.0);
    cell.pair.command_a(|plc, _| plc.keep_back = 0);
    let mut slowest = f32::INFINITY;
    while cell.feedback().pose[0] < 180.0 {
        cell.run_ms(1);
        slowest = slowest.min(cell.feedback().path_speed);
    }
    assert!(slowest > 249.0, "the junction of two parts of one line slowed it to {slowest} mm/s");
    cell.wait_for_end();
    assert_eq!(cell.feedback().blends_suppressed, 0);
}

#[test]
fn a_bad_motion_in_a_stream_stops_it_exactly_at_the_last_good_one() {
    let mut motions = back_and_forth(9);
    for motion in &mut motions {
        motion.approximation = 1_000;
    }
    motions[7].target[0] = 900.0;
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, motions.clone());
    cell.wait_for_end();
    let feedback = *cell.feedback();
    assert_eq!((feedback.error, feedback.error_motion), (ErrorNumber::Unreachable, 7));
    assert_eq!((feedback.executed, feedback.state), (7, State::Halted));
    assert!((feedback.pose[0] - motions[6].target[0]).abs() < 1e-3);
    assert_eq!(feedback.blends_suppressed, 0, "the stop has another reason");
    assert_eq!(cell.count(|event| matches!(event, RobotEvent::Refused { motion: 7, .. })), 1);
}

#[test]
fn a_second_call_while_one_runs_is_refused_and_the_first_goes_on() {
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, back_and_forth(3));
    cell.wait(|feedback| feedback.number == 2 && feedback.executed == 1);
    cell.command(|command| command.number += 1);
    cell.run_ms(50);
    assert_eq!((cell.feedback().error, cell.feedback().state), (ErrorNumber::NotReady, State::Running));
    cell.wait(|feedback| feedback.state == State::Ready);
    let done = |event: &RobotEvent| matches!(event, RobotEvent::SkillFinished { ending: Ending::Done, .. });
    assert_eq!(cell.count(done), 1);
}

#[test]
fn a_refused_call_with_motions_of_its_own_does_not_disturb_the_skill_that_runs() {
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, back_and_forth(3));
    cell.wait(|feedback| feedback.number == 2 && feedback.accepted == 3);
    cell.call(Skill::MoveLinCartesian, vec![lin(50.0, 20.0, 100.0, 0)]);
    cell.wait(|feedback| feedback.state != State::Running);
    assert_eq!((cell.feedback().error, cell.feedback().state), (ErrorNumber::NotReady, State::Ready));
    let done = |event: &RobotEvent| {
        matches!(event, RobotEvent::SkillFinished { ending: Ending::Done, number: 2, executed: 3, .. })
    };
    assert_eq!(cell.count(done), 1);
}

#[test]
fn motions_of_a_refused_call_are_never_executed() {
    let mut cell = ready_at_the_lines_start();
    let motions = back_and_forth(9);
    cell.call(Skill::MoveContinuous, motions.clone());
    cell.wait(|feedback| feedback.number == 2 && feedback.executed == 1);
    cell.command(|command| {
        command.number += 1;
        for index in 4..9 {
            let [x, y, ..] = motions[index as usize].target;
            command.set_slot(index, lin(x, y, 140.0, 0));
        }
        command.written = 9;
    });
    for _ in 0..2_000 {
        cell.run_ms(1);
        assert!((cell.feedback().pose[2] - 100.0).abs() < 1e-3, "{:?}", cell.feedback());
    }
    let feedback = cell.feedback();
    assert_eq!((feedback.error, feedback.state), (ErrorNumber::NotReady, State::Running));
    assert!(feedback.status.contains(Status::AT_REST), "it waits for motions of its own");
}

#[test]
fn at_half_override_a_motion_is_half_as_fast() {
    let duration = |percent: u8| {
        let mut cell = ready_at_the_lines_start();
        cell.command(|command| command.override_percent = percent);
        cell.call(Skill::MoveContinuous, vec![lin(200.0, 0.0, 100.0, 0)]);
        cell.wait_for_end();
        let overhead = 140.0 + 6.0;
        cell.feedback().execution_ns as f64 / 1e6 - overhead
    };
    let (full, half) = (duration(100), duration(50));
    // 200 mm, and what the ramps to and from 250 mm/s take longer: v/a, and what the acceleration takes to come and go.
    let shortest = 200.0 / 250.0 * 1e3 + 250.0 / 5.0;
    assert!((shortest..shortest + 60.0).contains(&full), "{full} ms at 100 %");
    // Two robot cycles for where start and end lie between them.
    assert!((half - 2.0 * full).abs() <= 12.0, "{half} ms at 50 %, {full} ms at 100 %");
}

#[test]
fn a_start_time_is_waited_for() {
    let mut cell = ready_at_the_lines_start();
    cell.call(Skill::MoveContinuous, back_and_forth(3));
    let start = cell.feedback().clock_ns + 1_000_000_000;
    cell.command(|command| command.start_time_ns = start);
    cell.wait(|feedback| feedback.path_speed > 0.0);
    let moved = cell.feedback().clock_ns;
    assert!(
        (start..start + 12_000_000).contains(&moved),
        "it started {} ns after",
        moved as i128 - start as i128
    );
}

/// When a program is done, in ms, on a host that does not run from `stall.start` to `stall.end`.
fn program_ends_at(stall: std::ops::Range<u64>) -> Option<u64> {
    let bus = Direct::new(Instant::ZERO, Duration::from_millis(1), Duration::from_secs(9));
    let mut robot = RobotNode::new(plc::config(), vec![(1, application().into())], bus, 1, Instant::ZERO);
    let mut command = Command { control: Control::ENABLE | Control::RESET, ..Command::default() };
    for ms in (0..20_000).filter(|ms| !stall.contains(ms)) {
        if ms == 40 {
            (command.control, command.number) = (Control::ENABLE | Control::EXECUTE, 1);
            (command.skill, command.program) = (Skill::RunProgram, 1);
        }
        let mut image = [0; IMAGE_LEN];
        command.emit::<BigEndian>(&mut image);
        robot.handle_frame(Instant::from_millis(ms), Source { port: Port::Ethernet, peer: None }, &image);
        robot.handle_timeout(Instant::from_millis(ms));
        if robot.controller().feedback().status.contains(Status::DONE) {
            assert_eq!(robot.lateness().missed(), ((stall.end - stall.start) / 4).saturating_sub(1));
            return Some(ms);
        }
    }
    None
}

#[test]
fn a_stalled_host_does_not_lengthen_the_motion() {
    let undisturbed = program_ends_at(0..0);
    assert!(undisturbed.is_some());
    assert_eq!(program_ends_at(1_001..1_041), undisturbed);
    assert_eq!(program_ends_at(1_001..2_001), undisturbed);
    assert_eq!(
        program_ends_at(1_001..6_001),
        undisturbed.map(|ms| ms + 3_996),
        "of a longer one 250 cycles are made up for"
    );
}
