//! The report of a node about itself: the same for all nodes, and can be sent as JSON.

use std::fmt;

use machine::Counters;
use machine::{Duration, Lateness};
use protocol::image::Checks;
use serde::{Deserialize, Serialize};

use crate::Snapshot;

/// Lateness of the runs of a cyclic task.
#[derive(Clone, PartialEq, Default, Debug, Serialize, Deserialize)]
pub struct LatenessReport {
    /// Runs of the task.
    pub runs: u64,
    /// Cycles that passed without a run.
    pub missed: u64,
    /// Median lateness, in µs.
    pub p50_us: f64,
    /// 99th percentile of the lateness, in µs.
    pub p99_us: f64,
    /// Largest lateness, in µs.
    pub max_us: f64,
    /// Histogram: for each bucket with runs, its upper bound in µs and its number of runs.
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

impl LatenessReport {
    /// Returns the runs since an earlier report of the same task. Quantiles are computed from the buckets; so is the
    /// largest lateness, unless the largest of all runs is among these.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        let earlier =
            |end: f64| before.buckets.iter().find(|(other, _)| *other == end).map_or(0, |(_, n)| *n);
        let buckets = self.buckets.iter().map(|(end, count)| (*end, count.saturating_sub(earlier(*end))));
        let buckets: Vec<_> = buckets.filter(|(_, count)| *count > 0).collect();
        let runs = buckets.iter().map(|(_, count)| u64::from(*count)).sum();
        let highest = buckets.last().map_or(0.0, |(end, _)| end.min(self.max_us));
        let max_us = if self.max_us > before.max_us { self.max_us } else { highest };
        let quantile = |share: f64| {
            let mut seen = 0;
            let reached = buckets.iter().find(|(_, count)| {
                seen += u64::from(*count);
                seen as f64 >= share * runs as f64
            });
            reached.map_or(0.0, |(end, _)| end.min(max_us))
        };
        let (p50_us, p99_us) = (quantile(0.5), quantile(0.99));
        Self { runs, missed: self.missed.saturating_sub(before.missed), p50_us, p99_us, max_us, buckets }
    }
}

fn micros(duration: Duration) -> f64 {
    duration.as_nanos() as f64 / 1_000.0
}

/// Figures of a node.
#[derive(Clone, PartialEq, Default, Debug, Serialize, Deserialize)]
pub struct NodeReport {
    /// Lateness of the node's own cycle: the PLC's scan, the robot's interpolation cycle.
    pub cycle: LatenessReport,
    /// Lateness of the thread at all deadlines of the machine.
    pub wake: LatenessReport,
    /// Counters of the bus endpoint's frames.
    pub bus: Counters,
    /// Received images by their checks.
    pub images: ImageChecks,
    /// Allocations of the cyclic thread before and after the connection was first up; `None` if they are not counted.
    pub allocations: Option<Allocations>,
    /// Frames of any kind that the kernel refused.
    pub send_errors: u64,
    /// The kernel's last error on sending a frame.
    pub last_send_error: Option<String>,
}

/// Received images by what their checks and life counters said.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
pub struct ImageChecks {
    /// Images that were refused because a byte was altered.
    pub altered: u64,
    /// Images without a check.
    pub unchecked: u64,
    /// Images that were refused because their life counter showed that they are old; none from a node of an older version.
    #[serde(default)]
    pub outdated: u64,
}

impl From<Checks> for ImageChecks {
    fn from(Checks { altered, unchecked, outdated }: Checks) -> Self {
        Self { altered, unchecked, outdated }
    }
}

impl ImageChecks {
    /// Returns the images since an earlier report.
    #[must_use]
    pub const fn since(self, before: Self) -> Self {
        Self {
            altered: self.altered.saturating_sub(before.altered),
            unchecked: self.unchecked.saturating_sub(before.unchecked),
            outdated: self.outdated.saturating_sub(before.outdated),
        }
    }
}

/// Allocations of a cyclic thread.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
pub struct Allocations {
    /// From the first wake until the connection was first up.
    pub while_connecting: u64,
    /// From then until the thread's end: the cyclic path.
    pub while_cyclic: u64,
}

impl NodeReport {
    /// Returns the figures since an earlier report of the same node.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        let cyclic = before.allocations.map_or(0, |allocations| allocations.while_cyclic);
        Self {
            cycle: self.cycle.since(&before.cycle),
            wake: self.wake.since(&before.wake),
            bus: self.bus.since(&before.bus),
            images: self.images.since(before.images),
            allocations: self.allocations.map(|allocations| Allocations {
                while_cyclic: allocations.while_cyclic.saturating_sub(cyclic),
                ..allocations
            }),
            send_errors: self.send_errors.saturating_sub(before.send_errors),
            last_send_error: self.last_send_error.clone(),
        }
    }
}

impl From<&Snapshot> for NodeReport {
    fn from(snapshot: &Snapshot) -> Self {
        Self {
            cycle: (&snapshot.cycle).into(),
            wake: (&snapshot.wake).into(),
            bus: snapshot.bus,
            images: snapshot.checks.into(),
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
        let Counters { sent, received, skipped, lost, late, malformed, foreign } = &self.bus;
        writeln!(
            f,
            "cycle: {runs} runs, late by {p50_us:.0} µs (p50), {p99_us:.0} µs (p99), {max_us:.0} µs (max); {missed} missed"
        )?;
        write!(
            f,
            "bus: {sent} frames sent, {skipped} skipped, {received} received, {lost} missing, {late} late, {malformed} malformed, {foreign} foreign"
        )?;
        let ImageChecks { altered, unchecked, outdated } = self.images;
        if altered > 0 || unchecked > 0 || outdated > 0 {
            write!(
                f,
                "\nimages: {altered} altered and refused, {outdated} outdated and refused, {unchecked} without a check"
            )?;
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use machine::{Instant, Tick};

    /// Builds a report of runs with these latenesses in µs.
    fn report(lateness: &mut Lateness, late_us: &[u64]) -> LatenessReport {
        for micros in late_us {
            let lateness_of_run = Duration::from_micros(*micros);
            lateness.record(&Tick { due: Instant::ZERO, lateness: lateness_of_run, skipped: micros / 1_000 });
        }
        (&*lateness).into()
    }

    #[test]
    fn the_difference_of_two_reports_contains_only_the_later_runs() {
        let mut lateness = Lateness::default();
        let before = report(&mut lateness, &[10, 10, 5_000]);
        assert_eq!(before.since(&LatenessReport::default()), before);

        let after = report(&mut lateness, &[100, 100, 100, 200]).since(&before);
        assert_eq!((after.runs, after.missed), (4, 0));
        let rough = |found: f64, micros: f64| (1.0..1.07).contains(&(found / micros));
        assert!(rough(after.p50_us, 100.0) && rough(after.p99_us, 200.0), "{after:?}");
        assert!(rough(after.max_us, 200.0), "the 5 ms were before: {after:?}");

        let latest = report(&mut lateness, &[6_000]).since(&before);
        assert_eq!((latest.max_us, latest.missed), (6_000.0, 6));
    }
}
