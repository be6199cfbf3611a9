//! The sequence as a PLC program executes it, in each of the paper's three execution types.

use machine::Instant;
use planning::{Stop, Switch};
use protocol::image::{MotionKind, PointHead};
use setup::Refill;

use crate::function_blocks::{
    BlockError, BufferMode, MotionInputs, MoveCircular, MoveContinuous, MoveLinCartesian,
    MoveLinForceCartesian, MovePtpCartesian, MovePtpJoint, MoveSpline, MoveTrajectory, Outputs, RunProgram,
    Tally,
};
use crate::motion_source::Section;
use crate::program::Totals;
use crate::{AxesGroup, ExecutionType, MotionSource};

/// The program never starts a skill while another one is under way, so that no mode matters.
const MODE: BufferMode = BufferMode::Aborting;

/// One instance of each function block, as the program declares them.
#[derive(Clone, Default, Debug)]
struct Blocks {
    run_program: RunProgram,
    move_continuous: MoveContinuous,
    move_trajectory: MoveTrajectory,
    lin: MoveLinCartesian,
    ptp_cartesian: MovePtpCartesian,
    ptp_joint: MovePtpJoint,
    circular: MoveCircular,
    spline: MoveSpline,
    lin_force: MoveLinForceCartesian,
}

/// Outputs of a block after its call.
#[derive(Clone, Copy, Debug)]
struct BlockAnswer {
    outputs: Outputs,
    error: Option<BlockError>,
    tally: Tally,
}

/// How far the arm may go at present.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Reach {
    /// Motions that it may execute.
    pub(crate) motions: u32,
    /// Whether the action at a stop behind the last of them happens too.
    pub(crate) with_action: bool,
}

impl Reach {
    /// To the end.
    pub(crate) const END: Self = Self { motions: u32::MAX, with_action: true };
}

/// State of a sequence after a scan.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum SkillProgress {
    /// A skill is being executed, or the next one starts in the next scan.
    Running,
    /// The last skill is done.
    Done,
    /// The robot aborted the skill.
    Aborted,
    /// The block of this motion reported an error.
    Failed { motion: u32, error: BlockError },
}

/// What a scan does.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Stage {
    /// Calls the block of the current skill.
    Skill,
    /// Switches an output.
    Switch(Switch),
    /// Waits for the switch to take effect.
    Wait { until: Instant },
}

impl Totals {
    fn plus(self, tally: Tally) -> Self {
        Self {
            executed: self.executed.saturating_add(tally.executed),
            blends_suppressed: self.blends_suppressed.saturating_add(u32::from(tally.blends_suppressed)),
            robot_execution_ns: self.robot_execution_ns.saturating_add(tally.execution_ns),
        }
    }
}

/// The program that runs a sequence once.
///
/// SM works like a step sequence in a PLC program: a step calls its block with `Execute`; when `Done` is set, the
/// program sets the step variable, and the next scan is the first of the next step. So there is one scan between the
/// `Done` of a motion and the `Execute` of the next. CM does the same from one continuous motion to the next.
///
/// Switching an output at a stop is a step of its own: its first scan sets the output and starts a timer, and its
/// last scan is the one in which the timer has elapsed. RC leaves all this to the robot's program.
#[derive(Clone, Debug)]
pub(crate) struct Sequence {
    execution_type: ExecutionType,
    program: u16,
    /// Whether RC has a program for each section between two marks, numbered from `program` on.
    is_in_sections: bool,
    blocks: Blocks,
    /// Motions before the current skill.
    step: u32,
    /// SM: the motion of the current step, its kind and the inputs of its block, read when the step begins.
    motion: Option<(MotionKind, MotionInputs)>,
    /// CM, and RC in sections: whether the block was called for this continuous motion or section.
    is_called: bool,
    /// RC in sections: motions before the end of the section that the robot's program runs.
    section_end: u32,
    /// CM: points that an image holds, where they go as compact points.
    points: Option<u32>,
    stage: Stage,
    /// Skills before the current one.
    ended: Totals,
    current: Tally,
}

