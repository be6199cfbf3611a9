//! Blocks on one axes group, called as a PLC program calls them, while the robot says what each test lets it say.

use plc_node::function_blocks::{
    BlockError, BufferMode, GroupContinue, GroupDisable, GroupEnable, GroupHalt, GroupInterrupt,
    GroupSetOverride, GroupStop, MotionInputs, MoveLinCartesian, MovePtpCartesian, Outputs, OverrideFactors,
    RunProgram, SkillState,
};
use plc_node::{AxesGroup, Override, WaitLimits};
use protocol::image::{Control, ErrorNumber, Feedback, Motion, MotionKind, State, Status};

const ANSWER_SCANS: u32 = 5;

fn group() -> AxesGroup {
    AxesGroup::new(WaitLimits { answer_scans: ANSWER_SCANS, silent_scans: u32::MAX })
}

/// What the robot says: the command that it has taken up last, its status bits and its state.
fn robot(number: u16, status: Status, state: State) -> Feedback {
    Feedback { number, status, state, ..Feedback::default() }
}

fn ready() -> Feedback {
    robot(0, Status(Status::ENABLED.0 | Status::AT_REST.0), State::Ready)
}

fn running(number: u16) -> Feedback {
    robot(number, Status(Status::ENABLED.0 | Status::BUSY.0), State::Running)
}

fn inputs() -> MotionInputs {
    MotionInputs::from(&Motion { kind: MotionKind::LinCartesian, ..Motion::EMPTY })
}

/// A group on which a line was started in its first scan.
fn with_a_line() -> (AxesGroup, MoveLinCartesian) {
    let (mut group, mut line) = (group(), MoveLinCartesian::default());
    group.read(Some(ready()));
    assert!(line.call(true, &inputs(), BufferMode::Aborting, &mut group).busy);
    assert!(asks(&group, Control::EXECUTE));
    (group, line)
}

fn asks(group: &AxesGroup, bit: Control) -> bool {
    group.command().control.contains(bit)
}

