//! Knowledge of a bus since it was last called, so that a node asks it only when it may have something.
//!
//! A bus changes only when it is called: with a frame, at its timeout, or with a command. Most calls of a node are scans and robot
//! cycles, which call no bus.

use core::cell::Cell;

use machine::{Instant, Pending};

/// Frames, requests and events that a bus may have, and when it wants to be called.
#[derive(Clone, Debug)]
pub struct BusPolls {
    /// True while it may have a frame to send.
    pub may_send: bool,
    /// True while it may have a request about a TCP connection.
    pub may_connect: bool,
    may_report: bool,
    /// Its next timeout; `None` where it was not asked since it was last called.
    timeout: Cell<Option<Option<Instant>>>,
}

impl BusPolls {
    /// Returns what is known of a bus that was just called: nothing.
    #[must_use]
    pub const fn called() -> Self {
        Self { may_send: true, may_connect: true, may_report: true, timeout: Cell::new(None) }
    }

    /// Takes over what the bus says that it may have.
    pub const fn narrow(&mut self, pending: Pending) {
        self.may_send &= pending.frame;
        self.may_connect &= pending.request;
        self.may_report &= pending.event;
    }

    /// Returns whether the bus may have an event, which leaves the question open.
    #[must_use]
    pub const fn may_report(&self) -> bool {
        self.may_report
    }

    /// Returns whether the bus may have an event. It has none afterwards: the caller takes all of them.
    pub const fn take_may_report(&mut self) -> bool {
        core::mem::replace(&mut self.may_report, false)
    }

    /// Returns the bus's next timeout, which is asked once.
    pub fn timeout(&self, ask: impl FnOnce() -> Option<Instant>) -> Option<Instant> {
        self.timeout.get().unwrap_or_else(|| {
            let timeout = ask();
            self.timeout.set(Some(timeout));
            timeout
        })
    }

    /// Says that the bus had no frame to send. Its timeout may be another one now.
    pub fn end_sending(&mut self) {
        self.may_send = false;
        self.timeout.set(None);
    }
}
