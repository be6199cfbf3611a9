//! Wake-up latency of this host: how late it wakes a thread that does nothing but sleep, as a cyclic thread does.

use std::thread;

use machine::{Cycle, Duration, Lateness};
use rustix::thread::{ClockId, Timespec, clock_nanosleep_absolute};

use crate::clock;
use crate::scheduling::{self, Granted};

/// Measured wake-up latency, and what the host granted to the thread.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Wakeups {
    /// Lateness of each wake-up.
    pub lateness: Lateness,
    /// What the host granted the thread.
    pub granted: Granted,
}

/// Sleeps `count` times until the next multiple of `period`, on a thread with the scheduling of cyclic threads (see
/// [`scheduling`]). It takes `count` times `period`.
///
/// # Errors
///
/// The thread cannot be created.
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

/// Sleeps until this instant. A signal may end the sleep early; the caller checks its clock anyway.
fn sleep_until(instant: machine::Instant) {
    let nanos = instant.as_nanos();
    let part = |nanos: u64| i64::try_from(nanos).unwrap_or(i64::MAX);
    let request = Timespec { tv_sec: part(nanos / 1_000_000_000), tv_nsec: part(nanos % 1_000_000_000) };
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &request);
}