impl Sequence {
    /// Creates the program; `queue_depth` is how many motions CM writes ahead of the executed ones.
    pub(crate) fn new(execution_type: ExecutionType, program: u16, queue_depth: u32) -> Self {
        Self {
            execution_type,
            program,
            is_in_sections: false,
            blocks: Blocks { move_continuous: MoveContinuous::with_depth(queue_depth), ..Blocks::default() },
            step: 0,
            motion: None,
            is_called: false,
            section_end: 0,
            points: None,
            stage: Stage::Skill,
            ended: Totals::default(),
            current: Tally::default(),
        }
    }

    /// Returns whether the robot's stored program runs.
    pub(crate) fn is_rc(&self) -> bool {
        self.execution_type == ExecutionType::Rc
    }

    /// Has CM refill slots by this count of the robot.
    pub(crate) const fn refilled_by(mut self, refill: Refill) -> Self {
        self.blocks.move_continuous = self.blocks.move_continuous.refilled_by(refill);
        self.blocks.move_trajectory = self.blocks.move_trajectory.refilled_by(refill);
        self
    }

    /// Tells CM what its points have in common, if they go as compact points.
    pub(crate) fn with_points(mut self, head: Option<PointHead>) -> Self {
        self.points = head.map(|head| head.capacity());
        self
    }

    /// Has RC run a program for each section between two marks. Actions at the ends of sections are the PLC's.
    pub(crate) const fn in_sections(mut self) -> Self {
        self.is_in_sections = true;
        self
    }

    /// Returns whether a block was called in this run.
    pub(crate) const fn was_called(&self) -> bool {
        self.is_called || self.step > 0
    }

    /// Returns whether the program itself waits, at a stop of the plan.
    pub(crate) const fn waits(&self) -> bool {
        matches!(self.stage, Stage::Wait { .. })
    }

    /// Returns the number of motions before the current skill.
    pub(crate) const fn step(&self) -> u32 {
        self.step
    }

    pub(crate) fn totals(&self) -> Totals {
        self.ended.plus(self.current)
    }

    /// Returns how many motions the robot has executed in this run, by the PLC's count.
    pub(crate) fn executed(&self) -> u32 {
        let executed = self.step.saturating_add(self.current.executed);
        // Whatever a robot counts, a section ends where it ends.
        let is_in_section = self.is_in_sections && self.is_called && self.is_rc();
        if is_in_section { executed.min(self.section_end) } else { executed }
    }

    /// Returns whether a motion could go to the robot now, if nothing kept it back: with CM it is written ahead.
    pub(crate) fn could_write(&self, motion: u32, stops: &[Stop]) -> bool {
        let executed = self.executed();
        if motion <= executed {
            return true;
        }
        let next = stops.partition_point(|stop| stop.after <= self.step);
        let end = stops.get(next).map_or(u32::MAX, |stop| stop.after);
        let is_continuous = self.execution_type == ExecutionType::Cm && self.stage == Stage::Skill;
        let written = match self.points {
            Some(capacity) => self.blocks.move_trajectory.writes_to(&self.current, capacity),
            None => self.blocks.move_continuous.writes_to(&self.current),
        };
        is_continuous && motion < end && motion < self.step.saturating_add(written)
    }

    /// Returns whether the arm stands as far as it may go, and waits there.
    pub(crate) fn has_come_to(&self, reach: Reach) -> bool {
        let executed = match self.stage {
            // The skill before the action may count its last motion before it is done.
            Stage::Skill if reach.with_action => self.step,
            Stage::Skill => self.step.saturating_add(self.current.executed),
            // The action comes after the wait, or before it.
            Stage::Switch(_) | Stage::Wait { .. } if reach.with_action => return false,
            Stage::Switch(_) | Stage::Wait { .. } => self.step,
        };
        executed >= reach.motions
    }

