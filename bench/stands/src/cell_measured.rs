//! What a run of a cell with several stations was, and its conditions.

use std::time::Duration;

use machine::Instant;
use plc_node::MarkPassage;
use protocol::fieldbus::Counters;
use records::cell_results::{CellResults, CellSample, StationSample};
use records::conditions::Measured;
use records::faults::FaultReport;
use records::lateness::CycleLateness;
use records::results::Frames;

/// A finished run of a cell.
#[derive(Clone, Debug)]
pub struct CellMeasured {
    /// The stations, in the order of the setup.
    pub stations: Vec<StationMeasured>,
    /// True time between the first and the last arm's first motion; `None` if an arm did not move.
    pub start_skew: Option<Duration>,
}

/// What a run of a cell was at one station.
#[derive(Clone, Debug)]
pub struct StationMeasured {
    /// The PLC's report, and the robot's.
    pub measured: Measured,
    /// The marks that the arm came to, in order, by the PLC's clock.
    pub passages: Vec<MarkPassage>,
}

impl StationMeasured {
    /// Returns how long the arm stood at marks.
    #[must_use]
    pub fn waited(&self) -> Duration {
        self.passages.iter().filter_map(|it| Some(it.passed?.since(it.came))).sum()
    }
}

impl CellMeasured {
    /// Returns what is saved of the run.
    #[must_use]
    pub fn sample(&self) -> CellSample {
        let station = |of_station: &StationMeasured| StationSample {
            robot_execution: Duration::from_nanos(of_station.measured.execution.robot_execution_ns),
            blends_suppressed: of_station.measured.execution.blends_suppressed,
            waited: of_station.waited(),
            came: of_station.passages.iter().map(|it| (it.mark, it.came.since(Instant::ZERO))).collect(),
        };
        let execution_ns =
            self.stations.first().map_or(0, |first| first.measured.execution.execution_time_ns);
        CellSample {
            execution: Duration::from_nanos(execution_ns),
            start_skew: self.start_skew,
            stations: self.stations.iter().map(station).collect(),
        }
    }
}

impl CellHealth {
    /// Writes the conditions of the run so far into its results.
    pub fn write_to(&self, results: &mut CellResults) {
        results.plc_cycle = self.plc.clone();
        results.cyclic_allocations = self.allocations;
        results.faults.clone_from(&self.faults);
        results.repeated.clone_from(&self.repeated);
        results.remarks.clone_from(&self.remarks);
        results.connected_after_ms = self.connected_after.map(|time| time.as_secs_f64() * 1e3);
        for (station, health) in results.stations.iter_mut().zip(&self.stations) {
            let StationHealth { robot, plc_bus, robot_bus } = health;
            station.cycle = robot.clone();
            station.frames = Frames {
                frames_sent: plc_bus.sent,
                frames_received: plc_bus.received,
                skipped: plc_bus.skipped + robot_bus.skipped,
                lost: plc_bus.lost + robot_bus.lost,
                foreign: plc_bus.foreign + robot_bus.foreign,
            };
        }
    }
}

/// Lateness of the cycles of a cell, its frames, and what else the nodes and the bench saw.
#[derive(Clone, Debug, Default)]
pub struct CellHealth {
    /// Lateness of the PLC's scans.
    pub plc: CycleLateness,
    /// The stations.
    pub stations: Vec<StationHealth>,
    /// Allocations of all cyclic threads since the connections were up; `None` if they are not counted.
    pub allocations: Option<u64>,
    /// Result of the injected faults, if any.
    pub faults: Option<FaultReport>,
    /// Repetitions that were run again because the host stalled a node until a connection was lost: which, and why.
    pub repeated: Vec<String>,
    /// What was remarkable about the connections.
    pub remarks: Vec<String>,
    /// Time from the start of the nodes until the robots were ready; `None` in virtual mode and if the nodes already ran.
    pub connected_after: Option<Duration>,
}

/// Lateness of a robot's cycles, and its frames.
#[derive(Clone, Debug)]
pub struct StationHealth {
    /// Lateness of the robot's cycles.
    pub robot: CycleLateness,
    /// Frames by the PLC's count.
    pub plc_bus: Counters,
    /// Frames by the robot's count.
    pub robot_bus: Counters,
}
