//! The master axis: a position that the PLC moves on, and that arms follow, each on its own path.
//!
//! PLCopen part 4 has MC_SyncGroupToAxis for this: a group of axes is the slave of one axis. The position is a time in s: that
//! on the law of the slowest arm, so that no arm is ever faster than its own law. The rate is the share of that law's speed, 0 to 1.
//!
//! ```text
//! rate │   ┌────────╮            a start from rest is a step: the laws of the arms begin at rest themselves
//!      │   │         ╲           while arms move, the rate changes steadily
//!      │   │          ╲______
//!      └───┴─────────────────── time
//! ```
//!
//! The axis runs ahead of the PLC's clock: its position holds at a time that is yet to come, so that the arms have it before.

use machine::{Duration, Instant};

/// Largest change of the rate per s when it rises, and when it falls because somebody wants it: from rest to the full speed in
/// 0.5 s, and back in 0.25 s. Assumed: at 1.5 m/s it takes 3 and 6 m/s², about what arms have.
const RISE: f64 = 2.0;
const FALL: f64 = 4.0;

/// The same where an arm lags: at once, as far as arms of such cycles can.
const FALL_FOR_LAG: f64 = 20.0;

/// Time for which arms go on with the last rate when no set-point comes: see `docs/process-image.md`, Moving together.
const ARMS_GO_ON: Duration = Duration::from_millis(100);

/// Limits of the axis until the next scan.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct MasterDemand {
    /// Rate to go to, 0 to 1.
    pub rate: f64,
    /// Set while an arm lags: the rate then falls faster.
    pub is_lagging: bool,
    /// Position in s that the axis must not pass; it stands there.
    pub stop_at_s: f64,
    /// Set where every arm rests at that position by its own law, so that the axis need not slow down before.
    pub all_rest_there: bool,
}

/// The position of the master, its rate, and when they hold.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct MasterAxis {
    at: Instant,
    position_s: f64,
    rate: f64,
    /// Set where all arms stand where a law begins, so that the rate may begin with a step.
    arms_rest: bool,
}

impl MasterAxis {
    /// Creates an axis that stands at 0, where all arms rest; its position holds at `at`.
    #[must_use]
    pub const fn at_rest(at: Instant) -> Self {
        Self { at, position_s: 0.0, rate: 0.0, arms_rest: true }
    }

    /// Returns when the position holds, by the PLC's clock.
    #[must_use]
    pub const fn at(&self) -> Instant {
        self.at
    }

    /// Returns the position in s.
    #[must_use]
    pub const fn position_s(&self) -> f64 {
        self.position_s
    }

    /// Returns the rate, 0 to 1.
    #[must_use]
    pub const fn rate(&self) -> f64 {
        self.rate
    }

    /// Moves the axis on: its position then holds at `until`.
    ///
    /// After a stall that is longer than arms go on without set-points, the axis is where they stand.
    pub fn advance(&mut self, until: Instant, demand: &MasterDemand) {
        let passed = until.since(self.at);
        self.at = self.at.max(until);
        if passed > ARMS_GO_ON {
            self.go(self.rate * ARMS_GO_ON.as_secs_f64(), demand.stop_at_s);
            self.rate = 0.0;
            return;
        }
        let seconds = passed.as_secs_f64();
        let rate = self.next_rate(seconds, demand);
        let mean = if self.arms_rest { rate } else { 0.5 * (self.rate + rate) };
        self.rate = rate;
        self.go(mean * seconds, demand.stop_at_s);
        if self.position_s >= demand.stop_at_s {
            (self.rate, self.arms_rest) = (0.0, demand.all_rest_there);
        }
    }

    fn go(&mut self, by_s: f64, stop_at_s: f64) {
        let to_s = (self.position_s + by_s).min(stop_at_s).max(self.position_s);
        self.arms_rest &= to_s == self.position_s;
        self.position_s = to_s;
    }

