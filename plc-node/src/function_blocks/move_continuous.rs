//! A sequence of motions without stops: the paper's MoveContinuousSkill and its FIFO update logic.

use protocol::image::{Command, Motion, SLOTS, Skill};

use super::skill::{SkillCall, Tally};
use super::{BlockError, Outputs};
use crate::{AxesGroup, MotionSource};

/// Runs a sequence of motions of any kind as one skill.
///
/// The first five motions are written with the start. Whenever the robot counts motion k as executed (the paper's
/// `curExec`), motion k + 5 goes into the slot of motion k, until all (`totalNo`) are written (paper, section 5.2).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct MoveContinuous {
    pub(super) call: SkillCall,
}

impl MoveContinuous {
    /// One scan. The number of motions counts at the rising edge of `execute`; the motions are asked for as slots
    /// become free.
    pub fn call(&mut self, execute: bool, motions: &mut dyn MotionSource, group: &mut AxesGroup) -> Outputs {
        self.call.call(execute, group, |command| {
            let total = motions.total();
            if total == 0 {
                return Err(BlockError::NoMotions);
            }
            command.skill = Skill::MoveContinuous;
            command.slots = [Motion::EMPTY; SLOTS];
            (command.total, command.written) = (total, 0);
            fill(command, 0, motions)?;
            Ok(true)
        });
        if self.call.face.is_active()
            && let Err(error) = fill(&mut group.command, self.call.tally.executed, motions)
        {
            self.call.fail(group, error);
        }
        self.call.outputs()
    }

    /// What `ErrorID` stands for; none without an error.
    #[must_use]
    pub const fn error(&self) -> Option<BlockError> {
        self.call.face.error()
    }

    pub(crate) const fn tally(&self) -> Tally {
        self.call.tally
    }
}

/// Writes motions into every slot whose motion is executed.
fn fill(command: &mut Command, executed: u32, motions: &mut dyn MotionSource) -> Result<(), BlockError> {
    let end = executed.saturating_add(SLOTS as u32).min(command.total);
    while command.written < end {
        let index = command.written;
        let motion = motions.get(index).ok_or(BlockError::SourceEnded { index, total: command.total })?;
        command.set_slot(index, motion);
        command.written += 1;
    }
    Ok(())
}
