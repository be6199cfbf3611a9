//! What a stand says of a run, and of the conditions that it was measured under.

use std::time::Duration;

use plc_node::Execution;
use protocol::fieldbus::Counters;
use robot_node::Quality;

use crate::records::faults::FaultReport;
use crate::records::lateness::CycleLateness;

/// One finished run.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Measured {
    /// What the PLC says of it.
    pub execution: Execution,
    /// How well the arm moved, by the robot; none where it did not say so of every motion.
    pub quality: Option<Quality>,
}

#[cfg(test)]
impl Measured {
    /// A run that took this long, by both clocks.
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

/// The conditions that runs were measured under.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Health {
    /// Lateness of the PLC's scans.
    pub plc: CycleLateness,
    /// Lateness of the robot's interpolation cycles.
    pub robot: CycleLateness,
    /// Cyclic frames as the PLC counts them.
    pub bus: Counters,
    /// Cyclic frames as the robot counts them.
    pub robot_bus: Counters,
    /// From the start of the nodes until the robot was ready; none in virtual mode and where the nodes ran already.
    pub connected_after: Option<Duration>,
    /// Allocations of the PLC's and of the robot's cyclic thread since the connection was up; none where they are
    /// not counted.
    pub allocations: Option<[u64; 2]>,
    /// Repetitions that were run again because a host that held a node up took the connection from them: which, and why.
    pub repeated: Vec<String>,
    /// What came of the faults that were put in, where some were.
    pub faults: Option<FaultReport>,
}

impl Health {
    /// Frames that were sent, either way, and never came. A side sees that a cycle brought no frame; what the other
    /// side says that it skipped was not lost.
    #[must_use]
    pub const fn frames_lost(&self) -> u64 {
        let towards_plc = self.bus.lost.saturating_sub(self.robot_bus.skipped);
        towards_plc + self.robot_bus.lost.saturating_sub(self.bus.skipped)
    }
}
