//! The rig as something to measure on.

use std::time::Duration;

use protocol::fieldbus::Counters;
use protocol_linux::report::LatenessReport;

use super::Rig;
use crate::plan::Step;
use crate::stand::{CycleHealth, Health, Measured, Stand};

impl Stand for Rig {
    async fn execute(&mut self, step: Step) -> anyhow::Result<Measured> {
        tokio::time::sleep(step.pause).await;
        let run = Self::execute(self, step.execution_type).await?;
        Ok(Measured {
            execution: Duration::from_nanos(run.execution_time_ns),
            robot_execution: Duration::from_nanos(run.robot_execution_ns),
            blends_suppressed: run.blends_suppressed,
        })
    }

    fn health(&self) -> Health {
        let reports = self.reports();
        let bus = reports.plc.bus;
        Health {
            plc: (&reports.plc.cycle).into(),
            robot: (&reports.robot.cycle).into(),
            bus: Counters {
                sent: bus.sent,
                received: bus.received,
                lost: bus.lost,
                late: bus.late,
                malformed: bus.malformed,
                foreign: bus.foreign,
            },
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
        }
    }
}
