//! A program that is stored in the robot controller: the paper's RC.

use protocol::image::{Skill, Slots};

use super::skill::{SkillCall, skill_outputs};
use super::{BufferMode, Outputs};
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
                command.slots = Slots::EMPTY;
                (command.total, command.written) = (0, 0);
                Ok(false)
            },
        );
        self.call.outputs()
    }
}

skill_outputs!(RunProgram: call);
