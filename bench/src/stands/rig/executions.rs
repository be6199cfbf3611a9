//! One run after another on the rig, and what the arm did in them.

use std::time::Duration;

use ::node::message::Instruction;
use plc_node::process::{PlcInstruction, PlcMessage};
use plc_node::{Execution, ExecutionType, OverrideSchedule};
use robot_node::Quality;
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::{Rig, RigError, Which};
use crate::records::schedule::PAUSE;
use crate::records::trace::Window;

/// The longest run; a PLC gives up a silent robot long before.
const LONGEST_RUN: Duration = Duration::from_secs(3_600);

/// What the robot said of its motions in a run.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ExecutedMotions {
    pub(super) motions: u32,
    pub(super) quality: Quality,
}

impl Rig {
    /// Runs the sequence once, with this schedule of overrides.
    ///
    /// # Errors
    ///
    /// The run failed, the connection was lost, or a node ended: within two seconds of it. After
    /// [`RigError::HeldUp`] the nodes connect again.
    pub async fn execute(
        &mut self,
        execution_type: ExecutionType,
        overrides: Option<OverrideSchedule>,
    ) -> Result<Execution, RigError> {
        self.start_run(execution_type, overrides).await;
        let result = match timeout(LONGEST_RUN, self.finished()).await {
            Ok(result) => result,
            Err(_) => Err(RigError::NoAnswer { which: Which::Plc, waited: LONGEST_RUN }),
        };
        let run = match result {
            Ok(run) => run,
            Err(error) => return Err(self.explained(error).await),
        };
        if self.recording
            && let Some(window) = self.traced.last_mut()
        {
            window.length_ns = Some(run.execution_time_ns);
        }
        self.ask_for_reports().await?;
        Ok(run)
    }

    /// Runs the sequence over and over for so long. A run that is not over by then goes on, and the next call with it. One
    /// that was lost because the host held a node up is followed by the next.
    ///
    /// # Errors
    ///
    /// As of [`Rig::execute`].
    pub async fn keep_running(
        &mut self,
        execution_type: ExecutionType,
        length: Duration,
    ) -> Result<(), RigError> {
        let end = Instant::now() + length;
        while Instant::now() < end {
            if !self.is_running {
                self.start_run(execution_type, None).await;
            }
            match timeout_at(end, self.finished()).await {
                Ok(Ok(_)) => sleep(PAUSE).await,
                Err(_) => {}
                Ok(Err(error)) => {
                    let error = self.explained(error).await;
                    self.recovered(error).await?;
                }
            }
        }
        self.ask_for_reports().await
    }

    async fn start_run(&mut self, execution_type: ExecutionType, overrides: Option<OverrideSchedule>) {
        self.moved = ExecutedMotions::default();
        self.is_running = true;
        self.tell_plc(&Instruction::Node(PlcInstruction::Start { execution_type, overrides })).await;
    }

    /// The end of the run. Whoever stops waiting for it may ask again.
    async fn finished(&mut self) -> Result<Execution, RigError> {
        loop {
            match self.next_plc_message().await? {
                PlcMessage::Finished(run) => return Ok(run),
                PlcMessage::Failed { execution_type, reason } => {
                    return Err(RigError::RunFailed { execution_type, reason });
                }
                PlcMessage::Started { execution_type, at_ns } if self.recording => {
                    self.traced.push(Window { of: execution_type, start_ns: at_ns, length_ns: None });
                }
                PlcMessage::MovingToStart
                | PlcMessage::Ready
                | PlcMessage::Started { .. }
                | PlcMessage::Refused { .. } => {}
            }
        }
    }

    /// How well the arm moved in the last run, of so many motions; none if the robot did not speak of all of them.
    #[must_use]
    pub fn quality_of(&self, motions: u32) -> Option<Quality> {
        (self.moved.motions == motions).then_some(self.moved.quality)
    }
}
