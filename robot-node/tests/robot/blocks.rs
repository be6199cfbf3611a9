//! The PLC's function blocks on the robot's controller: what PLCopen says of a group, with an arm that moves.

use std::time::Duration;

use machine::Instant;
use plc_node::function_blocks::{BlockError, BufferMode, MoveContinuous, Outputs, SkillState};
use plc_node::{AxesGroup, MotionList, MotionSource, WaitLimits};
use protocol::image::{Control, ErrorNumber, Feedback, Motion, State, Status};
use robot_node::{Controller, RobotConfig};

use crate::driven::{GroupBlocks, bare, lin, ptp};

/// A PLC program with one block of each kind that scans once every robot cycle.
struct Cell {
    group: AxesGroup,
    controller: Controller,
    at: Instant,
    motions: Box<dyn MotionSource>,
    skill: MoveContinuous,
    blocks: GroupBlocks,
    execute: Execute,
    skill_outputs: Outputs,
}

/// `Execute` of each block.
#[derive(Clone, Copy, Default)]
struct Execute {
    skill: bool,
    enable: bool,
    disable: bool,
    reset: bool,
    halt: bool,
    stop: bool,
    interrupt: bool,
    go_on: bool,
}

impl Cell {
    fn new() -> Self {
        Self::with(bare("A"))
    }

    fn with(config: RobotConfig) -> Self {
        Self {
            group: AxesGroup::new(WaitLimits { answer_scans: 200, silent_scans: u32::MAX }),
            controller: Controller::new(config, Vec::new(), 1),
            at: Instant::ZERO,
            motions: Box::new(MotionList::from(way())),
            skill: MoveContinuous::default(),
            blocks: GroupBlocks::default(),
            execute: Execute::default(),
            skill_outputs: Outputs::default(),
        }
    }

    /// A cell that is switched on.
    fn enabled() -> Self {
        let mut cell = Self::new();
        assert!(cell.ends(|execute| &mut execute.enable).done);
        cell
    }

    /// A cell whose skill moves the arm along the line.
    fn moving() -> Self {
        let mut cell = Self::enabled();
        cell.execute.skill = true;
        cell.until(|cell| cell.feedback().executed == 1 && cell.feedback().path_speed > 200.0);
        assert!(cell.skill_outputs.active);
        cell
    }

    /// One scan and one robot cycle. Returns what the blocks of the group say, in the order of [`Execute`].
    fn scan(&mut self) -> [Outputs; 7] {
        let (group, execute) = (&mut self.group, self.execute);
        group.read(Some(*self.controller.feedback()));
        self.skill_outputs = self.skill.call(execute.skill, &mut *self.motions, BufferMode::default(), group);
        let outputs = [
            self.blocks.enable.call(execute.enable, group),
            self.blocks.disable.call(execute.disable, group),
            self.blocks.reset.call(execute.reset, group),
            self.blocks.halt.call(execute.halt, group),
            self.blocks.stop.call(execute.stop, group),
            self.blocks.interrupt.call(execute.interrupt, group),
            self.blocks.go_on.call(execute.go_on, group),
        ];
        self.at += Duration::from_millis(4);
        self.controller.tick(self.at, Some(group.command()));
        outputs
    }

    fn scans(&mut self, count: u32) {
        for _ in 0..count {
            self.scan();
        }
    }

    #[track_caller]
    fn until(&mut self, condition: impl Fn(&Self) -> bool) {
        for _ in 0..5_000 {
            if condition(self) {
                return;
            }
            self.scan();
        }
        panic!("waited in vain: {:?}", self.feedback());
    }

    /// Sets `Execute` of a block of the group until the block has ended, and takes it back. Returns how it ended.
    #[track_caller]
    fn ends(&mut self, execute: impl Fn(&mut Execute) -> &mut bool) -> Outputs {
        *execute(&mut self.execute) = true;
        for _ in 0..5_000 {
            let ended =
                self.scan().into_iter().find(|block| block.done || block.command_aborted || block.error);
            if let Some(ended) = ended {
                *execute(&mut self.execute) = false;
                self.scan();
                return ended;
            }
        }
        panic!("the block does not end: {:?}", self.feedback());
    }

    fn feedback(&self) -> &Feedback {
        self.controller.feedback()
    }

