//! The blocks that change the robot's state instead of executing a skill.
//!
//! They have PLCopen's names; the image has those of OPC UA Part 10, whose states the robot has:
//!
//! | block | image | the robot is then |
//! |---|---|---|
//! | [`GroupEnable`] | `ENABLE` set, `RESET` where it stood still without an error | `Ready` |
//! | [`GroupDisable`] | `ENABLE` cleared | `Halted`, not enabled |
//! | [`GroupReset`] | `RESET` | `Ready` |
//! | [`GroupHalt`] | `CANCEL` | `Ready`; the skill is aborted |
//! | [`GroupStop`] | `HALT` | `Halted`: a reset is needed; the skill is aborted |
//! | [`GroupInterrupt`] | `SUSPEND` | `Suspended` |
//! | [`GroupContinue`] | `RESUME` | `Running` |
//!
//! [`GroupDisable`], [`GroupHalt`] and [`GroupStop`] also give up the skill of a block that waits for its turn, and a command
//! that the robot has not taken up yet. What a block starts while a [`GroupHalt`] is busy starts after it.
//!
//! Each sets its control bit with `Execute`'s rising edge and takes it back at its end; `ENABLE` stays. An end counts only
//! once the robot has seen the bit, by the life counter that it echoes: a state from before would be no answer. A robot
//! that does not follow in time ends the block with an error, and the bit goes back too, so that asking again is an edge.
//! Where a block acts on an arm that may move (all but [`GroupEnable`] and [`GroupReset`]), the time counts only while the arm
//! stands or the robot has not seen the bit: as long as it moves, it may be braking, by the deceleration of its motion, and the
//! bit stays. After an error of such a block the group stops the robot, as after an error of a skill: `HALT` stays until the
//! arm stands.

use protocol::image::{Control, Feedback, State, Status};

use super::execute_interface::{End, ExecuteInterface};
use super::{BlockError, Outputs};
use crate::AxesGroup;

/// What all of them have in common.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub(super) struct GroupCommand {
    pub(super) interface: ExecuteInterface,
    /// The first scan with the bit.
    pub(super) since: u64,
    /// Scans since the start, or since the arm moved last after the robot had seen the bit.
    pub(super) waited: u32,
}

/// What a block has to do with an arm that may be moving.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Arm {
    /// The block waits as long as it moves, and an error of the block stops the robot.
    Moving,
    /// Nothing: the block starts no motion, and ends none.
    Unmoved,
}

impl GroupCommand {
    /// Runs one scan. `before` must hold at the start; `reached` ends the block once the robot has seen the bit; `ask`
    /// sets the bits while the block is busy, and clears them at its end.
    fn call(
        &mut self,
        execute: bool,
        group: &mut AxesGroup,
        before: impl FnOnce(&Feedback) -> Result<(), BlockError>,
        reached: impl FnOnce(&Feedback) -> Option<End>,
        ask: impl FnOnce(&mut AxesGroup, bool),
        arm: Arm,
    ) -> Outputs {
        let started = self.interface.call(execute);
        if started {
            (self.since, self.waited) = (group.scans(), 0);
        }
        if self.interface.is_busy() {
            let seen = group.has_seen(self.since);
            let scans = self.waited;
            let late = scans >= group.answer_scans();
            let may_brake = seen && arm == Arm::Moving;
            self.waited = if may_brake { group.count_wait(scans) } else { scans.saturating_add(1) };
            let end = match &group.feedback {
                None => Some(End::Error(BlockError::NotConnected)),
                Some(feedback) if started => before(feedback).err().map(End::Error),
                Some(feedback) if seen => {
                    self.interface.activate();
                    reached(feedback)
                }
                Some(_) => None,
            };
            let end = end.or_else(|| late.then_some(End::Error(BlockError::StateNotReached { scans })));
            if let Some(end) = end {
                self.interface.end(end);
                if arm == Arm::Moving && !started && matches!(end, End::Error(_)) {
                    group.give_up();
                    group.stop_for_error();
                }
            }
            ask(group, self.interface.is_busy());
        }
        self.interface.outputs()
    }
}

