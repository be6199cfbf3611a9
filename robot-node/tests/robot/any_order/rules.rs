//! A model of the blocks: what each may show next, and what must have happened on the robot before it may.

use std::collections::HashMap;

use plc_node::function_blocks::{BufferMode, EnableOutputs, Outputs};
use protocol::image::ErrorNumber;
use robot_node::arm::{AxisLimits, Joints};
use robot_node::{Ending, RobotConfig, RobotEvent};

use super::cell::{
    BAD, BLOCKS, CONTINUE, DISABLE, HALT, INTERRUPT, MODES, OUT_OF_REACH, PROGRAM, SKILLS, STOP, TOTALS,
};

/// Scans after the last busy skill in which the arm may still brake, with images that are late or stale.
const BRAKING: u64 = 600;

/// A joint that moves less in a cycle stands, in degrees (mm).
const STANDS: f64 = 1e-9;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Phase {
    Idle,
    Busy,
    Ended,
}

/// A block as PLCopen's general rules allow it.
#[derive(Clone, Copy, Debug)]
struct Block {
    execute: bool,
    phase: Phase,
    shown: Outputs,
    /// Scan of the last start.
    started: u64,
}

/// How often each thing happened that may end a skill before its end.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
struct Causes {
    halts: u32,
    stops: u32,
    disables: u32,
    aborts: u32,
    errors: u32,
    losses: u32,
}

/// A command of this PLC.
#[derive(Clone, Copy, Debug)]
struct Issued {
    block: usize,
    before: Causes,
    /// The robot started it.
    started: bool,
    /// How it ended on the robot, and its executed motions.
    ending: Option<(Ending, u32)>,
    refused: Option<ErrorNumber>,
    /// The scan in which its block ended, and whether the robot had ended it by then.
    block_ended: Option<(u64, bool)>,
}

pub(super) struct Rules {
    blocks: [Block; BLOCKS],
    issued: HashMap<u16, Issued>,
    /// Number of the last command of each block of a skill; none while it waits for its turn.
    number: [Option<u16>; SKILLS],
    executed: [u32; SKILLS],
    causes: Causes,
    /// A skill was started since the arm was stopped: the arm may move.
    may_move: bool,
    last_busy: u64,
    interrupted: Option<u16>,
    override_percent: u8,
    limits: AxisLimits,
    cycle_s: f64,
    history: [Joints; 3],
}

impl Rules {
    pub(super) fn new(config: &RobotConfig, joints: Joints) -> Self {
        let block = Block { execute: false, phase: Phase::Idle, shown: Outputs::default(), started: 0 };
        Self {
            blocks: [block; BLOCKS],
            issued: HashMap::new(),
            number: [None; SKILLS],
            executed: [0; SKILLS],
            causes: Causes::default(),
            may_move: false,
            last_busy: 0,
            interrupted: None,
            override_percent: 100,
            limits: *config.arm.limits(),
            cycle_s: config.cycle.as_secs_f64(),
            history: [joints; 3],
        }
    }

    pub(super) fn connection_lost(&mut self) {
        self.causes.losses += 1;
        self.interrupted = None;
    }

    /// The robot lost what ran; its arm stands where it was switched off.
    pub(super) fn robot_restarted(&mut self, joints: Joints) {
        self.history = [joints; 3];
    }

    /// The PLC forgets its blocks, and begins with its first command number.
    pub(super) fn plc_restarted(&mut self) {
        for block in &mut self.blocks {
            (block.execute, block.phase, block.shown) = (false, Phase::Idle, Outputs::default());
        }
        self.issued.clear();
        self.number = [None; SKILLS];
        self.executed = [0; SKILLS];
    }

