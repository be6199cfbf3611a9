//! The motions that the arm may begin, by what the PLC commanded and what the robot has shown.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use protocol::image::{ErrorNumber, Feedback, Status};
use robot_export::execution::Begun;
use robot_export::registers::COUNT;

/// A rule that every script must keep.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) enum Rule {
    /// A motion belongs to a command of the PLC.
    Commanded,
    /// Motions of a command begin in their order, each once.
    Sequence,
    /// A motion of a later command is not followed by one of an earlier command.
    CommandOrder,
    /// No motion begins after the PLC has seen that a halt is done.
    AfterHalt,
    /// No motion begins after the end of its command was shown.
    AfterEnd,
    /// The count contains no motion that has not begun.
    CountedUnbegun,
    /// The count contains no motion that is still under way.
    CountedEarly,
    /// `DONE` is shown after all motions of the command.
    DoneEarly,
    /// `ERROR` has a number.
    ErrorNumber,
    /// An echo of an image with HALT or without ENABLE does not come with `Ready`.
    EchoAhead,
    /// An error of a block has a cause in the script.
    Explained,
    /// The robot recovers, and a script ends.
    Recovers,
}

/// A rule that a script broke, and how.
#[derive(Clone, Debug)]
pub(crate) struct Broken {
    pub(crate) rule: Rule,
    pub(crate) text: String,
}

impl fmt::Display for Broken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}: {}", self.rule, self.text)
    }
}

/// Returns a broken rule.
pub(crate) fn broken<T>(rule: Rule, text: impl Into<String>) -> Result<T, Broken> {
    Err(Broken { rule, text: text.into() })
}

/// A command of the PLC.
#[derive(Clone, Debug)]
struct Commanded {
    motions: Vec<[u32; COUNT]>,
    begun: usize,
    complete: usize,
    /// No motion of it may begin any more, and why.
    closed: Option<(Rule, &'static str)>,
    /// The robot has shown how it ended.
    has_ended: bool,
}

#[derive(Default)]
pub(crate) struct Rules {
    commands: BTreeMap<u16, Commanded>,
    seen: usize,
    last: u16,
    /// Commands whose error or abort was shown, and then cleared: what a reset does.
    taken_back: BTreeSet<u16>,
}

impl Rules {
    pub(crate) fn commanded(&mut self, number: u16, motions: Vec<[u32; COUNT]>) {
        self.commands
            .insert(number, Commanded { motions, begun: 0, complete: 0, closed: None, has_ended: false });
    }

    /// Returns the highest number of a command so far.
    pub(crate) fn highest(&self) -> u16 {
        self.commands.keys().next_back().copied().unwrap_or(0)
    }

    /// Closes all commands up to a number.
    pub(crate) fn close(&mut self, up_to: u16, reason: &'static str) {
        for (_, command) in self.commands.range_mut(..=up_to) {
            command.closed.get_or_insert((Rule::AfterHalt, reason));
        }
    }

    /// Compares what the arm began since the last call.
    pub(crate) fn begun(&mut self, begun: &[Begun]) -> Result<(), Broken> {
        for motion in &begun[self.seen..] {
            let number = motion.number;
            let Some(command) = self.commands.get_mut(&number) else {
                return broken(Rule::Commanded, format!("no command {number} was given"));
            };
            if let Some((rule, reason)) = command.closed {
                return broken(rule, format!("command {number}: a motion begins after {reason}"));
            }
            if number < self.last {
                let text = format!("command {number}: a motion begins after one of command {}", self.last);
                return broken(Rule::CommandOrder, text);
            }
            let index = command.begun;
            match command.motions.get(index) {
                None => {
                    return broken(Rule::Sequence, format!("command {number}: motion {index} of {index}"));
                }
                Some(expected) if *expected != motion.registers => {
                    let place = command.motions.iter().position(|other| *other == motion.registers);
                    let text = format!("command {number}: motion {index} is that of place {place:?}");
                    return broken(Rule::Sequence, text);
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

    /// Checks an image of the robot.
    pub(crate) fn shown(&mut self, feedback: &Feedback) -> Result<(), Broken> {
        let number = feedback.number;
        let Some(command) = self.commands.get_mut(&number) else { return Ok(()) };
        let executed = feedback.executed as usize;
        let Commanded { begun, complete, .. } = *command;
        if executed > begun {
            let text = format!("command {number}: {executed} are shown as executed, {begun} have begun");
            return broken(Rule::CountedUnbegun, text);
        }
        if executed > complete {
            let text = format!("command {number}: {executed} are shown as executed, {complete} are");
            return broken(Rule::CountedEarly, text);
        }
        let status = feedback.status;
        let total = command.motions.len();
        if status.contains(Status::DONE) && complete != total {
            let text = format!("command {number}: DONE after {complete} of {total} motions");
            return broken(Rule::DoneEarly, text);
        }
        if [Status::DONE, Status::ABORTED, Status::ERROR].into_iter().any(|end| status.contains(end)) {
            command.closed.get_or_insert((Rule::AfterEnd, "its end was shown"));
            command.has_ended = true;
        } else if command.has_ended {
            self.taken_back.insert(number);
        }
        if status.contains(Status::ERROR) && feedback.error == ErrorNumber::None {
            return broken(Rule::ErrorNumber, format!("command {number}: ERROR without a number"));
        }
        Ok(())
    }

    /// Returns whether the end of a command was shown and then cleared.
    pub(crate) fn was_taken_back(&self, number: u16) -> bool {
        self.taken_back.contains(&number)
    }
}
