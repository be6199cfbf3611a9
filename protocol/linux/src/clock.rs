//! The one clock of the cyclic threads.

use machine::{Duration, Instant};
use rustix::io::Errno;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

/// Three readings of a clock take a tenth of this.
const NOT_HELD_UP: Duration = Duration::from_micros(2);

/// Now, by `CLOCK_MONOTONIC`: nanoseconds since the host started, the same in every process of the host.
#[must_use]
pub fn now() -> Instant {
    let time = clock_gettime(ClockId::Monotonic);
    // The monotonic clock counts from 0 upwards, so both parts are positive.
    let seconds = u64::try_from(time.tv_sec).unwrap_or(0);
    let nanos = u64::try_from(time.tv_nsec).unwrap_or(0);
    Instant::from_nanos(seconds.saturating_mul(1_000_000_000).saturating_add(nanos))
}

/// The instant of this clock that was `since_1970` in UTC a moment ago: what the kernel stamps frames with, as the cyclic
/// threads count time.
#[must_use]
pub fn instant_of(since_1970: Duration) -> Instant {
    let (mut before, mut utc, mut after) = (now(), utc(), now());
    // A thread that is held up between the readings would put its wait into the result.
    for _ in 0..3 {
        if after.since(before) < NOT_HELD_UP {
            break;
        }
        (before, utc, after) = (now(), self::utc(), now());
    }
    let ago = utc.saturating_sub(since_1970).as_nanos();
    Instant::from_nanos(after.as_nanos().saturating_sub(u64::try_from(ago).unwrap_or(u64::MAX)))
}

/// Now in UTC, as a time since 1970.
#[must_use]
pub fn utc() -> Duration {
    let time = clock_gettime(ClockId::Realtime);
    Duration::new(u64::try_from(time.tv_sec).unwrap_or(0), u32::try_from(time.tv_nsec).unwrap_or(0))
}

/// Sleeps until `deadline` of that clock, or returns at once where it has passed.
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
    fn a_sleep_does_not_end_before_its_deadline() {
        let deadline = now() + Duration::from_millis(2);
        sleep_until(deadline);
        assert!(now() >= deadline);
        sleep_until(Instant::ZERO);
    }
}
