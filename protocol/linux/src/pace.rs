//! How often frames may wake the thread.
//!
//! A wake-up costs some 20 µs, several times what a frame costs. The frames of many stations arrive at any instants of a
//! cycle; if each woke the thread, 64 stations at a cycle of 1 ms would need more than one processor for this alone. So a
//! machine that receives often and does not answer gets its frames in groups. One with few stations, and one that waits for
//! each answer before it sends on, as at start-up, never notices.

use machine::{Duration, Instant};

/// Time between two wake-ups by frames at the pace that may last, besides one in each cycle of the machine.
const INTERVAL: Duration = Duration::from_micros(250);

/// Wake-ups that may follow one another faster.
const BURST: u32 = 32;

/// Counts the wake-ups by frames that the machine did not answer.
#[derive(Debug)]
pub(crate) struct Pace {
    /// Time that wake-ups may take up, at most that of a burst. Each takes [`INTERVAL`].
    credit: Duration,
    /// When the credit was counted last.
    counted: Instant,
}

impl Pace {
    /// Starts with the credit for a burst.
    pub(crate) const fn new(now: Instant) -> Self {
        Self { credit: INTERVAL.saturating_mul(BURST), counted: now }
    }

    fn let_pass(&mut self, now: Instant) {
        self.add(now.since(self.counted));
        self.counted = now;
    }

    fn add(&mut self, credit: Duration) {
        self.credit = (self.credit + credit).min(INTERVAL.saturating_mul(BURST));
    }

    /// Counts a wake-up by frames that the machine did not answer.
    pub(crate) fn count_wakeup(&mut self, now: Instant) {
        self.let_pass(now);
        self.credit = self.credit.saturating_sub(INTERVAL);
    }

    /// Counts a deadline of the machine: however short its cycle is, a frame in each may wake the thread.
    pub(crate) fn count_deadline(&mut self) {
        self.add(INTERVAL);
    }

    /// Returns until when frames do not wake the thread; `None` if they do.
    pub(crate) fn pause(&mut self, now: Instant) -> Option<Instant> {
        self.let_pass(now);
        (self.credit < INTERVAL).then(|| now + (INTERVAL - self.credit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns how many wake-ups frames cause in a second that arrive at these intervals, in cycles of this length.
    fn wakeups(between: Duration, cycle: Duration) -> u32 {
        let mut pace = Pace::new(Instant::ZERO);
        let (mut now, mut deadline, mut wakeups) = (Instant::ZERO, Instant::ZERO, 0);
        while now < Instant::ZERO + Duration::from_secs(1) {
            // The frames that arrive in a pause are handled at its end, or at the deadline before.
            let wake = pace.pause(now).unwrap_or(now + between);
            if deadline <= wake {
                now = deadline;
                deadline += cycle;
                pace.count_deadline();
            } else {
                now = wake;
                pace.count_wakeup(now);
                wakeups += 1;
            }
        }
        wakeups
    }

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_frame_in_each_cycle_wakes_the_thread_however_short_the_cycle_is() {
        for micros in [62, 125, 250, 1_000, 4_000] {
            let cycle = Duration::from_micros(micros);
            // Frames and deadlines in turn: the time between two frames restarts with each deadline.
            let wakeups = wakeups(cycle / 2, cycle);
            assert!(u64::from(wakeups) >= 1_000_000 / micros - 2, "{micros} µs: {wakeups} wake-ups");
        }
    }

    #[test]
    fn frames_of_many_stations_wake_the_thread_five_times_a_millisecond() {
        for stations in [16, 64, 250] {
            let wakeups = wakeups(MS / stations, MS);
            assert!((3_500..=5_000 + BURST).contains(&wakeups), "{stations} stations: {wakeups} wake-ups");
        }
    }

    #[test]
    fn a_burst_after_silence_is_not_slowed_down() {
        let mut pace = Pace::new(Instant::ZERO);
        let mut now = Instant::ZERO;
        for _ in 0..2 {
            now += Duration::from_secs(1);
            for _ in 1..BURST {
                now += Duration::from_micros(20);
                assert_eq!(pace.pause(now), None);
                pace.count_wakeup(now);
            }
            for _ in 0..10 {
                now += Duration::from_micros(20);
                let _ = pace.pause(now);
                pace.count_wakeup(now);
            }
            assert!(pace.pause(now).is_some());
        }
    }
}
