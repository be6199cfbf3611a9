//! A PLC program with two blocks of each kind of skill and one of each command to the group, the robot, and the images
//! between them.

use std::collections::VecDeque;
use std::time::Duration;

use machine::Instant;
use plc_node::function_blocks::{
    BufferMode, Dynamics, GroupSetOverride, MotionInputs, MoveContinuous, MoveLinCartesian, Outputs,
    OverrideFactors, RunProgram,
};
use plc_node::{AxesGroup, MotionList, WaitLimits};
use protocol::image::{Command, Feedback, Motion};
use robot_node::{Controller, RobotConfig, RobotEvent};

use super::rules::Rules;
use crate::driven::{GroupBlocks, bare, lin, ptp};

pub(super) const WAY: usize = 0;
pub(super) const LINE: usize = 1;
pub(super) const BAD: usize = 2;
pub(super) const PROGRAM: usize = 3;
pub(super) const SKILLS: usize = 4;
pub(super) const ENABLE: usize = 4;
pub(super) const DISABLE: usize = 5;
pub(super) const RESET: usize = 6;
pub(super) const HALT: usize = 7;
pub(super) const STOP: usize = 8;
pub(super) const INTERRUPT: usize = 9;
pub(super) const CONTINUE: usize = 10;
pub(super) const BLOCKS: usize = 11;

pub(super) const MODES: [BufferMode; 3] =
    [BufferMode::Aborting, BufferMode::Buffered, BufferMode::BlendingNext];

/// The robot runs a cycle in every fourth scan.
const SCANS_PER_CYCLE: u64 = 4;

/// Motions of each skill.
pub(super) const TOTALS: [u32; SKILLS] = [8, 1, 8, 8];

/// Motion of the bad skill that is out of reach: not written before the skill runs.
pub(super) const OUT_OF_REACH: usize = 6;

fn way() -> Vec<Motion> {
    let corner = |x, y| Motion { approximation: 300, ..lin(x, y, 100.0) };
    vec![
        ptp(10.0, 0.0, 100.0),
        corner(40.0, 0.0),
        corner(40.0, 30.0),
        corner(20.0, 30.0),
        corner(20.0, 10.0),
        corner(40.0, 10.0),
        corner(40.0, 0.0),
        lin(0.0, 0.0, 100.0),
    ]
}

fn bad() -> Vec<Motion> {
    let mut motions = way();
    motions[OUT_OF_REACH] = lin(0.0, -900.0, 100.0);
    motions
}

fn line() -> MotionInputs {
    MotionInputs {
        position: [60.0, 5.0, 110.0, 0.0, 0.0, 180.0],
        auxiliary: [0.0; 3],
        configuration: None,
        dynamics: Dynamics { velocity: 200.0, acceleration: 3000.0, ..Dynamics::default() },
        approximation_mm: 0.0,
        tool: 0,
        base: 1,
    }
}

/// The PLC program: what is gone when the PLC restarts.
struct Plc {
    group: AxesGroup,
    way: MoveContinuous,
    line: MoveLinCartesian,
    bad: MoveContinuous,
    program: RunProgram,
    blocks: GroupBlocks,
    set_override: GroupSetOverride,
}

impl Plc {
    fn new() -> Self {
        Self {
            group: AxesGroup::new(WaitLimits { answer_scans: 300, silent_scans: u32::MAX }),
            way: MoveContinuous::default(),
            line: MoveLinCartesian::default(),
            bad: MoveContinuous::default(),
            program: RunProgram::default(),
            blocks: GroupBlocks::default(),
            set_override: GroupSetOverride::default(),
        }
    }

    fn call(
        &mut self,
        block: usize,
        execute: bool,
        mode: BufferMode,
        lists: &mut [MotionList; 2],
    ) -> Outputs {
        let group = &mut self.group;
        let [good, bad] = lists;
        match block {
            WAY => self.way.call(execute, good, mode, group),
            LINE => self.line.call(execute, &line(), mode, group),
            BAD => self.bad.call(execute, bad, mode, group),
            PROGRAM => self.program.call(execute, 1, mode, group),
            ENABLE => self.blocks.enable.call(execute, group),
            DISABLE => self.blocks.disable.call(execute, group),
            RESET => self.blocks.reset.call(execute, group),
            HALT => self.blocks.halt.call(execute, group),
            STOP => self.blocks.stop.call(execute, group),
            INTERRUPT => self.blocks.interrupt.call(execute, group),
            _ => self.blocks.go_on.call(execute, group),
        }
    }

    fn executed(&self) -> [u32; SKILLS] {
        [self.way.executed(), self.line.executed(), self.bad.executed(), self.program.executed()]
    }
}

/// A command with the number of the scan that wrote it.
type Sent = (u64, Command);

pub(super) struct Cell {
    plc: Plc,
    controller: Controller,
    config: RobotConfig,
    lists: [MotionList; 2],
    execute: [bool; BLOCKS],
    pub(super) mode: BufferMode,
    pub(super) override_percent: u8,
    /// Scans for which the command, and the feedback, stay as they are.
    pub(super) stale: [u32; 2],
    delays: [u8; 2],
    skills_last: bool,
    commands: VecDeque<Sent>,
    command: Sent,
    feedbacks: VecDeque<Feedback>,
    feedback: Feedback,
    connected: bool,
    scan: u64,
    rules: Rules,
    outputs: [Outputs; BLOCKS],
}

