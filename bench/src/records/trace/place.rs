//! Which motion of the sequence the robot executes at each of its ticks.

use protocol::image::State;

use super::RobotTick;

/// Position in the sequence: a program or a MoveContinuousSkill has all motions or many, a single skill has one.
#[derive(Clone, Copy, Default, Debug)]
pub struct Place {
    /// The command being executed; the command before the run was never seen running.
    command: Option<u16>,
    /// Motions of the earlier commands, plus accepted motions of this command: all of them once it has ended.
    before: u32,
    accepted: u32,
}

impl Place {
    /// Follows the robot to its next tick. Returns the index of the motion that the robot executes in this cycle, while it runs.
    pub fn follow(&mut self, tick: &RobotTick) -> Option<usize> {
        if tick.state != State::Running {
            return None;
        }
        if self.command.replace(tick.command) != Some(tick.command) {
            self.before += std::mem::take(&mut self.accepted);
        }
        self.accepted = self.accepted.max(tick.accepted);
        usize::try_from(self.before + tick.executed).ok()
    }
}
