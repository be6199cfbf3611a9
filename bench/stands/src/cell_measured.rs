//! Result of one run of a cell with several stations, and the conditions of the measurement.

use std::time::Duration;

use machine::Instant;
use plc_node::MarkPassage;
use records::cell_results::CellResults;
use records::cell_sample::{CellSample, StationSample};
use records::conditions::{Health, Measured};
use records::faults::FaultReport;

/// A finished run of a cell.
#[derive(Clone, Debug)]
pub struct CellMeasured {
    /// Its saved part.
    pub sample: CellSample,
    /// The PLC's report and the robot's of each station, in the order of the setup.
    pub stations: Vec<Measured>,
}

impl CellMeasured {
    /// Takes the reports of each station with the marks that its arm passed, by the PLC's clock; `true_time` converts it.
    pub(crate) fn of(
        stations: Vec<(Measured, &[MarkPassage])>,
        start_skew: Option<Duration>,
        true_time: impl Fn(Instant) -> Instant,
    ) -> Self {
        let since_origin = |at: Instant| true_time(at).since(Instant::ZERO);
        let sample = |(measured, passages): &(Measured, &[MarkPassage])| StationSample {
            robot_execution: Duration::from_nanos(measured.execution.robot_execution_ns),
            blends_suppressed: measured.execution.blends_suppressed,
            waited: passages.iter().filter_map(|it| Some(it.passed?.since(it.came))).sum(),
            waited_for_zones: measured.execution.zone_wait_ns.map(Duration::from_nanos),
            came: passages.iter().map(|it| (it.mark, since_origin(it.came))).collect(),
        };
        let execution_ns = stations.first().map_or(0, |(first, _)| first.execution.execution_time_ns);
        let sample = CellSample {
            execution: Duration::from_nanos(execution_ns),
            start_skew,
            relative_pose_mm: None,
            stations: stations.iter().map(sample).collect(),
        };
        Self { sample, stations: stations.into_iter().map(|(measured, ..)| measured).collect() }
    }
}

/// The conditions of a run of a cell.
#[derive(Clone, Debug, Default)]
pub struct CellHealth {
    /// Those of the PLC and of each robot, in the order of the setup.
    pub stations: Vec<Health>,
    /// Result of the injected faults, if any.
    pub faults: Option<FaultReport>,
    /// Repetitions that were run again because the host stalled a node until a connection was lost: which, and why.
    pub repeated: Vec<String>,
    /// Remarks on the connections.
    pub remarks: Vec<String>,
    /// Time from the start of the nodes until the robots were ready; `None` in virtual mode and if the nodes already ran.
    pub connected_after: Option<Duration>,
}

impl CellHealth {
    /// Writes the conditions of the run so far into its results.
    pub fn write_to(&self, results: &mut CellResults) {
        results.set_health(&self.stations);
        results.faults.clone_from(&self.faults);
        results.repeated.clone_from(&self.repeated);
        results.remarks.clone_from(&self.remarks);
        results.connected_after_ms = self.connected_after.map(|time| time.as_secs_f64() * 1e3);
    }
}
