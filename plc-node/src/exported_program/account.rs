//! Account of what exported code did in a run, as its images show.

use protocol::image::{Command, Control, Digest, Feedback, Motion, Skill};

use crate::program::Totals;
use crate::{ExecutionType, MotionSource};

/// Motions that were sent and executed in a run.
#[derive(Debug)]
pub(super) struct RunAccount {
    /// Those of the plan.
    planned: Box<dyn MotionSource>,
    execution_type: ExecutionType,
    /// Number of the command under way; 0 before the first one.
    number: u16,
    /// Motions of this command that were seen in its slots.
    seen: u32,
    sent: Digest,
    /// Skills before the current one.
    ended: Totals,
    current: Totals,
}

impl RunAccount {
    pub(super) fn new(planned: Box<dyn MotionSource>) -> Self {
        Self {
            planned,
            execution_type: ExecutionType::Rc,
            number: 0,
            seen: 0,
            sent: Digest::default(),
            ended: Totals::default(),
            current: Totals::default(),
        }
    }

    pub(super) fn begin(&mut self, execution_type: ExecutionType) {
        self.execution_type = execution_type;
        self.restart();
    }

    /// Forgets what was sent so far: it belonged to the way to the start.
    pub(super) fn restart(&mut self) {
        (self.number, self.seen, self.sent) = (0, 0, Digest::default());
        (self.ended, self.current) = (Totals::default(), Totals::default());
    }

    pub(super) const fn execution_type(&self) -> ExecutionType {
        self.execution_type
    }

    pub(super) const fn digest(&self) -> &Digest {
        &self.sent
    }

    /// Returns the number of motions of the sequence before the current skill.
    pub(super) const fn motions_before(&self) -> u32 {
        self.ended.executed
    }

    pub(super) const fn totals(&self) -> Totals {
        let (ended, current) = (&self.ended, &self.current);
        Totals {
            executed: ended.executed.saturating_add(current.executed),
            blends_suppressed: ended.blends_suppressed.saturating_add(current.blends_suppressed),
            robot_execution_ns: ended.robot_execution_ns.saturating_add(current.robot_execution_ns),
        }
    }

    /// Takes over what the robot counts of the command under way.
    pub(super) fn see_feedback(&mut self, feedback: &Feedback) {
        if self.number != 0 && feedback.number == self.number {
            self.current = Totals {
                executed: feedback.executed,
                blends_suppressed: feedback.blends_suppressed.into(),
                robot_execution_ns: feedback.execution_ns,
            };
        }
    }

    /// Takes over the motions that a scan of a run has written into the slots.
    pub(super) fn see_command(&mut self, command: &Command) {
        if !command.control.contains(Control::EXECUTE) {
            return;
        }
        if command.number != self.number {
            self.ended = self.totals();
            (self.number, self.seen, self.current) = (command.number, 0, Totals::default());
        }
        while self.seen < command.written {
            let motion = *command.slot(self.seen);
            self.seen += 1;
            self.add(motion, command.skill != Skill::MoveContinuous);
        }
    }

    /// Adds a motion. A single one is sent without its approximation distance, with which the plan counts it.
    fn add(&mut self, motion: Motion, is_single: bool) {
        let index = u32::try_from(self.sent.sum().motions).unwrap_or(u32::MAX);
        let planned = self
            .planned
            .get(index)
            .filter(|planned| is_single && Motion { approximation: 0, ..*planned } == motion);
        self.sent.add(&planned.unwrap_or(motion));
    }
}
