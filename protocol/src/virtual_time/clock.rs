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
        let elapsed = i128::from(true_time.as_nanos());
        let gained = elapsed * i128::from(self.drift_ppb) / 1_000_000_000;
        Instant::from_nanos(clamp(elapsed + gained + i128::from(self.offset_ns)))
    }

    /// The first instant of true time at which the clock shows `local` or more.
    #[must_use]
    pub fn true_time(self, local: Instant) -> Instant {
        let shown = i128::from(local.as_nanos()) - i128::from(self.offset_ns);
        let rate = 1_000_000_000 + i128::from(self.drift_ppb);
        let mut guess = Instant::from_nanos(clamp(shown * 1_000_000_000 / rate.max(1)));
        while self.local_time(guess) < local && guess.as_nanos() < u64::MAX {
            guess = Instant::from_nanos(guess.as_nanos() + 1);
        }
        guess
    }
}

fn clamp(nanos: i128) -> u64 {
    u64::try_from(nanos.max(0)).unwrap_or(u64::MAX)
}

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
            after in 0..100_000_000_000_u64,
        ) {
            let clock = Clock { offset_ns, drift_ppb };
            let local = Instant::from_nanos(offset_ns + after);
            let due = clock.true_time(local);
            prop_assert!(clock.local_time(due) >= local);
            prop_assert!(due.as_nanos() == 0 || clock.local_time(Instant::from_nanos(due.as_nanos() - 1)) < local);
        }
    }
}
