//! Runs on the rig, one after another, and what the arm did in them.

use std::time::Duration;

use ::node::message::Instruction;
use plc_node::process::{PlcInstruction, PlcMessage};
use plc_node::{Execution, ExecutionType, OverrideSchedule};
use tokio::time::{Instant, sleep, timeout_at};

use super::reports::FirstReports;
use super::{Rig, RigError};
use crate::Unreported;
use records::conditions::{Measured, ToldSkills};
use records::schedule::PAUSE;
use records::trace::Window;

impl Rig {
    /// Runs the sequence once, with this schedule of overrides.
    ///
    /// # Errors
    ///
    /// The run failed, the connection was lost, or a node ended; detected within two seconds, or a node
    /// sent nothing for ten seconds. After
    /// [`RigError::HeldUp`] the nodes connect again.
    pub async fn execute(
        &mut self,
        execution_type: ExecutionType,
        overrides: Option<OverrideSchedule>,
    ) -> Result<Measured, RigError> {
        self.start_run(execution_type, overrides).await;
        let run = match self.finished().await {
            Ok(run) => run,
            Err(error) => return Err(self.with_cause(error).await),
        };
        if self.recording
            && let Some(window) = self.traced.last_mut()
        {
            window.length_ns = Some(run.execution_time_ns);
        }
        self.ask_for_reports().await?;
        let told = self.told.of_run();
        let moved = told.of(run.motions);
        if moved.is_none() && self.robot.is_some() {
            // Without the robot's report the run could not be verified.
            let unreported = Unreported { executed: run.motions, reported: told.motions };
            return Err(RigError::Unreported(unreported));
        }
        Ok(Measured {
            execution: run,
            quality: moved.map(|moved| moved.quality),
            account: moved.map(|moved| moved.account),
            interference: self.reports.counts().since(&self.first_reports.with.counts()),
        })
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
        self.told = ToldSkills::default();
        self.is_running = true;
        self.before_run = self.reports.clone();
        // The nodes answer at once, before they do anything for this run.
        self.first_reports =
            FirstReports { is_awaited: [true; 2], earlier: self.awaited, ..FirstReports::default() };
        self.request_reports().await;
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
                PlcMessage::Started { execution_type, at_ns, .. } if self.recording => {
                    self.traced.push(Window { execution_type, start_ns: at_ns, length_ns: None });
                }
                PlcMessage::ImageBad
                | PlcMessage::ImageGood
                | PlcMessage::LifeStill
                | PlcMessage::MovingToStart
                | PlcMessage::Ready
                | PlcMessage::Started { .. }
                | PlcMessage::Refused { .. } => {}
            }
        }
    }
}
