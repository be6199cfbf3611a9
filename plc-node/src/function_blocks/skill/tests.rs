use super::*;
use crate::WaitLimits;

const PATIENCE: WaitLimits = WaitLimits { answer_scans: 5, silent_scans: u32::MAX };

/// Scans a call with what the robot sends, until it ends; returns in which scan, from 1 on, and with what error.
fn ends_in(
    call: &mut SkillCall<()>,
    group: &mut AxesGroup,
    mode: BufferMode,
    feedback: impl Fn(u16) -> Feedback,
) -> (u32, Option<BlockError>) {
    for scan in 1..100 {
        group.read(Some(feedback(group.command.number)));
        call.call(true, mode, group, || Ok(()), |_, ()| Ok(true));
        if !call.outputs().busy {
            return (scan, call.interface.error());
        }
    }
    panic!("it waits for ever")
}

#[test]
fn a_robot_that_does_not_echo_the_number_has_as_many_scans_as_the_setup_says() {
    let (mut call, mut group) = (SkillCall::default(), AxesGroup::new(PATIENCE));
    let ended = ends_in(&mut call, &mut group, BufferMode::Aborting, |_| Feedback::default());
    // The first scan sends the command.
    assert_eq!(ended, (6, Some(BlockError::NoAnswer { number: 1, scans: 5 })));
}

#[test]
fn a_robot_that_echoes_the_number_and_says_no_more_has_as_many_scans() {
    let (mut call, mut group) = (SkillCall::default(), AxesGroup::new(PATIENCE));
    let echo = |number| Feedback { number, ..Feedback::default() };
    let ended = ends_in(&mut call, &mut group, BufferMode::Aborting, echo);
    assert_eq!(ended, (6, Some(BlockError::NoAnswer { number: 1, scans: 5 })));
}

#[test]
fn a_robot_that_does_not_give_up_a_skill_is_stopped_after_as_many_scans() {
    let mut group = AxesGroup::new(PATIENCE);
    let busy =
        |number| Feedback { number, status: Status::BUSY, state: State::Running, ..Feedback::default() };
    let mut first = SkillCall::<()>::default();
    for _ in 0..2 {
        group.read(Some(busy(group.command.number)));
        first.call(true, BufferMode::Aborting, &mut group, || Ok(()), |_, ()| Ok(true));
    }
    assert!(first.outputs().active);
    let mut second = SkillCall::default();
    let ended = ends_in(&mut second, &mut group, BufferMode::Aborting, busy);
    assert_eq!(ended, (5, Some(BlockError::StateNotReached { scans: 5 })));
    assert!(group.command.control.contains(protocol::image::Control::HALT));
}

/// Scans a call once: `execute`, and what the robot sends.
fn scan(
    call: &mut SkillCall<()>,
    group: &mut AxesGroup,
    mode: BufferMode,
    execute: bool,
    feedback: Feedback,
) -> Outputs {
    group.read(Some(feedback));
    call.call(execute, mode, group, || Ok(()), |_, ()| Ok(false));
    call.outputs()
}

const HALT: protocol::image::Control = protocol::image::Control::HALT;

fn answer(number: u16, status: Status, state: State) -> Feedback {
    Feedback { number, status, state, ..Feedback::default() }
}

#[test]
fn a_command_is_in_the_image_from_its_turn_to_its_end() {
    let mut group = AxesGroup::new(PATIENCE);
    let (mut first, mut second) = (SkillCall::default(), SkillCall::default());
    assert!(!first.is_sent());
    let busy = |number| answer(number, Status::BUSY, State::Running);
    scan(&mut first, &mut group, BufferMode::Aborting, true, busy(0));
    assert!(first.is_sent());
    scan(&mut second, &mut group, BufferMode::Buffered, true, busy(1));
    assert!(second.outputs().busy && !second.is_sent(), "it waits for the first");
    scan(&mut first, &mut group, BufferMode::Aborting, true, answer(1, Status::DONE, State::Ready));
    assert!(first.outputs().done && !first.is_sent());
    scan(&mut second, &mut group, BufferMode::Buffered, true, answer(1, Status::DONE, State::Ready));
    assert!(second.is_sent());
}

#[test]
fn a_call_that_has_ended_takes_no_notice_of_the_robot() {
    let mut group = AxesGroup::new(PATIENCE);
    let mut call = SkillCall::default();
    scan(&mut call, &mut group, BufferMode::Aborting, true, Feedback::default());
    assert!(
        scan(&mut call, &mut group, BufferMode::Aborting, true, answer(1, Status::DONE, State::Ready)).done
    );
    // The number of another block's skill.
    let other = answer(2, Status::ERROR, State::Halted);
    let outputs = scan(&mut call, &mut group, BufferMode::Aborting, true, other);
    assert!(outputs.done && !outputs.error, "{outputs:?}");
    let outputs = scan(&mut call, &mut group, BufferMode::Aborting, false, other);
    assert_eq!(outputs, Outputs::default());
    assert!(!group.command.control.contains(HALT));
}

