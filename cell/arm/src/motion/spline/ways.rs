//! The way along a piece in mm, and the share of the piece after a way.

use super::quintic::Quintic;
use crate::{distance, length};

/// Parts into which the piece is cut to measure its length.
const PARTS: usize = 8;

/// One of them, as a share of the piece.
const PART: f64 = 1.0 / PARTS as f64;

/// Largest number of intervals within a part whose ways are measured one by one: where the curve almost turns back.
const MOST_INTERVALS: u8 = 16;

/// Where the derivative of the position by the share changes within a part by no more than this share of it, one interval is
/// enough.
const STEADY: f64 = 0.75;

/// Largest share by which twice as many intervals may change the way of a part. The speed along it is off by some twenty times
/// as much.
const WELL_MEASURED: f64 = 1e-7;

/// A step of Newton's method that is smaller than this share of a part leaves an error of less than a hundred-millionth
/// of it: each step squares the error.
const LAST_STEP: f64 = 1e-4;

/// Largest number of steps: where the way hardly grows with τ, one is not enough.
const NEWTON_STEPS: usize = 4;

/// Points and weights of Gauss-Legendre quadrature over 0…1.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// Where a curve is after which way.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Ways {
    /// The way at the end of each part, in mm.
    ends: [f64; PARTS],
    /// How many intervals of each part are measured one by one.
    intervals: [u8; PARTS],
    /// How τ grows with the way where each part begins, and at the end: its first two derivatives, by mm.
    growth: [[f64; 2]; PARTS + 1],
}

/// A guessed share: within a part from `start` to `end`, which begins after a way in mm and is measured in intervals.
#[derive(Clone, Copy)]
struct Guess {
    intervals: u8,
    start: f64,
    end: f64,
    start_way: f64,
    share: f64,
}

impl Ways {
    /// Those of a straight line that is so many mm long and driven evenly.
    pub(super) fn of_line(way: f64) -> Self {
        Self {
            ends: core::array::from_fn(|part| way * (part + 1) as f64 * PART),
            intervals: [1; PARTS],
            growth: [[1.0 / way, 0.0]; PARTS + 1],
        }
    }

    /// Measures a curve.
    pub(super) fn of(curve: &Quintic) -> Self {
        let (mut ends, mut intervals, mut way) = ([0.0; PARTS], [1; PARTS], 0.0);
        for part in 0..PARTS {
            let (of_part, cut) = measured(curve, part as f64 * PART, (part + 1) as f64 * PART);
            way += of_part;
            (ends[part], intervals[part]) = (way, cut);
        }
        let growth = core::array::from_fn(|border| curve.growth_at(border as f64 * PART));
        Self { ends, intervals, growth }
    }

    /// The whole way, in mm.
    pub(super) const fn length(&self) -> f64 {
        self.ends[PARTS - 1]
    }

    /// The shares τ of the piece after some ways: first guessed, then by Newton's method, of which one step is enough as a
    /// rule. Each step waits for roots and quotients, so all shares take it together.
    pub(super) fn shares<const N: usize>(&self, curve: &Quintic, ways: &[f64; N]) -> [f64; N] {
        let mut guesses = ways.map(|way| self.guess(way));
        // For a way outside of the piece no share is needed.
        let mut is_off = ways.map(|way| way > 0.0 && way < self.length());
        for _ in 0..NEWTON_STEPS {
            for ((guess, is_off), way) in guesses.iter_mut().zip(&mut is_off).zip(ways) {
                if *is_off {
                    let Guess { intervals, start, end, start_way, share } = *guess;
                    let off = start_way + way_between(curve, start, share, intervals) - way;
                    let step = off / curve.speed(share).max(1e-9);
                    guess.share = (share - step).clamp(start, end);
                    *is_off = step.abs() >= LAST_STEP * PART;
                }
            }
        }
        guesses.map(|guess| guess.share)
    }

    /// The share after `way` by the polynomial of degree five that has the part's ends and how τ grows with the way there.
    fn guess(&self, way: f64) -> Guess {
        let part = self.ends.partition_point(|end| *end < way).min(PARTS - 1);
        let (start, end) = (part as f64 * PART, (part + 1) as f64 * PART);
        let start_way = if part == 0 { 0.0 } else { self.ends[part - 1] };
        let width = (self.ends[part] - start_way).max(1e-12);
        let t = (way - start_way) / width;
        let [[slope, bend], [end_slope, end_bend]] = [self.growth[part], self.growth[part + 1]]
            .map(|[first, second]| [first * width, second * width * width]);
        // The differences from the parabola of the start at the end: of τ and of its derivatives.
        let [rest, of_slope, of_bend] =
            [PART - slope - bend / 2.0, end_slope - slope - bend, end_bend - bend];
        let cubic = 10.0 * rest - 4.0 * of_slope + of_bend / 2.0;
        let quartic = -15.0 * rest + 7.0 * of_slope - of_bend;
        let quintic = 6.0 * rest - 3.0 * of_slope + of_bend / 2.0;
        let grown = t * (slope + t * (bend / 2.0 + t * (cubic + t * (quartic + t * quintic))));
        let share = (start + grown).clamp(start, end);
        Guess { intervals: self.intervals[part], start, end, start_way, share }
    }
}

