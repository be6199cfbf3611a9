//! Arrivals of cyclic data: how evenly they come.

use machine::{Duration, Instant};

/// Intervals between cyclic data of the device.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Arrivals {
    /// Number of intervals.
    pub count: u64,
    /// Shortest one.
    pub shortest: Duration,
    /// Longest one.
    pub longest: Duration,
    /// Sum, for the mean.
    total: Duration,
    last: Option<Instant>,
}

impl Arrivals {
    pub(crate) fn record(&mut self, now: Instant) {
        if let Some(last) = self.last.replace(now) {
            let interval = now.since(last);
            self.shortest = if self.count == 0 { interval } else { self.shortest.min(interval) };
            self.longest = self.longest.max(interval);
            self.total = self.total.saturating_add(interval);
            self.count += 1;
        }
    }

    /// Begins anew after a pause, whose length is not an interval.
    pub(crate) fn pause(&mut self) {
        self.last = None;
    }

    /// Returns the mean interval.
    #[must_use]
    pub fn mean(&self) -> Duration {
        let count = u32::try_from(self.count).unwrap_or(u32::MAX);
        if count == 0 { Duration::ZERO } else { self.total / count }
    }
}
