//! Two blocks of skills on one robot: what PLCopen's `BufferMode` says, with an arm that moves.

use std::time::Duration;

use machine::Instant;
use plc_node::function_blocks::{
    BlockError, BufferMode, Dynamics, GroupEnable, GroupHalt, GroupInterrupt, GroupStop, MotionInputs,
    MoveCircular, MoveContinuous, MoveLinCartesian, MovePtpCartesian, Outputs, SkillState,
};
use plc_node::{AxesGroup, MotionList, WaitLimits};
use protocol::image::{ErrorNumber, Feedback, State};
use robot_node::Controller;

use crate::driven::{bare, lin, ptp};

/// A PLC program that scans once every robot cycle. Its blocks are called in the order of the fields.
struct Cell {
    group: AxesGroup,
    controller: Controller,
    at: Instant,
    way: MoveContinuous,
    line: MoveLinCartesian,
    back: MovePtpCartesian,
    circle: MoveCircular,
    halt: GroupHalt,
    stop: GroupStop,
    enable: GroupEnable,
    interrupt: GroupInterrupt,
    execute: [bool; 8],
    /// The buffer mode of each block of a skill.
    modes: [BufferMode; 4],
    outputs: [Outputs; 8],
    line_inputs: MotionInputs,
}

const WAY: usize = 0;
const LINE: usize = 1;
const BACK: usize = 2;
const CIRCLE: usize = 3;
const HALT: usize = 4;
const STOP: usize = 5;
const ENABLE: usize = 6;
const INTERRUPT: usize = 7;

/// Along y = 0 from x = 0 to 200 mm and back.
fn way() -> MotionList {
    vec![ptp(0.0, 0.0, 100.0), lin(200.0, 0.0, 100.0), lin(0.0, 0.0, 100.0)].into()
}

/// In engineering units: a line up to z = 140, at 100 mm/s.
fn line() -> MotionInputs {
    MotionInputs {
        position: [100.0, 0.0, 140.0, 0.0, 0.0, 180.0],
        auxiliary: [0.0; 3],
        configuration: None,
        dynamics: Dynamics { velocity: 100.0, acceleration: 1000.0, deceleration: 500.0, jerk: 20_000.0 },
        approximation_mm: 0.0,
        tool: 0,
        base: 1,
    }
}

/// A PTP to the start of the way, at half of what the axes are rated for.
fn back() -> MotionInputs {
    let position = [0.0, 0.0, 100.0, 0.0, 0.0, 180.0];
    let dynamics = Dynamics { velocity: 50.0, acceleration: 50.0, ..Dynamics::default() };
    MotionInputs { position, dynamics, ..line() }
}

impl Cell {
    /// A cell whose first skill moves the arm along the line.
    fn moving() -> Self {
        let mut cell = Self {
            group: AxesGroup::new(WaitLimits { answer_scans: 200, silent_scans: u32::MAX }),
            controller: Controller::new(bare("A"), Vec::new(), 1),
            at: Instant::ZERO,
            way: MoveContinuous::default(),
            line: MoveLinCartesian::default(),
            back: MovePtpCartesian::default(),
            circle: MoveCircular::default(),
            halt: GroupHalt::default(),
            stop: GroupStop::default(),
            enable: GroupEnable::default(),
            interrupt: GroupInterrupt::default(),
            execute: [false; 8],
            modes: [BufferMode::Buffered; 4],
            outputs: [Outputs::default(); 8],
            line_inputs: line(),
        };
        cell.execute[ENABLE] = true;
        cell.until(|cell| cell.outputs[ENABLE].done);
        cell.execute[WAY] = true;
        cell.until(|cell| cell.feedback().executed == 1 && cell.feedback().path_speed > 200.0);
        cell
    }

    fn scan(&mut self) {
        let (group, execute, modes) = (&mut self.group, self.execute, self.modes);
        group.read(Some(*self.controller.feedback()));
        self.outputs = [
            self.way.call(execute[WAY], &mut way(), modes[WAY], group),
            self.line.call(execute[LINE], &self.line_inputs, modes[LINE], group),
            self.back.call(execute[BACK], &back(), modes[BACK], group),
            self.circle.call(execute[CIRCLE], &line(), modes[CIRCLE], group),
            self.halt.call(execute[HALT], group),
            self.stop.call(execute[STOP], group),
            self.enable.call(execute[ENABLE], group),
            self.interrupt.call(execute[INTERRUPT], group),
        ];
        self.at += Duration::from_millis(4);
        self.controller.tick(self.at, Some(group.command()));
    }

    #[track_caller]
    fn until(&mut self, condition: impl Fn(&Self) -> bool) {
        self.each_scan_until(condition, |_| ());
    }

    /// Scans until the condition holds, and checks the state before each scan.
    #[track_caller]
    fn each_scan_until(&mut self, condition: impl Fn(&Self) -> bool, mut check: impl FnMut(&mut Self)) {
        for _ in 0..5_000 {
            if condition(self) {
                return;
            }
            check(self);
            self.scan();
        }
        panic!("waited in vain: {:?} {:?}", self.outputs, self.feedback());
    }

