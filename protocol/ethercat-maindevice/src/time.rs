//! The time by which ethercrab waits: the time of the machine that runs in the calling thread at the moment.
//!
//! Without its feature `std`, ethercrab takes the time from the crate `embassy-time`, which has one driver for a whole
//! program. This driver returns the instant that was given to the machine. So machines of one thread may have different
//! clocks, and the driver of the machines decides whether time is real or virtual.

use std::cell::Cell;
use std::task::Waker;

use machine::Instant;

thread_local! {
    static NOW: Cell<u64> = const { Cell::new(0) };
    static WAKE: Cell<u64> = const { Cell::new(u64::MAX) };
}

struct ThreadTime;

impl embassy_time_driver::Driver for ThreadTime {
    fn now(&self) -> u64 {
        NOW.get()
    }

    /// Keeps the earliest wake. A machine always polls its whole future, so it needs no waker.
    fn schedule_wake(&self, at: u64, _waker: &Waker) {
        WAKE.set(WAKE.get().min(at));
    }
}

embassy_time_driver::time_driver_impl!(static TIME: ThreadTime = ThreadTime);

/// Runs `poll` at this time. Returns its result, and when it wants to be run again.
pub(crate) fn at<R>(now: Instant, poll: impl FnOnce() -> R) -> (R, Option<Instant>) {
    NOW.set(now.as_nanos());
    WAKE.set(u64::MAX);
    let result = poll();
    let wake = WAKE.get();
    (result, (wake < u64::MAX).then(|| Instant::from_nanos(wake)))
}

/// Returns the time of the machine that the thread runs.
#[must_use]
pub fn now() -> Instant {
    Instant::from_nanos(NOW.get())
}

/// Returns the same in nanoseconds, as ethercrab wants it.
#[must_use]
pub fn now_ns() -> u64 {
    NOW.get()
}

/// Waits until this instant. A tick of `embassy-time` is a nanosecond here.
pub async fn wait_until(instant: Instant) {
    embassy_time::Timer::at(embassy_time::Instant::from_ticks(instant.as_nanos())).await;
}

/// Runs a future until this instant. Returns its result, or `None` if it has none by then.
pub(crate) async fn by<F: Future>(deadline: Instant, future: F) -> Option<F::Output> {
    let deadline = embassy_time::Instant::from_ticks(deadline.as_nanos());
    embassy_time::with_deadline(deadline, future).await.ok()
}
