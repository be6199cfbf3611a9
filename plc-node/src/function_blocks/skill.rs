//! One skill call over the image: the part that all skill blocks share.
//!
//! ```text
//! PLC    number n, EXECUTE ──────────────────────────────────────┐ EXECUTE back
//! robot          echo n, BUSY ── executed 1 … total ── DONE (ABORTED, ERROR)
//! block  Busy    Busy, Active                          Done (CommandAborted, Error)
//! ```
//!
//! A block whose `Execute` rises while another block's skill is under way waits for its turn first: `Busy` alone.

use protocol::image::{Command, Feedback, Services, State, Status};
use setup::Refill;

use super::execute_interface::{End, ExecuteInterface, SkillState};
use super::{BlockError, BufferMode, Outputs, is_executing};
use crate::{AxesGroup, Ticket, Turn};

/// Results of a skill besides the outputs; kept until the next start.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub(crate) struct Tally {
    /// Motions that the robot counts as executed.
    pub(crate) executed: u32,
    /// Motions that the robot has accepted.
    pub(crate) accepted: u32,
    /// Motions that were run to a stop because the next one was not there in time.
    pub(crate) blends_suppressed: u16,
    /// The robot's own measure of the skill in ns.
    pub(crate) execution_ns: u64,
}

impl Tally {
    /// Returns how many motions have left their places in the image by this count.
    pub(super) const fn freed(&self, by: Refill) -> u32 {
        match by {
            Refill::Executed => self.executed,
            Refill::Accepted => self.accepted,
        }
    }
}

/// Returns whether the robot serves places that become free by this count: by `accepted` only if it keeps what it accepts.
pub(super) fn serves_refill(group: &AxesGroup, by: Refill) -> bool {
    let keeps = |feedback: &Feedback| feedback.services.contains(Services::KEEPS_ACCEPTED);
    by == Refill::Executed || group.feedback().is_none_or(keeps)
}

/// A skill call of a block with the parameters `P`, which count at the rising edge of `Execute`.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) struct SkillCall<P> {
    pub(super) interface: ExecuteInterface,
    /// The block's place behind the skill of another block, and its parameters until it is called.
    waiting: Option<(Ticket, P)>,
    pub(super) number: u16,
    /// Whether the robot echoed the number.
    pub(super) acknowledged: bool,
    /// Scans since the start while the robot has not taken the command up.
    pub(super) waited: u32,
    /// Whether the robot counts motions that came from the PLC.
    counted: bool,
    pub(super) tally: Tally,
}

impl<P> Default for SkillCall<P> {
    fn default() -> Self {
        Self {
            interface: ExecuteInterface::default(),
            waiting: None,
            number: 0,
            acknowledged: false,
            waited: 0,
            counted: false,
            tally: Tally::default(),
        }
    }
}

impl<P: Copy> SkillCall<P> {
    /// Runs one call of the block. On a rising edge `read` checks the parameters. `write` writes skill and parameters
    /// into the command, in the same scan or once the skill of another block has ended.
    ///
    /// `write` returns whether the robot counts motions that it got from the PLC (and not from a program of its own).
    pub(super) fn call(
        &mut self,
        execute: bool,
        mode: BufferMode,
        group: &mut AxesGroup,
        read: impl FnOnce() -> Result<P, BlockError>,
        write: impl FnOnce(&mut Command, P) -> Result<bool, BlockError>,
    ) {
        if self.interface.call(execute) {
            *self = Self { interface: self.interface, ..Self::default() };
            let waiting = aborts(mode).and_then(|aborts| Ok((read()?, aborts)));
            match waiting.and_then(|(parameters, aborts)| Ok((group.take_ticket(aborts)?, parameters))) {
                Ok(waiting) => self.waiting = Some(waiting),
                Err(error) => return self.interface.end(End::Error(error)),
            }
        }
        match self.waiting {
            Some((ticket, parameters)) if self.interface.is_busy() => {
                self.wait_for_turn(ticket, parameters, group, write);
            }
            _ if self.interface.is_busy() => self.observe(group),
            _ => {}
        }
    }

