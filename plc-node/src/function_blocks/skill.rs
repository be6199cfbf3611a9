//! One skill call over the image: the part that all skill blocks share.
//!
//! ```text
//! PLC    number n, EXECUTE ──────────────────────────────────────┐ EXECUTE back
//! robot          echo n, BUSY ── executed 1 … total ── DONE (ABORTED, ERROR)
//! block  Busy    Busy, Active                          Done (CommandAborted, Error)
//! ```
//!
//! A block whose `Execute` rises while another block's skill is under way waits for its turn first: `Busy` alone.

use protocol::image::{Command, Feedback, State, Status};

use super::execute_interface::{End, ExecuteInterface, SkillState};
use super::{BlockError, BufferMode, Outputs, is_executing};
use crate::{AxesGroup, Ticket, Turn};

/// Results of a skill besides the outputs; kept until the next start.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub(crate) struct Tally {
    /// Motions that the robot counts as executed.
    pub(crate) executed: u32,
    /// Motions that were run to a stop because the next one was not there in time.
    pub(crate) blends_suppressed: u16,
    /// The robot's own measure of the skill in ns.
    pub(crate) execution_ns: u64,
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

    /// Waits until the robot has given up the skill under way, and stops a robot that does not.
    fn wait_for_cancel(&mut self, group: &mut AxesGroup) {
        self.interface.wait();
        self.waited = self.waited.saturating_add(1);
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
        if has(Status::ERROR) {
            let Feedback { error: number, error_motion: motion, finding, .. } = *feedback;
            return Err(BlockError::Robot { number, motion, finding });
        }
        self.count(feedback, command)?;
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
            blends_suppressed: feedback.blends_suppressed,
            execution_ns: feedback.execution_ns,
        };
        Ok(())
    }
}

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
mod tests {
    use super::*;
    use crate::WaitLimits;

    const PATIENCE: WaitLimits = WaitLimits { answer_scans: 5, silent_scans: u32::MAX };

    /// Scans a call with what the robot sends, until it ends; returns in which scan, from 1 on, and with what error.
    fn ends_in(
        call: &mut SkillCall<()>,
        group: &mut AxesGroup,
        mode: BufferMode,
        feedback: impl Fn(u16) -> Feedback,
    ) -> (u32, Option<BlockError>) {
        for scan in 1..100 {
            group.read(Some(feedback(group.command.number)));
            call.call(true, mode, group, || Ok(()), |_, ()| Ok(true));
            if !call.outputs().busy {
                return (scan, call.interface.error());
            }
        }
        panic!("it waits for ever")
    }

    #[test]
    fn a_robot_that_does_not_echo_the_number_has_as_many_scans_as_the_setup_says() {
        let (mut call, mut group) = (SkillCall::default(), AxesGroup::new(PATIENCE));
        let ended = ends_in(&mut call, &mut group, BufferMode::Aborting, |_| Feedback::default());
        // The first scan sends the command.
        assert_eq!(ended, (6, Some(BlockError::NoAnswer { number: 1, scans: 5 })));
    }

    #[test]
    fn a_robot_that_echoes_the_number_and_says_no_more_has_as_many_scans() {
        let (mut call, mut group) = (SkillCall::default(), AxesGroup::new(PATIENCE));
        let echo = |number| Feedback { number, ..Feedback::default() };
        let ended = ends_in(&mut call, &mut group, BufferMode::Aborting, echo);
        assert_eq!(ended, (6, Some(BlockError::NoAnswer { number: 1, scans: 5 })));
    }

    #[test]
    fn a_robot_that_does_not_give_up_a_skill_is_stopped_after_as_many_scans() {
        let mut group = AxesGroup::new(PATIENCE);
        let busy =
            |number| Feedback { number, status: Status::BUSY, state: State::Running, ..Feedback::default() };
        let mut first = SkillCall::<()>::default();
        for _ in 0..2 {
            group.read(Some(busy(group.command.number)));
            first.call(true, BufferMode::Aborting, &mut group, || Ok(()), |_, ()| Ok(true));
        }
        assert!(first.outputs().active);
        let mut second = SkillCall::default();
        let ended = ends_in(&mut second, &mut group, BufferMode::Aborting, busy);
        assert_eq!(ended, (5, Some(BlockError::StateNotReached { scans: 5 })));
        assert!(group.command.control.contains(protocol::image::Control::HALT));
    }

    /// Scans a call once: `execute`, and what the robot sends.
    fn scan(
        call: &mut SkillCall<()>,
        group: &mut AxesGroup,
        mode: BufferMode,
        execute: bool,
        feedback: Feedback,
    ) -> Outputs {
        group.read(Some(feedback));
        call.call(execute, mode, group, || Ok(()), |_, ()| Ok(false));
        call.outputs()
    }

    const HALT: protocol::image::Control = protocol::image::Control::HALT;

    fn answer(number: u16, status: Status, state: State) -> Feedback {
        Feedback { number, status, state, ..Feedback::default() }
    }

