//! The rig as something to measure on.

use std::time::Duration;

use ::node::report::{LatenessReport, NodeReport};

use super::{Reports, Rig, RigError};
use crate::records::conditions::{CycleHealth, Health, Measured};
use crate::records::schedule::Step;
use crate::stands::Stand;

/// How often a repetition is started that the host takes the connection from. One that lets no run pass is not repeated for
/// ever.
const TRIES: u32 = 10;

impl Stand for Rig {
    async fn execute(&mut self, step: Step) -> anyhow::Result<Measured> {
        self.wait_until_at_start().await?;
        // Before the pause, so that it is no work of the measured run.
        self.record(step.repetition == 1).await?;
        let mut tries = 1;
        let run = loop {
            tokio::time::sleep(step.pause).await;
            match Self::execute(self, step.execution_type).await {
                Err(error @ RigError::HeldUp { .. }) if tries < TRIES => {
                    tries += 1;
                    self.repeated.push(format!("{} {}: {error}", step.execution_type, step.repetition));
                    // No run of it is to be seen in a trace.
                    self.traced.pop_if(|window| window.length_ns.is_none());
                    self.recovered(error).await?;
                }
                run => break run?,
            }
        };
        Ok(Measured {
            execution: Duration::from_nanos(run.execution_time_ns),
            robot_execution: Duration::from_nanos(run.robot_execution_ns),
            blends_suppressed: run.blends_suppressed,
            quality: self.quality_of(run.motions),
        })
    }

    fn health(&self) -> Health {
        Health {
            faults: self.fault_report(),
            repeated: self.repeated.clone(),
            connected_after: self.connected_after,
            ..self.reports().health()
        }
    }
}

impl Reports {
    /// What the nodes reported, as the conditions of a run, without what the rig knows of it.
    fn health(&self) -> Health {
        let cyclic = |report: &NodeReport| report.allocations.map(|allocations| allocations.while_cyclic);
        Health {
            plc: (&self.plc.cycle).into(),
            robot: (&self.robot.cycle).into(),
            bus: self.plc.bus.into(),
            robot_bus: self.robot.bus.into(),
            connected_after: None,
            allocations: cyclic(&self.plc).zip(cyclic(&self.robot)).map(|(plc, robot)| [plc, robot]),
            faults: None,
            repeated: Vec::new(),
        }
    }
}

impl From<&LatenessReport> for CycleHealth {
    fn from(report: &LatenessReport) -> Self {
        let micros = |micros: f64| Duration::from_secs_f64(micros.max(0.0) / 1e6);
        Self {
            p50: micros(report.p50_us),
            p99: micros(report.p99_us),
            max: micros(report.max_us),
            missed: report.missed,
            buckets: report.buckets.clone(),
        }
    }
}
