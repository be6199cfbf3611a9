//! Runs on the rig, one after another, and what the arm did in them.

use std::time::Duration;

use ::node::message::Instruction;
use ::node::role::NodeRole;
use plc_node::process::{PlcInstruction, PlcMessage};
use plc_node::{Execution, ExecutionType, OverrideSchedule};
use robot_node::Quality;
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::{Rig, RigError};
use crate::records::schedule::PAUSE;
use crate::records::trace::Window;

/// Longest run; a PLC gives up a silent robot long before.
const LONGEST_RUN: Duration = Duration::from_secs(3_600);

/// The robot's reports of its motions in one run.
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
    /// The run failed, the connection was lost, or a node ended; detected within two seconds. After
    /// [`RigError::HeldUp`] the nodes connect again.
    pub async fn execute(
        &mut self,
        execution_type: ExecutionType,
        overrides: Option<OverrideSchedule>,
    ) -> Result<Execution, RigError> {
        self.start_run(execution_type, overrides).await;
        let result = match timeout(LONGEST_RUN, self.finished()).await {
            Ok(result) => result,
            Err(_) => Err(RigError::NoAnswer { role: NodeRole::Plc, waited: LONGEST_RUN }),
        };
        let run = match result {
            Ok(run) => run,
            Err(error) => return Err(self.with_cause(error).await),
        };
        if self.recording
            && let Some(window) = self.traced.last_mut()
        {
            window.length_ns = Some(run.execution_time_ns);
        }
        self.ask_for_reports().await?;
        Ok(run)
    }

    /// Runs the sequence repeatedly for this time. A run that has not finished by then goes on, and the next call
    /// continues with it. A run that was lost because the host stalled a node is followed by the next one.
    ///
    /// # Errors
    ///
    /// The same as [`Rig::execute`].
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
                    let error = self.with_cause(error).await;
                    self.reconnect_after(error).await?;
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

    /// Waits for the end of the run. It is safe to drop this future and to wait again later.
    async fn finished(&mut self) -> Result<Execution, RigError> {
        loop {
            match self.next_plc_message().await? {
                PlcMessage::Finished(run) => return Ok(run),
                PlcMessage::Failed { execution_type, reason } => {
                    return Err(RigError::RunFailed { execution_type, reason });
                }
                PlcMessage::Started { execution_type, at_ns } if self.recording => {
                    self.traced.push(Window { execution_type, start_ns: at_ns, length_ns: None });
                }
                PlcMessage::ImageBad
                | PlcMessage::ImageGood
                | PlcMessage::MovingToStart
                | PlcMessage::Ready
                | PlcMessage::Started { .. }
                | PlcMessage::Refused { .. } => {}
            }
        }
    }

    /// Returns the quality of the arm's motion in the last run of `motions` motions; `None` if the robot did not
    /// report all of them.
    #[must_use]
    pub fn quality_of(&self, motions: u32) -> Option<Quality> {
        (self.moved.motions == motions).then_some(self.moved.quality)
    }
}
