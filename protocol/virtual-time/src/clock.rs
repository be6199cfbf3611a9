//! A node's clock with offset and drift.

use machine::Instant;

/// How a node's clock relates to true time: it is ahead by `offset_ns` at the origin and gains `drift_ppb`
/// nanoseconds a second.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Clock {
    /// The clock's value at true time zero, in ns.
    pub offset_ns: u64,
    /// Drift in parts per billion; negative for a slow clock. A quartz is within ±100 000.
    pub drift_ppb: i32,
}

impl Clock {
    /// Returns the clock's value at `true_time`.
    #[must_use]
    pub fn local_time(self, true_time: Instant) -> Instant {
        let shown = true_time.as_nanos().saturating_add(self.offset_ns);
        Instant::from_nanos(shown.saturating_add_signed(self.gained_ns(true_time)))
    }

    /// Returns the first instant of true time at which the clock shows `local` or more.
    #[must_use]
    pub fn true_time(self, local: Instant) -> Instant {
        let ahead = local.as_nanos().saturating_sub(self.offset_ns);
        Instant::from_nanos(self.time_for(ahead))
    }

    /// Returns the true time in ns in which the clock advances by `ahead` ns. A clock that stands still never does.
    fn time_for(self, ahead: u64) -> u64 {
        let rate = (i64::from(self.drift_ppb) + SECOND.cast_signed()).max(0).cast_unsigned();
        if (1..SECOND).contains(&ahead) && rate > 0 {
            // The product has 60 bits at most: as below, without a division of 128 bits.
            return match self.drift_ppb < 0 {
                true => (ahead - 1) * SECOND / rate + 1,
                false => (ahead * SECOND).div_ceil(rate),
            };
        }
        let (ahead, second, rate) = (u128::from(ahead), u128::from(SECOND), u128::from(rate));
        // The gain is rounded towards zero, so the shown time is rounded down if the clock runs fast and up if it
        // runs slow.
        let time = if ahead == 0 {
            Some(0)
        } else if self.drift_ppb < 0 {
            ((ahead - 1) * second).checked_div(rate).map(|before| before + 1)
        } else {
            Some((ahead * second).div_ceil(rate))
        };
        time.and_then(|time| u64::try_from(time).ok()).unwrap_or(u64::MAX)
    }

    /// Returns the clock's gain at `true_time`, in ns. Whole seconds and the rest are computed separately, which is
    /// exact and needs no 128 bits: this runs several times for each frame of a virtual run.
    fn gained_ns(self, true_time: Instant) -> i64 {
        let (seconds, rest) = (true_time.as_nanos() / SECOND, true_time.as_nanos() % SECOND);
        seconds.cast_signed().saturating_mul(self.drift_ppb.into()) + self.gained_in_second_ns(rest)
    }

    /// Returns the clock's gain in a part of a second of true time, in ns.
    fn gained_in_second_ns(self, part: u64) -> i64 {
        part.cast_signed() * i64::from(self.drift_ppb) / SECOND.cast_signed()
    }
}

/// A clock that is read repeatedly as time advances. It remembers what the clock showed at the start of the current
/// second of true time, so that only the part below a second is computed: a virtual run converts times at every step.
#[derive(Debug)]
pub(super) struct ClockReader {
    clock: Clock,
    /// Start of the current second, in ns of true time, and what the clock showed then.
    second: u64,
    shown: u64,
}

impl ClockReader {
    pub(super) fn new(clock: Clock) -> Self {
        Self { clock, second: 0, shown: clock.local_time(Instant::ZERO).as_nanos() }
    }

    pub(super) const fn clock(&self) -> Clock {
        self.clock
    }

    /// Converts like [`Clock::local_time`].
    pub(super) fn local_time(&mut self, now: Instant) -> Instant {
        let part = now.as_nanos().wrapping_sub(self.second);
        if part < SECOND {
            return Instant::from_nanos(self.shown_after(part));
        }
        self.second = now.as_nanos() / SECOND * SECOND;
        self.shown = self.clock.local_time(Instant::from_nanos(self.second)).as_nanos();
        self.clock.local_time(now)
    }

    /// Converts like [`Clock::true_time`].
    pub(super) fn true_time(&self, local: Instant) -> Instant {
        let ahead = local.as_nanos().wrapping_sub(self.shown);
        let part = if (1..SECOND).contains(&ahead) { self.clock.time_for(ahead) } else { 0 };
        if (1..SECOND).contains(&part) {
            Instant::from_nanos(self.second + part)
        } else {
            self.clock.true_time(local)
        }
    }

    fn shown_after(&self, part: u64) -> u64 {
        self.shown.saturating_add(part).saturating_add_signed(self.clock.gained_in_second_ns(part))
    }
}

const SECOND: u64 = 1_000_000_000;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_clock_that_gains_50_ppm_is_50_us_ahead_after_a_second() {
        let clock = Clock { offset_ns: 7, drift_ppb: 50_000 };
        assert_eq!(clock.local_time(Instant::from_millis(1_000)).as_nanos(), 1_000_050_007);
    }

    proptest! {
        #[test]
        fn a_timeout_is_never_early_on_its_own_clock(
            offset_ns in 0..1_000_000_000_u64,
            drift_ppb in prop_oneof![-200_000..200_000_i32, -500_000_000..500_000_000_i32],
            after in prop_oneof![0..100_000_000_000_u64, 0..10_000_000_000_000_000_u64],
            before in prop_oneof![0..10_000_000_u64, 0..10_000_000_000_u64],
        ) {
            let clock = Clock { offset_ns, drift_ppb };
            let local = Instant::from_nanos(offset_ns + after);
            let due = clock.true_time(local);
            prop_assert!(clock.local_time(due) >= local);
            prop_assert!(due.as_nanos() == 0 || clock.local_time(Instant::from_nanos(due.as_nanos() - 1)) < local);
            let mut reading = ClockReader::new(clock);
            let now = Instant::from_nanos(due.as_nanos().saturating_sub(before));
            prop_assert_eq!(reading.local_time(now), clock.local_time(now));
            prop_assert_eq!(reading.local_time(now), clock.local_time(now));
            prop_assert_eq!(reading.true_time(local), due);
        }
    }
}
