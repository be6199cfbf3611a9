//! The robot's digital outputs: what switches them, and what does not change them.

use std::time::Duration;

use planning::{Stop, Switch};
use protocol::image::{Control, Skill, State, Status};
use robot_node::Program;

use crate::driven::{Driven, bare, lin, ptp};

const GRIP: u16 = 1 << 2;

/// Returns a program that grips after its first motion for 150 ms, and goes on.
fn gripping() -> Program {
    let motions = vec![ptp(0.0, 40.0, 90.0), lin(50.0, 40.0, 90.0), lin(0.0, 40.0, 90.0)];
    let then = Some(Switch { output: 2, set: true, wait: Duration::from_millis(150) });
    Program::new(motions, &[Stop { after: 1, then }, Stop { after: 3, then: None }])
}

#[test]
fn a_change_of_the_plcs_outputs_switches_the_robots() {
    let mut robot = Driven::ready(bare("A"), Program::default());
    robot.command.outputs = GRIP | 1;
    robot.tick();
    assert_eq!(robot.feedback().inputs, GRIP | 1);
    robot.command.outputs = GRIP;
    robot.tick();
    assert_eq!(robot.feedback().inputs, GRIP);
}

#[test]
fn neither_a_lost_connection_nor_a_restarted_plc_drops_the_part() {
    let mut robot = Driven::ready(bare("A"), Program::default());
    robot.command.outputs = GRIP;
    robot.tick();
    robot.connected = false;
    robot.run_ms(100);
    assert_eq!(robot.feedback().inputs, GRIP);
    robot.command.outputs = 0;
    robot.connected = true;
    robot.run_ms(100);
    assert_eq!(robot.feedback().inputs, GRIP, "only a change switches");
}

#[test]
fn a_program_stops_exactly_switches_waits_and_goes_on_and_the_output_keeps_its_state() {
    let mut robot = Driven::ready(bare("A"), gripping());
    robot.call(Skill::RunProgram, Vec::new());
    robot.wait(|feedback| feedback.inputs == GRIP);
    assert_eq!(robot.feedback().executed, 1);
    let [x, y, z, ..] = robot.feedback().pose;
    assert!(x.abs() < 1e-3 && (y - 40.0).abs() < 1e-3 && (z - 90.0).abs() < 1e-3);
    let switched = robot.at;
    // The path ended within this cycle: only the next cycle finds the arm at rest.
    robot.tick();
    robot.wait(|feedback| !feedback.status.contains(Status::AT_REST));
    let waited = robot.at.since(switched).as_millis();
    assert!((150..=160).contains(&waited), "{waited} ms");
    robot.wait_for_end();
    assert!(robot.is_done());
    assert_eq!((robot.feedback().executed, robot.feedback().inputs), (3, GRIP));
    assert_eq!(robot.feedback().blends_suppressed, 0);
}

#[test]
fn a_program_that_is_suspended_while_it_waits_goes_on_only_when_resumed() {
    let mut robot = Driven::ready(bare("A"), gripping());
    robot.call(Skill::RunProgram, Vec::new());
    robot.wait(|feedback| feedback.inputs == GRIP);
    robot.control(Control::SUSPEND);
    robot.run_ms(1_000);
    assert_eq!((robot.feedback().state, robot.feedback().executed), (State::Suspended, 1));
    robot.control(Control::RESUME);
    robot.wait_for_end();
    assert!(robot.is_done());
    assert_eq!(robot.feedback().executed, 3);
}

#[test]
fn a_program_that_is_halted_while_it_waits_runs_from_its_start_the_next_time() {
    let mut robot = Driven::ready(bare("A"), gripping());
    robot.call(Skill::RunProgram, Vec::new());
    robot.wait(|feedback| feedback.inputs == GRIP);
    robot.command.control = Control::ENABLE | Control::HALT;
    robot.wait_for_end();
    assert_eq!((robot.feedback().state, robot.feedback().inputs), (State::Halted, GRIP));
    robot.command.control = Control::ENABLE | Control::RESET;
    robot.wait(|feedback| feedback.state == State::Ready);
    robot.call(Skill::RunProgram, Vec::new());
    robot.wait_for_end();
    assert!(robot.is_done(), "{:?}", robot.feedback());
}
