//! `Execute` and the outputs, the same for every block.

use super::BlockError;

/// The outputs of a block after a call.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct Outputs {
    /// The block has something to do.
    pub busy: bool,
    /// The robot has taken the skill up.
    pub active: bool,
    /// The skill ended as wanted.
    pub done: bool,
    /// The robot gave the skill up.
    pub command_aborted: bool,
    /// Something is wrong.
    pub error: bool,
    /// What is wrong, see [`BlockError::error_id`]; 0 without an error.
    pub error_id: u16,
}

/// How a block ended.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) enum End {
    Done,
    Aborted,
    Error(BlockError),
}

#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Phase {
    Idle,
    Busy { active: bool },
    Ended(End),
}

/// The edge of `Execute` and what the outputs show. One value holds all of them, so that they cannot contradict.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) struct Face {
    execute: bool,
    phase: Phase,
}

impl Default for Face {
    fn default() -> Self {
        Self { execute: false, phase: Phase::Idle }
    }
}

impl Face {
    /// Begins a call. Returns whether the block is to start now.
    pub(super) fn call(&mut self, execute: bool) -> bool {
        let before = core::mem::replace(&mut self.execute, execute);
        let rising = execute && !before;
        match self.phase {
            Phase::Ended(_) if !execute => self.phase = Phase::Idle,
            Phase::Idle | Phase::Ended(_) if rising => {
                self.phase = Phase::Busy { active: false };
                return true;
            }
            _ => {}
        }
        false
    }

    pub(super) const fn is_busy(&self) -> bool {
        matches!(self.phase, Phase::Busy { .. })
    }

    pub(super) const fn is_active(&self) -> bool {
        matches!(self.phase, Phase::Busy { active: true })
    }

    pub(super) const fn activate(&mut self) {
        self.phase = Phase::Busy { active: true };
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

    pub(super) fn outputs(&self) -> Outputs {
        let none = Outputs::default();
        match self.phase {
            Phase::Idle => none,
            Phase::Busy { active } => Outputs { busy: true, active, ..none },
            Phase::Ended(End::Done) => Outputs { done: true, ..none },
            Phase::Ended(End::Aborted) => Outputs { command_aborted: true, ..none },
            Phase::Ended(End::Error(error)) => Outputs { error: true, error_id: error.error_id(), ..none },
        }
    }
}