    /// Runs the skill again, from its start edge to its end.
    #[track_caller]
    fn runs_a_skill(&mut self) {
        self.execute.skill = false;
        self.scan();
        self.execute.skill = true;
        self.until(|cell| cell.skill_outputs.done || cell.skill_outputs.error);
        assert!(self.skill_outputs.done, "{:?}", self.skill.error());
    }
}

/// To the start of a line, along it and back.
fn way() -> Vec<Motion> {
    vec![ptp(0.0, 0.0, 100.0), lin(200.0, 0.0, 100.0), lin(0.0, 0.0, 100.0)]
}

#[test]
fn group_enable_leads_a_robot_that_was_just_switched_on_to_ready_and_group_disable_back() {
    let mut cell = Cell::new();
    assert_eq!(cell.skill.state(), SkillState::Ready);
    assert!(cell.ends(|execute| &mut execute.enable).done);
    assert_eq!(cell.feedback().state, State::Ready);
    cell.runs_a_skill();
    assert_eq!((cell.skill.executed(), cell.skill.state()), (3, SkillState::Ready));
    assert!(cell.ends(|execute| &mut execute.disable).done);
    let off = *cell.feedback();
    assert!(!off.status.contains(Status::ENABLED) && off.state == State::Halted);
    assert!(cell.ends(|execute| &mut execute.enable).done);
    cell.runs_a_skill();
}

#[test]
fn an_interrupted_skill_shows_it_and_goes_on_when_it_is_continued() {
    let mut cell = Cell::moving();
    assert_eq!(cell.skill.state(), SkillState::Running);
    assert!(cell.ends(|execute| &mut execute.interrupt).done);
    let Outputs { busy, active, command_interrupted, command_aborted, .. } = cell.skill_outputs;
    assert!(busy && command_interrupted && !active && !command_aborted, "{:?}", cell.skill_outputs);
    assert_eq!(cell.skill.state(), SkillState::Suspended);
    assert!(cell.feedback().status.contains(Status::AT_REST));
    assert!(cell.ends(|execute| &mut execute.go_on).done);
    cell.until(|cell| cell.skill_outputs.active);
    cell.until(|cell| cell.skill_outputs.done);
    assert_eq!(cell.skill.executed(), 3);
}

#[test]
fn after_group_halt_the_next_skill_starts_without_a_reset() {
    let mut cell = Cell::moving();
    assert!(cell.ends(|execute| &mut execute.halt).done);
    assert!(cell.skill_outputs.command_aborted && cell.skill.state() == SkillState::Halted);
    assert_eq!(cell.feedback().state, State::Ready);
    assert!(cell.feedback().status.contains(Status::ABORTED | Status::AT_REST));
    assert!((cell.feedback().pose[1]).abs() < 1e-3, "on its path: {:?}", cell.feedback().pose);
    cell.runs_a_skill();
}

#[test]
fn after_group_stop_a_reset_is_needed() {
    let mut cell = Cell::moving();
    assert!(cell.ends(|execute| &mut execute.stop).done);
    assert!(cell.skill_outputs.command_aborted);
    assert_eq!(cell.feedback().state, State::Halted);
    let halt = cell.ends(|execute| &mut execute.halt);
    assert!(halt.error, "there is nothing to halt: {halt:?}");
    cell.execute.skill = false;
    cell.scan();
    cell.execute.skill = true;
    cell.until(|cell| cell.skill_outputs.error);
    let Some(BlockError::Robot { number, .. }) = cell.skill.error() else {
        panic!("{:?}", cell.skill.error())
    };
    assert_eq!(number, ErrorNumber::NotReady);
    assert!(cell.ends(|execute| &mut execute.reset).done);
    cell.runs_a_skill();
}

#[test]
fn a_stop_while_the_arm_halts_aborts_the_halt_and_needs_a_reset() {
    let mut cell = Cell::moving();
    cell.execute.halt = true;
    cell.scans(4);
    assert!(!cell.feedback().status.contains(Status::AT_REST), "it still brakes");
    cell.execute.stop = true;
    let mut halt = Outputs::default();
    while !(halt.done || halt.command_aborted || halt.error) {
        halt = cell.scan()[3];
    }
    assert!(halt.command_aborted && cell.feedback().state == State::Halted, "{halt:?}");
}