    /// Returns whether the command is in the image.
    pub(super) const fn is_sent(&self) -> bool {
        self.interface.is_busy() && self.waiting.is_none()
    }

    pub(super) fn outputs(&self) -> Outputs {
        self.interface.outputs()
    }

    pub(super) const fn state(&self) -> SkillState {
        self.interface.state()
    }

    /// Ends the call from the block's side; the robot is stopped.
    pub(super) fn fail(&mut self, group: &mut AxesGroup, error: BlockError) {
        self.end(group, End::Error(error));
    }

    /// Waits for the block's turn. Nothing is written before: the image belongs to the skill under way.
    fn wait_for_turn(
        &mut self,
        ticket: Ticket,
        parameters: P,
        group: &mut AxesGroup,
        write: impl FnOnce(&mut Command, P) -> Result<bool, BlockError>,
    ) {
        match group.turn(ticket) {
            Ok(Turn::Wait) => self.interface.wait(),
            Ok(Turn::Cancelling) => self.wait_for_cancel(group),
            Ok(Turn::Lost) => self.give_way(End::Aborted),
            Ok(Turn::Now) => self.start(parameters, group, write),
            Err(error) => self.give_way(End::Error(error)),
        }
    }

    /// Waits until the robot has aborted the skill under way, and stops a robot that does not.
    fn wait_for_cancel(&mut self, group: &mut AxesGroup) {
        self.interface.wait();
        self.waited = group.count_wait(self.waited);
        if self.waited >= group.answer_scans() {
            group.withdraw();
            group.stop_for_error();
            self.give_way(End::Error(BlockError::StateNotReached { scans: self.waited }));
        }
    }

    fn give_way(&mut self, end: End) {
        self.waiting = None;
        self.interface.end(end);
    }

    fn start(
        &mut self,
        parameters: P,
        group: &mut AxesGroup,
        write: impl FnOnce(&mut Command, P) -> Result<bool, BlockError>,
    ) {
        self.waiting = None;
        let started = group.issue().and_then(|number| {
            self.number = number;
            write(&mut group.command, parameters).inspect_err(|_| group.release(number, false))
        });
        match started {
            Ok(counted) => {
                (self.counted, self.waited) = (counted, 0);
                self.interface.sent();
            }
            Err(error) => self.interface.end(End::Error(error)),
        }
    }

    /// Ends the call. After an error the arm must not go on moving: the robot is stopped unless it reports that the skill
    /// has ended.
    fn end(&mut self, group: &mut AxesGroup, end: End) {
        group.release(self.number, end == End::Done);
        let has_ended = group.feedback.as_ref().is_some_and(|feedback| has_ended(feedback, self.number));
        if matches!(end, End::Error(_)) && !has_ended {
            group.stop_for_error();
        }
        self.interface.end(end);
    }

    fn observe(&mut self, group: &mut AxesGroup) {
        let observed = match &group.feedback {
            None => Err(BlockError::NotConnected),
            Some(_) if !self.acknowledged && !group.is_commanded(self.number) => Ok(Some(End::Aborted)),
            Some(feedback) => self.judge(feedback, &group.command, group.answer_scans()),
        };
        match observed {
            Ok(None) => {}
            Ok(Some(end)) => self.end(group, end),
            Err(error) => self.end(group, End::Error(error)),
        }
    }

