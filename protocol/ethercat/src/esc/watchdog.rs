//! The watchdog of process data: it expires when the MainDevice writes no outputs for too long, in whichever state.

use machine::{Duration, Instant};

use super::memory::Memory;
use super::registers::{WATCHDOG_COUNTER, WATCHDOG_DIVIDER, WATCHDOG_STATUS, WATCHDOG_TIME};

/// Runs from each trigger until it expires, or until the chip is reset.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Watchdog {
    triggered: Option<Instant>,
}

impl Watchdog {
    /// Starts or restarts it.
    pub(crate) fn trigger(&mut self, now: Instant, memory: &mut Memory) {
        self.triggered = Some(now);
        memory.set(WATCHDOG_STATUS, &[1]);
    }

    /// Follows a new time. The status of a watchdog that the time 0 switches off is good.
    pub(crate) fn change_time(self, memory: &mut Memory) {
        if memory.u16(WATCHDOG_TIME) == 0 {
            memory.set(WATCHDOG_STATUS, &[1]);
        }
    }

    /// Returns when it expires; `None` if it does not run, or its time is 0.
    pub(crate) fn deadline(&self, memory: &Memory) -> Option<Instant> {
        // In periods of 25 MHz.
        let tick = (u64::from(memory.u16(WATCHDOG_DIVIDER)) + 2) * 40;
        let time = tick * u64::from(memory.u16(WATCHDOG_TIME));
        (time > 0).then_some(self.triggered? + Duration::from_nanos(time))
    }

    /// Returns whether it has just expired.
    pub(crate) fn expire(&mut self, now: Instant, memory: &mut Memory) -> bool {
        let expired = self.deadline(memory).is_some_and(|deadline| deadline <= now);
        if expired {
            self.triggered = None;
            memory.set(WATCHDOG_STATUS, &[0]);
            memory.change(WATCHDOG_COUNTER, |count| count.saturating_add(1));
        }
        expired
    }
}
