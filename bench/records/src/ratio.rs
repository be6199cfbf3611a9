//! The ratio of two means of one real run, with its confidence interval.
//!
//! On a shared host, absolute times depend on the neighbours as much as on the program. But the types of one run are
//! interleaved, so the host affects all of them equally, and their ratio can be judged. If the samples do not suffice
//! for a verdict, the verdict says so.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Number of resamples; the limits of a 95 % interval are then accurate to about a hundredth of its width.
const RESAMPLES: usize = 10_000;

/// Share of the resamples beyond each end of the interval.
const TAIL: f64 = 0.025;

/// Fewest samples of a type: fewer do not show their spread.
pub const FEWEST: usize = 5;

/// The ratio of two means, with its 95 % interval (percentile bootstrap).
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Ratio {
    /// Mean of the numerator divided by mean of the denominator.
    pub ratio: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

/// Whether a ratio is within a limit.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum RatioVerdict {
    /// The whole interval is at or below the limit.
    Within,
    /// The whole interval is above the limit.
    Beyond,
    /// The limit is inside the interval: the samples are too few or too scattered for a verdict.
    Inconclusive,
}

impl Ratio {
    /// Returns the ratio of the means of two types of one run, for example CM by RC. The same seed gives the same
    /// interval. `None` with fewer than five samples of either, or with times that are not positive.
    #[must_use]
    pub fn of(numerator_ms: &[f64], denominator_ms: &[f64], seed: u64) -> Option<Self> {
        let usable = |times: &[f64]| times.len() >= FEWEST && times.iter().all(|time| *time > 0.0);
        if !usable(numerator_ms) || !usable(denominator_ms) {
            return None;
        }
        let mean = |times: &[&f64]| times.iter().copied().sum::<f64>() / times.len() as f64;
        let all = |times| mean(&Vec::from_iter(times));
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let resample = || {
            let [numerator, denominator] = [numerator_ms, denominator_ms].map(|times: &[f64]| {
                let draw = draws(times.len(), &mut random);
                mean(&draw.filter_map(|index| times.get(index)).collect::<Vec<_>>())
            });
            numerator / denominator
        };
        Self::with_interval(all(numerator_ms) / all(denominator_ms), RESAMPLES, resample)
    }

    /// Returns the ratio of a statistic of paired samples, each of which may be a whole series. Both samples of a
    /// pair met the same state of the host, so they are resampled together. `None` with fewer than five pairs.
    #[must_use]
    pub fn of_pairs<T>(
        pairs: &[(T, T)],
        resamples: usize,
        seed: u64,
        statistic: impl Fn(&[&T]) -> f64,
    ) -> Option<Self> {
        if pairs.len() < FEWEST {
            return None;
        }
        let ratio = |pairs: &[&(T, T)]| {
            let (numerators, denominators): (Vec<&T>, Vec<&T>) = pairs.iter().map(|(a, b)| (a, b)).unzip();
            statistic(&numerators) / statistic(&denominators)
        };
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let resample = || {
            let draw = draws(pairs.len(), &mut random);
            ratio(&draw.filter_map(|index| pairs.get(index)).collect::<Vec<_>>())
        };
        Self::with_interval(ratio(&pairs.iter().collect::<Vec<_>>()), resamples, resample)
    }

    /// Returns the median of the ratios of paired samples, without pairs in which a sample is not positive. Anything
    /// that affects the host for longer than a pair takes cancels out; an effect on one sample of a pair moves the
    /// median no further than any other outlier. `None` with fewer than five pairs.
    #[must_use]
    pub fn median_of_pairs(pairs: &[(f64, f64)], seed: u64) -> Option<Self> {
        let usable = pairs.iter().filter(|(a, b)| *a > 0.0 && *b > 0.0);
        Self::median_of(&usable.map(|(a, b)| a / b).collect::<Vec<_>>(), seed)
    }

    /// Returns the median of samples, as a ratio by one of their unit. A stall of the host moves it no further than any other
    /// outlier. `None` with fewer than five samples.
    #[must_use]
    pub fn median_of(samples: &[f64], seed: u64) -> Option<Self> {
        if samples.len() < FEWEST {
            return None;
        }
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let resample =
            || median(draws(samples.len(), &mut random).filter_map(|index| samples.get(index).copied()));
        Self::with_interval(median(samples.iter().copied()), RESAMPLES, resample)
    }

