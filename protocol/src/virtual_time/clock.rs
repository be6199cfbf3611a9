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
        let mut guess = local.as_nanos().saturating_sub(self.offset_ns);
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
        seconds.cast_signed().saturating_mul(self.drift_ppb.into()) + self.gained_in_second_ns(rest)
    }

    /// What the clock gains in a part of a second of true time, in ns.
    fn gained_in_second_ns(self, part: u64) -> i64 {
        part.cast_signed() * i64::from(self.drift_ppb) / SECOND.cast_signed()
    }
}

/// A clock that is read again and again as time goes on. It keeps what the clock showed when the present second of true
/// time began; what is left is below a second, and a virtual run turns one time into the other at every step.
#[derive(Debug)]
pub(super) struct Reading {
    clock: Clock,
    /// When the second began, in ns of true time, and what the clock showed then.
    second: u64,
    shown: u64,
    /// What the clock gains in a second of its own time, in ns.
    gained_in_own_second_ns: i64,
}

impl Reading {
    pub(super) fn new(clock: Clock) -> Self {
        let (second, drift) = (SECOND.cast_signed(), i64::from(clock.drift_ppb));
        // A clock that stands still has no time of its own; it is asked in the exact way.
        let gained_in_own_second_ns = (drift * second).checked_div(second + drift).unwrap_or(0);
        let shown = clock.local_time(Instant::ZERO).as_nanos();
        Self { clock, second: 0, shown, gained_in_own_second_ns }
    }

    pub(super) const fn clock(&self) -> Clock {
        self.clock
    }

    /// [`Clock::local_time`].
    pub(super) fn local_time(&mut self, now: Instant) -> Instant {
        let part = now.as_nanos().wrapping_sub(self.second);
        if part < SECOND {
            return Instant::from_nanos(self.shown_after(part));
        }
        self.second = now.as_nanos() / SECOND * SECOND;
        self.shown = self.clock.local_time(Instant::from_nanos(self.second)).as_nanos();
        self.clock.local_time(now)
    }

    /// [`Clock::true_time`].
    pub(super) fn true_time(&self, local: Instant) -> Instant {
        let ahead = local.as_nanos().wrapping_sub(self.shown);
        if ahead >= SECOND || self.clock.drift_ppb.unsigned_abs() > USUAL_DRIFT_PPB {
            return self.clock.true_time(local);
        }
        // Within a nanosecond or two, and then exactly.
        let gained = ahead.cast_signed() * self.gained_in_own_second_ns / SECOND.cast_signed();
        let mut part = ahead.saturating_add_signed(-gained);
        let is_early = |part: u64| part.saturating_add_signed(self.clock.gained_in_second_ns(part)) < ahead;
        while is_early(part) {
            part += 1;
        }
        while part > 0 && !is_early(part - 1) {
            part -= 1;
        }
        if part == 0 || part >= SECOND {
            return self.clock.true_time(local);
        }
        Instant::from_nanos(self.second + part)
    }

    fn shown_after(&self, part: u64) -> u64 {
        self.shown.saturating_add(part).saturating_add_signed(self.clock.gained_in_second_ns(part))
    }
}

/// Up to this drift, that of a quartz, no product overflows and no estimate is off by more than a few ns.
const USUAL_DRIFT_PPB: u32 = 100_000;

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
            let mut reading = Reading::new(clock);
            let now = Instant::from_nanos(due.as_nanos().saturating_sub(before));
            prop_assert_eq!(reading.local_time(now), clock.local_time(now));
            prop_assert_eq!(reading.local_time(now), clock.local_time(now));
            prop_assert_eq!(reading.true_time(local), due);
        }
    }
}
