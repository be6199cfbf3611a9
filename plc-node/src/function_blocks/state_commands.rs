//! The blocks that change the robot's state instead of running a skill (OPC UA Part 10: Reset, Halt, Suspend,
//! Resume).
//!
//! Each sets its control bit with `Execute`'s rising edge and takes it back at its end. An end counts only once the
//! robot has seen the bit, by the life counter that it echoes: a state from before would be no answer. A robot that
//! does not follow in time ends the block with an error, and the bit goes back too, so that asking again is an edge.

use protocol::image::{Control, Feedback, State, Status};

use super::face::{End, Face};
use super::{BlockError, Outputs};
use crate::AxesGroup;

/// What the four have in common.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub(super) struct StateCommand {
    pub(super) face: Face,
    /// The PLC's life counter in the first image with the bit.
    pub(super) since: u16,
    /// Scans since the start.
    pub(super) waited: u32,
}

impl StateCommand {
    /// `before` must hold at the start; `reached` ends the block, once the robot has seen the bit.
    fn call(
        &mut self,
        execute: bool,
        group: &mut AxesGroup,
        bit: Control,
        before: impl FnOnce(&Feedback) -> Result<(), BlockError>,
        reached: impl FnOnce(&Feedback) -> Option<End>,
    ) -> Outputs {
        let started = self.face.call(execute);
        if started {
            (self.since, self.waited) = (group.command.life, 0);
        }
        if self.face.is_busy() {
            let seen = group.has_seen(self.since);
            let scans = self.waited;
            let late = scans >= group.answer_scans();
            self.waited = self.waited.saturating_add(1);
            let end = match &group.feedback {
                None => Some(End::Error(BlockError::NotConnected)),
                Some(feedback) if started => before(feedback).err().map(End::Error),
                Some(feedback) if seen => {
                    self.face.activate();
                    reached(feedback)
                }
                Some(_) => None,
            };
            let end = end.or_else(|| late.then_some(End::Error(BlockError::StateNotReached { scans })));
            if let Some(end) = end {
                self.face.end(end);
            }
            group.set_control(bit, self.face.is_busy());
        }
        self.face.outputs()
    }
}

macro_rules! state_blocks {
    ($($(#[$doc:meta])* $name:ident: $bit:ident, $before:expr, $reached:expr;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
        pub struct $name {
            pub(super) inner: StateCommand,
        }

        impl $name {
            /// One scan.
            pub fn call(&mut self, execute: bool, group: &mut AxesGroup) -> Outputs {
                self.inner.call(execute, group, Control::$bit, $before, $reached)
            }

            /// What `ErrorID` stands for; none without an error.
            #[must_use]
            pub const fn error(&self) -> Option<BlockError> {
                self.inner.face.error()
            }
        }
    )*};
}

state_blocks! {
    /// Leads the robot to `Ready`, out of `Halted` and out of an error.
    Reset: RESET, |_| Ok(()), |feedback| is_ready(feedback).then_some(End::Done);
    /// Stops the robot on its path; a skill under way is given up.
    Halt: HALT, |_| Ok(()), |feedback| {
        let rests = !is_executing(feedback) && feedback.status.contains(Status::AT_REST);
        rests.then_some(End::Done)
    };
    /// Stops the robot on its path; the skill waits there. A skill that ends meanwhile aborts the block.
    Suspend: SUSPEND, |feedback| is_in(feedback, State::Running, "running"), |feedback| match feedback.state {
        State::Suspended => Some(End::Done),
        State::Running => None,
        _ => Some(End::Aborted),
    };
    /// Lets a suspended skill go on.
    Resume: RESUME, |feedback| is_in(feedback, State::Suspended, "suspended"), |feedback| match feedback.state {
        State::Suspended => None,
        State::Halted => Some(End::Aborted),
        _ => Some(End::Done),
    };
}

/// Whether the robot would take up a skill.
pub(crate) fn is_ready(feedback: &Feedback) -> bool {
    feedback.state == State::Ready
        && feedback.status.contains(Status::ENABLED)
        && !feedback.status.contains(Status::ERROR)
}

/// Whether a skill is under way on the robot.
pub(crate) const fn is_executing(feedback: &Feedback) -> bool {
    matches!(feedback.state, State::Running | State::Suspended)
}

fn is_in(feedback: &Feedback, state: State, name: &'static str) -> Result<(), BlockError> {
    if feedback.state == state { Ok(()) } else { Err(BlockError::NothingToDo(name)) }
}
