//! Timing of a connection: its timeout, its inhibit time, and which frames are new.

use machine::{Duration, Instant, Numbering, Sequence};

/// Number of packet intervals that a consumer waits: 4 << code, code 0 to 7 (volume 1, 3-5.5.1.4).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct TimeoutMultiplier(u8);

impl TimeoutMultiplier {
    /// 128 packet intervals: enough for a host that stalls for 100 intervals.
    pub const TIMES_128: Self = Self(5);

    /// Returns the multiplier of this code, if it is defined.
    #[must_use]
    pub const fn new(code: u8) -> Option<Self> {
        if code <= 7 { Some(Self(code)) } else { None }
    }

    /// Returns the smallest multiplier of at least this many packet intervals, if there is one.
    #[must_use]
    pub const fn at_least(intervals: u32) -> Option<Self> {
        let mut code = 0;
        while code <= 7 {
            if 4 << code >= intervals {
                return Some(Self(code));
            }
            code += 1;
        }
        None
    }

    /// Returns the number of packet intervals that a consumer waits: 4 to 512.
    #[must_use]
    pub const fn intervals(self) -> u32 {
        4 << self.0
    }

    /// Returns the code.
    #[must_use]
    pub const fn code(self) -> u8 {
        self.0
    }

    /// Returns how long a consumer with this packet interval waits: 4 to 512 intervals.
    #[must_use]
    pub fn timeout(self, packet_interval: Duration) -> Duration {
        packet_interval.saturating_mul(self.intervals())
    }
}

/// Shortest time that a consumer waits for the first frame of a connection (volume 1, 3-4.6.2).
const FIRST_FRAME: Duration = Duration::from_secs(10);

/// Detects that the other end of a connection has been silent for too long.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Watchdog {
    timeout: Duration,
    deadline: Instant,
    fed_at: Instant,
}

impl Watchdog {
    /// Starts with the connection: the first frame may take 10 s, or longer if the timeout is longer.
    #[must_use]
    pub fn start(now: Instant, timeout: Duration) -> Self {
        Self { timeout, deadline: now + timeout.max(FIRST_FRAME), fed_at: now }
    }

    /// Restarts the time: a frame was received.
    pub fn feed(&mut self, now: Instant) {
        self.deadline = now + self.timeout;
        self.fed_at = now;
    }

    /// Returns when the last frame was received, or when the connection was opened.
    #[must_use]
    pub const fn fed_at(&self) -> Instant {
        self.fed_at
    }

    /// Returns how long the connection lasts after a frame.
    #[must_use]
    pub const fn timeout(&self) -> Duration {
        self.timeout
    }

    /// Returns when the connection times out.
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        self.deadline
    }

    /// Returns whether the connection has timed out.
    #[must_use]
    pub fn expired(&self, now: Instant) -> bool {
        now >= self.deadline
    }
}

/// Keeps a producer that is triggered by changes from producing more often than the inhibit time allows.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Inhibit {
    time: Duration,
    free_at: Instant,
}

impl Inhibit {
    /// Creates the limit for a producer that may produce at once.
    #[must_use]
    pub const fn new(time: Duration, now: Instant) -> Self {
        Self { time, free_at: now }
    }

    /// Returns the inhibit time.
    #[must_use]
    pub const fn time(&self) -> Duration {
        self.time
    }

    /// Returns when the producer may produce again.
    #[must_use]
    pub const fn free_at(&self) -> Instant {
        self.free_at
    }

    /// Restarts the inhibit time: the producer has produced.
    pub fn produced(&mut self, now: Instant) {
        self.free_at = now + self.time;
    }
}

/// How many frames may be missing at once, besides those that time since the last frame explains.
const SLACK: u32 = 100;

/// Distinguishes new frames of a connection from late ones by the 32-bit sequence number (volume 2, 3-4.1).
#[must_use]
pub const fn sequence(packet_interval: Duration) -> Sequence {
    let cycle = packet_interval;
    Sequence::new(Numbering { mask: u32::MAX, newer: 0x7FFF_FFFF, slack: SLACK, step: 1, cycle })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_eight_multipliers_are_4_to_512_packet_intervals() {
        let intervals =
            |code| TimeoutMultiplier::new(code).map(|m| m.timeout(Duration::from_millis(1)).as_millis());
        let all: Vec<_> = (0..=8).map(intervals).collect();
        let expected = [4, 8, 16, 32, 64, 128, 256, 512].map(Some);
        assert_eq!(all[..8], expected);
        assert_eq!(all[8], None);
    }

    #[test]
    fn a_number_of_intervals_is_covered_by_the_next_multiplier_that_is_not_less() {
        let at_least = |intervals| TimeoutMultiplier::at_least(intervals).map(TimeoutMultiplier::intervals);
        let covered: Vec<_> = [0, 3, 4, 5, 100, 512, 513].map(at_least).into();
        assert_eq!(covered, [Some(4), Some(4), Some(4), Some(8), Some(128), Some(512), None]);
    }

    #[test]
    fn the_first_frame_may_take_ten_seconds_or_longer() {
        let start = |millis| Watchdog::start(Instant::ZERO, Duration::from_millis(millis)).deadline();
        assert_eq!(start(4), Instant::from_millis(10_000));
        assert_eq!(start(60_000), Instant::from_millis(60_000));
    }
}