macro_rules! group_blocks {
    ($($(#[$doc:meta])* $name:ident ($arm:ident): $before:expr, $reached:expr, $ask:expr;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
        pub struct $name {
            pub(super) inner: GroupCommand,
        }

        impl $name {
            /// Runs one scan.
            pub fn call(&mut self, execute: bool, group: &mut AxesGroup) -> Outputs {
                self.inner.call(execute, group, $before, $reached, $ask, Arm::$arm)
            }

            /// Returns the error behind `ErrorID`; `None` without an error.
            #[must_use]
            pub const fn error(&self) -> Option<BlockError> {
                self.inner.interface.error()
            }
        }
    )*};
}

group_blocks! {
    /// Switches the robot on and leads it to `Ready`. One that stands in an error stays in it: that is for [`GroupReset`].
    GroupEnable (Unmoved): |_| Ok(()), |feedback| {
        let is_enabled = feedback.status.contains(Status::ENABLED);
        let in_error = feedback.status.contains(Status::ERROR);
        match feedback.state {
            _ if !is_enabled => None,
            State::Halted if in_error => Some(End::Error(BlockError::InError { number: feedback.error })),
            State::Halted => None,
            _ => Some(End::Done),
        }
    }, |group, is_busy| {
        if is_busy {
            group.set_control(Control::ENABLE, true);
        }
        group.set_control(Control::RESET, is_busy && group.feedback().is_some_and(may_be_reset));
    };
    /// Switches the robot off. A skill under way stops on its path and ends with an error.
    GroupDisable (Moving): |_| Ok(()), |feedback| {
        let is_off = !feedback.status.contains(Status::ENABLED) && is_at_rest(feedback);
        is_off.then_some(End::Done)
    }, |group, is_busy| if is_busy {
        group.give_up();
        group.set_control(Control::ENABLE, false);
    };
    /// Acknowledges an error and leads the robot out of `Halted` to `Ready`.
    GroupReset (Unmoved): |_| Ok(()), |feedback| is_ready(feedback).then_some(End::Done),
        |group, is_busy| group.set_control(Control::RESET, is_busy);
    /// Stops the robot on its path; a skill under way is aborted, and the next one may start at once. A robot that is
    /// stopped otherwise meanwhile, and so needs a reset, aborts the block.
    GroupHalt (Moving): |feedback| match feedback.state {
        State::Halted => Err(BlockError::NothingToDo("running or ready")),
        _ => Ok(()),
    }, |feedback| match feedback.state {
        State::Halted => Some(End::Aborted),
        _ => is_at_rest(feedback).then_some(End::Done),
    }, |group, is_busy| group.halt(is_busy);
    /// Stops the robot on its path; a skill under way is aborted. No skill starts before a reset.
    GroupStop (Moving): |_| Ok(()), |feedback| is_at_rest(feedback).then_some(End::Done),
        |group, is_busy| {
            if is_busy {
                group.give_up();
            }
            group.set_control(Control::HALT, is_busy);
        };
    /// Stops the robot on its path; the skill waits there, and its block shows `CommandInterrupted`. A skill that ends
    /// meanwhile aborts the block.
    GroupInterrupt (Moving): |feedback| is_in(feedback, State::Running, "running"), |feedback| match feedback.state {
        State::Suspended => Some(End::Done),
        State::Running => None,
        _ => Some(End::Aborted),
    }, |group, is_busy| group.set_control(Control::SUSPEND, is_busy);
    /// Lets an interrupted skill go on.
    GroupContinue (Moving): |feedback| is_in(feedback, State::Suspended, "interrupted"), |feedback| match feedback.state {
        State::Suspended => None,
        State::Halted => Some(End::Aborted),
        _ => Some(End::Done),
    }, |group, is_busy| group.set_control(Control::RESUME, is_busy);
}

/// Returns whether the robot would accept a skill.
pub(crate) fn is_ready(feedback: &Feedback) -> bool {
    feedback.state == State::Ready
        && feedback.status.contains(Status::ENABLED)
        && !feedback.status.contains(Status::ERROR)
}

/// Returns whether a skill is under way on the robot.
pub(crate) const fn is_executing(feedback: &Feedback) -> bool {
    matches!(feedback.state, State::Running | State::Suspended)
}

/// Returns whether no skill is under way and the arm stands.
pub(crate) const fn is_at_rest(feedback: &Feedback) -> bool {
    !is_executing(feedback) && feedback.status.contains(Status::AT_REST)
}

/// Returns whether a reset acknowledges no error.
const fn may_be_reset(feedback: &Feedback) -> bool {
    matches!(feedback.state, State::Halted)
        && feedback.status.contains(Status::ENABLED)
        && !feedback.status.contains(Status::ERROR)
}

fn is_in(feedback: &Feedback, state: State, name: &'static str) -> Result<(), BlockError> {
    if feedback.state == state { Ok(()) } else { Err(BlockError::NothingToDo(name)) }
}
