//! A clock that is a little off.

use crate::Instant;

/// How a node's clock follows true time: it is ahead by `offset_ns` at the origin and gains `drift_ppb`
/// nanoseconds a second.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Clock {
    /// What the clock shows at true time zero, in ns.
    pub offset_ns: u64,
    /// Parts per billion that it runs fast; negative for slow. A quartz is within ±100 000.
    pub drift_ppb: i32,
}

impl Clock {
    /// What the clock shows at `true_time`.
    #[must_use]
    pub fn local_time(self, true_time: Instant) -> Instant {
        let shown = true_time.as_nanos().saturating_add(self.offset_ns);
        Instant::from_nanos(shown.saturating_add_signed(self.gained_ns(true_time)))
    }

    /// The first instant of true time at which the clock shows `local` or more.
    #[must_use]
    pub fn true_time(self, local: Instant) -> Instant {
        self.true_time_near(local, Instant::ZERO, self.local_time(Instant::ZERO))
    }

    /// The same, found sooner where the clock shows `shown` at `now` and that is not long before `local`.
    #[must_use]
    pub fn true_time_near(self, local: Instant, now: Instant, shown: Instant) -> Instant {
        let ahead = local.as_nanos().saturating_sub(shown.as_nanos());
        let gained = (ahead % SECOND).cast_signed() * i64::from(self.drift_ppb) / SECOND.cast_signed();
        let mut guess = now.as_nanos().saturating_add(ahead.saturating_add_signed(-gained));
        // Each step leaves the share of the error that the clock drifts by, so a few are enough.
        for _ in 0..8 {
            let shown = self.local_time(Instant::from_nanos(guess)).as_nanos();
            match local.as_nanos().wrapping_sub(shown).cast_signed() {
                0 => break,
                missing => guess = guess.saturating_add_signed(missing),
            }
        }
        let is_early = |at: u64| self.local_time(Instant::from_nanos(at)) < local;
        while is_early(guess) && guess < u64::MAX {
            guess += 1;
        }
        // A clock that runs slow shows the same nanosecond twice.
        if guess > 0 && !is_early(guess - 1) {
            guess -= 1;
        }
        Instant::from_nanos(guess)
    }

    /// What the clock has gained by `true_time`, in ns. Seconds and the rest apart, which is exact and needs no 128
    /// bits: this runs several times for each frame of a virtual run.
    fn gained_ns(self, true_time: Instant) -> i64 {
        let (seconds, rest) = (true_time.as_nanos() / SECOND, true_time.as_nanos() % SECOND);
        let drift_ppb = i64::from(self.drift_ppb);
        seconds.cast_signed().saturating_mul(drift_ppb)
            + rest.cast_signed() * drift_ppb / SECOND.cast_signed()
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
            drift_ppb in -200_000..200_000_i32,
            after in prop_oneof![0..100_000_000_000_u64, 0..10_000_000_000_000_000_u64],
            before in prop_oneof![0..10_000_000_u64, 0..10_000_000_000_u64],
        ) {
            let clock = Clock { offset_ns, drift_ppb };
            let local = Instant::from_nanos(offset_ns + after);
            let due = clock.true_time(local);
            prop_assert!(clock.local_time(due) >= local);
            prop_assert!(due.as_nanos() == 0 || clock.local_time(Instant::from_nanos(due.as_nanos() - 1)) < local);
            let now = Instant::from_nanos(due.as_nanos().saturating_sub(before));
            prop_assert_eq!(clock.true_time_near(local, now, clock.local_time(now)), due);
        }
    }
}
