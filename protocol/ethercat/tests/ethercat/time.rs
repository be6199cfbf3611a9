//! The time that ethercrab waits by: that of the thread's running machine.

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

    /// Keeps the earliest wake. The machine polls its future whole, so it needs no waker.
    fn schedule_wake(&self, at: u64, _waker: &Waker) {
        WAKE.set(WAKE.get().min(at));
    }
}

embassy_time_driver::time_driver_impl!(static TIME: ThreadTime = ThreadTime);

/// Runs `poll` at this time. Returns its result, and when it wants to be run again.
pub fn at<R>(now: Instant, poll: impl FnOnce() -> R) -> (R, Option<Instant>) {
    NOW.set(now.as_nanos());
    WAKE.set(u64::MAX);
    let result = poll();
    let wake = WAKE.get();
    (result, (wake < u64::MAX).then(|| Instant::from_nanos(wake)))
}

/// Returns the time of the thread's running machine in nanoseconds.
pub fn now_ns() -> u64 {
    NOW.get()
}
