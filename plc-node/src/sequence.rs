//! The sequence as a PLC program steps through it, in each of the paper's three execution types.

use protocol::image::{Motion, MotionKind};

use crate::function_blocks::{
    BlockError, MoveCircular, MoveContinuous, MoveLinCartesian, MoveLinForceCartesian, MovePtpCartesian,
    MovePtpJoint, MoveSpline, Outputs, RunProgram, Tally,
};
use crate::{AxesGroup, ExecutionType, MotionSource};

/// One instance of each block, as the program declares them.
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

/// What a block says after its call.
#[derive(Clone, Copy, Debug)]
struct Answer {
    outputs: Outputs,
    error: Option<BlockError>,
    tally: Tally,
}

/// Where the program stands after a scan.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Progress {
    /// A skill is under way, or the next one starts with the next scan.
    Running,
    /// The last skill is done.
    Done,
    /// The robot gave the skill up.
    Aborted,
    /// The block of this motion found an error.
    Failed { motion: u32, error: BlockError },
}

/// What a sequence has come to so far.
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
/// SM steps as a chain of a PLC program of today does: a step calls its block with `Execute`; when `Done` shows, the
/// step variable is set, and the next scan is the first of the next step. So one scan passes from the `Done` of a
/// motion to the `Execute` of the next.
#[derive(Clone, Debug)]
pub(crate) struct Sequence {
    execution_type: ExecutionType,
    program: u16,
    blocks: Blocks,
    /// SM: the motion of the current step, fetched when the step begins.
    step: u32,
    motion: Option<Motion>,
    /// Skills before the current one.
    ended: Totals,
    current: Tally,
}

impl Sequence {
    /// `queue_depth` is how many motions CM writes ahead of those that are executed.
    pub(crate) fn new(execution_type: ExecutionType, program: u16, queue_depth: u32) -> Self {
        Self {
            execution_type,
            program,
            blocks: Blocks { move_continuous: MoveContinuous::with_depth(queue_depth), ..Blocks::default() },
            step: 0,
            motion: None,
            ended: Totals::default(),
            current: Tally::default(),
        }
    }

    pub(crate) const fn execution_type(&self) -> ExecutionType {
        self.execution_type
    }

    pub(crate) fn totals(&self) -> Totals {
        self.ended.plus(self.current)
    }

    /// One scan of the program; the first one sets the start edge.
    pub(crate) fn scan(&mut self, motions: &mut dyn MotionSource, group: &mut AxesGroup) -> Progress {
        let answer = match self.execution_type {
            ExecutionType::Rc => {
                let block = &mut self.blocks.run_program;
                let outputs = block.call(true, self.program, group);
                Ok(Answer { outputs, error: block.error(), tally: block.tally() })
            }
            ExecutionType::Cm => {
                let block = &mut self.blocks.move_continuous;
                let outputs = block.call(true, motions, group);
                Ok(Answer { outputs, error: block.error(), tally: block.tally() })
            }
            ExecutionType::Sm => self.single_motion(motions, group),
        };
        match answer {
            Ok(answer) => self.advance(answer, motions.total()),
            Err(error) => Progress::Failed { motion: self.step, error },
        }
    }

    fn advance(&mut self, Answer { outputs, error, tally }: Answer, total: u32) -> Progress {
        self.current = tally;
        if outputs.done {
            self.ended = self.totals();
            self.current = Tally::default();
            self.step = self.step.saturating_add(1);
            self.motion = None;
            let last = self.execution_type != ExecutionType::Sm || self.step >= total;
            return if last { Progress::Done } else { Progress::Running };
        }
        if outputs.command_aborted {
            return Progress::Aborted;
        }
        match error {
            None => Progress::Running,
            Some(error @ BlockError::Robot { motion, .. }) => {
                Progress::Failed { motion: self.step.saturating_add(motion), error }
            }
            // SM counts its steps; RC and CM are one step, in which the robot counts.
            Some(error) => Progress::Failed { motion: self.step.max(tally.executed), error },
        }
    }

    /// Calls the block of the current step. A step that begins first shows its block a falling edge, since the step
    /// before may have used the same instance.
    fn single_motion(
        &mut self,
        motions: &mut dyn MotionSource,
        group: &mut AxesGroup,
    ) -> Result<Answer, BlockError> {
        if let Some(motion) = self.motion {
            return self.call(true, &motion, group);
        }
        let (index, total) = (self.step, motions.total());
        let motion = motions.get(index).ok_or(BlockError::SourceEnded { index, total })?;
        self.motion = Some(motion);
        self.call(false, &motion, group)?;
        self.call(true, &motion, group)
    }

    fn call(&mut self, execute: bool, motion: &Motion, group: &mut AxesGroup) -> Result<Answer, BlockError> {
        macro_rules! call {
            ($block:ident) => {{
                let block = &mut self.blocks.$block;
                let outputs = block.call(execute, motion, group);
                Ok(Answer { outputs, error: block.error(), tally: block.tally() })
            }};
        }
        match motion.kind {
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