    #[test]
    fn a_command_is_in_the_image_from_its_turn_to_its_end() {
        let mut group = AxesGroup::new(PATIENCE);
        let (mut first, mut second) = (SkillCall::default(), SkillCall::default());
        assert!(!first.is_sent());
        let busy = |number| answer(number, Status::BUSY, State::Running);
        scan(&mut first, &mut group, BufferMode::Aborting, true, busy(0));
        assert!(first.is_sent());
        scan(&mut second, &mut group, BufferMode::Buffered, true, busy(1));
        assert!(second.outputs().busy && !second.is_sent(), "it waits for the first");
        scan(&mut first, &mut group, BufferMode::Aborting, true, answer(1, Status::DONE, State::Ready));
        assert!(first.outputs().done && !first.is_sent());
        scan(&mut second, &mut group, BufferMode::Buffered, true, answer(1, Status::DONE, State::Ready));
        assert!(second.is_sent());
    }

    #[test]
    fn a_call_that_has_ended_takes_no_notice_of_the_robot() {
        let mut group = AxesGroup::new(PATIENCE);
        let mut call = SkillCall::default();
        scan(&mut call, &mut group, BufferMode::Aborting, true, Feedback::default());
        assert!(
            scan(&mut call, &mut group, BufferMode::Aborting, true, answer(1, Status::DONE, State::Ready))
                .done
        );
        // The number of another block's skill.
        let other = answer(2, Status::ERROR, State::Halted);
        let outputs = scan(&mut call, &mut group, BufferMode::Aborting, true, other);
        assert!(outputs.done && !outputs.error, "{outputs:?}");
        let outputs = scan(&mut call, &mut group, BufferMode::Aborting, false, other);
        assert_eq!(outputs, Outputs::default());
        assert!(!group.command.control.contains(HALT));
    }

    #[test]
    fn a_call_that_was_ended_while_it_waited_is_not_started_when_its_turn_would_come() {
        let mut group = AxesGroup::new(PATIENCE);
        let (mut first, mut second) = (SkillCall::default(), SkillCall::default());
        let busy = |number| answer(number, Status::BUSY, State::Running);
        scan(&mut first, &mut group, BufferMode::Aborting, true, busy(0));
        scan(&mut second, &mut group, BufferMode::Buffered, true, busy(1));
        let done = answer(1, Status::DONE, State::Ready);
        second.fail(&mut group, BlockError::NotConnected);
        scan(&mut first, &mut group, BufferMode::Aborting, true, done);
        let number = group.command.number;
        let outputs = scan(&mut second, &mut group, BufferMode::Buffered, true, done);
        assert!(outputs.error && !outputs.busy, "{outputs:?}");
        assert_eq!(
            (second.interface.error(), group.command.number),
            (Some(BlockError::NotConnected), number)
        );
    }

    #[test]
    fn a_robot_is_stopped_after_an_error_unless_it_has_ended_the_skill_itself() {
        for (status, state, outcome, stops) in [
            (Status::DONE, State::Running, "done", false),
            (Status::ABORTED, State::Ready, "aborted", false),
            (Status::ERROR, State::Halted, "error", false),
            (Status::ERROR, State::Running, "error", true),
        ] {
            let mut group = AxesGroup::new(PATIENCE);
            let mut call = SkillCall::default();
            scan(&mut call, &mut group, BufferMode::Aborting, true, Feedback::default());
            let Outputs { done, command_aborted, error, .. } =
                scan(&mut call, &mut group, BufferMode::Aborting, true, answer(1, status, state));
            let expected = ["done", "aborted", "error"].map(|name| name == outcome);
            assert_eq!([done, command_aborted, error], expected, "{status:?}");
            assert_eq!(group.command.control.contains(HALT), stops, "{status:?} in {state:?}");
        }
    }

    #[test]
    fn a_robot_that_counts_wrongly_is_stopped_unless_it_says_that_the_skill_has_ended() {
        for (status, stops) in [(Status::default(), true), (Status::DONE, false), (Status::ABORTED, false)] {
            let mut group = AxesGroup::new(PATIENCE);
            let mut call = SkillCall::default();
            let wrong = |number| Feedback { executed: 9, ..answer(number, status, State::Ready) };
            let ended = ends_in(&mut call, &mut group, BufferMode::Aborting, wrong);
            assert_eq!(ended, (2, Some(BlockError::CountedTooFar { counted: 9, written: 0 })));
            assert_eq!(group.command.control.contains(HALT), stops, "{status:?}");
        }
    }

    #[test]
    fn a_skill_behind_another_starts_only_if_that_one_is_done() {
        for (status, starts) in [(Status::DONE, true), (Status::ABORTED, false)] {
            let mut group = AxesGroup::new(PATIENCE);
            let (mut first, mut second) = (SkillCall::default(), SkillCall::default());
            let busy = |number| answer(number, Status::BUSY, State::Running);
            scan(&mut first, &mut group, BufferMode::Aborting, true, busy(0));
            scan(&mut second, &mut group, BufferMode::Buffered, true, busy(1));
            let ended = answer(1, status, State::Ready);
            scan(&mut first, &mut group, BufferMode::Aborting, true, ended);
            let outputs = scan(&mut second, &mut group, BufferMode::Buffered, true, ended);
            assert_eq!((outputs.busy, outputs.command_aborted), (starts, !starts), "{status:?}");
        }
    }
}