impl Cell {
    pub(super) fn new(delays: [u8; 2], takes_time: bool, skills_last: bool) -> Self {
        let setup = setup::setup("A").unwrap();
        let config = if takes_time { RobotConfig::from_setup(&setup).unwrap() } else { bare("A") };
        let controller = Controller::new(config.clone(), vec![(1, way().into())], 1);
        Self {
            plc: Plc::new(),
            rules: Rules::new(&config, *controller.joints()),
            controller,
            config,
            lists: [way().into(), bad().into()],
            execute: [false; BLOCKS],
            mode: MODES[0],
            override_percent: 100,
            stale: [0; 2],
            delays,
            skills_last,
            commands: VecDeque::new(),
            command: Sent::default(),
            feedbacks: VecDeque::new(),
            feedback: Feedback::default(),
            connected: true,
            scan: 0,
            outputs: [Outputs::default(); BLOCKS],
        }
    }

    pub(super) fn set(&mut self, block: usize, execute: bool) {
        self.execute[block] = execute;
    }

    pub(super) fn scans(&mut self, count: u32) {
        (0..count).for_each(|_| self.scan());
    }

    pub(super) fn lose(&mut self, count: u32) {
        self.connected = false;
        self.commands.clear();
        self.feedbacks.clear();
        self.plc.group.disarm();
        self.command = (self.scan, *self.plc.group.command());
        self.rules.connection_lost();
        self.scans(count);
        self.connected = true;
        self.feedback = *self.controller.feedback();
    }

    pub(super) fn restart_robot(&mut self) {
        self.lose(20);
        let home = *self.controller.joints();
        let config = RobotConfig { home, ..self.config.clone() };
        self.controller = Controller::new(config, vec![(1, way().into())], self.scan);
        self.feedback = *self.controller.feedback();
        self.rules.robot_restarted(home);
    }

    pub(super) fn restart_plc(&mut self) {
        self.lose(20);
        self.plc = Plc::new();
        self.command = (self.scan, *self.plc.group.command());
        (self.execute, self.outputs) = ([false; BLOCKS], [Outputs::default(); BLOCKS]);
        self.rules.plc_restarted();
    }

    /// Sets `Execute` of a block until the block has ended.
    pub(super) fn ends(&mut self, block: usize) -> Outputs {
        self.set(block, true);
        self.scan();
        for _ in 0..10_000 {
            if !self.outputs[block].busy {
                break;
            }
            self.scan();
        }
        let outputs = self.outputs[block];
        assert!(!outputs.busy, "block {block} does not end: {}", self.told());
        self.set(block, false);
        self.scans(2);
        outputs
    }

    pub(super) fn told(&self) -> String {
        let errors =
            [self.plc.way.error(), self.plc.line.error(), self.plc.bad.error(), self.plc.program.error()];
        format!("{errors:?} {:?}", self.controller.feedback())
    }

    fn scan(&mut self) {
        self.scan += 1;
        let feedback = self.connected.then_some(self.feedback);
        self.plc.group.read(feedback);
        for place in 0..BLOCKS {
            let block = if self.skills_last { BLOCKS - 1 - place } else { place };
            let before = self.plc.group.command().number;
            let (execute, mode) = (self.execute[block], self.mode);
            let outputs = self.plc.call(block, execute, mode, &mut self.lists);
            let number = self.plc.group.command().number;
            let issued = (number != before).then_some(number);
            self.rules.called(self.scan, block, execute, mode, outputs, issued);
            self.outputs[block] = outputs;
        }
        let velocity = f64::from(self.override_percent) / 100.0;
        let factors = OverrideFactors { velocity, ..OverrideFactors::default() };
        let overriding = self.plc.set_override.call(self.connected, &factors, &mut self.plc.group);
        self.rules.overridden(overriding, self.override_percent);
        self.rules.counted(self.plc.executed());
        if self.connected {
            self.exchange();
        }
        if self.scan.is_multiple_of(SCANS_PER_CYCLE) {
            self.cycle();
        }
    }

    /// Takes what was sent some scans ago to the other side.
    fn exchange(&mut self) {
        self.commands.push_back((self.scan, *self.plc.group.command()));
        self.feedbacks.push_back(*self.controller.feedback());
        let [command_is_stale, feedback_is_stale] = self.stale.map(|stale| stale > 0);
        self.stale = self.stale.map(|stale| stale.saturating_sub(1));
        while self.commands.len() > usize::from(self.delays[0]) {
            let command = self.commands.pop_front();
            self.command = command.filter(|_| !command_is_stale).unwrap_or(self.command);
        }
        while self.feedbacks.len() > usize::from(self.delays[1]) {
            let feedback = self.feedbacks.pop_front();
            self.feedback = feedback.filter(|_| !feedback_is_stale).unwrap_or(self.feedback);
        }
    }

    fn cycle(&mut self) {
        let (written_in, command) = self.command;
        let at = Instant::ZERO + Duration::from_millis(self.scan);
        self.controller.tick(at, self.connected.then_some(&command));
        let events: Vec<RobotEvent> = core::iter::from_fn(|| self.controller.poll_event()).collect();
        self.rules.moved(self.scan, self.controller.joints());
        events.iter().for_each(|event| self.rules.happened(written_in, event));
    }
}