    /// Calls a block with its start edge.
    fn start(&mut self, block: usize, mode: BufferMode) {
        self.modes[block] = mode;
        self.execute[block] = true;
        self.scan();
    }

    fn feedback(&self) -> &Feedback {
        self.controller.feedback()
    }

    #[track_caller]
    fn assert_at(&self, x: f32, z: f32) {
        let pose = self.feedback().pose;
        assert!((pose[0] - x).abs() < 0.01 && (pose[2] - z).abs() < 0.01, "at {pose:?}");
    }

    /// The whole way is run, as if no other block had been called.
    #[track_caller]
    fn goes_on_undisturbed(&mut self) {
        self.until(|cell| !cell.outputs[WAY].busy);
        assert!(self.outputs[WAY].done && self.way.executed() == 3, "{:?}", self.way.error());
    }
}

const WAITS: Outputs = Outputs {
    busy: true,
    active: false,
    command_interrupted: false,
    done: false,
    command_aborted: false,
    error: false,
    error_id: 0,
};

#[test]
fn a_buffered_skill_waits_busy_and_not_active_until_the_one_before_is_done() {
    let mut cell = Cell::moving();
    cell.start(LINE, BufferMode::Buffered);
    let number = cell.feedback().number;
    cell.each_scan_until(
        |cell| cell.outputs[WAY].done,
        |cell| {
            assert_eq!((cell.outputs[LINE], cell.line.state()), (WAITS, SkillState::Ready));
            assert_eq!(cell.feedback().number, number, "nothing else was commanded");
        },
    );
    assert_eq!(cell.way.executed(), 3);
    cell.until(|cell| cell.outputs[LINE].active);
    assert_eq!(cell.line.state(), SkillState::Running);
    cell.until(|cell| cell.outputs[LINE].done);
    cell.assert_at(100.0, 140.0);
}

#[test]
fn an_aborting_skill_cancels_the_one_before_on_its_path_and_starts_from_where_the_arm_stands() {
    let mut cell = Cell::moving();
    cell.start(LINE, BufferMode::Aborting);
    let mut fastest = 0.0_f32;
    cell.each_scan_until(
        |cell| cell.outputs[WAY].command_aborted,
        |cell| {
            let pose = cell.feedback().pose;
            assert!(pose[1].abs() < 1e-3 && (pose[2] - 100.0).abs() < 1e-3, "off its path: {pose:?}");
            assert_eq!(cell.outputs[LINE], WAITS);
        },
    );
    assert_eq!((cell.way.state(), cell.way.executed()), (SkillState::Halted, 1));
    cell.each_scan_until(
        |cell| cell.outputs[LINE].done,
        |cell| {
            assert!(!cell.outputs[LINE].error, "{:?}", cell.line.error());
            fastest = fastest.max(cell.feedback().path_speed);
        },
    );
    cell.assert_at(100.0, 140.0);
    assert!((fastest - 100.0).abs() < 1.0, "it moves at {fastest} mm/s");
    assert_eq!(cell.feedback().state, State::Ready);
}

#[test]
fn a_block_takes_its_inputs_at_the_start_edge_also_where_it_waits() {
    let mut cell = Cell::moving();
    cell.start(LINE, BufferMode::Buffered);
    let elsewhere = MotionInputs { position: [150.0, 0.0, 100.0, 0.0, 0.0, 180.0], ..line() };
    cell.each_scan_until(
        |cell| cell.outputs[LINE].active,
        |cell| _ = cell.line.call(true, &elsewhere, BufferMode::Buffered, &mut cell.group),
    );
    let sent = *cell.group.command().slot(0);
    assert_eq!((sent.target[0], sent.velocity_mm_s()), (100.0, 100.0));
    assert_eq!((sent.deceleration_mm_s2(), sent.jerk_mm_s3()), (Some(500.0), Some(20_000.0)));
}

#[test]
fn what_gives_up_a_skill_gives_up_the_one_that_waits_for_it() {
    for (gives_up, state) in [(HALT, State::Ready), (STOP, State::Halted)] {
        for mode in [BufferMode::Buffered, BufferMode::Aborting] {
            let mut cell = Cell::moving();
            cell.start(LINE, mode);
            cell.execute[gives_up] = true;
            cell.until(|cell| cell.outputs[gives_up].done);
            assert!(cell.outputs[WAY].command_aborted && cell.outputs[LINE].command_aborted, "{mode:?}");
            let pose = cell.feedback().pose;
            (0..100).for_each(|_| cell.scan());
            assert_eq!((cell.feedback().state, cell.feedback().pose), (state, pose), "{mode:?}");
        }
    }
}

#[test]
fn one_skill_may_wait_and_a_second_one_is_refused_and_disturbs_neither() {
    let mut cell = Cell::moving();
    cell.start(LINE, BufferMode::Buffered);
    cell.start(BACK, BufferMode::Buffered);
    assert_eq!(cell.back.error(), Some(BlockError::QueueFull));
    cell.goes_on_undisturbed();
    cell.until(|cell| cell.outputs[LINE].done);
}

