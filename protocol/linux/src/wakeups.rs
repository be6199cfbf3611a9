//! How late this host wakes a thread that does nothing but sleep: what a cyclic thread has to live with.

use std::thread;

use machine::{Cycle, Duration, Lateness};
use rustix::thread::{ClockId, Timespec, clock_nanosleep_absolute};

use crate::clock;
use crate::scheduling::{self, Granted};

/// Lateness of the wake-ups, and what the thread had.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Wakeups {
    /// How late each wake-up came.
    pub lateness: Lateness,
    /// What the host granted the thread.
    pub granted: Granted,
}

/// Sleeps `count` times until the next point of a grid of `period`, on a thread with what [`scheduling`] gives to
/// cyclic ones. It takes `count` times `period`.
///
/// # Errors
///
/// There is no thread to be had.
pub fn measure(period: Duration, count: u64) -> std::io::Result<Wakeups> {
    let sleeper = move || {
        let granted = scheduling::make_real_time();
        let mut lateness = Lateness::default();
        let mut cycle = Cycle::new(clock::now() + period, period);
        while lateness.runs() < count {
            sleep_until(cycle.next());
            if let Some(tick) = cycle.tick(clock::now()) {
                lateness.record(&tick);
            }
        }
        Wakeups { lateness, granted }
    };
    let thread = thread::Builder::new().name("wakeups".to_owned()).spawn(sleeper)?;
    thread.join().map_err(|_| std::io::Error::other("the thread that measures wake-ups broke off"))
}

/// A signal may wake it early; the caller looks at its clock anyway.
fn sleep_until(instant: machine::Instant) {
    let nanos = instant.as_nanos();
    let part = |nanos: u64| i64::try_from(nanos).unwrap_or(i64::MAX);
    let request = Timespec { tv_sec: part(nanos / 1_000_000_000), tv_nsec: part(nanos % 1_000_000_000) };
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &request);
}
