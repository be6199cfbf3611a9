//! A program that is stored in the robot controller: the paper's RC.

use protocol::image::{Motion, SLOTS, Skill};

use super::skill::{SkillCall, Tally};
use super::{BlockError, BufferMode, Outputs, SkillState};
use crate::AxesGroup;

/// Runs a program of the robot controller.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct RunProgram {
    pub(super) call: SkillCall<u16>,
}

impl RunProgram {
    /// Runs one scan. `program` and `mode` are read at the rising edge of `execute`.
    pub fn call(&mut self, execute: bool, program: u16, mode: BufferMode, group: &mut AxesGroup) -> Outputs {
        self.call.call(
            execute,
            mode,
            group,
            || Ok(program),
            |command, program| {
                command.skill = Skill::RunProgram;
                command.program = program;
                command.slots = [Motion::EMPTY; SLOTS];
                (command.total, command.written) = (0, 0);
                Ok(false)
            },
        );
        self.call.outputs()
    }

    /// Returns the error behind `ErrorID`; `None` without an error.
    #[must_use]
    pub const fn error(&self) -> Option<BlockError> {
        self.call.interface.error()
    }

    /// Returns the state of the skill.
    #[must_use]
    pub const fn state(&self) -> SkillState {
        self.call.state()
    }

    /// Returns the number of executed motions of the skill, the paper's `curExec`. It is kept until the next start.
    #[must_use]
    pub const fn executed(&self) -> u32 {
        self.call.tally.executed
    }

    pub(crate) const fn tally(&self) -> Tally {
        self.call.tally
    }
}