/// One call of a block that ends a skill, by name.
type Ending = (&'static str, fn(&mut AxesGroup));

const ENDINGS: [Ending; 3] = [
    ("GroupHalt", |group| assert!(GroupHalt::default().call(true, group).busy)),
    ("GroupStop", |group| assert!(GroupStop::default().call(true, group).busy)),
    ("GroupDisable", |group| assert!(GroupDisable::default().call(true, group).busy)),
];

#[test]
fn a_command_that_the_robot_has_not_taken_up_is_taken_back_by_a_halt_a_stop_or_a_disable() {
    for (name, end) in ENDINGS {
        let (mut group, mut line) = with_a_line();
        group.read(Some(ready()));
        end(&mut group);
        assert!(
            !asks(&group, Control::EXECUTE),
            "{name}: the robot would take it up when nothing stops it any more"
        );
        let outputs = line.call(true, &inputs(), BufferMode::Aborting, &mut group);
        assert!(outputs.command_aborted && !outputs.busy, "{name}: {outputs:?}");
    }
}

#[test]
fn a_skill_that_the_robot_executes_stays_commanded_until_the_robot_says_how_it_ended() {
    for (name, end) in ENDINGS {
        let (mut group, mut line) = with_a_line();
        group.read(Some(running(1)));
        end(&mut group);
        assert!(asks(&group, Control::EXECUTE), "{name}");
        assert!(line.call(true, &inputs(), BufferMode::Aborting, &mut group).active, "{name}");
        group.read(Some(robot(1, Status::ABORTED, State::Halted)));
        assert!(line.call(true, &inputs(), BufferMode::Aborting, &mut group).command_aborted, "{name}");
        assert!(!asks(&group, Control::EXECUTE), "{name}");
    }
}

#[test]
fn a_buffered_skill_lets_the_one_before_it_go_on_and_an_aborting_one_cancels_it_once_the_robot_has_it() {
    for (mode, taken_up, cancels) in [
        (BufferMode::Buffered, true, false),
        (BufferMode::Buffered, false, false),
        (BufferMode::Aborting, true, true),
        // A command that the robot has not accepted yet would be lost instead of cancelled.
        (BufferMode::Aborting, false, false),
    ] {
        let (mut group, _line) = with_a_line();
        group.read(Some(if taken_up { running(1) } else { ready() }));
        let outputs = MovePtpCartesian::default().call(true, &inputs(), mode, &mut group);
        assert!(outputs.busy && !outputs.active, "{mode:?}: {outputs:?}");
        assert_eq!(asks(&group, Control::CANCEL), cancels, "{mode:?}, taken up: {taken_up}");
    }
}

#[test]
fn one_skill_may_wait_a_buffered_one_more_is_refused_and_an_aborting_one_takes_its_place() {
    for (mode, refused) in [(BufferMode::Buffered, true), (BufferMode::Aborting, false)] {
        let (mut group, _line) = with_a_line();
        let (mut waiting, mut late) = (MovePtpCartesian::default(), RunProgram::default());
        group.read(Some(running(1)));
        assert!(waiting.call(true, &inputs(), BufferMode::Buffered, &mut group).busy);
        let outputs = late.call(true, 1, mode, &mut group);
        assert_eq!((outputs.error, outputs.busy), (refused, !refused), "{mode:?}");
        assert_eq!(late.error(), refused.then_some(BlockError::QueueFull), "{mode:?}");
        let outputs = waiting.call(true, &inputs(), BufferMode::Buffered, &mut group);
        assert_eq!((outputs.busy, outputs.command_aborted), (refused, !refused), "{mode:?}");
    }
}

#[test]
fn a_skill_is_ready_while_it_waits_and_runs_from_its_command_on() {
    let (mut group, mut line) = with_a_line();
    let mut waiting = MovePtpCartesian::default();
    assert_eq!((line.state(), waiting.state()), (SkillState::Running, SkillState::Ready));
    group.read(Some(running(1)));
    assert!(waiting.call(true, &inputs(), BufferMode::Buffered, &mut group).busy);
    assert_eq!(waiting.state(), SkillState::Ready, "another skill is under way");
    group.read(Some(Feedback { accepted: 1, executed: 1, ..robot(1, Status::DONE, State::Ready) }));
    assert!(line.call(true, &inputs(), BufferMode::Aborting, &mut group).done);
    assert!(waiting.call(true, &inputs(), BufferMode::Buffered, &mut group).busy);
    assert_eq!((line.state(), waiting.state()), (SkillState::Ready, SkillState::Running));
}

#[test]
fn a_disarmed_group_asks_the_robot_for_nothing_and_remembers_no_skill() {
    let (mut group, _line) = with_a_line();
    group.set_override(Override::STOP);
    group.read(Some(running(1)));
    assert!(MovePtpCartesian::default().call(true, &inputs(), BufferMode::Buffered, &mut group).busy);
    assert!(GroupInterrupt::default().call(true, &mut group).busy);
    group.disarm();
    assert_eq!(group.command().control, Control::default());
    assert_eq!((group.command().number, group.command().override_percent), (1, 0), "these two stay");
    assert_eq!(group.feedback(), None);

    group.read(Some(ready()));
    let mut next = MoveLinCartesian::default();
    assert!(next.call(true, &inputs(), BufferMode::Buffered, &mut group).busy);
    assert!(asks(&group, Control::EXECUTE) && group.command().number == 2, "there is nothing to wait for");
}

#[test]
fn group_enable_resets_a_robot_that_stands_switched_on_but_never_acknowledges_an_error() {
    let with = |bits: &[Status]| Status(bits.iter().fold(0, |all, bit| all | bit.0));
    for (state, status, resets) in [
        (State::Halted, with(&[Status::ENABLED]), true),
        (State::Halted, with(&[]), false),
        (State::Halted, with(&[Status::ENABLED, Status::ERROR]), false),
        (State::Halted, with(&[Status::ERROR]), false),
        (State::Running, with(&[Status::ENABLED]), false),
    ] {
        let (mut group, mut enable) = (group(), GroupEnable::default());
        group.read(Some(robot(0, status, state)));
        assert!(enable.call(true, &mut group).busy);
        assert!(asks(&group, Control::ENABLE));
        assert_eq!(asks(&group, Control::RESET), resets, "{state:?} with {status:?}");
    }
}

#[test]
fn group_enable_tells_the_error_in_which_the_robot_stands() {
    let (mut group, mut enable) = (group(), GroupEnable::default());
    let status = Status(Status::ENABLED.0 | Status::ERROR.0);
    for _ in 0..2 {
        let life_echo = group.command().life;
        let feedback =
            Feedback { error: ErrorNumber::DriveFault, life_echo, ..robot(0, status, State::Halted) };
        group.read(Some(feedback));
        enable.call(true, &mut group);
    }
    assert_eq!(enable.error(), Some(BlockError::InError { number: ErrorNumber::DriveFault }));
}

#[test]
fn only_a_running_skill_can_be_interrupted_and_only_an_interrupted_one_continued() {
    for state in [State::Halted, State::Ready, State::Running, State::Suspended] {
        let mut group = group();
        group.read(Some(robot(0, Status::ENABLED, state)));
        let mut interrupt = GroupInterrupt::default();
        let is_busy = interrupt.call(true, &mut group).busy;
        assert_eq!(
            (is_busy, asks(&group, Control::SUSPEND)),
            (state == State::Running, is_busy),
            "{state:?}"
        );
        let refused = BlockError::NothingToDo("running");
        assert_eq!(interrupt.error(), (!is_busy).then_some(refused), "{state:?}");

        let mut go_on = GroupContinue::default();
        let is_busy = go_on.call(true, &mut group).busy;
        assert_eq!(
            (is_busy, asks(&group, Control::RESUME)),
            (state == State::Suspended, is_busy),
            "{state:?}"
        );
        let refused = BlockError::NothingToDo("interrupted");
        assert_eq!(go_on.error(), (!is_busy).then_some(refused), "{state:?}");
    }
}

#[test]
fn a_robot_that_does_not_follow_a_group_command_has_as_many_scans_as_the_setup_says() {
    let (mut group, mut halt) = (group(), GroupHalt::default());
    // The first scan asks; the next ones wait.
    for scan in 0..ANSWER_SCANS {
        group.read(Some(running(0)));
        assert!(halt.call(true, &mut group).busy, "scan {scan}");
    }
    group.read(Some(running(0)));
    assert!(halt.call(true, &mut group).error);
    assert_eq!(halt.error(), Some(BlockError::StateNotReached { scans: ANSWER_SCANS }));
    assert!(!asks(&group, Control::CANCEL), "asking again is an edge");
}

/// A block that acts on a moving arm, called in each scan.
type Called = Box<dyn FnMut(&mut AxesGroup) -> (Outputs, Option<BlockError>)>;

macro_rules! called {
    ($($block:ident),*) => {[$((stringify!($block), {
        let mut block = $block::default();
        Box::new(move |group: &mut AxesGroup| (block.call(true, group), block.error())) as Called
    })),*]};
}

/// A robot that has seen the PLC's last image and does not follow it; its first joint stands there.
fn runs_on(group: &mut AxesGroup, joint: f32) {
    let joints = [joint, 0.0, 0.0, 0.0, 0.0, 0.0];
    group.read(Some(Feedback { joints, life_echo: group.command().life, ..running(0) }));
}

#[test]
fn a_block_waits_for_an_arm_that_brakes_and_one_that_ends_with_an_error_has_the_robot_stopped() {
    for (name, mut call) in called![GroupDisable, GroupHalt, GroupStop, GroupInterrupt] {
        let mut group = group();
        for scan in 0..20 * ANSWER_SCANS {
            runs_on(&mut group, scan as f32 * 0.001);
            assert!(call(&mut group).0.busy, "{name}, scan {scan}");
        }
        // It has moved in the first of these scans.
        for scan in 0..=ANSWER_SCANS + 1 {
            runs_on(&mut group, -1.0);
            let (outputs, error) = call(&mut group);
            let is_late = scan > ANSWER_SCANS;
            assert_eq!((outputs.busy, outputs.error), (!is_late, is_late), "{name}, scan {scan}: {error:?}");
        }
        let (_, error) = call(&mut group);
        assert_eq!(error, Some(BlockError::StateNotReached { scans: ANSWER_SCANS }), "{name}");
        for scan in 0..100 {
            runs_on(&mut group, scan as f32);
            call(&mut group);
            assert!(asks(&group, Control::HALT), "{name}: nothing stops the robot in scan {scan}");
        }
        group.read(Some(Feedback { life_echo: group.command().life, ..ready() }));
        assert!(!asks(&group, Control::HALT), "{name}: the arm stands");
    }
}

#[test]
fn a_robot_that_does_not_take_an_override_has_as_many_scans_and_the_error_stays_until_enable_falls() {
    let (mut group, mut block) = (group(), GroupSetOverride::default());
    let half = OverrideFactors { velocity: 0.5, ..OverrideFactors::default() };
    let goes_by = |override_percent, group: &AxesGroup| {
        Some(Feedback { override_percent, life_echo: group.command().life, ..ready() })
    };
    for scan in 0..ANSWER_SCANS {
        group.read(goes_by(100, &group));
        assert!(block.call(true, &half, &mut group).busy, "scan {scan}");
    }
    group.read(goes_by(100, &group));
    assert!(block.call(true, &half, &mut group).error);
    let error = BlockError::OverrideNotTaken { wanted: 50, in_effect: 100, scans: ANSWER_SCANS };
    assert_eq!(block.error(), Some(error));

    group.read(goes_by(50, &group));
    assert!(block.call(true, &half, &mut group).error, "its cause is gone, but Enable is TRUE still");
    assert_eq!(block.error(), Some(error));
    assert!(!block.call(false, &half, &mut group).error);
    group.read(goes_by(50, &group));
    assert!(block.call(true, &half, &mut group).busy);
}
