//! The motions that the arm may begin, by what the PLC commanded and what the robot has shown.

use std::collections::BTreeMap;

use plc_node::function_blocks::BlockError;
use protocol::image::{ErrorNumber, Feedback, Status};
use robot_export::execution::Begun;
use robot_export::registers::COUNT;

/// Why a script fails.
pub(crate) type Broken = String;

/// A command of the PLC.
#[derive(Clone, Debug)]
struct Commanded {
    motions: Vec<[u32; COUNT]>,
    begun: usize,
    complete: usize,
    /// No motion of it may begin any more, and why.
    closed: Option<&'static str>,
}

#[derive(Default)]
pub(crate) struct Rules {
    commands: BTreeMap<u16, Commanded>,
    seen: usize,
    last: u16,
}

impl Rules {
    pub(crate) fn commanded(&mut self, number: u16, motions: Vec<[u32; COUNT]>) {
        self.commands.insert(number, Commanded { motions, begun: 0, complete: 0, closed: None });
    }

    /// Returns the highest number of a command so far.
    pub(crate) fn highest(&self) -> u16 {
        self.commands.keys().next_back().copied().unwrap_or(0)
    }

    /// Closes all commands up to a number.
    pub(crate) fn close(&mut self, up_to: u16, reason: &'static str) {
        for (_, command) in self.commands.range_mut(..=up_to) {
            command.closed.get_or_insert(reason);
        }
    }

    /// Compares what the arm began since the last call.
    pub(crate) fn begun(&mut self, begun: &[Begun]) -> Result<(), Broken> {
        for motion in &begun[self.seen..] {
            let number = motion.number;
            let command = self.commands.get_mut(&number).ok_or(format!("no command {number} was given"))?;
            if let Some(reason) = command.closed {
                return Err(format!("command {number}: a motion begins after {reason}"));
            }
            if number < self.last {
                return Err(format!("command {number}: a motion begins after one of command {}", self.last));
            }
            let index = command.begun;
            match command.motions.get(index) {
                None => return Err(format!("command {number}: motion {index} of {index}")),
                Some(expected) if *expected != motion.registers => {
                    let place = command.motions.iter().position(|other| *other == motion.registers);
                    return Err(format!("command {number}: motion {index} is that of place {place:?}"));
                }
                Some(_) => command.begun += 1,
            }
            self.last = number;
        }
        self.seen = begun.len();
        let complete = |number: u16| begun.iter().rev().skip_while(move |motion| motion.number > number);
        if let Some(command) = self.commands.get_mut(&self.last) {
            let number = self.last;
            let own = complete(number).take_while(|motion| motion.number == number);
            command.complete = own.filter(|motion| motion.is_complete).count();
        }
        Ok(())
    }

    /// Checks what the robot shows.
    pub(crate) fn shown(&mut self, feedback: &Feedback) -> Result<(), Broken> {
        let number = feedback.number;
        let Some(command) = self.commands.get_mut(&number) else { return Ok(()) };
        if feedback.executed as usize > command.complete {
            let (executed, complete) = (feedback.executed, command.complete);
            return Err(format!("command {number}: {executed} are shown as executed, {complete} are"));
        }
        let status = feedback.status;
        if status.contains(Status::DONE) && command.complete != command.motions.len() {
            let (complete, total) = (command.complete, command.motions.len());
            return Err(format!("command {number}: DONE after {complete} of {total} motions"));
        }
        if [Status::DONE, Status::ABORTED, Status::ERROR].into_iter().any(|end| status.contains(end)) {
            command.closed.get_or_insert("its end was shown");
        }
        if status.contains(Status::ERROR) && feedback.error == ErrorNumber::None {
            return Err(format!("command {number}: ERROR without a number"));
        }
        Ok(())
    }

    /// Checks the error of a block.
    pub(crate) fn failed(
        block: usize,
        error: BlockError,
        with_bad: bool,
        was_lost: bool,
    ) -> Result<(), Broken> {
        let is_fine = match error {
            BlockError::Robot { number, motion, .. } => match number {
                ErrorNumber::Unreachable => with_bad && motion == super::cell::BAD_MOTION,
                ErrorNumber::NotReady
                | ErrorNumber::Disabled
                | ErrorNumber::NotServed
                | ErrorNumber::ConnectionLost => true,
                _ => false,
            },
            // The program resets a robot that it has not enabled, or two of its blocks hold RESET, which acts once when it is set.
            BlockError::StateNotReached { .. } => matches!(block, super::plc::RESET | super::plc::ENABLE),
            // The first number of a connection is an old one: a program that does not wait for ENABLED loses its command.
            BlockError::NoAnswer { .. } => was_lost,
            BlockError::NotConnected
            | BlockError::Stopping
            | BlockError::QueueFull
            | BlockError::InError { .. }
            | BlockError::NothingToDo(_) => true,
            _ => false,
        };
        if is_fine { Ok(()) } else { Err(format!("a block fails: {error}")) }
    }
}
