//! Which motion of the sequence the robot executes in each of its cycles.

use protocol::image::State;
use robot_node::Sample;

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
    /// Follows the robot to its next cycle. Returns the index of the motion that the robot executes in this cycle, while it runs.
    pub fn follow(&mut self, sample: &Sample) -> Option<usize> {
        if sample.state != State::Running {
            return None;
        }
        if self.command.replace(sample.command) != Some(sample.command) {
            self.before += std::mem::take(&mut self.accepted);
        }
        self.accepted = self.accepted.max(sample.accepted);
        usize::try_from(self.before + sample.executed).ok()
    }
}