#[test]
fn a_call_that_was_ended_while_it_waited_is_not_started_when_its_turn_would_come() {
    let mut group = AxesGroup::new(PATIENCE);
    let (mut first, mut second) = (SkillCall::default(), SkillCall::default());
    let busy = |number| answer(number, Status::BUSY, State::Running);
    scan(&mut first, &mut group, BufferMode::Aborting, true, busy(0));
    scan(&mut second, &mut group, BufferMode::Buffered, true, busy(1));
    let done = answer(1, Status::DONE, State::Ready);
    second.fail(&mut group, BlockError::NotConnected);
    scan(&mut first, &mut group, BufferMode::Aborting, true, done);
    let number = group.command.number;
    let outputs = scan(&mut second, &mut group, BufferMode::Buffered, true, done);
    assert!(outputs.error && !outputs.busy, "{outputs:?}");
    assert_eq!((second.interface.error(), group.command.number), (Some(BlockError::NotConnected), number));
}

#[test]
fn a_robot_is_stopped_after_an_error_unless_it_has_ended_the_skill_itself() {
    for (status, state, outcome, stops) in [
        (Status::DONE, State::Running, "done", false),
        (Status::ABORTED, State::Ready, "aborted", false),
        (Status::ERROR, State::Halted, "error", false),
        (Status::ERROR, State::Running, "error", true),
    ] {
        let mut group = AxesGroup::new(PATIENCE);
        let mut call = SkillCall::default();
        scan(&mut call, &mut group, BufferMode::Aborting, true, Feedback::default());
        let Outputs { done, command_aborted, error, .. } =
            scan(&mut call, &mut group, BufferMode::Aborting, true, answer(1, status, state));
        let expected = ["done", "aborted", "error"].map(|name| name == outcome);
        assert_eq!([done, command_aborted, error], expected, "{status:?}");
        assert_eq!(group.command.control.contains(HALT), stops, "{status:?} in {state:?}");
    }
}

#[test]
fn a_robot_that_counts_wrongly_is_stopped_unless_it_says_that_the_skill_has_ended() {
    for (status, stops) in [(Status::default(), true), (Status::DONE, false), (Status::ABORTED, false)] {
        let mut group = AxesGroup::new(PATIENCE);
        let mut call = SkillCall::default();
        let wrong = |number| Feedback { executed: 9, ..answer(number, status, State::Ready) };
        let ended = ends_in(&mut call, &mut group, BufferMode::Aborting, wrong);
        assert_eq!(ended, (2, Some(BlockError::CountedTooFar { counted: 9, written: 0 })));
        assert_eq!(group.command.control.contains(HALT), stops, "{status:?}");
    }
}

#[test]
fn a_skill_behind_another_starts_only_if_that_one_is_done() {
    for (status, starts) in [(Status::DONE, true), (Status::ABORTED, false)] {
        let mut group = AxesGroup::new(PATIENCE);
        let (mut first, mut second) = (SkillCall::default(), SkillCall::default());
        let busy = |number| answer(number, Status::BUSY, State::Running);
        scan(&mut first, &mut group, BufferMode::Aborting, true, busy(0));
        scan(&mut second, &mut group, BufferMode::Buffered, true, busy(1));
        let ended = answer(1, status, State::Ready);
        scan(&mut first, &mut group, BufferMode::Aborting, true, ended);
        let outputs = scan(&mut second, &mut group, BufferMode::Buffered, true, ended);
        assert_eq!((outputs.busy, outputs.command_aborted), (starts, !starts), "{status:?}");
    }
}

#[test]
fn a_skill_that_starts_while_the_group_halts_does_not_end_the_halt() {
    let (mut group, mut halt) = (AxesGroup::new(PATIENCE), super::super::GroupHalt::default());
    let mut call = SkillCall::<()>::default();
    let standing = Feedback { state: State::Ready, status: Status::AT_REST, ..Feedback::default() };
    for scan in 0..4 {
        group.read(Some(standing));
        assert!(halt.call(true, &mut group).busy);
        call.call(scan > 0, BufferMode::Aborting, &mut group, || Ok(()), |_, ()| Ok(true));
        assert!(group.command.control.contains(protocol::image::Control::CANCEL), "scan {scan}");
    }
    assert!(call.outputs().busy, "it starts when the arm stands");
}