#[test]
fn an_aborting_skill_takes_the_place_of_the_one_that_waits() {
    let mut cell = Cell::moving();
    cell.start(LINE, BufferMode::Buffered);
    cell.start(BACK, BufferMode::Aborting);
    cell.until(|cell| cell.outputs[BACK].done);
    assert!(cell.outputs[WAY].command_aborted && cell.outputs[LINE].command_aborted);
    cell.assert_at(0.0, 100.0);
}

#[test]
fn a_suspended_skill_is_waited_for_and_cancelled_as_one_that_runs() {
    let mut cell = Cell::moving();
    cell.execute[INTERRUPT] = true;
    cell.until(|cell| cell.outputs[INTERRUPT].done);
    cell.start(LINE, BufferMode::Buffered);
    (0..50).for_each(|_| cell.scan());
    assert!(cell.outputs[WAY].command_interrupted && cell.outputs[LINE] == WAITS);
    cell.start(BACK, BufferMode::Aborting);
    cell.until(|cell| cell.outputs[BACK].done);
    assert!(cell.outputs[WAY].command_aborted);
}

#[test]
fn a_refused_block_says_why_and_leaves_the_skill_that_runs_alone() {
    let mut words = String::new();
    for (block, mode, id) in [
        (LINE, BufferMode::BlendingLow, 0x8013),
        (LINE, BufferMode::BlendingHigh, 0x8013),
        (CIRCLE, BufferMode::Aborting, 0x8015),
    ] {
        let mut cell = Cell::moving();
        cell.start(block, mode);
        assert_eq!((cell.outputs[block].error, cell.outputs[block].error_id), (true, id));
        let error = if block == LINE { cell.line.error() } else { cell.circle.error() };
        words.extend(error.map(|error| format!("{error}\n")));
        cell.goes_on_undisturbed();
    }
    insta::assert_snapshot!(words, @r"
    BufferMode is BlendingLow: the skills of two blocks are not blended into each other; use Buffered, or give the motions to one MoveContinuous, which blends them by their approximation distances
    BufferMode is BlendingHigh: the skills of two blocks are not blended into each other; use Buffered, or give the motions to one MoveContinuous, which blends them by their approximation distances
    Deceleration is given, and the process image has no room for it in this kind of motion (Circular); leave it out
    ");
}

#[test]
fn a_skill_that_fails_takes_the_one_that_waits_with_it() {
    let mut cell = Cell::moving();
    cell.until(|cell| cell.outputs[WAY].done);
    let mut bad = MoveContinuous::default();
    let mut motions = MotionList::from(vec![lin(20.0, 0.0, 100.0), lin(0.0, -900.0, 90.0)]);
    bad.call(true, &mut motions, BufferMode::Aborting, &mut cell.group);
    cell.start(LINE, BufferMode::Buffered);
    assert_eq!(cell.outputs[LINE], WAITS);
    cell.each_scan_until(
        |cell| !cell.outputs[LINE].busy,
        |cell| _ = bad.call(true, &mut motions, BufferMode::Aborting, &mut cell.group),
    );
    assert!(cell.outputs[LINE].command_aborted, "{:?}", cell.outputs[LINE]);
    assert_eq!(bad.error().map(BlockError::error_id), Some(u16::from(ErrorNumber::Unreachable)));
}

/// A line of 150 mm at 20 mm/s whose braking takes four seconds, five times as long as a robot may take to answer.
fn gentle() -> MotionInputs {
    let position = [150.0, 0.0, 100.0, 0.0, 0.0, 180.0];
    let dynamics = Dynamics { velocity: 20.0, acceleration: 1000.0, deceleration: 5.0, jerk: 0.0 };
    MotionInputs { position, dynamics, ..line() }
}

/// A cell whose line of [`gentle`] has been running for half a second.
fn moving_gently() -> Cell {
    let mut cell = Cell::moving();
    cell.until(|cell| cell.outputs[WAY].done);
    cell.line_inputs = gentle();
    cell.start(LINE, BufferMode::Buffered);
    cell.until(|cell| cell.feedback().path_speed > 19.9);
    cell
}

#[test]
fn a_halt_a_stop_and_an_interrupt_wait_for_an_arm_that_brakes_gently() {
    for (block, state) in [(HALT, State::Ready), (STOP, State::Halted), (INTERRUPT, State::Suspended)] {
        let mut cell = moving_gently();
        let began = cell.at;
        cell.execute[block] = true;
        cell.until(|cell| !cell.outputs[block].busy && cell.outputs[block] != Outputs::default());
        assert!(cell.outputs[block].done, "{:?}", cell.outputs[block]);
        assert_eq!(cell.feedback().state, state);
        assert!(cell.at.since(began) > Duration::from_secs(3), "it brakes by its own deceleration");
    }
}

#[test]
fn an_aborting_block_waits_for_an_arm_that_brakes_gently() {
    let mut cell = moving_gently();
    cell.start(BACK, BufferMode::Aborting);
    cell.until(|cell| !cell.outputs[BACK].busy);
    assert!(cell.outputs[BACK].done && cell.outputs[LINE].command_aborted, "{:?}", cell.back.error());
}