#[test]
fn group_disable_in_motion_is_an_error_that_only_a_reset_acknowledges() {
    let mut cell = Cell::moving();
    assert!(cell.ends(|execute| &mut execute.disable).done);
    let Some(BlockError::Robot { number, .. }) = cell.skill.error() else {
        panic!("{:?}", cell.skill.error())
    };
    assert_eq!(number, ErrorNumber::Disabled);
    cell.execute.skill = false;
    assert!(cell.ends(|execute| &mut execute.enable).error);
    let told = BlockError::InError { number: ErrorNumber::Disabled }.to_string();
    insta::assert_snapshot!(told, @"the robot stands in error 18: the PLC took back `enable` while the skill ran; GroupReset acknowledges it");
    assert!(cell.ends(|execute| &mut execute.reset).done);
    assert!(cell.ends(|execute| &mut execute.enable).done);
    cell.runs_a_skill();
}

/// Gives the first motions of a list and then fails, as a file that cannot be read.
#[derive(Debug)]
struct Torn(MotionList);

impl MotionSource for Torn {
    fn total(&self) -> u32 {
        40
    }

    fn get(&mut self, index: u32) -> Option<Motion> {
        self.0.get(index)
    }
}

#[test]
fn an_error_of_the_block_stops_an_arm_that_moves() {
    let mut cell = Cell::enabled();
    let motions: Vec<Motion> = (0..6).map(|index| lin(40.0 * index as f32, 0.0, 100.0)).collect();
    cell.motions = Box::new(Torn([vec![ptp(-20.0, 0.0, 100.0)], motions].concat().into()));
    cell.execute.skill = true;
    cell.until(|cell| cell.skill_outputs.error);
    assert!(matches!(cell.skill.error(), Some(BlockError::SourceEnded { index: 7, .. })));
    assert!(!cell.feedback().status.contains(Status::AT_REST), "the arm still moves");
    assert_eq!(cell.skill.state(), SkillState::Halted);
    cell.until(|cell| cell.feedback().status.contains(Status::AT_REST));
    let stopped = *cell.feedback();
    assert_eq!((stopped.state, stopped.executed < 7), (State::Halted, true));
    cell.scans(100);
    assert_eq!(cell.feedback().pose, stopped.pose);
    cell.motions = Box::new(MotionList::from(way()));
    assert!(cell.ends(|execute| &mut execute.reset).done);
    cell.runs_a_skill();
}

#[test]
fn a_skill_that_the_robot_has_not_taken_up_is_given_up_as_one_that_runs() {
    let blocks: [fn(&mut Execute) -> &mut bool; 3] =
        [|it| &mut it.halt, |it| &mut it.stop, |it| &mut it.disable];
    for gives_up in blocks {
        let quantum = Duration::from_millis(400);
        let mut cell = Cell::with(RobotConfig { interpreter_quantum: quantum, ..bare("A") });
        assert!(cell.ends(|execute| &mut execute.enable).done);
        let joints = *cell.controller.joints();
        cell.execute.skill = true;
        cell.scans(5);
        assert!(cell.skill_outputs.busy && !cell.skill_outputs.active);
        assert!(cell.ends(gives_up).done);
        assert!(cell.skill_outputs.command_aborted, "{:?}", cell.skill_outputs);
        cell.scans(200);
        assert_eq!((cell.controller.joints(), cell.feedback().error), (&joints, ErrorNumber::None));
        assert_eq!(cell.feedback().number, 0, "the robot did not take it up later");
        cell.ends(|execute| &mut execute.enable);
        cell.runs_a_skill();
    }
}

#[test]
fn without_a_connection_group_enable_leaves_the_robot_switched_off() {
    let enable_bit = |group: &AxesGroup| group.command().control.contains(Control::ENABLE);
    let mut cell = Cell::new();
    cell.group.read(None);
    assert_eq!(cell.blocks.enable.call(true, &mut cell.group).error_id, 0x8001);
    assert!(!enable_bit(&cell.group));
    let mut cell = Cell::new();
    cell.group.read(Some(*cell.controller.feedback()));
    assert!(cell.blocks.enable.call(true, &mut cell.group).busy && enable_bit(&cell.group));
    cell.group.disarm();
    cell.group.read(None);
    assert_eq!(cell.blocks.enable.call(true, &mut cell.group).error_id, 0x8001);
    assert!(!enable_bit(&cell.group));
}