    fn with_interval(ratio: f64, resamples: usize, mut resample: impl FnMut() -> f64) -> Option<Self> {
        let mut ratios: Vec<f64> = (0..resamples).map(|_| resample()).collect();
        ratios.sort_by(f64::total_cmp);
        let at =
            |share: f64| ratios.get((share * resamples.saturating_sub(1) as f64).round() as usize).copied();
        Some(Self { ratio, low: at(TAIL)?, high: at(1.0 - TAIL)? })
    }

    /// Compares the ratio with a limit.
    #[must_use]
    pub fn against(&self, limit: f64) -> RatioVerdict {
        if self.high <= limit {
            RatioVerdict::Within
        } else if self.low > limit {
            RatioVerdict::Beyond
        } else {
            RatioVerdict::Inconclusive
        }
    }
}

/// Returns the median, the higher one of two middle values; not a number if there are no figures.
pub fn median(figures: impl Iterator<Item = f64>) -> f64 {
    let mut figures: Vec<f64> = figures.collect();
    let middle = figures.len() / 2;
    if middle >= figures.len() {
        return f64::NAN;
    }
    *figures.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Draws as many indices as there are samples, each from all of them.
fn draws(count: usize, random: &mut Pcg64Mcg) -> impl Iterator<Item = usize> {
    (0..count).map(move |_| ((u128::from(random.next_u64()) * count as u128) >> 64) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns times evenly distributed over ± `spread` about `mean`.
    fn times(mean: f64, spread: f64) -> Vec<f64> {
        (0..25).map(|index| mean + spread * (f64::from(index) / 12.0 - 1.0)).collect()
    }

    #[test]
    fn the_interval_contains_the_ratio_and_its_width_is_the_spread_over_the_root_of_the_count() {
        let found = Ratio::of(&times(3730.0, 12.0), &times(3725.0, 12.0), 1).unwrap();
        assert!((found.ratio - 3730.0 / 3725.0).abs() < 1e-12);
        assert!(found.low < found.ratio && found.ratio < found.high);
        // Standard deviation 7.2 ms; of a mean of 25 samples, 1.44 ms; of the ratio √2 times that; 95 % is ± 1.96
        // times that.
        let expected = 2.0 * 1.96 * 1.44 * 2_f64.sqrt() / 3725.0;
        let width = found.high - found.low;
        assert!((width / expected - 1.0).abs() < 0.1, "{width} instead of {expected}");
    }

    #[test]
    fn a_limit_outside_the_interval_gives_a_verdict_and_one_inside_it_gives_none() {
        let found = Ratio::of(&times(3730.0, 12.0), &times(3725.0, 12.0), 1).unwrap();
        assert_eq!(found.against(1.01), RatioVerdict::Within);
        assert_eq!(found.against(0.99), RatioVerdict::Beyond);
        assert_eq!(found.against(found.ratio), RatioVerdict::Inconclusive);
    }

    #[test]
    fn pairs_are_compared_one_by_one_so_that_drift_and_stalls_of_the_host_cancel_out() {
        // The host becomes eleven times slower, and every seventh sample of either is a stall.
        let sample = |index: u32, factor: f64, phase| {
            let stall = if index % 7 == phase { 300.0 } else { 1.0 };
            (1.0 + f64::from(index) / 10.0) * factor * stall * (1.0 + f64::from(index % (phase + 3)) / 100.0)
        };
        let pairs: Vec<_> = (0..100).map(|index| (sample(index, 1.03, 2), sample(index, 1.0, 5))).collect();
        let found = Ratio::median_of_pairs(&pairs, 1).unwrap();
        assert!((found.ratio - 1.03).abs() < 0.02, "{found:?}");
        assert!(found.low > 1.0 && found.high < 1.06, "{found:?}");
        assert_eq!(Ratio::median_of_pairs(&[(1.0, 0.0); 100], 1), None);
    }

    #[test]
    fn the_same_seed_gives_the_same_interval_and_too_few_samples_none() {
        let (cm, rc) = (times(3730.0, 12.0), times(3725.0, 12.0));
        assert_eq!(Ratio::of(&cm, &rc, 7), Ratio::of(&cm, &rc, 7));
        assert_ne!(Ratio::of(&cm, &rc, 7), Ratio::of(&cm, &rc, 8));
        assert_eq!(Ratio::of(&cm[..4], &rc, 7), None);
        assert_eq!(Ratio::of(&cm, &[0.0; 25], 7), None);
    }
}