    /// Checks one call of a block. `issued` is the number of a command that it wrote in this call.
    pub(super) fn called(
        &mut self,
        scan: u64,
        block: usize,
        execute: bool,
        mode: BufferMode,
        outputs: Outputs,
        issued: Option<u16>,
    ) {
        let before = self.blocks[block];
        let rising = execute && !before.execute;
        let starts = rising && before.phase != Phase::Busy;
        let shown = [outputs.busy, outputs.done, outputs.command_aborted, outputs.error];
        let phase = match shown.iter().filter(|shown| **shown).count() {
            0 => Phase::Idle,
            1 if outputs.busy => Phase::Busy,
            1 => Phase::Ended,
            _ => panic!("block {block} shows {outputs:?}"),
        };
        assert!(outputs.busy || !outputs.active && !outputs.command_interrupted, "{outputs:?}");
        assert!(!(outputs.active && outputs.command_interrupted), "{outputs:?}");
        assert_eq!(outputs.error, outputs.error_id != 0, "{outputs:?}");
        match before.phase {
            _ if starts => assert!(phase != Phase::Idle, "block {block} does not start"),
            Phase::Busy => assert!(phase != Phase::Idle, "block {block} ends without saying how"),
            Phase::Ended if execute => assert_eq!(outputs, before.shown, "block {block}"),
            Phase::Idle | Phase::Ended => assert_eq!(phase, Phase::Idle, "block {block}"),
        }
        if starts {
            self.blocks[block].started = scan;
            self.starts(block, mode, phase);
        }
        if let Some(number) = issued {
            assert!(block < SKILLS, "block {block} starts a skill");
            self.number[block] = Some(number);
            let command = Issued {
                block,
                before: self.causes,
                started: false,
                ending: None,
                refused: None,
                block_ended: None,
            };
            self.issued.insert(number, command);
        }
        if phase == Phase::Ended && (before.phase == Phase::Busy || starts) {
            self.ended(scan, block, outputs);
        }
        if block < SKILLS && phase == Phase::Busy {
            self.last_busy = scan;
            let is_active = outputs.active || outputs.command_interrupted;
            let started = self.number[block].is_some_and(|number| self.issued[&number].started);
            assert!(!is_active || started, "block {block} is active, but the robot did not start its skill");
        }
        let block = &mut self.blocks[block];
        (block.execute, block.phase, block.shown) = (execute, phase, outputs);
    }

    fn starts(&mut self, block: usize, mode: BufferMode, phase: Phase) {
        match block {
            ..=PROGRAM if phase == Phase::Busy => {
                (self.may_move, self.number[block]) = (true, None);
                self.executed[block] = 0;
                self.causes.aborts += u32::from(mode == MODES[0]);
            }
            ..=PROGRAM => (self.number[block], self.executed[block]) = (None, 0),
            HALT => self.causes.halts += 1,
            STOP => self.causes.stops += 1,
            DISABLE => self.causes.disables += 1,
            CONTINUE => self.interrupted = None,
            _ => {}
        }
    }

    fn ended(&mut self, scan: u64, block: usize, outputs: Outputs) {
        match block {
            ..=PROGRAM => self.skill_ended(scan, block, outputs),
            HALT | STOP | DISABLE if outputs.done => {
                let since = self.blocks[block].started;
                self.may_move &= self.blocks[..SKILLS].iter().any(|skill| skill.started >= since);
            }
            INTERRUPT if outputs.done => {
                let running =
                    self.issued.iter().find(|(_, issued)| issued.started && issued.ending.is_none());
                self.interrupted = running.map(|(number, _)| *number);
            }
            _ => {}
        }
    }

    /// Checks the end of a block of a skill against what the robot did.
    fn skill_ended(&mut self, scan: u64, block: usize, outputs: Outputs) {
        if outputs.error {
            self.causes.errors += 1;
        }
        let total = TOTALS[block];
        let Some(number) = self.number[block] else {
            return assert!(!outputs.done, "block {block} is done and started nothing");
        };
        let command = self.issued.get_mut(&number).unwrap();
        command.block_ended = Some((scan, command.ending.is_some()));
        if outputs.done {
            assert_eq!(command.ending, Some((Ending::Done, total)), "block {block} is done");
        } else if outputs.command_aborted {
            // The robot may have taken it up, and the PLC gives it up before it can know.
            let given_up = matches!(command.ending, None | Some((Ending::Halted | Ending::Cancelled, _)));
            assert!(given_up, "block {block} is aborted: {command:?}");
        } else if outputs.error_id < 0x8000 {
            let error = match command.ending {
                Some((Ending::Fault { error, .. }, _)) => Some(error),
                _ => command.refused,
            };
            assert_eq!(error.map(u16::from), Some(outputs.error_id), "block {block}: {command:?}");
        }
    }

    /// Checks `GroupSetOverride`, which is enabled while there is a connection.
    pub(super) fn overridden(&mut self, outputs: EnableOutputs, percent: u8) {
        assert!(!outputs.error || outputs.error_id == 0x8001, "the override fails: {outputs:?}");
        self.override_percent = percent;
    }

