//! The blocks that are explored, the images that a robot could send them, and what entitles them to their ends.

use super::*;

/// Returns all images that a robot may send about skills of `total` motions: every status, state, number and count.
fn skill_images(total: u32) -> Vec<Feedback> {
    // The PLC's life counter is 1 in each scan that is explored: the robot has seen it and stands.
    let standing = Feedback { status: Status::AT_REST, life_echo: 1, ..Feedback::default() };
    let mut images = vec![standing];
    for number in [0, 1, 7] {
        for (status, state) in (0..16).flat_map(|bits| STATES.map(|state| (Status(bits), state))) {
            for executed in 0..=total + 1 {
                for accepted in [executed, total + 3] {
                    let error = ErrorNumber::AxisLimit;
                    let image =
                        Feedback { status, state, number, executed, accepted, error, ..Feedback::default() };
                    images.push(image);
                }
            }
        }
    }
    images
}

fn skill_done(feedback: &Feedback) -> bool {
    let ended = |bit| feedback.status.contains(bit);
    feedback.number == 1
        && ended(Status::DONE)
        && !ended(Status::BUSY)
        && !ended(Status::ERROR)
        && !ended(Status::ABORTED)
}

fn skill_aborted(feedback: &Feedback) -> bool {
    feedback.number == 1 && feedback.status.contains(Status::ABORTED)
}

fn skill_way_to_done(total: u32) -> Vec<Feedback> {
    let image = Feedback { number: 1, state: State::Running, status: Status::BUSY, ..Feedback::default() };
    let counted = |executed| Feedback { executed, accepted: executed, ..image };
    let done = Feedback { state: State::Ready, status: Status::DONE, ..counted(total) };
    vec![image, counted(total.min(5)), done]
}

/// Asserts that the state of OPC UA Part 10 agrees with PLCopen's outputs.
fn assert_state_fits(state: SkillState, outputs: Outputs) {
    let expected = match outputs {
        Outputs { command_interrupted: true, .. } => SkillState::Suspended,
        Outputs { busy: true, .. } => SkillState::Running,
        Outputs { error: true, .. } | Outputs { command_aborted: true, .. } => SkillState::Halted,
        _ => SkillState::Ready,
    };
    assert_eq!(state, expected, "{outputs:?}");
}

/// Sets the number of the command to 1 in every state. A block that never got one keeps 0.
fn normalise_number<P>(call: &mut skill::SkillCall<P>, group: &mut AxesGroup) {
    if call.number == group.command.number {
        call.number = 1;
    }
    group.command.number = 1;
}

macro_rules! explored_skill {
    ($block:ty, $exported:expr, $total:expr, |$self:ident| $call:expr, |$run:ident, $execute:ident, $group:ident| $step:expr) => {
        impl Explored for $block {
            const EXPORTED: u8 = $exported;
            fn asks(control: Control) -> Option<bool> {
                while_busy(control, Control::EXECUTE)
            }
            fn images() -> Vec<Feedback> {
                skill_images($total)
            }
            fn call(&mut self, $execute: bool, $group: &mut AxesGroup) -> Outputs {
                let $run = self;
                $step
            }
            fn error(&self) -> Option<BlockError> {
                self.error()
            }
            fn normalise(&mut self, group: &mut AxesGroup) {
                let $self = self;
                normalise_number($call, group);
            }
            fn may_be_done(feedback: &Feedback) -> bool {
                skill_done(feedback)
            }
            fn may_be_aborted(feedback: &Feedback) -> bool {
                skill_aborted(feedback)
            }
            fn way_to_done() -> Vec<Feedback> {
                skill_way_to_done($total)
            }
            fn may_leave(feedback: Option<Feedback>) -> bool {
                feedback.is_some_and(|feedback| {
                    let ends = Status::DONE.0 | Status::ABORTED.0 | Status::ERROR.0;
                    feedback.number == 1 && feedback.status.0 & ends != 0 && !is_executing(&feedback)
                })
            }
            fn check(&self, group: &AxesGroup, after: Outputs) {
                let $self = &mut self.clone();
                assert_eq!($self.executed(), $call.tally.executed);
                assert_state_fits($self.state(), after);
                let executed = $call.tally.executed;
                let (total, written) = (group.command.total, group.command.written);
                if after.busy && group.command.skill == protocol::image::Skill::MoveContinuous {
                    assert_eq!(written, total.min(executed + 5), "free slots are filled at once");
                    for index in executed..written {
                        assert_eq!(Some(*group.command.slot(index)), list().get(index), "motion {index}");
                    }
                }
            }
        }
    };
}

/// One more than the slots hold.
const SEQUENCE: u32 = 6;

pub(super) fn list() -> MotionList {
    let motion = |velocity| Motion { kind: MotionKind::LinCartesian, velocity, ..Motion::EMPTY };
    MotionList::from((1..=SEQUENCE as u16).map(motion).collect::<Vec<_>>())
}

