//! The rig as a [`Stand`]: started, run and ended like every stand.

use std::path::PathBuf;

use ::node::report::NodeReport;

use super::error::at_start;
use super::{FrameLog, Reports, Rig, RigConfig, RigError};
use crate::{Finished, Stand, StandConfig};
use records::attached::Attached;
use records::conditions::{Health, Measured};
use records::exit::Failure;
use records::schedule::Step;
use records::trace::Trace;

/// Largest number of attempts for a repetition in which the host stalls a node for too long. Without a limit, a host
/// that lets no run pass would be tried for ever.
const TRIES: u32 = 10;

impl Stand for Rig {
    async fn start(config: &StandConfig<'_>) -> Result<Self, Failure> {
        if let Some(nodes) = config.attach {
            let mut rig =
                Self::attach(nodes, config.token, config.setup, config.application_text, config.voice)
                    .await
                    .map_err(|error| at_start(error, config.faults))?;
            rig.feed = config.feed.cloned();
            return Ok(rig);
        }
        let directory = config.directory.to_owned();
        let rig = RigConfig {
            seed: config.seed,
            capture: config.capture.map(|keep| (directory.clone(), keep)),
            trace: Some(directory.clone()),
            frames: config.frames.then(FrameLog::default),
            feed: config.feed.cloned(),
            voice: config.voice.cloned(),
            writes_all: config.feed.is_some(),
            faults: config.faults.to_vec(),
            code: config.code.map(|(directory, _)| directory.into()),
            ..RigConfig::new(config.setup, directory.join("setup.toml"))
        };
        Self::start(&rig).await.map_err(|error| at_start(error, config.faults))
    }

    fn refused(&self) -> Option<Vec<String>> {
        Some(self.warnings().into_iter().map(str::to_owned).collect())
    }

    fn attached(&self) -> Option<Attached> {
        self.attached_nodes()
    }

    async fn execute(&mut self, step: Step) -> anyhow::Result<Measured> {
        self.prepare(&step).await?;
        loop {
            tokio::time::sleep(step.pause).await;
            match Self::execute(self, step.execution_type, step.overrides).await {
                Err(error) => self.try_again(&step, error).await?,
                Ok(run) => return Ok(run),
            }
        }
    }

    fn health(&self) -> Health {
        Health {
            faults: self.fault_report(),
            repeated: self.repeated.clone(),
            remarks: self.remarks.clone(),
            connected_after: self.connected_after,
            ..self.reports().health()
        }
    }

    async fn finish(mut self, keeps_capture: bool) -> Finished {
        if !keeps_capture {
            self.discard_capture();
        }
        let traced = self.traced().to_vec();
        let (directory, frames) = (self.trace_directory.take(), self.frames.take());
        let stopped = self.stop().await;
        let health = stopped.map(|faults| Health { faults, ..Stand::health(&self) });
        let collect = |directory: PathBuf| {
            // A killed node may have left no trace; the run's results do not depend on it.
            let mut trace = Trace::collect(&directory, &traced)?;
            trace.add_frames(&traced, frames.as_ref().map(FrameLog::take).unwrap_or_default());
            Ok(trace)
        };
        Finished {
            trace: directory.map(collect).transpose(),
            health: health.map(Some).map_err(Failure::from),
            capture: Ok(()),
            speed: None,
        }
    }
}

impl Rig {
    /// Waits for the start of a repetition. Before the pause, so that it is not part of the measured run.
    pub(super) async fn prepare(&mut self, step: &Step) -> Result<(), RigError> {
        self.wait_until_at_start().await?;
        self.tries = 1;
        self.record(step.repetition == 1).await
    }

    /// Connects again after a repetition that was lost because the host stalled a node.
    ///
    /// # Errors
    ///
    /// Any other error, also that of the last attempt: none of these is mended by another one.
    pub(super) async fn try_again(&mut self, step: &Step, error: RigError) -> Result<(), RigError> {
        if !matches!(error, RigError::HeldUp { .. }) || self.tries >= TRIES {
            return Err(error);
        }
        self.tries += 1;
        self.repeated.push(format!("{} {}: {error}", step.execution_type, step.repetition));
        // The trace must not contain the lost run.
        self.traced.pop_if(|window| window.length_ns.is_none());
        self.reconnect_after(error).await
    }
}

impl Reports {
    /// Converts the nodes' reports to the conditions of a run, without what only the rig knows.
    fn health(&self) -> Health {
        let robot = self.robot();
        let cyclic = |report: &NodeReport| report.allocations.map(|allocations| allocations.while_cyclic);
        Health {
            plc: (&self.plc.cycle).into(),
            robot: (&robot.cycle).into(),
            bus: self.plc.bus,
            robot_bus: robot.bus,
            images: [self.plc.images, robot.images],
            connected_after: None,
            allocations: cyclic(&self.plc).zip(cyclic(&robot)).map(|(plc, robot)| [plc, robot]),
            faults: None,
            repeated: Vec::new(),
            remarks: Vec::new(),
        }
    }
}
