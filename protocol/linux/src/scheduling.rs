//! What a cyclic thread needs from the kernel: priority over ordinary threads, locked memory, exact timers.

use std::num::NonZeroU64;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::set_current_timer_slack;

/// The SCHED_FIFO priority of a cyclic thread: just below 50, which the kernel gives to interrupt threads.
pub const PRIORITY: i32 = 49;

/// What the host granted to a cyclic thread.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Granted {
    /// SCHED_FIFO at [`PRIORITY`].
    pub fifo: bool,
    /// The process's memory is locked: it is never swapped out.
    pub memory: bool,
}

impl Granted {
    /// Returns what is missing and how to allow it; `None` if nothing is.
    #[must_use]
    pub fn refused(&self) -> Option<String> {
        let missing = match (self.fifo, self.memory) {
            (true, true) => return None,
            (false, true) => "real-time priority (SCHED_FIFO)",
            (true, false) => "locked memory (mlockall)",
            (false, false) => "real-time priority (SCHED_FIFO) and locked memory (mlockall)",
        };
        Some(format!(
            "the host grants no {missing}, so cycles may come late when it is busy; to allow it, give this user \
             `rtprio {PRIORITY}` and `memlock unlimited` in /etc/security/limits.conf and log in again, or run as root"
        ))
    }
}

/// Gives the calling thread SCHED_FIFO, locks the process's memory, and removes the slack from its timers, as far as
/// the host allows. Without them the thread still runs, with more jitter.
#[must_use]
pub fn make_real_time() -> Granted {
    // Every user may do this. It fails on no kernel that we run on; the loss would be 50 µs of slack.
    let _ = set_current_timer_slack(NonZeroU64::new(1));
    Granted {
        fifo: set_fifo(PRIORITY).is_ok(),
        memory: mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).is_ok(),
    }
}

fn set_fifo(priority: i32) -> std::io::Result<()> {
    let parameter = libc::sched_param { sched_priority: priority };
    // SAFETY: thread 0 is the calling one, and the structure is only read during the call.
    let result = unsafe {
        libc::sched_setscheduler(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, &raw const parameter)
    };
    if result < 0 { Err(std::io::Error::last_os_error()) } else { Ok(()) }
}
