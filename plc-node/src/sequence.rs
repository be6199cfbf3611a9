//! The sequence as a PLC program executes it, in each of the paper's three execution types.

use machine::Instant;
use planning::{Stop, Switch};
use protocol::image::MotionKind;

use crate::function_blocks::{
    BlockError, BufferMode, MotionInputs, MoveCircular, MoveContinuous, MoveLinCartesian,
    MoveLinForceCartesian, MovePtpCartesian, MovePtpJoint, MoveSpline, Outputs, RunProgram, Tally,
};
use crate::motion_source::Section;
use crate::{AxesGroup, ExecutionType, MotionSource};

/// The program never starts a skill while another one is under way, so that no mode matters.
const MODE: BufferMode = BufferMode::Aborting;

/// One instance of each function block, as the program declares them.
#[derive(Clone, Default, Debug)]
struct Blocks {
    run_program: RunProgram,
    move_continuous: MoveContinuous,
    lin: MoveLinCartesian,
    ptp_cartesian: MovePtpCartesian,
    ptp_joint: MovePtpJoint,
    circular: MoveCircular,
    spline: MoveSpline,
    lin_force: MoveLinForceCartesian,
}

/// Outputs of a block after its call.
#[derive(Clone, Copy, Debug)]
struct Answer {
    outputs: Outputs,
    error: Option<BlockError>,
    tally: Tally,
}

/// State of the program after a scan.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Progress {
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

/// Totals of a sequence so far.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(crate) struct Totals {
    pub(crate) executed: u32,
    pub(crate) blends_suppressed: u32,
    pub(crate) robot_execution_ns: u64,
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
    blocks: Blocks,
    /// Motions before the current skill.
    step: u32,
    /// SM: the motion of the current step, its kind and the inputs of its block, read when the step begins.
    motion: Option<(MotionKind, MotionInputs)>,
    /// CM: whether the block was called for this continuous motion.
    is_called: bool,
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
            blocks: Blocks { move_continuous: MoveContinuous::with_depth(queue_depth), ..Blocks::default() },
            step: 0,
            motion: None,
            is_called: false,
            stage: Stage::Skill,
            ended: Totals::default(),
            current: Tally::default(),
        }
    }

    pub(crate) const fn execution_type(&self) -> ExecutionType {
        self.execution_type
    }

    /// Returns whether the program itself waits, at a stop of the plan.
    pub(crate) const fn waits(&self) -> bool {
        matches!(self.stage, Stage::Wait { .. })
    }

    pub(crate) fn totals(&self) -> Totals {
        self.ended.plus(self.current)
    }

    /// Executes one scan of the program, which began at `now`; the first one sets the start edge. `stops` contains where the
    /// continuous motions end.
    pub(crate) fn scan(
        &mut self,
        now: Instant,
        motions: &mut dyn MotionSource,
        stops: &[Stop],
        group: &mut AxesGroup,
    ) -> Progress {
        let total = motions.total();
        match self.stage {
            Stage::Skill => {}
            Stage::Switch(switch) => {
                group.set_outputs(switch.applied_to(group.outputs()));
                self.stage = Stage::Wait { until: now + switch.wait };
                return Progress::Running;
            }
            Stage::Wait { until } if now < until => return Progress::Running,
            Stage::Wait { .. } => {
                self.stage = Stage::Skill;
                return self.next_step(total);
            }
        }
        let answer = match self.execution_type {
            ExecutionType::Rc => {
                let block = &mut self.blocks.run_program;
                let outputs = block.call(true, self.program, MODE, group);
                Ok(Answer { outputs, error: block.error(), tally: block.tally() })
            }
            ExecutionType::Cm => {
                let next = stops.partition_point(|stop| stop.after <= self.step);
                let end = stops.get(next).map_or(total, |stop| stop.after.min(total));
                Ok(self.continuous_motion(&mut Section { source: motions, from: self.step, end }, group))
            }
            ExecutionType::Sm => self.single_motion(motions, group),
        };
        match answer {
            Ok(answer) => self.advance(answer, total, stops),
            Err(error) => Progress::Failed { motion: self.step, error },
        }
    }

    fn advance(&mut self, Answer { outputs, error, tally }: Answer, total: u32, stops: &[Stop]) -> Progress {
        self.current = tally;
        if outputs.done {
            self.ended = self.totals();
            self.current = Tally::default();
            self.step = match self.execution_type {
                ExecutionType::Rc => return Progress::Done,
                ExecutionType::Sm => self.step.saturating_add(1),
                ExecutionType::Cm => self.step.saturating_add(tally.executed),
            };
            (self.motion, self.is_called) = (None, false);
            let here = stops.partition_point(|stop| stop.after < self.step);
            let stop = stops.get(here).filter(|stop| stop.after == self.step);
            if let Some(switch) = stop.and_then(|stop| stop.then) {
                self.stage = Stage::Switch(switch);
                return Progress::Running;
            }
            return self.next_step(total);
        }
        if outputs.command_aborted {
            return Progress::Aborted;
        }
        match error {
            None => Progress::Running,
            Some(error @ BlockError::Robot { motion, .. }) => {
                Progress::Failed { motion: self.step.saturating_add(motion), error }
            }
            // A source counts all motions, a block only those of its skill.
            Some(BlockError::SourceEnded { index, .. }) => {
                let index = self.step.saturating_add(index);
                Progress::Failed { motion: index, error: BlockError::SourceEnded { index, total } }
            }
            Some(error) => Progress::Failed { motion: self.step.saturating_add(tally.executed), error },
        }
    }

    /// Sets the step variable: the next scan is the first of the next step, if there is one.
    const fn next_step(&self, total: u32) -> Progress {
        if self.step >= total { Progress::Done } else { Progress::Running }
    }

    /// Calls the block of the current continuous motion; if it ran the previous one, with a falling edge first.
    fn continuous_motion(&mut self, motions: &mut Section<'_>, group: &mut AxesGroup) -> Answer {
        let block = &mut self.blocks.move_continuous;
        if self.step > 0 && !self.is_called {
            block.call(false, motions, MODE, group);
        }
        self.is_called = true;
        let outputs = block.call(true, motions, MODE, group);
        Answer { outputs, error: block.error(), tally: block.tally() }
    }

    /// Calls the block of the current step. A step first calls its block with a falling edge, since the previous step
    /// may have used the same instance.
    fn single_motion(
        &mut self,
        motions: &mut dyn MotionSource,
        group: &mut AxesGroup,
    ) -> Result<Answer, BlockError> {
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
    ) -> Result<Answer, BlockError> {
        macro_rules! call {
            ($block:ident) => {{
                let block = &mut self.blocks.$block;
                let outputs = block.call(execute, inputs, MODE, group);
                Ok(Answer { outputs, error: block.error(), tally: block.tally() })
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
            let progress = sequence.scan(Instant::ZERO, &mut motions, &stops, &mut group);
            if seen.last() != Some(&group.outputs()) {
                seen.push(group.outputs());
            }
            if progress == Progress::Done {
                break;
            }
        }
        assert_eq!(seen, [0, 0b0001, 0b1001, 0b1000]);
    }
}