    /// Executes one scan of the program, which began at `now`; the first one sets the start edge. `stops` contains where the
    /// continuous motions end, `reach` how far the arm may go.
    pub(crate) fn scan(
        &mut self,
        now: Instant,
        motions: &mut dyn MotionSource,
        stops: &[Stop],
        reach: Reach,
        group: &mut AxesGroup,
    ) -> SkillProgress {
        let total = motions.total();
        let may_act = self.step < reach.motions || reach.with_action;
        match self.stage {
            // A skill that begins at a mark waits for it.
            Stage::Skill if self.is_between_skills() && self.step >= reach.motions => {
                return SkillProgress::Running;
            }
            Stage::Skill => {}
            Stage::Switch(_) if !may_act => return SkillProgress::Running,
            Stage::Switch(switch) => {
                group.set_outputs(switch.applied_to(group.outputs()));
                self.stage = Stage::Wait { until: now + switch.wait };
                return SkillProgress::Running;
            }
            Stage::Wait { until } if now < until => return SkillProgress::Running,
            Stage::Wait { .. } => {
                self.stage = Stage::Skill;
                return self.next_step(total);
            }
        }
        let answer = match self.execution_type {
            ExecutionType::Rc => Ok(self.stored_program(reach.motions.min(total), group)),
            ExecutionType::Cm => {
                let next = stops.partition_point(|stop| stop.after <= self.step);
                let end = stops.get(next).map_or(total, |stop| stop.after.min(total));
                let available = reach.motions;
                Ok(self.continuous_motion(
                    &mut Section { source: motions, from: self.step, end, available },
                    group,
                ))
            }
            ExecutionType::Sm => self.single_motion(motions, group),
        };
        match answer {
            Ok(answer) => self.advance(answer, total, stops),
            Err(error) => SkillProgress::Failed { motion: self.step, error },
        }
    }

    fn advance(
        &mut self,
        BlockAnswer { outputs, error, tally }: BlockAnswer,
        total: u32,
        stops: &[Stop],
    ) -> SkillProgress {
        self.current = tally;
        if outputs.done {
            self.ended = self.totals();
            self.current = Tally::default();
            self.step = match self.execution_type {
                ExecutionType::Rc if !self.is_in_sections => return SkillProgress::Done,
                ExecutionType::Rc => {
                    // Whatever the robot counts, the mark comes next.
                    self.program = self.program.saturating_add(1);
                    self.section_end
                }
                ExecutionType::Sm => self.step.saturating_add(1),
                ExecutionType::Cm => self.step.saturating_add(tally.executed),
            };
            (self.motion, self.is_called) = (None, false);
            let here = stops.partition_point(|stop| stop.after < self.step);
            let stop = stops.get(here).filter(|stop| stop.after == self.step);
            if let Some(switch) = stop.and_then(|stop| stop.then) {
                self.stage = Stage::Switch(switch);
                return SkillProgress::Running;
            }
            return self.next_step(total);
        }
        if outputs.command_aborted {
            return SkillProgress::Aborted;
        }
        match error {
            None => SkillProgress::Running,
            Some(error @ BlockError::Robot { motion, .. }) => {
                SkillProgress::Failed { motion: self.step.saturating_add(motion), error }
            }
            // A source counts all motions, a block only those of its skill.
            Some(BlockError::SourceEnded { index, .. }) => {
                let index = self.step.saturating_add(index);
                SkillProgress::Failed { motion: index, error: BlockError::SourceEnded { index, total } }
            }
            Some(error) => SkillProgress::Failed { motion: self.step.saturating_add(tally.executed), error },
        }
    }

    /// Returns whether no block was called for the current step yet.
    pub(crate) const fn is_between_skills(&self) -> bool {
        match self.execution_type {
            ExecutionType::Rc => self.is_in_sections && !self.is_called,
            ExecutionType::Sm => self.motion.is_none(),
            ExecutionType::Cm => !self.is_called,
        }
    }

    /// Sets the step variable: the next scan is the first of the next step, if there is one.
    const fn next_step(&self, total: u32) -> SkillProgress {
        if self.step >= total { SkillProgress::Done } else { SkillProgress::Running }
    }

    /// Calls the block of the stored program; if it ran the previous section, with a falling edge first.
    fn stored_program(&mut self, section_end: u32, group: &mut AxesGroup) -> BlockAnswer {
        let block = &mut self.blocks.run_program;
        if self.step > 0 && !self.is_called {
            block.call(false, self.program, MODE, group);
        }
        if !self.is_called {
            (self.is_called, self.section_end) = (true, section_end);
        }
        let outputs = block.call(true, self.program, MODE, group);
        BlockAnswer { outputs, error: block.error(), tally: block.tally() }
    }

