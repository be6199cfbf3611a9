//! The rig as the stand of a cell with several stations.

use std::path::PathBuf;

use ::node::report::NodeReport;

use super::error::at_start;
use super::rig_node::RigNode;
use super::robot::RigRobot;
use super::{Rig, RigConfig};
use crate::cell_measured::{CellHealth, CellMeasured};
use crate::cell_stand::{CellConfig, CellFinished, CellStand};
use records::cell_results::CellAttached;
use records::conditions::Health;
use records::exit::Failure;
use records::schedule::Step;
use records::trace::Trace;

impl CellStand for Rig {
    async fn start(config: &CellConfig<'_>) -> Result<Self, Failure> {
        let started = match config.attach {
            Some(nodes) => {
                let mut rig = Self::attach_cell(config, nodes).await;
                if let Ok(rig) = &mut rig {
                    rig.feed = config.feed.cloned();
                }
                rig
            }
            None => {
                let directory = config.directory.to_owned();
                let rig = RigConfig {
                    seed: config.seed,
                    capture: config.capture.map(|keep| (directory.clone(), keep)),
                    trace: Some(directory.clone()),
                    feed: config.feed.cloned(),
                    voice: config.voice.cloned(),
                    writes_all: config.feed.is_some(),
                    faults: config.faults.to_vec(),
                    ..RigConfig::of_cell(config.cell, directory.join("setup.toml"))
                };
                Self::start(&rig).await
            }
        };
        started.map_err(|error| at_start(error, config.faults))
    }

    fn refused(&self) -> Option<Vec<String>> {
        Some(self.warnings().into_iter().map(str::to_owned).collect())
    }

    fn attached(&self) -> Option<CellAttached> {
        let plc = self.attached_at(RigNode::Plc)?;
        let robots = (0..self.robots.len()).filter_map(|station| self.attached_at(RigNode::Robot(station)));
        let identities = self.robots.iter().map(|robot| robot.identity.clone()).collect();
        Some(CellAttached { plc, robots: robots.collect(), identities })
    }

    async fn execute(&mut self, step: Step) -> anyhow::Result<CellMeasured> {
        self.prepare(&step).await?;
        loop {
            tokio::time::sleep(step.pause).await;
            match self.execute_cell(step.execution_type, step.overrides).await {
                Err(error) => self.try_again(&step, error).await?,
                Ok(run) => return Ok(run),
            }
        }
    }

    fn health(&self) -> CellHealth {
        let reports = self.reports();
        let cyclic = |report: &NodeReport| report.allocations.map(|allocations| allocations.while_cyclic);
        let station = |(robot, report): (&RigRobot, &NodeReport)| Health {
            plc: (&reports.plc.cycle).into(),
            robot: (&report.cycle).into(),
            bus: robot.frames,
            robot_bus: report.bus,
            images: [reports.plc.images, report.images],
            allocations: cyclic(&reports.plc).zip(cyclic(report)).map(|(plc, robot)| [plc, robot]),
            ..Health::default()
        };
        CellHealth {
            stations: self.robots.iter().zip(&reports.robots).map(station).collect(),
            faults: self.fault_report(),
            repeated: self.repeated.clone(),
            remarks: self.remarks.clone(),
            connected_after: self.connected_after,
        }
    }

    async fn finish(mut self, keeps_capture: bool) -> CellFinished {
        if !keeps_capture {
            self.discard_capture();
        }
        let (traced, directory) = (self.traced().to_vec(), self.trace_directory.take());
        let stopped = self.stop().await;
        let names: Vec<_> = self.robots.iter().filter_map(|robot| robot.station.as_deref()).collect();
        // A killed node may have left no trace; the run's results do not depend on it.
        let collect = |directory: PathBuf| Trace::collect_stations(&directory, &names, &traced);
        let trace = directory.map(collect).transpose();
        let health = stopped.map(|faults| Some(CellHealth { faults, ..CellStand::health(&self) }));
        CellFinished { trace, health: health.map_err(Failure::from) }
    }
}
