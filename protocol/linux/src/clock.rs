//! The clock of all cyclic threads.

use machine::{Duration, Instant};
use rustix::io::Errno;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

/// Longest time that three readings of a clock may take; usually they take a tenth of it. Longer: the thread was
/// interrupted between them.
const UNINTERRUPTED: Duration = Duration::from_micros(2);

/// Returns the time by `CLOCK_MONOTONIC`: nanoseconds since the host started, the same in every process of the host.
#[must_use]
pub fn now() -> Instant {
    let time = clock_gettime(ClockId::Monotonic);
    // The monotonic clock counts from 0 upwards, so both parts are positive.
    let seconds = u64::try_from(time.tv_sec).unwrap_or(0);
    let nanos = u64::try_from(time.tv_nsec).unwrap_or(0);
    Instant::from_nanos(seconds.saturating_mul(1_000_000_000).saturating_add(nanos))
}

/// Longest time for which frames wait until they are looked at. A stamp that is older, or in the future, is from before a
/// step of UTC.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// Converts a recent moment in UTC, as the kernel stamps frames, to an instant of this clock. If UTC was stepped since, by
/// more than ten seconds forwards or by any time back, that is now.
#[must_use]
pub fn instant_of(since_1970: Duration) -> Instant {
    let (mut before, mut utc, mut after) = (now(), utc(), now());
    // If the thread is interrupted between the readings, its wait would be part of the result: read again.
    for _ in 0..3 {
        if after.since(before) < UNINTERRUPTED {
            break;
        }
        (before, utc, after) = (now(), self::utc(), now());
    }
    before_now(after, utc, since_1970)
}

/// Returns the instant of a moment in UTC, `now` being `utc`.
fn before_now(now: Instant, utc: Duration, since_1970: Duration) -> Instant {
    let ago = utc.saturating_sub(since_1970);
    let ago = if ago > LONGEST_WAIT { Duration::ZERO } else { ago };
    Instant::from_nanos(now.as_nanos().saturating_sub(u64::try_from(ago.as_nanos()).unwrap_or(0)))
}

/// Returns the time in UTC, since 1970.
#[must_use]
pub fn utc() -> Duration {
    let time = clock_gettime(ClockId::Realtime);
    Duration::new(u64::try_from(time.tv_sec).unwrap_or(0), u32::try_from(time.tv_nsec).unwrap_or(0))
}

/// Sleeps until `deadline`, or returns at once if it has passed.
pub fn sleep_until(deadline: Instant) {
    let nanos = deadline.as_nanos();
    let deadline = Timespec {
        tv_sec: i64::try_from(nanos / 1_000_000_000).unwrap_or(i64::MAX),
        tv_nsec: i64::try_from(nanos % 1_000_000_000).unwrap_or(0),
    };
    // A signal that is handled wakes the thread early; nothing else can go wrong with this clock.
    while clock_nanosleep_absolute(ClockId::Monotonic, &deadline) == Err(Errno::INTR) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_does_not_run_backwards() {
        let mut last = now();
        for _ in 0..10_000 {
            let next = now();
            assert!(next >= last);
            last = next;
        }
    }

    #[test]
    fn a_moment_in_utc_is_found_on_the_monotonic_clock() {
        let (before, moment, after) = (now(), utc(), now());
        let found = instant_of(moment);
        let off = Duration::from_micros(50);
        assert!(
            found + off >= before && found <= after + off,
            "{found:?} is not within {before:?} and {after:?}"
        );
    }

    #[test]
    fn a_frame_from_before_a_step_of_utc_counts_as_seen_now() {
        let (now, utc, hour) = (Instant::from_millis(5_000), Duration::from_secs(1 << 30), 3_600);
        let seen = |stamped| before_now(now, utc, stamped);
        assert_eq!(seen(utc), now);
        assert_eq!(seen(utc - Duration::from_millis(40)), Instant::from_millis(4_960));
        assert_eq!(seen(utc - Duration::from_secs(4)), Instant::from_millis(1_000));
        assert_eq!(seen(utc - Duration::from_secs(3 * hour)), now);
        assert_eq!(seen(utc + Duration::from_secs(5 * hour)), now);
        assert_eq!(seen(Duration::ZERO), now);
    }

    #[test]
    fn a_sleep_does_not_end_before_its_deadline() {
        let deadline = now() + Duration::from_millis(2);
        sleep_until(deadline);
        assert!(now() >= deadline);
        sleep_until(Instant::ZERO);
    }
}
