//! What a node reports at its end, the same for every node, fit to be sent as JSON.

use protocol::fieldbus::Counters;
use protocol::{Duration, Lateness};
use serde::{Deserialize, Serialize};

use crate::Finished;

/// How late the runs of a cyclic task were.
#[derive(Clone, PartialEq, Default, Debug, Serialize, Deserialize)]
pub struct LatenessReport {
    /// Runs of the task.
    pub runs: u64,
    /// Cycles that passed without a run.
    pub missed: u64,
    /// Half of the runs were not later than this, in µs.
    pub p50_us: f64,
    /// 99 of 100 runs were not later than this, in µs.
    pub p99_us: f64,
    /// The latest run, in µs.
    pub max_us: f64,
    /// Each bucket that holds runs: its upper end in µs, and how many runs are in it.
    pub buckets: Vec<(f64, u32)>,
}

impl From<&Lateness> for LatenessReport {
    fn from(lateness: &Lateness) -> Self {
        Self {
            runs: lateness.runs(),
            missed: lateness.missed(),
            p50_us: micros(lateness.quantile(0.5)),
            p99_us: micros(lateness.quantile(0.99)),
            max_us: micros(lateness.max()),
            buckets: lateness.buckets().map(|(upper, count)| (micros(upper), count)).collect(),
        }
    }
}

fn micros(duration: Duration) -> f64 {
    duration.as_nanos() as f64 / 1_000.0
}

/// Cyclic frames of a bus endpoint: [`Counters`].
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
pub struct BusReport {
    /// Cyclic frames sent.
    pub sent: u64,
    /// Cyclic frames received and taken over.
    pub received: u64,
    /// Cyclic frames that never came, by the peer's counter.
    pub lost: u64,
    /// Cyclic frames out of order or twice, dropped.
    pub late: u64,
    /// Frames that broke the format.
    pub malformed: u64,
    /// Frames in good format that are not for this connection.
    pub foreign: u64,
}

impl From<Counters> for BusReport {
    fn from(counters: Counters) -> Self {
        let Counters { sent, received, lost, late, malformed, foreign } = counters;
        Self { sent, received, lost, late, malformed, foreign }
    }
}

/// What a node did.
#[derive(Clone, PartialEq, Default, Debug, Serialize, Deserialize)]
pub struct NodeReport {
    /// Lateness of the node's own cycle: the PLC's scan, the robot's interpolation cycle.
    pub cycle: LatenessReport,
    /// Lateness of the thread, at any deadline of the machine.
    pub wake: LatenessReport,
    /// The bus endpoint's frames.
    pub bus: BusReport,
    /// Allocations of the cyclic thread from its start until the connection was up, and from then to its end; none
    /// where they are not counted.
    pub allocations: Option<Allocations>,
    /// Frames of any kind that the kernel did not take.
    pub send_errors: u64,
    /// What the kernel said last when it did not take a frame.
    pub last_send_error: Option<String>,
}

/// Allocations of a cyclic thread.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
pub struct Allocations {
    /// From the first wake until the connection was up.
    pub while_connecting: u64,
    /// From then until the thread's end: the cyclic path.
    pub while_cyclic: u64,
}

impl NodeReport {
    /// Gathers the report of a thread that ended. `at_link_up` is [`crate::allocation::count`] as the task read it
    /// when the connection came up.
    pub fn of<M: protocol::Machine, T>(
        finished: &Finished<M, T>,
        cycle: &Lateness,
        bus: Counters,
        at_link_up: Option<u64>,
    ) -> Self {
        let statistics = finished.driver.statistics();
        Self {
            cycle: cycle.into(),
            wake: (&statistics.lateness).into(),
            bus: bus.into(),
            allocations: statistics.allocations.map(|all| {
                let while_connecting = at_link_up.unwrap_or(all);
                Allocations { while_connecting, while_cyclic: all.saturating_sub(while_connecting) }
            }),
            send_errors: statistics.send_errors,
            last_send_error: statistics.last_send_error.map(|error| std::io::Error::from(error).to_string()),
        }
    }
}