/// The way in mm from one share to another, and the number of intervals that it takes to measure it well.
fn measured(curve: &Quintic, from: f64, to: f64) -> (f64, u8) {
    let (mut way, mut intervals) = (way_between(curve, from, to, 1), 1);
    let [start, end] = [from, to].map(|share| curve.slope(share));
    if distance(start, end) <= STEADY * length(start).min(length(end)) {
        return (way, intervals);
    }
    while intervals < MOST_INTERVALS {
        let finer = way_between(curve, from, to, 2 * intervals);
        if (finer - way).abs() <= WELL_MEASURED * finer {
            break;
        }
        (way, intervals) = (finer, 2 * intervals);
    }
    (way, intervals)
}

/// The way in mm from one share to another, in so many intervals.
fn way_between(curve: &Quintic, from: f64, to: f64, intervals: u8) -> f64 {
    if intervals == 1 {
        return way_in_one(curve, from, to);
    }
    let border = |interval| from + f64::from(interval) / f64::from(intervals) * (to - from);
    (0..intervals).map(|interval| way_in_one(curve, border(interval), border(interval + 1))).sum()
}

fn way_in_one(curve: &Quintic, from: f64, to: f64) -> f64 {
    let sum: f64 = GAUSS.iter().map(|(at, weight)| weight * curve.speed(from + at * (to - from))).sum();
    sum * (to - from)
}

#[cfg(test)]
mod tests {
    use super::super::tests::pieces;
    use super::*;

    /// Gentle pieces, and some that almost turn back at their targets.
    fn curves(side: f64) -> Vec<Quintic> {
        let target = |index: u8| {
            let x = 40.0 * f64::from(index);
            [x, if index.is_multiple_of(2) { side } else { 0.0 }, 0.0, 0.0, 0.0, 0.0]
        };
        let targets: Vec<_> = (0..6).map(target).collect();
        pieces(&targets).into_iter().map(|piece| piece.curve).collect()
    }

    /// The way by very many short intervals.
    fn measured_finely(curve: &Quintic, to: f64) -> f64 {
        way_between_many(curve, to, 4_096)
    }

    fn way_between_many(curve: &Quintic, to: f64, intervals: u32) -> f64 {
        let border = |interval: u32| to * f64::from(interval) / f64::from(intervals);
        (0..intervals).map(|interval| way_in_one(curve, border(interval), border(interval + 1))).sum()
    }

    #[test]
    fn a_curve_is_as_long_as_by_very_many_intervals() {
        for side in [0.0, 10.0, 60.0, 300.0, 900.0] {
            for curve in curves(side) {
                let ways = Ways::of(&curve);
                let whole = measured_finely(&curve, 1.0);
                assert!((ways.length() / whole - 1.0).abs() < 1e-6, "{} mm for {whole} mm", ways.length());
                for (part, end) in ways.ends.into_iter().enumerate() {
                    let way = measured_finely(&curve, (part + 1) as f64 * PART);
                    assert!((end - way).abs() < 1e-6 * whole, "{end} for {way} of {whole} mm");
                }
                let most = if side > 500.0 {
                    8
                } else if side > 100.0 {
                    2
                } else {
                    1
                };
                assert_eq!(ways.intervals.into_iter().max(), Some(most), "a curve {side} mm to the side");
                assert_eq!(ways.intervals[2..6], [1; 4], "it is steady in the middle");
            }
        }
    }

    #[test]
    fn a_guess_is_near_and_a_share_is_exact() {
        // How far a guess is off at most, in parts.
        for (side, most) in [(0.0, 1e-12), (10.0, 2e-6), (60.0, 3.2e-4), (300.0, 7.3e-3), (900.0, 9e-3)] {
            for curve in curves(side) {
                let ways = Ways::of(&curve);
                let mut worst = 0.0_f64;
                for number in 1..40 {
                    let way = ways.length() * f64::from(number) / 40.0;
                    let [share] = ways.shares(&curve, &[way]);
                    let found = measured_finely(&curve, share);
                    assert!((found - way).abs() < 1e-6 * ways.length(), "{found} for {way} mm");
                    let guess = ways.guess(way);
                    assert!(
                        (guess.start..=guess.end).contains(&share),
                        "{share} is not from {} on",
                        guess.start
                    );
                    assert!((guess.end - guess.start - PART).abs() < 1e-12);
                    let off =
                        guess.start_way + way_between(&curve, guess.start, share, guess.intervals) - way;
                    assert!(off.abs() < 1e-9 * ways.length(), "{off} mm");
                    worst = worst.max((guess.share - share).abs() / PART);
                }
                assert!(worst <= most, "{worst} of a part");
            }
        }
        let line = Ways::of_line(40.0);
        assert!((line.guess(13.0).share - 13.0 / 40.0).abs() < 1e-12);
    }
}
