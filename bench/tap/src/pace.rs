//! Intervals and lateness of the frames of one direction.
//!
//! The lateness of a frame is how much later it came than the most punctual of the last 256 to 512 frames would have it. So the
//! sender's clock may drift against that of the capture: at 50 ppm and 1 ms that adds 26 µs at most.

use std::time::Duration;

use machine::{Instant, Lateness, Tick};

/// Frames of which the most punctual one sets the schedule, twice.
const WINDOW: u32 = 256;

/// Intervals and lateness.
#[derive(Clone, Default, Debug)]
pub(crate) struct FramePace {
    cycle_ns: u64,
    last_ns: Option<u64>,
    /// Cycles from the first frame to this one.
    cycles: u64,
    frames_in_window: u32,
    /// Smallest phase of this window and of the one before.
    earliest: [Option<i128>; 2],
    intervals: Lateness,
    shortest_ns: Option<u64>,
    sum_ns: u128,
    lateness: Lateness,
}

impl FramePace {
    /// Sets the time from frame to frame, in ns. A change starts the schedule of the frames again.
    pub(crate) const fn set_cycle(&mut self, cycle_ns: u64) {
        if self.cycle_ns != cycle_ns {
            self.cycle_ns = cycle_ns;
            self.restart_schedule();
        }
    }

    const fn restart_schedule(&mut self) {
        self.cycles = 0;
        self.frames_in_window = 0;
        self.earliest = [None; 2];
    }

    /// Adds a frame that came at this time after so many that are missing.
    pub(crate) fn add(&mut self, now_ns: u64, missing: u64) {
        if let Some(last) = self.last_ns {
            let interval = now_ns.saturating_sub(last);
            self.intervals.record(&tick(interval));
            self.shortest_ns = Some(self.shortest_ns.map_or(interval, |shortest| shortest.min(interval)));
            self.sum_ns += u128::from(interval);
            self.cycles = self.cycles.saturating_add(missing).saturating_add(1);
        }
        self.last_ns = Some(now_ns);
        let phase = i128::from(now_ns) - i128::from(self.cycles) * i128::from(self.cycle_ns);
        if self.frames_in_window == WINDOW {
            self.frames_in_window = 0;
            self.earliest = [None, self.earliest[0]];
        }
        self.frames_in_window += 1;
        self.earliest[0] = Some(self.earliest[0].map_or(phase, |earliest| earliest.min(phase)));
        let earliest = self.earliest.iter().flatten().min().copied().unwrap_or(phase);
        self.lateness.record(&tick(u64::try_from(phase - earliest).unwrap_or(u64::MAX)));
    }

    /// Starts a new connection: the time since its last frame is not an interval.
    pub(crate) const fn disconnect(&mut self) {
        self.last_ns = None;
        self.restart_schedule();
    }

    pub(crate) const fn cycle_ns(&self) -> u64 {
        self.cycle_ns
    }

    pub(crate) const fn intervals(&self) -> &Lateness {
        &self.intervals
    }

    pub(crate) const fn lateness(&self) -> &Lateness {
        &self.lateness
    }

    pub(crate) const fn shortest_ns(&self) -> Option<u64> {
        self.shortest_ns
    }

    /// Returns the mean interval in ns.
    pub(crate) fn mean_ns(&self) -> Option<f64> {
        let count = self.intervals.runs();
        (count > 0).then(|| self.sum_ns as f64 / count as f64)
    }
}

/// Returns a value for the histograms, which count the lateness of ticks.
pub(crate) const fn tick(nanos: u64) -> Tick {
    Tick { due: Instant::ZERO, lateness: Duration::from_nanos(nanos), skipped: 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_frame_is_late_and_the_drift_of_the_senders_clock_is_not() {
        let mut pace = FramePace::default();
        pace.set_cycle(1_000_000);
        let mut highest = 0;
        for number in 0..100_000_u64 {
            // 50 ppm slow, and frame 70,000 comes 300 µs late.
            let late = if number == 70_000 { 300_000 } else { 0 };
            pace.add(number * 1_000_050 + late, 0);
            if number == 69_999 {
                highest = pace.lateness().max().as_micros();
            }
        }
        assert!(highest <= 26, "{highest} us");
        let max = pace.lateness().max().as_micros();
        assert!((300..=326).contains(&max), "{max} us");
        assert_eq!(pace.shortest_ns(), Some(1_000_050 - 300_000));
    }

    #[test]
    fn missing_frames_do_not_make_the_next_one_late() {
        let mut pace = FramePace::default();
        pace.set_cycle(1_000_000);
        (0..100_u64).for_each(|number| pace.add(number * 1_000_000, 0));
        pace.add(105_000_000, 5);
        assert_eq!(pace.lateness().max(), Duration::ZERO);
        assert_eq!(pace.intervals().max(), Duration::from_millis(6));
    }
}
