//! What a node reports of itself, the same for every node, fit to be sent as JSON.

use std::fmt;

use protocol::fieldbus::Counters;
use protocol::{Duration, Lateness};
use serde::{Deserialize, Serialize};

use crate::Snapshot;

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
    /// Cycles without a frame, because the node came too late to send it.
    pub skipped: u64,
    /// Cycles of the peer for which no frame came, by its counter; those that it skipped are among them.
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
        let Counters { sent, received, skipped, lost, late, malformed, foreign } = counters;
        Self { sent, received, skipped, lost, late, malformed, foreign }
    }
}

impl From<BusReport> for Counters {
    fn from(report: BusReport) -> Self {
        let BusReport { sent, received, skipped, lost, late, malformed, foreign } = report;
        Self { sent, received, skipped, lost, late, malformed, foreign }
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

impl From<&Snapshot> for NodeReport {
    fn from(snapshot: &Snapshot) -> Self {
        Self {
            cycle: (&snapshot.cycle).into(),
            wake: (&snapshot.wake).into(),
            bus: snapshot.bus.into(),
            allocations: snapshot
                .allocations
                .map(|(while_connecting, while_cyclic)| Allocations { while_connecting, while_cyclic }),
            send_errors: snapshot.send_errors,
            last_send_error: snapshot.last_send_error.map(|error| std::io::Error::from(error).to_string()),
        }
    }
}

impl fmt::Display for NodeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let LatenessReport { runs, missed, p50_us, p99_us, max_us, .. } = &self.cycle;
        let BusReport { sent, received, skipped, lost, late, malformed, foreign } = &self.bus;
        writeln!(
            f,
            "cycle: {runs} runs, late by {p50_us:.0} µs (p50), {p99_us:.0} µs (p99), {max_us:.0} µs (max); {missed} missed"
        )?;
        write!(
            f,
            "bus: {sent} frames sent, {skipped} skipped, {received} received, {lost} missing, {late} late, {malformed} malformed, {foreign} foreign"
        )?;
        if let Some(Allocations { while_connecting, while_cyclic }) = self.allocations {
            write!(
                f,
                "\nallocations of the cyclic thread: {while_cyclic} once connected, {while_connecting} before"
            )?;
        }
        if self.send_errors > 0 {
            let last = self.last_send_error.as_deref().unwrap_or("no reason given");
            write!(f, "\nframes that the kernel did not take: {}, at last: {last}", self.send_errors)?;
        }
        Ok(())
    }
}
