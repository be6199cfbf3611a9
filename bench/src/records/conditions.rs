//! Result of one run on a stand, and the conditions of the measurement.

use std::time::Duration;

use plc_node::Execution;
use protocol::fieldbus::Counters;
use robot_node::Quality;

use crate::records::faults::FaultReport;
use crate::records::lateness::CycleLateness;

/// One finished run.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Measured {
    /// The PLC's report of the run.
    pub execution: Execution,
    /// Quality of the arm's motion, measured by the robot; `None` if it did not report every motion.
    pub quality: Option<Quality>,
}

#[cfg(test)]
impl Measured {
    /// Returns a run that took this long, by both clocks.
    pub fn lasting(time: Duration) -> Self {
        let nanos = u64::try_from(time.as_nanos()).unwrap();
        let execution = Execution {
            execution_type: plc_node::ExecutionType::Cm,
            execution_time_ns: nanos,
            robot_execution_ns: nanos,
            motions: 1,
            blends_suppressed: 0,
            scans: 1,
            frames: Counters::default(),
        };
        Self { execution, quality: None }
    }
}

/// Conditions of a measurement.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Health {
    /// Lateness of the PLC's scans.
    pub plc: CycleLateness,
    /// Lateness of the robot's interpolation cycles.
    pub robot: CycleLateness,
    /// Cyclic frames counted by the PLC.
    pub bus: Counters,
    /// Cyclic frames counted by the robot.
    pub robot_bus: Counters,
    /// Time from the start of the nodes until the robot was ready; `None` in virtual mode and if the nodes already
    /// ran.
    pub connected_after: Option<Duration>,
    /// Allocations of the PLC's and of the robot's cyclic thread since the connection was up; `None` if they are not
    /// counted.
    pub allocations: Option<[u64; 2]>,
    /// Repetitions that were run again because the host stalled a node until the connection was lost: which, and why.
    pub repeated: Vec<String>,
    /// Result of the injected faults, if any.
    pub faults: Option<FaultReport>,
}

impl Health {
    /// Returns how many frames of either direction were sent and not received. A side counts cycles without a frame;
    /// those that the other side skipped were not lost.
    #[must_use]
    pub const fn frames_lost(&self) -> u64 {
        let towards_plc = self.bus.lost.saturating_sub(self.robot_bus.skipped);
        towards_plc + self.robot_bus.lost.saturating_sub(self.bus.skipped)
    }
}
