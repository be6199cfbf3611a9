//! Runs on the rig, one after another, and what the arm did in them.

use std::time::Duration;

use ::node::message::Instruction;
use plc_node::process::{PlcInstruction, PlcMessage};
use plc_node::{ExecutionType, OverrideSchedule};
use tokio::time::{Instant, sleep, timeout_at};

use super::messages::ANSWER;
use super::reports::{FirstReports, Reports};
use super::rig_node::RigNode;
use super::robot::RigRobot;
use super::{Rig, RigError};
use crate::Unreported;
use crate::cell_measured::CellMeasured;
use records::conditions::Measured;
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
        self.run_once(execution_type, overrides).await?;
        self.measured(0)
    }

    /// Runs the sequences of all stations once.
    ///
    /// # Errors
    ///
    /// Those of [`Rig::execute`]; they name the station.
    pub async fn execute_cell(
        &mut self,
        execution_type: ExecutionType,
        overrides: Option<OverrideSchedule>,
    ) -> Result<CellMeasured, RigError> {
        self.run_once(execution_type, overrides).await?;
        let mut stations = Vec::with_capacity(self.robots.len());
        for (index, robot) in self.robots.iter().enumerate() {
            stations.push((self.measured(index)?, robot.passages.as_slice()));
        }
        let began = self.robots.iter().map(|robot| robot.skills.began_ns()).collect::<Option<Vec<_>>>();
        let skew_ns = began.and_then(|began| Some(began.iter().max()? - began.iter().min()?));
        // The nodes of one host have one clock, by which the PLC's is the true time.
        Ok(CellMeasured::of(stations, skew_ns.map(Duration::from_nanos), |at| at))
    }

    /// Runs the sequence once, and takes the reports of all nodes.
    async fn run_once(
        &mut self,
        execution_type: ExecutionType,
        overrides: Option<OverrideSchedule>,
    ) -> Result<(), RigError> {
        self.start_run(execution_type, overrides).await;
        if let Err(error) = self.finished().await {
            return Err(self.with_cause(error).await);
        }
        let length_ns = self.robots.first().and_then(|robot| Some(robot.finished?.execution_time_ns));
        if self.recording
            && let Some(window) = self.traced.last_mut()
        {
            window.length_ns = length_ns;
        }
        self.ask_for_reports().await
    }

    /// Returns what the run was at a station.
    fn measured(&self, station: usize) -> Result<Measured, RigError> {
        let unfinished = || RigError::NoAnswer { node: self.name(RigNode::Plc), waited: ANSWER };
        let robot = self.robots.get(station).ok_or_else(unfinished)?;
        let run = robot.finished.ok_or_else(unfinished)?;
        let reported = robot.skills.of_run();
        let moved = reported.of(run.motions);
        if moved.is_none() && robot.node.is_some() {
            // Without the robot's report the run could not be verified.
            let unreported = Unreported { executed: run.motions, reported: reported.motions };
            return Err(RigError::Unreported { station: robot.station.clone(), unreported });
        }
        let interference = self.reports.counts(station).since(&self.first_reports.with.counts(station));
        Ok(Measured {
            execution: run,
            quality: moved.map(|moved| moved.quality),
            account: moved.map(|moved| moved.account),
            interference,
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
                Ok(Ok(())) => sleep(PAUSE).await,
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
        self.robots.iter_mut().for_each(RigRobot::begin_run);
        (self.is_running, self.lost) = (true, None);
        self.before_run = self.reports.clone();
        // The nodes answer at once, before they do anything for this run.
        self.first_reports = FirstReports {
            with: Reports::of_robots(self.robots.len()),
            is_awaited: vec![true; self.awaited.len()],
            earlier: self.awaited.clone(),
        };
        self.request_reports().await;
        self.tell_plc(&Instruction::Node(PlcInstruction::Start { execution_type, overrides })).await;
    }

    /// Waits for the end of the run. It is safe to drop this future and to wait again later.
    async fn finished(&mut self) -> Result<(), RigError> {
        while self.is_running {
            let (station, message) = self.next_plc_message().await?;
            match message {
                PlcMessage::Failed { execution_type, reason } => {
                    return Err(RigError::RunFailed { station, execution_type, reason });
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
                | PlcMessage::Passed { .. }
                | PlcMessage::Finished(_)
                | PlcMessage::Refused { .. } => {}
            }
        }
        Ok(())
    }
}
