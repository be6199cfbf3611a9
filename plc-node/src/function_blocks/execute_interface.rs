//! `Execute` and the outputs, the same for every block.

use super::BlockError;

/// The outputs of a block after a call.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct Outputs {
    /// The block has something to do.
    pub busy: bool,
    /// The robot executes the skill.
    pub active: bool,
    /// The skill waits on its path, stopped by [`GroupInterrupt`](super::GroupInterrupt), until
    /// [`GroupContinue`](super::GroupContinue).
    pub command_interrupted: bool,
    /// The skill ended as wanted.
    pub done: bool,
    /// The skill was aborted.
    pub command_aborted: bool,
    /// Something is wrong.
    pub error: bool,
    /// What is wrong, see [`BlockError::error_id`]; 0 without an error.
    pub error_id: u16,
}

/// Where the skill of a block stands: the states of OPC UA Part 10 programs, as the robot has them.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum SkillState {
    /// The skill may be started: it was not yet, it waits for another one to end, or it ended as wanted.
    Ready,
    /// It was started and has not ended: while `Busy`, but for a wait and for `CommandInterrupted`.
    Running,
    /// It waits on its path: `CommandInterrupted`.
    Suspended,
    /// It was aborted or failed: `CommandAborted` or `Error`. When `Execute` falls the block is `Ready` again.
    Halted,
}

/// How a block ended.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) enum End {
    Done,
    Aborted,
    Error(BlockError),
}

/// How far a busy block has come.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Progress {
    /// The skill of another block is under way.
    Waiting,
    /// The robot has not answered yet.
    Called,
    Active,
    Interrupted,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Phase {
    Idle,
    Busy(Progress),
    Ended(End),
}

/// The edge of `Execute` and what the outputs show. One value holds all of them, so that they cannot contradict.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) struct ExecuteInterface {
    execute: bool,
    phase: Phase,
}

impl Default for ExecuteInterface {
    fn default() -> Self {
        Self { execute: false, phase: Phase::Idle }
    }
}

impl ExecuteInterface {
    /// Begins a call. Returns whether the block is to start now.
    pub(super) fn call(&mut self, execute: bool) -> bool {
        let before = core::mem::replace(&mut self.execute, execute);
        let rising = execute && !before;
        match self.phase {
            Phase::Ended(_) if !execute => self.phase = Phase::Idle,
            Phase::Idle | Phase::Ended(_) if rising => {
                self.phase = Phase::Busy(Progress::Called);
                return true;
            }
            _ => {}
        }
        false
    }

    pub(super) const fn is_busy(&self) -> bool {
        matches!(self.phase, Phase::Busy(_))
    }

    /// Returns whether the robot has accepted the command.
    pub(super) const fn is_taken_up(&self) -> bool {
        matches!(self.phase, Phase::Busy(Progress::Active | Progress::Interrupted))
    }

    /// Notes that the block waits until the skill of another block ends.
    pub(super) const fn wait(&mut self) {
        self.phase = Phase::Busy(Progress::Waiting);
    }

    /// Notes that the command is in the image.
    pub(super) const fn sent(&mut self) {
        self.phase = Phase::Busy(Progress::Called);
    }

    pub(super) const fn activate(&mut self) {
        self.phase = Phase::Busy(Progress::Active);
    }

    pub(super) const fn interrupt(&mut self) {
        self.phase = Phase::Busy(Progress::Interrupted);
    }

    pub(super) const fn end(&mut self, end: End) {
        self.phase = Phase::Ended(end);
    }

    pub(super) const fn error(&self) -> Option<BlockError> {
        match self.phase {
            Phase::Ended(End::Error(error)) => Some(error),
            _ => None,
        }
    }

    pub(super) const fn state(&self) -> SkillState {
        match self.phase {
            Phase::Idle | Phase::Busy(Progress::Waiting) | Phase::Ended(End::Done) => SkillState::Ready,
            Phase::Busy(Progress::Interrupted) => SkillState::Suspended,
            Phase::Busy(_) => SkillState::Running,
            Phase::Ended(End::Aborted | End::Error(_)) => SkillState::Halted,
        }
    }

    pub(super) fn outputs(&self) -> Outputs {
        let none = Outputs::default();
        match self.phase {
            Phase::Idle => none,
            Phase::Busy(progress) => Outputs {
                busy: true,
                active: progress == Progress::Active,
                command_interrupted: progress == Progress::Interrupted,
                ..none
            },
            Phase::Ended(End::Done) => Outputs { done: true, ..none },
            Phase::Ended(End::Aborted) => Outputs { command_aborted: true, ..none },
            Phase::Ended(End::Error(error)) => Outputs { error: true, error_id: error.error_id(), ..none },
        }
    }
}