    /// Calls the block of the current continuous motion; if it ran the previous one, with a falling edge first.
    fn continuous_motion(&mut self, motions: &mut Section<'_>, group: &mut AxesGroup) -> BlockAnswer {
        if motions.point_head().is_some() {
            // It is the only one of its run.
            self.is_called = true;
            let block = &mut self.blocks.move_trajectory;
            let outputs = block.call(true, motions, MODE, group);
            return BlockAnswer { outputs, error: block.error(), tally: block.tally() };
        }
        let block = &mut self.blocks.move_continuous;
        if self.step > 0 && !self.is_called {
            block.call(false, motions, MODE, group);
        }
        self.is_called = true;
        let outputs = block.call(true, motions, MODE, group);
        BlockAnswer { outputs, error: block.error(), tally: block.tally() }
    }

    /// Calls the block of the current step. A step first calls its block with a falling edge, since the previous step
    /// may have used the same instance.
    fn single_motion(
        &mut self,
        motions: &mut dyn MotionSource,
        group: &mut AxesGroup,
    ) -> Result<BlockAnswer, BlockError> {
        if let Some((kind, inputs)) = self.motion {
            return self.call(true, kind, &inputs, group);
        }
        let (index, total) = (self.step, motions.total());
        let motion = motions.get(index).ok_or(BlockError::SourceEnded { index, total })?;
        let (kind, inputs) = (motion.kind, MotionInputs::from(&motion));
        self.motion = Some((kind, inputs));
        self.call(false, kind, &inputs, group)?;
        self.call(true, kind, &inputs, group)
    }

    fn call(
        &mut self,
        execute: bool,
        kind: MotionKind,
        inputs: &MotionInputs,
        group: &mut AxesGroup,
    ) -> Result<BlockAnswer, BlockError> {
        macro_rules! call {
            ($block:ident) => {{
                let block = &mut self.blocks.$block;
                let outputs = block.call(execute, inputs, MODE, group);
                Ok(BlockAnswer { outputs, error: block.error(), tally: block.tally() })
            }};
        }
        match kind {
            MotionKind::LinCartesian => call!(lin),
            MotionKind::PtpCartesian => call!(ptp_cartesian),
            MotionKind::PtpJoint => call!(ptp_joint),
            MotionKind::Circular => call!(circular),
            MotionKind::Spline => call!(spline),
            MotionKind::LinForceCartesian => call!(lin_force),
            kind @ (MotionKind::None | MotionKind::Unknown(_)) => Err(BlockError::NoSkillForKind(kind)),
        }
    }
}

#[cfg(test)]
mod tests {
    use machine::Duration;
    use protocol::image::{Feedback, Motion, State, Status};

    use super::*;
    use crate::{MotionList, WaitLimits};

    #[test]
    fn an_output_that_is_switched_leaves_the_others_as_they_are() {
        let switch = |output, set| Some(Switch { output, set, wait: Duration::ZERO });
        let stops = [switch(0, true), switch(3, true), switch(0, false)];
        let stops: Vec<Stop> = (1..).zip(stops).map(|(after, then)| Stop { after, then }).collect();
        let mut motions =
            MotionList::from(vec![Motion { kind: MotionKind::PtpJoint, ..Motion::EMPTY }; stops.len()]);
        let mut group = AxesGroup::new(WaitLimits { answer_scans: 9, silent_scans: u32::MAX });
        let mut sequence = Sequence::new(ExecutionType::Sm, 0, 5);
        let mut seen = vec![group.outputs()];
        for _ in 0..20 {
            // A robot that executes each motion at once.
            let number = group.command().number;
            group.read(Some(Feedback {
                number,
                status: Status::DONE,
                state: State::Ready,
                accepted: 1,
                executed: 1,
                ..Feedback::default()
            }));
            let progress = sequence.scan(Instant::ZERO, &mut motions, &stops, Reach::END, &mut group);
            if seen.last() != Some(&group.outputs()) {
                seen.push(group.outputs());
            }
            if progress == SkillProgress::Done {
                break;
            }
        }
        assert_eq!(seen, [0, 0b0001, 0b1001, 0b1000]);
    }
}