explored_skill!(MoveLinCartesian, 10, 1, |block| &mut block.inner.call, |block, execute, group| {
    block.call(execute, &MotionInputs::from(&Motion::EMPTY), BufferMode::default(), group)
});
explored_skill!(MoveContinuous, 11, SEQUENCE, |block| &mut block.call, |block, execute, group| {
    block.call(execute, &mut list(), BufferMode::default(), group)
});
explored_skill!(RunProgram, 12, 1, |block| &mut block.call, |block, execute, group| {
    block.call(execute, 1, BufferMode::default(), group)
});

macro_rules! explored_group_command {
    ($block:ident, $exported:expr, |$control:ident| $asks:expr, done: |$done:ident| $is_done:expr,
     aborted: |$aborted:ident| $is_aborted:expr, leaves: $leaves:expr, way: [$($way:expr),*]) => {
        impl Explored for $block {
            const EXPORTED: u8 = $exported;
            fn asks($control: Control) -> Option<bool> {
                $asks
            }
            fn images() -> Vec<Feedback> {
                let bits = [Status::AT_REST, Status::ENABLED, Status::ERROR];
                let statuses = (0_u8..8).map(|set| {
                    let mut status = Status::default();
                    bits.iter().enumerate().for_each(|(bit, name)| status.set(*name, set >> bit & 1 == 1));
                    status
                });
                // The PLC's life counter is 1 in each scan that is explored, so an echo of 0 is from before.
                let images = statuses.flat_map(|status| {
                    STATES.into_iter().flat_map(move |state| {
                        [0, 1].map(|life_echo| Feedback { status, state, life_echo, ..Feedback::default() })
                    })
                });
                images.collect()
            }
            fn call(&mut self, execute: bool, group: &mut AxesGroup) -> Outputs {
                $block::call(self, execute, group)
            }
            fn error(&self) -> Option<BlockError> {
                self.error()
            }
            fn may_be_done($done: &Feedback) -> bool {
                $done.life_echo == 1 && $is_done
            }
            fn may_be_aborted($aborted: &Feedback) -> bool {
                $aborted.life_echo == 1 && $is_aborted
            }
            fn may_leave(_feedback: Option<Feedback>) -> bool {
                $leaves
            }
            fn way_to_done() -> Vec<Feedback> {
                let image = |(state, status)| Feedback { state, status, life_echo: 1, ..Feedback::default() };
                [$($way),*].map(image).into()
            }
        }
    };
}

const ON: Status = Status(Status::AT_REST.0 | Status::ENABLED.0);

/// Returns whether the bit is set; it must be set exactly while the block is busy.
const fn while_busy(control: Control, bit: Control) -> Option<bool> {
    Some(control.contains(bit))
}

explored_group_command!(GroupEnable, 1, |control| (!control.contains(Control::ENABLE)).then_some(false),
    done: |f| f.status.contains(Status::ENABLED) && f.state != State::Halted,
    aborted: |_f| false, leaves: true, way: [(State::Halted, Status::AT_REST), (State::Halted, ON), (State::Ready, ON)]);
explored_group_command!(GroupDisable, 2, |control| control.contains(Control::ENABLE).then_some(false),
    done: |f| is_at_rest(f) && !f.status.contains(Status::ENABLED),
    aborted: |_f| false, leaves: false, way: [(State::Running, Status::ENABLED), (State::Halted, Status::AT_REST)]);
explored_group_command!(GroupReset, 3, |control| while_busy(control, Control::RESET),
    done: |f| f.state == State::Ready && f.status.contains(Status::ENABLED) && !f.status.contains(Status::ERROR),
    aborted: |_f| false, leaves: true, way: [(State::Halted, ON), (State::Ready, ON)]);
explored_group_command!(GroupHalt, 4, |control| while_busy(control, Control::CANCEL),
    done: |f| is_at_rest(f) && f.state != State::Halted,
    aborted: |f| f.state == State::Halted, leaves: false, way: [(State::Running, ON), (State::Ready, ON)]);
explored_group_command!(GroupStop, 5, |control| while_busy(control, Control::HALT),
    done: |f| is_at_rest(f),
    aborted: |_f| false, leaves: false, way: [(State::Running, ON), (State::Halted, ON)]);
explored_group_command!(GroupInterrupt, 6, |control| while_busy(control, Control::SUSPEND),
    done: |f| f.state == State::Suspended,
    aborted: |f| f.state != State::Running, leaves: false, way: [(State::Running, ON), (State::Suspended, ON)]);
explored_group_command!(GroupContinue, 7, |control| while_busy(control, Control::RESUME),
    done: |f| !matches!(f.state, State::Suspended | State::Halted),
    aborted: |f| f.state == State::Halted, leaves: false, way: [(State::Suspended, ON), (State::Running, ON)]);