    /// Returns how the call ended according to the robot's image; `None` if it has not ended.
    fn judge(
        &mut self,
        feedback: &Feedback,
        command: &Command,
        answer_scans: u32,
    ) -> Result<Option<End>, BlockError> {
        let number = self.number;
        if feedback.number != number {
            if self.acknowledged {
                return Err(BlockError::Forgotten { expected: number, found: feedback.number });
            }
            return self.wait(answer_scans);
        }
        self.acknowledged = true;
        let has = |bit| feedback.status.contains(bit);
        let counted = self.count(feedback, command);
        if has(Status::ERROR) {
            let Feedback { error: number, error_motion: motion, finding, .. } = *feedback;
            return Err(BlockError::Robot { number, motion, finding });
        }
        counted?;
        if has(Status::ABORTED) {
            return Ok(Some(End::Aborted));
        }
        // The status bits decide; the state only helps where none of them is set.
        if has(Status::BUSY)
            || !has(Status::DONE) && matches!(feedback.state, State::Running | State::Suspended)
        {
            if feedback.state == State::Suspended {
                self.interface.interrupt();
            } else {
                self.interface.activate();
            }
            return Ok(None);
        }
        if !has(Status::DONE) {
            return if self.interface.is_taken_up() {
                Err(BlockError::EndUnknown { number })
            } else {
                self.wait(answer_scans)
            };
        }
        if self.counted && feedback.executed != command.total {
            return Err(BlockError::EndedEarly { executed: feedback.executed, total: command.total });
        }
        Ok(Some(End::Done))
    }

    fn wait(&mut self, answer_scans: u32) -> Result<Option<End>, BlockError> {
        self.waited = self.waited.saturating_add(1);
        if self.waited >= answer_scans {
            return Err(BlockError::NoAnswer { number: self.number, scans: self.waited });
        }
        Ok(None)
    }

    /// Takes over the robot's counts, if they are possible. A count may skip numbers: two short motions can end between
    /// two scans, and a frame can be lost.
    fn count(&mut self, feedback: &Feedback, command: &Command) -> Result<(), BlockError> {
        let (from, to) = (self.tally.executed, feedback.executed);
        let counted = to.max(feedback.accepted);
        if self.counted && counted > command.written {
            return Err(BlockError::CountedTooFar { counted, written: command.written });
        }
        if to < from {
            return Err(BlockError::CountedBackwards { from, to });
        }
        self.tally = Tally {
            executed: to,
            accepted: feedback.accepted.max(self.tally.accepted),
            blends_suppressed: feedback.blends_suppressed,
            execution_ns: feedback.execution_ns,
        };
        Ok(())
    }
}

/// Gives a block the outputs that every skill has besides those of [`Outputs`], from the field that is its [`SkillCall`].
macro_rules! skill_outputs {
    ($block:ident: $($call:ident).+) => {
        impl $block {
            /// Returns the error behind `ErrorID`; `None` without an error.
            #[must_use]
            pub const fn error(&self) -> Option<$crate::function_blocks::BlockError> {
                self.$($call).+.interface.error()
            }

            /// Returns the state of the skill.
            #[must_use]
            pub const fn state(&self) -> $crate::function_blocks::SkillState {
                self.$($call).+.state()
            }

            /// Returns the number of executed motions of the skill, the paper's `curExec`. It is kept until the next start.
            #[must_use]
            pub const fn executed(&self) -> u32 {
                self.$($call).+.tally.executed
            }

            pub(crate) const fn tally(&self) -> $crate::function_blocks::Tally {
                self.$($call).+.tally
            }
        }
    };
}
pub(super) use skill_outputs;

/// Returns whether a block of this mode gives up the skill under way.
const fn aborts(mode: BufferMode) -> Result<bool, BlockError> {
    match mode {
        BufferMode::Aborting => Ok(true),
        BufferMode::Buffered => Ok(false),
        mode => Err(BlockError::BlendingBetweenSkills(mode)),
    }
}

/// Returns whether the robot reports that the command with this number has ended.
fn has_ended(feedback: &Feedback, number: u16) -> bool {
    let ends = Status::DONE.0 | Status::ABORTED.0 | Status::ERROR.0;
    feedback.number == number && feedback.status.0 & ends != 0 && !is_executing(feedback)
}

#[cfg(test)]
mod tests;
