//! Whose turn it is: which block's skill comes after the one that is under way.
//!
//! One skill may wait. It starts once the block of the skill under way has seen its end; that block need not know of it.
//! If the skill under way is aborted or fails, the waiting one fails too, unless the waiting one aborted it.

use protocol::image::Control;

use super::AxesGroup;
use crate::function_blocks::BlockError;

/// A place behind the skill under way.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Ticket(u16);

/// The skill that waits.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Waiting {
    ticket: Ticket,
    /// Whether it gives up the skill under way.
    aborts: bool,
}

/// What a block that waits may do.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Turn {
    /// Another skill is under way.
    Wait,
    /// The robot was asked to give up the skill under way.
    Cancelling,
    /// It starts its skill in this scan.
    Now,
    /// It lost its place: the skill under way failed or was aborted, or a third block aborts it.
    Lost,
}

impl AxesGroup {
    /// Takes the place behind the skill under way; without one it is the block's turn at once.
    pub(crate) fn take_ticket(&mut self, aborts: bool) -> Result<Ticket, BlockError> {
        if self.waiting.is_some() && !aborts {
            return Err(BlockError::QueueFull);
        }
        self.withdraw();
        self.tickets = self.tickets.wrapping_add(1);
        let ticket = Ticket(self.tickets);
        self.waiting = Some(Waiting { ticket, aborts });
        Ok(ticket)
    }

    /// Returns what the holder of a ticket may do in this scan.
    pub(crate) fn turn(&mut self, ticket: Ticket) -> Result<Turn, BlockError> {
        let Some(waiting) = self.waiting.filter(|waiting| waiting.ticket == ticket) else {
            return Ok(Turn::Lost);
        };
        let Some(feedback) = &self.feedback else {
            self.withdraw();
            return Err(BlockError::NotConnected);
        };
        if !self.commanded {
            self.withdraw();
            return Ok(Turn::Now);
        }
        // A command that the robot has not accepted yet would be lost instead of aborted.
        if waiting.aborts && feedback.number == self.command.number {
            self.set_control(Control::CANCEL, true);
            return Ok(Turn::Cancelling);
        }
        Ok(Turn::Wait)
    }

    /// Removes the waiting skill, if there is one.
    pub(crate) const fn withdraw(&mut self) {
        if let Some(Waiting { aborts: true, .. }) = self.waiting {
            self.set_control(Control::CANCEL, self.halting);
        }
        self.waiting = None;
    }

    /// Notes that the skill under way has ended.
    pub(super) const fn end_skill(&mut self, is_done: bool) {
        if let Some(Waiting { aborts: false, .. }) = self.waiting
            && !is_done
        {
            self.waiting = None;
        }
    }
}
