//! A sequence of motions without stops: the paper's MoveContinuousSkill and its FIFO update logic.

use protocol::image::{Command, SLOTS, Skill, Slots};
use setup::Refill;

use super::skill::{SkillCall, serves_refill, skill_outputs};
use super::{BlockError, BufferMode, Outputs, Tally};
use crate::{AxesGroup, MotionSource};

/// Runs a sequence of motions of any kind as one skill.
///
/// The first five motions are written with the start. Whenever the robot counts motion k as executed (the paper's
/// `curExec`), motion k + 5 goes into the slot of motion k, until all (`totalNo`) are written (paper, section 5.2). With
/// [`Refill::Accepted`] that happens as soon as the robot has accepted motion k: only robots that keep what they accept serve it.
///
/// The source gives motions as the image carries them. [`MotionInputs`](super::MotionInputs) makes them of engineering units:
///
/// ```
/// use plc_node::MotionList;
/// use plc_node::function_blocks::{Dynamics, MotionInputs};
/// use protocol::image::MotionKind;
///
/// let line = |x| MotionInputs {
///     position: [x, 0.0, 100.0, 0.0, 0.0, 180.0], // mm and degrees
///     auxiliary: [0.0; 3],
///     configuration: None,
///     dynamics: Dynamics { velocity: 250.0, acceleration: 2500.0, ..Dynamics::default() }, // mm/s, mm/s²
///     approximation_mm: 5.0,
///     tool: 0,
///     base: 1,
/// };
/// let motions = [line(0.0), line(50.0), line(100.0)].map(|inputs| inputs.motion(MotionKind::LinCartesian));
/// let motions = motions.into_iter().collect::<Result<Vec<_>, _>>()?;
/// assert_eq!(motions[0].velocity, 2500); // in steps of 0.1 mm/s
/// let mut source = MotionList::from(motions); // for MoveContinuous::call
/// # Ok::<(), plc_node::function_blocks::BlockError>(())
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct MoveContinuous {
    /// Its parameter is the number of motions.
    pub(super) call: SkillCall<u32>,
    /// The paper's `cntFC`: motions that are written and not executed, at most.
    depth: u32,
    /// The count by which slots become free.
    refill: Refill,
}

impl Default for MoveContinuous {
    /// Creates a block that uses all slots.
    fn default() -> Self {
        Self::with_depth(SLOTS as u32)
    }
}

impl MoveContinuous {
    /// Creates a block that writes at most `depth` motions, 1 to 5, ahead of the executed ones: the paper's `cntFC`.
    /// Fewer than the image's five slots are only useful to measure what the slots are worth.
    #[must_use]
    pub fn with_depth(depth: u32) -> Self {
        let depth = depth.clamp(1, SLOTS as u32);
        Self { call: SkillCall::default(), depth, refill: Refill::Executed }
    }

    /// Returns the block with slots that become free by this count.
    #[must_use]
    pub const fn refilled_by(mut self, refill: Refill) -> Self {
        self.refill = refill;
        self
    }

    /// Returns up to which motion of its skill it writes, by the robot's counts.
    pub(crate) const fn writes_to(&self, tally: &Tally) -> u32 {
        tally.freed(self.refill).saturating_add(self.depth)
    }

    /// Runs one scan. `mode` and the number of motions are read at the rising edge of `execute`; the motions are read
    /// from the source when slots become free, the first ones when the skill starts.
    pub fn call(
        &mut self,
        execute: bool,
        motions: &mut dyn MotionSource,
        mode: BufferMode,
        group: &mut AxesGroup,
    ) -> Outputs {
        let (depth, total) = (self.depth, motions.total());
        let is_served = serves_refill(group, self.refill);
        let read = || match total {
            0 => Err(BlockError::NoMotions),
            _ if !is_served => Err(BlockError::RefillNotServed),
            _ => Ok(total),
        };
        self.call.call(execute, mode, group, read, |command, total| {
            command.skill = Skill::MoveContinuous;
            command.slots = Slots::EMPTY;
            (command.total, command.written) = (total, 0);
            fill(command, depth, motions)?;
            Ok(true)
        });
        if self.call.is_sent()
            && let Err(error) = fill(&mut group.command, self.writes_to(&self.call.tally), motions)
        {
            self.call.fail(group, error);
        }
        self.call.outputs()
    }
}

