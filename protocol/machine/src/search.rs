//! What searches for devices have in common on every bus: when they send requests, and what they keep of the answers.
//!
//! A search of length T sends requests to all devices at 0, T/4 and T/2, so that a request or an answer may be lost. The
//! devices spread their answers over T/4; the remaining time is for slow ones.

use alloc::vec::Vec;

use crate::{Duration, Instant};

/// Requests of one search.
pub const REQUESTS: u32 = 3;

/// Largest number of entries. More devices on one cable must be forged.
pub const MOST_DEVICES: usize = 1024;

/// Event: the search has ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SearchEnded;

/// Counters of the frames besides the answers of new devices.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct SearchCounters {
    /// Answers of devices that had already answered.
    pub repeated: u64,
    /// Broken answers, and answers to requests of others.
    pub ignored: u64,
    /// Answers of devices beyond [`MOST_DEVICES`].
    pub surplus: u64,
}

/// The devices found, one entry each.
#[derive(Clone, Debug)]
pub struct Answers<D> {
    devices: Vec<D>,
    counters: SearchCounters,
}

impl<D> Default for Answers<D> {
    fn default() -> Self {
        Self { devices: Vec::new(), counters: SearchCounters::default() }
    }
}

impl<D> Answers<D> {
    /// Returns the devices, the first one to answer first.
    #[must_use]
    pub fn devices(&self) -> &[D] {
        &self.devices
    }

    /// Returns the counters.
    #[must_use]
    pub const fn counters(&self) -> SearchCounters {
        self.counters
    }

    /// Stores a device's answer in place of its earlier one: it may have just got a name or an address.
    pub fn keep(&mut self, device: D, is_same: impl Fn(&D, &D) -> bool) {
        let known = self.devices.iter().position(|known| is_same(known, &device));
        if let Some(known) = known.and_then(|index| self.devices.get_mut(index)) {
            *known = device;
            self.counters.repeated += 1;
        } else if self.devices.len() < MOST_DEVICES {
            self.devices.push(device);
        } else {
            self.counters.surplus += 1;
        }
    }

    /// Counts a frame that is no answer to this search.
    pub const fn ignore(&mut self) {
        self.counters.ignored += 1;
    }
}

/// When a search sends requests, and when it ends.
#[derive(Clone, Debug)]
pub struct Schedule {
    start: Instant,
    length: Duration,
    /// Requests that are due.
    asked: u32,
    ended: bool,
    /// [`SearchEnded`] was not reported yet.
    report_end: bool,
}

/// What is due at an instant.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Due {
    /// Nothing.
    Nothing,
    /// A request. A driver that was late for several sends one.
    Request,
}

impl Schedule {
    /// Creates the schedule of a search that sends its first request at `start` and ends after `length`.
    #[must_use]
    pub const fn new(start: Instant, length: Duration) -> Self {
        Self { start, length, asked: 0, ended: false, report_end: false }
    }

    /// Returns the time over which devices are asked to spread their answers.
    #[must_use]
    pub fn spread(&self) -> Duration {
        self.length / 4
    }

    /// Returns whether the search has ended.
    #[must_use]
    pub const fn has_ended(&self) -> bool {
        self.ended
    }

    /// Returns what is due now.
    pub fn handle_timeout(&mut self, now: Instant) -> Due {
        if self.ended {
            return Due::Nothing;
        }
        if now >= self.start + self.length {
            (self.ended, self.report_end) = (true, true);
            return Due::Nothing;
        }
        let mut due = Due::Nothing;
        while self.asked < REQUESTS && self.request(self.asked) <= now {
            self.asked += 1;
            due = Due::Request;
        }
        due
    }

    /// Returns [`SearchEnded`] once, after the end.
    pub const fn poll_event(&mut self) -> Option<SearchEnded> {
        if core::mem::replace(&mut self.report_end, false) { Some(SearchEnded) } else { None }
    }

    /// Returns when something is due; `None` after the end.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        if self.ended {
            None
        } else if self.asked < REQUESTS {
            Some(self.request(self.asked))
        } else {
            Some(self.start + self.length)
        }
    }

    /// Returns when request `number`, from 0, is due.
    fn request(&self, number: u32) -> Instant {
        self.start + self.length.saturating_mul(number) / 4
    }
}