    /// Checks the counts of executed motions at the blocks' outputs.
    pub(super) fn counted(&mut self, executed: [u32; SKILLS]) {
        for block in 0..SKILLS {
            let (before, now) = (self.executed[block], executed[block]);
            assert!((before..=TOTALS[block]).contains(&now), "block {block} counts {before}, then {now}");
            let Outputs { done, command_aborted, error_id, .. } = self.blocks[block].shown;
            let command = self.number[block].map(|number| self.issued[&number]);
            if let Some(Issued { ending: Some((_, executed)), block_ended: Some((_, true)), .. }) = command
                && (done || command_aborted || (1..0x8000).contains(&error_id))
            {
                assert_eq!(now, executed, "curExec of block {block}");
            }
        }
        self.executed = executed;
    }

    /// Checks what the robot reports in a cycle on the image that the PLC wrote in scan `written_in`.
    pub(super) fn happened(&mut self, written_in: u64, event: &RobotEvent) {
        let causes = self.causes;
        match *event {
            RobotEvent::SkillStarted { number, .. } => {
                // A PLC that was restarted does not know what it called before.
                let Some(command) = self.issued.get_mut(&number) else { return };
                assert!(!command.started, "command {number} starts twice");
                let ended = command.block_ended;
                assert!(
                    ended.is_none_or(|(ended, _)| written_in < ended),
                    "command {number} starts after its block ended: {command:?}"
                );
                command.started = true;
            }
            RobotEvent::SkillFinished { number, ending, executed, .. } => {
                let is_interrupted = self.interrupted == Some(number);
                self.interrupted = self.interrupted.filter(|interrupted| *interrupted != number);
                assert!(
                    !is_interrupted || ending != Ending::Done,
                    "an interrupted skill ends as done without GroupContinue"
                );
                let Some(command) = self.issued.get_mut(&number) else { return };
                command.ending = Some((ending, executed));
                let Issued { block, before, .. } = *command;
                let allowed = match ending {
                    Ending::Done => {
                        block != BAD && (command.block_ended.is_none() || self.blocks[block].shown.error)
                    }
                    Ending::Halted => causes.stops > before.stops || causes.errors > before.errors,
                    Ending::Cancelled => causes.halts > before.halts || causes.aborts > before.aborts,
                    Ending::Fault { error: ErrorNumber::ConnectionLost, .. } => causes.losses > before.losses,
                    // The PLC clears its command when it loses the connection; a short loss does not reach the robot.
                    Ending::Fault { error: ErrorNumber::Disabled, .. } => {
                        let disables = self.blocks[DISABLE].phase != Phase::Idle;
                        disables || causes.disables > before.disables || causes.losses > before.losses
                    }
                    // The line may start at its target.
                    Ending::Fault { error: ErrorNumber::ZeroLength, .. } => true,
                    Ending::Fault { error: ErrorNumber::Unreachable, motion, .. } => {
                        assert_eq!((motion, executed), (OUT_OF_REACH as u32, OUT_OF_REACH as u32));
                        block == BAD
                    }
                    Ending::Fault { .. } => false,
                };
                assert!(allowed, "the skill of block {block} ends as {ending:?} for no reason");
            }
            RobotEvent::Refused { number, error, .. } => {
                if let Some(command) = self.issued.get_mut(&number) {
                    command.refused = Some(error);
                }
            }
            _ => {}
        }
    }

    /// Checks where the arm is after a cycle.
    pub(super) fn moved(&mut self, scan: u64, joints: &Joints) {
        let [one, two, three] = self.history;
        let cycle_s = self.cycle_s;
        let speed: Joints = core::array::from_fn(|axis| (joints[axis] - one[axis]) / cycle_s);
        let change: Joints =
            core::array::from_fn(|axis| (joints[axis] - 2.0 * one[axis] + two[axis]) / (cycle_s * cycle_s));
        let jerk: Joints = core::array::from_fn(|axis| {
            (joints[axis] - 3.0 * (one[axis] - two[axis]) - three[axis]) / (cycle_s * cycle_s * cycle_s)
        });
        let loads = [
            self.limits.speed_load(&speed).share,
            self.limits.acceleration_load(&change).share,
            self.limits.jerk_load(&jerk).share,
        ];
        assert!(loads.iter().all(|share| *share < 1.001), "the arm jumps: {loads:?}");
        let moves = joints.iter().zip(one).any(|(now, before)| (now - before).abs() > STANDS);
        assert!(!moves || self.may_move, "the arm moves after it was stopped, scan {scan}");
        assert!(!moves || scan < self.last_busy + BRAKING, "the arm moves and no block is busy");
        assert!(!moves || self.interrupted.is_none(), "the arm moves and its skill is interrupted");
        self.history = [*joints, one, two];
    }
}