skill_outputs!(MoveContinuous: call);

/// Writes motions into every free slot, up to motion `end`.
fn fill(command: &mut Command, end: u32, motions: &mut dyn MotionSource) -> Result<(), BlockError> {
    let end = end.min(command.total).min(motions.available());
    while command.written < end {
        let index = command.written;
        let motion = motions.get(index).ok_or(BlockError::SourceEnded { index, total: command.total })?;
        command.set_slot(index, motion);
        command.written += 1;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MotionList, WaitLimits};
    use proptest::prelude::*;
    use protocol::image::{Feedback, Motion, MotionKind, Services, State, Status};

    /// What happens between two scans: what gets through, and what the robot does.
    #[derive(Clone, Copy, Debug)]
    struct Between {
        command_arrives: bool,
        takes: u32,
        executes: u32,
        feedback_arrives: bool,
    }

    fn between() -> impl Strategy<Value = Between> {
        (any::<bool>(), 0..=6_u32, 0..=6_u32, any::<bool>()).prop_map(
            |(command_arrives, takes, executes, feedback_arrives)| Between {
                command_arrives,
                takes,
                executes,
                feedback_arrives,
            },
        )
    }

    fn list(count: u16) -> Vec<Motion> {
        let motion = |velocity| Motion { kind: MotionKind::LinCartesian, velocity, ..Motion::EMPTY };
        (1..=count).map(motion).collect()
    }

    /// A robot that takes motions from the slots and executes them whenever it likes.
    #[derive(Default)]
    struct Robot {
        command: Command,
        feedback: Feedback,
        taken: Vec<Motion>,
    }

    impl Robot {
        fn go_on(&mut self, Between { takes, executes, .. }: Between) {
            if self.command.number == 0 {
                return;
            }
            let feedback = &mut self.feedback;
            (feedback.number, feedback.state, feedback.status) =
                (self.command.number, State::Running, Status::BUSY);
            for _ in 0..takes.min(self.command.written - feedback.accepted) {
                self.taken.push(*self.command.slot(feedback.accepted));
                feedback.accepted += 1;
            }
            feedback.executed += executes.min(feedback.accepted - feedback.executed);
            if feedback.executed == self.command.total {
                (feedback.state, feedback.status) = (State::Ready, Status::DONE);
            }
        }
    }

    /// Has a block stream motions to a robot in these circumstances. `freed` says how many slots the robot has freed, `depth` how far
    /// the block may write ahead of them.
    fn stream(
        count: u16,
        script: Vec<Between>,
        (mut block, depth): (MoveContinuous, u32),
        mut robot: Robot,
        freed: fn(&Feedback) -> u32,
    ) -> Result<(), TestCaseError> {
        let motions = list(count);
        let mut source = MotionList::from(motions.clone());
        let mut group = AxesGroup::new(WaitLimits { answer_scans: 10_000, silent_scans: 10_000 });
        let mut seen = robot.feedback;
        let eager = Between { command_arrives: true, takes: 5, executes: 1, feedback_arrives: true };
        for between in script.into_iter().chain(core::iter::repeat_n(eager, 60)) {
            group.read(Some(seen));
            let outputs = block.call(true, &mut source, BufferMode::default(), &mut group);
            prop_assert!(!outputs.error, "{:?}", block.error());
            let Command { written, total, .. } = *group.command();
            let freed = freed(&robot.feedback);
            prop_assert!(written <= total.min(freed + depth), "ahead of the slots");
            for index in freed..written {
                prop_assert_eq!(group.command().slot(index), &motions[index as usize]);
            }
            if between.command_arrives {
                robot.command = *group.command();
            }
            robot.go_on(between);
            if between.feedback_arrives {
                seen = robot.feedback;
            }
        }
        prop_assert!(block.call(true, &mut source, BufferMode::default(), &mut group).done);
        prop_assert_eq!(robot.taken, motions);
        Ok(())
    }

    proptest! {
        #[test]
        fn every_motion_arrives_once_and_in_order_and_no_slot_in_use_is_touched(
            count in 1..=40_u16,
            depth in 1..=5_u32,
            script in proptest::collection::vec(between(), 1..200),
        ) {
            let block = MoveContinuous::with_depth(depth);
            stream(count, script, (block, depth), Robot::default(), |feedback| feedback.executed)?;
        }

        #[test]
        fn refilled_by_accepted_every_motion_arrives_once_and_no_slot_that_is_not_accepted_is_touched(
            count in 1..=40_u16,
            script in proptest::collection::vec(between(), 1..200),
        ) {
            let block = MoveContinuous::default().refilled_by(Refill::Accepted);
            let mut robot = Robot::default();
            robot.feedback.services = Services::KEEPS_ACCEPTED;
            stream(count, script, (block, SLOTS as u32), robot, |feedback| feedback.accepted)?;
        }
    }

    #[test]
    fn refill_by_accepted_is_refused_by_a_robot_that_does_not_keep_what_it_accepts_and_nothing_is_sent() {
        let mut source = MotionList::from(list(9));
        for services in [Services::default(), Services::SYNC] {
            let mut group = AxesGroup::new(WaitLimits { answer_scans: 10, silent_scans: 10 });
            let mut block = MoveContinuous::default().refilled_by(Refill::Accepted);
            group.read(Some(Feedback { services, ..Feedback::default() }));
            assert!(block.call(true, &mut source, BufferMode::default(), &mut group).error);
            assert_eq!(block.error(), Some(BlockError::RefillNotServed));
            assert_eq!((group.command().number, group.command().written), (0, 0));
        }
    }

    #[test]
    fn a_source_is_asked_for_each_motion_once_and_in_order_so_that_it_can_stream() {
        const TOTAL: u32 = 1_000_000;
        #[derive(Debug)]
        struct MotionStream(u32);
        impl MotionSource for MotionStream {
            fn total(&self) -> u32 {
                TOTAL
            }
            fn get(&mut self, index: u32) -> Option<Motion> {
                assert_eq!(index, core::mem::replace(&mut self.0, index + 1));
                Some(Motion::EMPTY)
            }
        }
        let mut source = MotionStream(0);
        let mut group = AxesGroup::new(WaitLimits { answer_scans: 10, silent_scans: 10 });
        let mut block = MoveContinuous::default();
        group.read(Some(Feedback::default()));
        assert!(block.call(true, &mut source, BufferMode::default(), &mut group).busy);
        let mut feedback =
            Feedback { number: group.command().number, status: Status::BUSY, ..Feedback::default() };
        while feedback.executed < TOTAL {
            feedback.executed += 1;
            feedback.status = if feedback.executed == TOTAL { Status::DONE } else { Status::BUSY };
            group.read(Some(feedback));
            let outputs = block.call(true, &mut source, BufferMode::default(), &mut group);
            assert!(outputs.busy || outputs.done, "{:?}", block.error());
        }
        assert!(block.call.outputs().done);
        assert_eq!(source.0, TOTAL);
    }

    #[test]
    fn a_source_that_ends_early_is_an_error_that_says_where() {
        #[derive(Debug)]
        struct Short;
        impl MotionSource for Short {
            fn total(&self) -> u32 {
                9
            }
            fn get(&mut self, index: u32) -> Option<Motion> {
                (index < 6).then_some(Motion::EMPTY)
            }
        }
        let mut group = AxesGroup::new(WaitLimits { answer_scans: 10, silent_scans: 10 });
        let mut block = MoveContinuous::default();
        group.read(Some(Feedback::default()));
        assert!(block.call(true, &mut Short, BufferMode::default(), &mut group).busy);
        let number = group.command().number;
        let feedback = Feedback { number, status: Status::BUSY, executed: 2, ..Feedback::default() };
        group.read(Some(feedback));
        assert!(block.call(true, &mut Short, BufferMode::default(), &mut group).error);
        assert_eq!(block.error(), Some(BlockError::SourceEnded { index: 6, total: 9 }));
    }
}
