//! Regularity of frames: the intervals between arrivals, compared with the requested interval.

use std::time::Duration;

use protocol_linux::Arrival;

use super::stopwatch::CYCLIC_LEN;

/// Time of a turn: arrivals within it count.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Window {
    /// Since 1970.
    pub(super) start: Duration,
    /// Since 1970.
    pub(super) end: Duration,
}

/// Regularity of the frames of all turns.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Evenness {
    /// Deviation of the mean interval from the requested one, in ppm: slope of the line through the arrivals, mean of
    /// all turns.
    pub(super) mean_ppm: f64,
    /// By how much each interval was longer than the requested one, in µs; a list per turn. If the sender keeps its
    /// grid, a longer interval is followed by one that is shorter by the same amount: this is the same frame's
    /// lateness and counts as zero.
    pub(super) turns_us: Vec<Vec<f64>>,
    /// Cycles without a frame: lost, or never sent.
    pub(super) missing: u64,
}

impl Evenness {
    /// Evaluates the arrivals in `turns` of frames that should arrive every `interval`.
    pub(super) fn of(arrivals: &[Arrival], turns: &[Window], interval: Duration) -> Self {
        let mut evenness = Self { mean_ppm: 0.0, turns_us: Vec::new(), missing: 0 };
        let mut slopes = Vec::new();
        for turn in turns {
            let within = |arrival: &&Arrival| {
                arrival.len >= CYCLIC_LEN && (turn.start..turn.end).contains(&arrival.since_1970)
            };
            let times: Vec<f64> = arrivals
                .iter()
                .filter(within)
                .map(|arrival| {
                    arrival.since_1970.saturating_sub(turn.start).as_secs_f64() / interval.as_secs_f64()
                })
                .collect();
            let expected =
                (turn.end.saturating_sub(turn.start).as_secs_f64() / interval.as_secs_f64()).round();
            // The first and the last cycle may be outside of the turn.
            evenness.missing += (expected as u64).saturating_sub(times.len() as u64 + 1);
            let late = times
                .windows(2)
                .filter_map(|pair| {
                    Some((pair.last()? - pair.first()? - 1.0).max(0.0) * interval.as_secs_f64() * 1e6)
                })
                .collect();
            evenness.turns_us.push(late);
            slopes.extend(slope(&times));
        }
        evenness.mean_ppm = (slopes.iter().sum::<f64>() / slopes.len() as f64 - 1.0) * 1e6;
        evenness
    }
}

/// Returns the nearest-rank quantile of all numbers of some turns.
pub(super) fn quantile(turns: &[&Vec<f64>], share: f64) -> Option<f64> {
    let mut all: Vec<f64> = turns.iter().copied().flatten().copied().collect();
    let rank = (share * all.len() as f64).ceil() as usize;
    let index = rank.max(1) - 1;
    (index < all.len()).then(|| *all.select_nth_unstable_by(index, f64::total_cmp).1)
}

/// Returns the least-squares slope of arrivals, in intervals, over their cycles. A mean of the intervals would depend
/// on the first and the last frame only.
fn slope(times: &[f64]) -> Option<f64> {
    let origin = *times.first()?;
    // A cycle without a frame counts as a cycle.
    let cycles: Vec<f64> = times.iter().map(|time| (time - origin).round()).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_time, mean_cycle) = (mean(times), mean(&cycles));
    let pairs = || cycles.iter().zip(times).map(|(cycle, time)| (cycle - mean_cycle, time - mean_time));
    let variance: f64 = pairs().map(|(cycle, _)| cycle * cycle).sum();
    (variance > 0.0).then(|| pairs().map(|(cycle, time)| cycle * time).sum::<f64>() / variance)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);
    const TURN: Window = Window { start: Duration::from_secs(10), end: Duration::from_secs(11) };

    fn quantile_us(evenness: &Evenness, share: f64) -> Option<f64> {
        quantile(&evenness.turns_us.iter().collect::<Vec<_>>(), share)
    }

    /// Returns a frame per cycle from half a cycle after the turn's start on, each late by the given ns.
    fn arrivals(period_ns: u64, late_ns: impl Fn(u64) -> Option<u64>) -> Vec<Arrival> {
        let frame = |cycle: u64| {
            let after = Duration::from_nanos(500_000 + cycle * period_ns + late_ns(cycle)?);
            Some(Arrival { since_1970: TURN.start + after, len: 318 })
        };
        (0..1_000).filter_map(frame).collect()
    }

    #[test]
    fn frames_on_the_grid_have_no_lateness() {
        let even = Evenness::of(&arrivals(1_000_000, |_| Some(0)), &[TURN], MS);
        assert!(even.mean_ppm.abs() < 1e-6 && quantile_us(&even, 1.0).unwrap() < 1e-6, "{even:?}");
        assert_eq!(even.missing, 0);
    }

    #[test]
    fn a_sender_clock_that_is_20_ppm_slow_changes_only_the_mean() {
        let slow = Evenness::of(&arrivals(1_000_020, |_| Some(0)), &[TURN], MS);
        assert!((slow.mean_ppm - 20.0).abs() < 0.01, "{}", slow.mean_ppm);
        assert!((quantile_us(&slow, 0.99).unwrap() - 0.02).abs() < 1e-6);
    }

    #[test]
    fn one_late_frame_in_fifty_changes_the_99th_percentile_and_not_the_mean() {
        let late = Evenness::of(
            &arrivals(1_000_000, |cycle| Some(u64::from(cycle % 50 == 7) * 80_000)),
            &[TURN],
            MS,
        );
        assert!(late.mean_ppm.abs() < 5.0, "{}", late.mean_ppm);
        assert_eq!(quantile_us(&late, 0.5).map(f64::round), Some(0.0));
        assert_eq!(quantile_us(&late, 0.99).map(f64::round), Some(80.0));
    }

    #[test]
    fn a_cycle_without_a_frame_counts_as_missing_and_does_not_change_the_mean() {
        let gap = Evenness::of(
            &arrivals(1_000_000, |cycle| (cycle != 500 && cycle != 501).then_some(0)),
            &[TURN],
            MS,
        );
        assert_eq!(gap.missing, 1, "one at a turn's end may be beyond it");
        assert!(gap.mean_ppm.abs() < 1e-6);
        assert_eq!(quantile_us(&gap, 1.0).map(f64::round), Some(2_000.0));
    }

    #[test]
    fn frames_between_turns_and_frames_that_are_not_cyclic_do_not_count() {
        let mut frames = arrivals(1_000_000, |_| Some(0));
        frames.insert(10, Arrival { since_1970: TURN.start + Duration::from_micros(10_100), len: 60 });
        frames.push(Arrival { since_1970: TURN.end + Duration::from_millis(300), len: 318 });
        let even = Evenness::of(&frames, &[TURN], MS);
        assert!(quantile_us(&even, 1.0).unwrap() < 1e-6, "{even:?}");
    }
}
