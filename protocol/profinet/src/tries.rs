//! The requests of tools, which are repeated until a station answers.

use machine::{Duration, Instant};

/// Tries of one request: how many were made, whether one is to be sent, and when the next one is due.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Tries {
    most: u32,
    every: Duration,
    made: u32,
    is_to_send: bool,
    next_at: Instant,
}

impl Tries {
    /// Plans so many requests, the first at `start`, each `every` after the one before.
    pub(crate) const fn new(most: u32, every: Duration, start: Instant) -> Self {
        Self { most, every, made: 0, is_to_send: false, next_at: start }
    }

    /// Plans the same for the next request.
    pub(crate) const fn restart(&mut self, now: Instant) {
        *self = Self::new(self.most, self.every, now);
    }

    /// Makes a try if it is due. Returns true if the last one was made and stayed without an answer.
    pub(crate) fn handle_timeout(&mut self, now: Instant) -> bool {
        if now < self.next_at {
            return false;
        }
        if self.made == self.most {
            return true;
        }
        (self.made, self.is_to_send, self.next_at) = (self.made + 1, true, now + self.every);
        false
    }

    /// Returns whether the request is to be sent now, once for each try.
    pub(crate) const fn take_request(&mut self) -> bool {
        core::mem::replace(&mut self.is_to_send, false)
    }

    /// Returns whether a try was made: an answer cannot come before.
    pub(crate) const fn are_begun(&self) -> bool {
        self.made > 0
    }

    /// Returns when something is due.
    pub(crate) const fn poll_timeout(&self) -> Instant {
        self.next_at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_sent_once_a_try_and_after_the_last_one_there_is_no_answer() {
        let mut tries = Tries::new(2, Duration::from_secs(1), Instant::from_millis(5));
        assert!(!tries.handle_timeout(Instant::from_millis(4)) && !tries.are_begun());
        for due in [5, 1_005] {
            assert_eq!(tries.poll_timeout(), Instant::from_millis(due));
            assert!(!tries.handle_timeout(Instant::from_millis(due)) && tries.are_begun());
            assert_eq!([tries.take_request(), tries.take_request()], [true, false]);
        }
        assert!(tries.handle_timeout(Instant::from_millis(2_005)));
        tries.restart(Instant::from_millis(2_005));
        assert!(!tries.handle_timeout(Instant::from_millis(2_005)) && tries.take_request());
    }
}
