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
    /// One scan. `program` and `mode` count at the rising edge of `execute`.
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

    /// What `ErrorID` stands for; none without an error.
    #[must_use]
    pub const fn error(&self) -> Option<BlockError> {
        self.call.face.error()
    }

    /// Where the skill stands.
    #[must_use]
    pub const fn state(&self) -> SkillState {
        self.call.state()
    }

    /// Motions of the skill that are executed: the paper's `curExec`. Stays until the next start.
    #[must_use]
    pub const fn executed(&self) -> u32 {
        self.call.tally.executed
    }

    pub(crate) const fn tally(&self) -> Tally {
        self.call.tally
    }
}
