//! A PLC program with a block for each kind of skill and one for each command to the group.

use plc_node::function_blocks::{
    BlockError, BufferMode, GroupDisable, GroupEnable, GroupHalt, GroupInterrupt, GroupReset, GroupStop,
    MotionInputs, MoveContinuous, MoveLinCartesian, Outputs, RunProgram,
};
use plc_node::{AxesGroup, MotionSource, WaitLimits};
use protocol::image::{Motion, MotionKind};

pub(crate) const WAY: usize = 0;
pub(crate) const LINE: usize = 1;
pub(crate) const OTHER: usize = 2;
pub(crate) const PROGRAM: usize = 3;
pub(crate) const SKILLS: usize = 4;
pub(crate) const ENABLE: usize = 4;
pub(crate) const DISABLE: usize = 5;
pub(crate) const RESET: usize = 6;
pub(crate) const HALT: usize = 7;
pub(crate) const STOP: usize = 8;
pub(crate) const INTERRUPT: usize = 9;
pub(crate) const BLOCKS: usize = 10;

/// Height below which no target is reached, in mm.
pub(crate) const LOWEST: f32 = -500.0;

/// Motions that arrive little by little, as from a file.
#[derive(Clone, Debug, Default)]
pub(crate) struct Supply {
    pub(crate) motions: Vec<Motion>,
    pub(crate) available: u32,
}

impl MotionSource for Supply {
    fn total(&self) -> u32 {
        self.motions.len() as u32
    }

    fn get(&mut self, index: u32) -> Option<Motion> {
        self.motions.get(index as usize).copied()
    }

    fn available(&self) -> u32 {
        self.available.min(self.total())
    }
}

/// A line or PTP that no other motion of a script equals: `salt` says which.
pub(crate) fn motion(kind: MotionKind, salt: u32, z: f32) -> Motion {
    let [a, b] = [(salt % 1_000) as f32, (salt / 1_000) as f32];
    Motion {
        kind,
        target: [a, b, z, 0.5 * a, 0.0, 180.0],
        auxiliary: if kind.has_auxiliary() { [b, a, 1.0] } else { [0.0; 3] },
        velocity: 100 + (salt % 900) as u16,
        acceleration: 1_000,
        approximation: (salt % 3) as u16 * 100,
        base: 1,
        ..Motion::EMPTY
    }
}

/// The stored program of all scripts, with a stop after the third motion.
pub(crate) fn program() -> Vec<Motion> {
    (0..7).map(|at| motion(MotionKind::LinCartesian, 900_000 + at, 10.0)).collect()
}

pub(crate) struct PlcBlocks {
    pub(crate) group: AxesGroup,
    way: MoveContinuous,
    line: MoveLinCartesian,
    other: MoveContinuous,
    program: RunProgram,
    enable: GroupEnable,
    disable: GroupDisable,
    reset: GroupReset,
    halt: GroupHalt,
    stop: GroupStop,
    interrupt: GroupInterrupt,
    /// Motions of each block of a skill.
    pub(crate) supplies: [Supply; SKILLS],
}

impl PlcBlocks {
    pub(crate) fn new() -> Self {
        Self {
            group: AxesGroup::new(WaitLimits { answer_scans: 8_000, silent_scans: u32::MAX }),
            way: MoveContinuous::default(),
            line: MoveLinCartesian::default(),
            other: MoveContinuous::default(),
            program: RunProgram::default(),
            enable: GroupEnable::default(),
            disable: GroupDisable::default(),
            reset: GroupReset::default(),
            halt: GroupHalt::default(),
            stop: GroupStop::default(),
            interrupt: GroupInterrupt::default(),
            supplies: Default::default(),
        }
    }

    pub(crate) fn call(&mut self, block: usize, execute: bool, mode: BufferMode) -> Outputs {
        let group = &mut self.group;
        let [way, line, other, _] = &mut self.supplies;
        match block {
            WAY => self.way.call(execute, way, mode, group),
            LINE => {
                let motion = line.motions.first().copied().unwrap_or(Motion::EMPTY);
                self.line.call(execute, &MotionInputs::from(&motion), mode, group)
            }
            OTHER => self.other.call(execute, other, mode, group),
            PROGRAM => self.program.call(execute, 1, mode, group),
            ENABLE => self.enable.call(execute, group),
            DISABLE => self.disable.call(execute, group),
            RESET => self.reset.call(execute, group),
            HALT => self.halt.call(execute, group),
            STOP => self.stop.call(execute, group),
            _ => self.interrupt.call(execute, group),
        }
    }

    pub(crate) fn error(&self, block: usize) -> Option<BlockError> {
        match block {
            WAY => self.way.error(),
            LINE => self.line.error(),
            OTHER => self.other.error(),
            PROGRAM => self.program.error(),
            ENABLE => self.enable.error(),
            DISABLE => self.disable.error(),
            RESET => self.reset.error(),
            HALT => self.halt.error(),
            STOP => self.stop.error(),
            _ => self.interrupt.error(),
        }
    }
}
