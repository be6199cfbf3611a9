//! Marks in a stored program: its robot switches an output there, and waits for those of the others.

use planning::{MarkSignal, Meeting, Stop, Switch};
use protocol::image::{Control, ErrorNumber, Skill, State, Status};
use robot_node::Program;
use std::time::Duration;

use crate::driven::{Driven, bare, lin, ptp};

const OWN: u16 = 1 << 14;
const OTHER: u16 = 1 << 12;

const fn meeting(after: u32, after_action: bool, set: bool) -> Meeting {
    Meeting { after, after_action, signal: MarkSignal { output: 14, set, inputs: OTHER } }
}

/// Returns a program of three motions with these marks.
fn program(meetings: &[Meeting], stops: &[Stop]) -> Program {
    let motions = vec![ptp(0.0, 40.0, 90.0), lin(50.0, 40.0, 90.0), lin(0.0, 40.0, 90.0)];
    Program::new(motions, stops).meeting(meetings, OWN)
}

fn called(meetings: &[Meeting]) -> Driven {
    let mut robot = Driven::ready(bare("A"), program(meetings, &[]));
    robot.call(Skill::RunProgram, Vec::new());
    robot
}

#[test]
fn a_program_shows_its_mark_when_the_arm_stands_there_and_goes_on_once_the_input_is_set() {
    for after in [0, 1, 3] {
        let mut robot = called(&[meeting(after, false, true)]);
        robot.wait(|feedback| feedback.inputs == OWN);
        assert_eq!(robot.feedback().executed, after, "not before it has come");
        robot.run_ms(2_000);
        assert_eq!((robot.feedback().executed, robot.feedback().state), (after, State::Running));
        assert!(robot.feedback().status.contains(Status::AT_REST));
        robot.command.outputs = OTHER;
        robot.wait_for_end();
        assert!(robot.is_done(), "after {after}: {:?}", robot.feedback());
        // The robot has the output of the same number as the input that changed, too; that of the mark keeps its state.
        assert_eq!((robot.feedback().executed, robot.feedback().inputs & OWN), (3, OWN));
    }
}

#[test]
fn where_the_others_have_come_before_a_mark_takes_one_robot_cycle() {
    let mut times = [0, 0].map(|_: i32| 0);
    for (meetings, time) in [vec![], vec![meeting(1, false, true)]].iter().zip(&mut times) {
        let mut robot = Driven::ready(bare("A"), program(meetings, &[Stop { after: 1, then: None }]));
        robot.command.outputs = OTHER;
        robot.call(Skill::RunProgram, Vec::new());
        let began = robot.at;
        robot.wait_for_end();
        *time = i32::try_from(robot.at.since(began).as_millis()).unwrap();
    }
    // The motion before a mark stops exactly, as the plan has it.
    assert!((0..=12).contains(&(times[1] - times[0])), "{times:?}");
}

#[test]
fn an_action_is_before_or_after_the_wait_at_its_place() {
    let then = Some(Switch { output: 0, set: true, wait: Duration::from_millis(100) });
    for (after_action, shown) in [(true, OWN | 1), (false, OWN)] {
        let stops = [Stop { after: 2, then }];
        let mut robot = Driven::ready(bare("A"), program(&[meeting(2, after_action, true)], &stops));
        robot.call(Skill::RunProgram, Vec::new());
        robot.wait(|feedback| feedback.inputs & OWN != 0);
        robot.run_ms(500);
        assert_eq!((robot.feedback().inputs, robot.feedback().executed), (shown, 2));
        robot.command.outputs = OTHER;
        robot.wait_for_end();
        assert!(robot.is_done());
        assert_eq!(robot.feedback().inputs & (OWN | 1), OWN | 1);
    }
}

#[test]
fn a_mark_with_a_cleared_output_waits_until_the_input_is_cleared() {
    let mut robot = called(&[meeting(1, false, true), meeting(2, false, false)]);
    robot.command.outputs = OTHER;
    robot.wait(|feedback| feedback.executed == 2 && feedback.inputs & OWN == 0);
    robot.run_ms(500);
    assert_eq!(robot.feedback().executed, 2);
    robot.command.outputs = 0;
    robot.wait_for_end();
    assert!(robot.is_done());
}

#[test]
fn a_robot_that_is_suspended_at_a_mark_goes_on_only_when_resumed_also_if_the_others_come() {
    let mut robot = called(&[meeting(1, false, true)]);
    robot.wait(|feedback| feedback.inputs == OWN);
    robot.control(Control::SUSPEND);
    robot.command.outputs = OTHER;
    robot.run_ms(1_000);
    assert_eq!((robot.feedback().state, robot.feedback().executed), (State::Suspended, 1));
    robot.control(Control::RESUME);
    robot.wait_for_end();
    assert!(robot.is_done());
}

#[test]
fn a_halt_at_a_mark_ends_the_program_and_the_next_one_begins_by_clearing_what_it_showed() {
    let mut robot = called(&[meeting(1, false, true)]);
    robot.wait(|feedback| feedback.inputs == OWN);
    robot.command.control = Control::ENABLE | Control::HALT;
    robot.wait_for_end();
    assert_eq!((robot.feedback().state, robot.feedback().inputs), (State::Halted, OWN), "a stale output");
    robot.command.control = Control::ENABLE | Control::RESET;
    robot.wait(|feedback| feedback.state == State::Ready);
    robot.call(Skill::RunProgram, Vec::new());
    let number = robot.command.number;
    robot.wait(|feedback| feedback.number == number);
    assert_eq!(robot.feedback().inputs & OWN, 0, "cleared in the first image that echoes the command");
    robot.wait(|feedback| feedback.inputs & OWN != 0);
    assert_eq!(robot.feedback().executed, 1);
}

#[test]
fn a_connection_that_is_lost_at_a_mark_ends_the_program() {
    let mut robot = called(&[meeting(1, false, true)]);
    robot.wait(|feedback| feedback.inputs == OWN);
    robot.connected = false;
    robot.run_ms(20);
    assert_eq!(
        (robot.feedback().error, robot.feedback().state),
        (ErrorNumber::ConnectionLost, State::Halted)
    );
}
