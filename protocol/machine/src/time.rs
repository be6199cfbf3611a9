//! Time as every machine sees it: integer nanoseconds of the driver's clock.

use core::fmt;
use core::ops::{Add, AddAssign, Sub};

pub use core::time::Duration;

/// A point in time: nanoseconds since an origin that the driver chooses. It has no `now()`.
///
/// The clock is monotonic. Two nodes have two clocks, so an `Instant` of one must not be compared with one of the other.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Instant(u64);

impl Instant {
    /// The clock's origin.
    pub const ZERO: Self = Self(0);

    /// Returns the instant `nanos` nanoseconds after the origin.
    #[must_use]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Returns the instant `micros` microseconds after the origin.
    #[must_use]
    pub const fn from_micros(micros: u64) -> Self {
        Self(micros.saturating_mul(1_000))
    }

    /// Returns the instant `millis` milliseconds after the origin.
    #[must_use]
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1_000_000))
    }

    /// Returns the nanoseconds since the origin.
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Returns the time from `earlier` to `self`; zero if `earlier` is later.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// Returns the earlier of two deadlines, each of which may be unset.
    #[must_use]
    #[inline]
    pub fn earlier(a: Option<Self>, b: Option<Self>) -> Option<Self> {
        match (a, b) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    /// Returns the first instant of the grid `self + k · period` (k ≥ 1) after `now`, and the number of grid points
    /// skipped before it: a cyclic task that is late drops cycles, it never sends a burst.
    ///
    /// A zero `period` counts as one nanosecond.
    #[must_use]
    pub fn next_on_grid(self, period: Duration, now: Self) -> (Self, u64) {
        let period = nanos(period).max(1);
        let late = now.0.saturating_sub(self.0);
        // Avoid the division for a task that is on time, as most are: it takes as long as the rest of the
        // bookkeeping.
        let skipped = if late < period { 0 } else { late / period };
        (Self(self.0.saturating_add(period.saturating_mul(skipped.saturating_add(1)))), skipped)
    }
}

/// Returns a time in ns, at most the largest number.
pub(crate) const fn nanos(duration: Duration) -> u64 {
    duration.as_secs().saturating_mul(1_000_000_000).saturating_add(duration.subsec_nanos() as u64)
}

impl Add<Duration> for Instant {
    type Output = Self;
    fn add(self, rhs: Duration) -> Self {
        Self(self.0.saturating_add(nanos(rhs)))
    }
}

impl AddAssign<Duration> for Instant {
    fn add_assign(&mut self, rhs: Duration) {
        *self = *self + rhs;
    }
}

impl Sub<Duration> for Instant {
    type Output = Self;
    fn sub(self, rhs: Duration) -> Self {
        Self(self.0.saturating_sub(nanos(rhs)))
    }
}

impl fmt::Debug for Instant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:09}s", self.0 / 1_000_000_000, self.0 % 1_000_000_000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_in_time_gets_the_next_grid_point() {
        let (next, skipped) =
            Instant::from_millis(5).next_on_grid(Duration::from_millis(1), Instant::from_micros(5_200));
        assert_eq!((next, skipped), (Instant::from_millis(6), 0));
    }

    #[test]
    fn a_task_that_is_late_skips_cycles_and_stays_on_its_grid() {
        let (next, skipped) =
            Instant::from_millis(5).next_on_grid(Duration::from_millis(1), Instant::from_micros(9_300));
        assert_eq!((next, skipped), (Instant::from_millis(10), 4));
    }
}