    fn next_rate(&self, seconds: f64, demand: &MasterDemand) -> f64 {
        let mut rate = demand.rate.clamp(0.0, 1.0);
        if self.arms_rest {
            return rate;
        }
        let left_s = (demand.stop_at_s - self.position_s).max(0.0);
        if !demand.all_rest_there && left_s.is_finite() {
            // From this rate the axis comes to rest at the stop.
            let half = 0.5 * FALL * seconds;
            rate = rate.min((half * half + 2.0 * FALL * left_s).sqrt() - half);
        }
        let fall = if demand.is_lagging { FALL_FOR_LAG } else { FALL };
        rate.clamp(self.rate - fall * seconds, self.rate + RISE * seconds).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: Duration = Duration::from_millis(1);
    const FREE: MasterDemand =
        MasterDemand { rate: 1.0, is_lagging: false, stop_at_s: f64::INFINITY, all_rest_there: false };

    /// Moves the axis on in scans of 1 ms.
    fn advance(axis: &mut MasterAxis, scans: u32, demand: &MasterDemand) {
        (0..scans).for_each(|_| axis.advance(axis.at() + MS, demand));
    }

    #[test]
    fn from_rest_the_axis_goes_at_once_and_while_arms_move_its_rate_changes_steadily() {
        let mut axis = MasterAxis::at_rest(Instant::ZERO);
        advance(&mut axis, 20, &MasterDemand { rate: 0.0, ..FREE });
        assert_eq!((axis.position_s(), axis.rate()), (0.0, 0.0));
        advance(&mut axis, 1, &FREE);
        assert_eq!(axis.rate(), 1.0);
        advance(&mut axis, 100, &MasterDemand { rate: 0.5, ..FREE });
        assert!((axis.rate() - (1.0 - 0.1 * FALL)).abs() < 1e-9, "{axis:?}");
        advance(&mut axis, 200, &MasterDemand { rate: 0.5, ..FREE });
        assert!((axis.rate() - 0.5).abs() < 1e-9, "{axis:?}");
        advance(&mut axis, 100, &FREE);
        assert!((axis.rate() - (0.5 + 0.1 * RISE)).abs() < 1e-9, "{axis:?}");
    }

    #[test]
    fn at_a_stop_where_an_arm_is_on_its_way_the_axis_slows_down_before_and_where_all_rest_it_does_not() {
        for all_rest_there in [false, true] {
            let mut axis = MasterAxis::at_rest(Instant::ZERO);
            let demand = MasterDemand { stop_at_s: 1.0, all_rest_there, ..FREE };
            let mut before = 0.0;
            while axis.position_s() < 1.0 {
                before = axis.rate();
                advance(&mut axis, 1, &demand);
                assert!(axis.at() < Instant::from_millis(5_000), "{axis:?}");
            }
            assert_eq!((axis.position_s(), axis.rate()), (1.0, 0.0));
            assert_eq!(before > 0.9, all_rest_there, "{before}");
        }
    }

    #[test]
    fn after_a_stall_the_axis_is_where_arms_stand_that_had_no_set_points() {
        let mut axis = MasterAxis::at_rest(Instant::ZERO);
        advance(&mut axis, 500, &MasterDemand { rate: 0.5, ..FREE });
        let before = axis.position_s();
        axis.advance(axis.at() + MS * 700, &FREE);
        assert!((axis.position_s() - before - 0.05).abs() < 1e-9, "{axis:?}");
        assert_eq!(axis.rate(), 0.0);
        // A shorter one changes nothing.
        let (mut stalled, mut even) = (axis, axis);
        advance(&mut even, 50, &FREE);
        stalled.advance(stalled.at() + MS * 50, &FREE);
        assert!((stalled.position_s() - even.position_s()).abs() < 1e-9, "{stalled:?} {even:?}");
    }

    proptest! {
        #[test]
        fn the_axis_never_goes_back_never_passes_its_stop_and_never_goes_faster_than_its_law(
            scans in prop::collection::vec(
                (-1.0..2.0_f64, any::<bool>(), 0.0..3.0_f64, any::<bool>(), 0..300_000_u64), 1..200),
        ) {
            let mut axis = MasterAxis::at_rest(Instant::ZERO);
            let mut stop_at_s = 0.0_f64;
            for (rate, is_lagging, more_s, all_rest_there, micros) in scans {
                stop_at_s = stop_at_s.max(axis.position_s() + more_s);
                let before = axis;
                let passed = Duration::from_micros(micros);
                axis.advance(axis.at() + passed, &MasterDemand { rate, is_lagging, stop_at_s, all_rest_there });
                let went = axis.position_s() - before.position_s();
                prop_assert!((0.0..=passed.as_secs_f64().min(0.1) + 1e-12).contains(&went), "{before:?} {axis:?}");
                prop_assert!(axis.position_s() <= stop_at_s && (0.0..=1.0).contains(&axis.rate()), "{axis:?}");
            }
        }
    }
}
