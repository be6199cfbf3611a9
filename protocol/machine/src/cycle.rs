//! The deadline of a cyclic task: a PLC scan, a robot tick, a bus cycle.

use crate::{Duration, Instant};

/// A task that is due on a fixed grid and never in a burst.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Cycle {
    period: Duration,
    next: Instant,
}

/// One run of a cyclic task.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Tick {
    /// The grid point at which this run was due.
    pub due: Instant,
    /// How late the run is.
    pub lateness: Duration,
    /// Grid points between `due` and now that get no run.
    pub skipped: u64,
}

impl Cycle {
    /// Creates a task that is due at `first` and every `period` after it.
    #[must_use]
    pub const fn new(first: Instant, period: Duration) -> Self {
        Self { period, next: first }
    }

    /// Returns when the task is due next.
    #[must_use]
    pub const fn next(&self) -> Instant {
        self.next
    }

    /// Returns the time from one run to the next.
    #[must_use]
    pub const fn period(&self) -> Duration {
        self.period
    }

    /// Returns the run that is due at `now`, if one is. The next deadline is the first grid point after `now`.
    pub fn tick(&mut self, now: Instant) -> Option<Tick> {
        if now < self.next {
            return None;
        }
        let due = self.next;
        let (next, skipped) = due.next_on_grid(self.period, now);
        self.next = next;
        Some(Tick { due, lateness: now.since(due), skipped })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_task_runs_once_and_reports_the_skipped_cycles() {
        let mut cycle = Cycle::new(Instant::from_millis(4), Duration::from_millis(4));
        assert_eq!(cycle.tick(Instant::from_millis(3)), None);
        let tick = cycle.tick(Instant::from_millis(13)).unwrap();
        assert_eq!(
            tick,
            Tick { due: Instant::from_millis(4), lateness: Duration::from_millis(9), skipped: 2 }
        );
        assert_eq!(cycle.next(), Instant::from_millis(16));
    }
}
