//! The paper's figures from measured execution times.

use std::f64::consts::{FRAC_PI_2, PI};
use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Average execution time and mean absolute deviation of one execution type.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct AetMad {
    /// AET: the mean, in ms.
    pub aet_ms: f64,
    /// MAD: the mean absolute deviation from the mean, in ms. It is not the median absolute deviation, which many
    /// tools call MAD.
    pub mad_ms: f64,
}

impl From<setup::PaperRow> for AetMad {
    fn from(setup::PaperRow { aet_ms, mad_ms }: setup::PaperRow) -> Self {
        Self { aet_ms, mad_ms }
    }
}

impl AetMad {
    /// Computes AET and MAD of these execution times; `None` without times.
    ///
    /// The mean is computed from integer nanoseconds, so that it does not depend on the order.
    #[must_use]
    pub fn of(times: impl Iterator<Item = Duration> + Clone) -> Option<Self> {
        let count = times.clone().count();
        if count == 0 {
            return None;
        }
        let count = count as f64;
        let sum_ns: u128 = times.clone().map(|time| time.as_nanos()).sum();
        let aet_ns = sum_ns as f64 / count;
        let deviation_ns: f64 = times.map(|time| (time.as_nanos() as f64 - aet_ns).abs()).sum();
        Some(Self { aet_ms: aet_ns / 1e6, mad_ms: deviation_ns / count / 1e6 })
    }
}

/// Returns the standard deviation of a normal distribution that a mean absolute deviation of `count` samples from their
/// mean points to, in its unit; `None` for fewer than two samples.
///
/// The mean absolute deviation is √(2/π) of the standard deviation, and √((n − 1) / n) less for the mean being that of the
/// same samples: a factor of 1.279 at n = 25.
#[must_use]
pub fn deviation_from_mad(mad: f64, count: u32) -> Option<f64> {
    let count = f64::from(count);
    (count >= 2.0).then(|| mad * (FRAC_PI_2 * count / (count - 1.0)).sqrt())
}

/// Returns the standard error of the mean of `count` samples with this mean absolute deviation: 0.256 of it at n = 25.
#[must_use]
pub fn error_of_mean(mad: f64, count: u32) -> Option<f64> {
    deviation_from_mad(mad, count).map(|deviation| deviation / f64::from(count).sqrt())
}

/// Returns the standard error of the mean absolute deviation of `count` samples, where that of the distribution is `mad` at
/// `mad_count` samples: 0.154 of it where both are 25 (R. A. Fisher, 1920: normal distribution).
#[must_use]
pub fn error_of_mad(mad: f64, mad_count: u32, count: u32) -> Option<f64> {
    let deviation = deviation_from_mad(mad, mad_count)?;
    let n = f64::from(count);
    (n >= 2.0).then(|| {
        let spread = FRAC_PI_2 + (n * (n - 2.0)).sqrt() - n + libm::asin(1.0 / (n - 1.0));
        deviation * (2.0 * (n - 1.0) / (PI * n * n) * spread).max(0.0).sqrt()
    })
}

/// Computes AETi, the paper's formula (1): the share (0…1) of SM's execution time that CM saves.
#[must_use]
pub fn aet_improvement(sm_aet_ms: f64, cm_aet_ms: f64) -> f64 {
    (sm_aet_ms - cm_aet_ms) / sm_aet_ms
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    fn millis(times: &[u64]) -> Option<AetMad> {
        AetMad::of(times.iter().map(|time| Duration::from_millis(*time)))
    }

    #[test]
    fn mad_is_the_mean_absolute_deviation_from_the_mean_and_not_from_the_median() {
        // Mean 4; deviations 3, 2, 1, 6. The median is 2.5, and the median deviation from it 1.
        assert_eq!(millis(&[1, 2, 3, 10]), Some(AetMad { aet_ms: 4.0, mad_ms: 3.0 }));
    }

    #[test]
    fn one_time_has_no_deviation_and_no_times_have_no_figure() {
        assert_eq!(millis(&[3725]), Some(AetMad { aet_ms: 3725.0, mad_ms: 0.0 }));
        assert_eq!(millis(&[]), None);
    }

    #[test]
    fn of_25_samples_of_a_normal_distribution_mads_and_means_scatter_as_their_formulas_say() {
        let approx = |value: Option<f64>, wanted: f64| (value.unwrap() - wanted).abs() < 5e-4;
        assert!(approx(deviation_from_mad(1.0, 25), 1.2791), "{:?}", deviation_from_mad(1.0, 25));
        assert!(approx(error_of_mean(1.0, 25), 0.2558), "{:?}", error_of_mean(1.0, 25));
        assert!(approx(error_of_mad(1.0, 25, 25), 0.1538), "{:?}", error_of_mad(1.0, 25, 25));
        assert_eq!((deviation_from_mad(1.0, 1), error_of_mad(1.0, 25, 1)), (None, None));
        // The same by 4,000 draws, each uniform sum of twelve about normal.
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX);
        let draws: Vec<[f64; 2]> = (0..4_000)
            .map(|_| {
                let times: Vec<f64> = (0..25).map(|_| (0..12).map(|_| uniform()).sum::<f64>()).collect();
                let mean = times.iter().sum::<f64>() / 25.0;
                [mean, times.iter().map(|time| (time - mean).abs()).sum::<f64>() / 25.0]
            })
            .collect();
        let mean = |index: usize| draws.iter().map(|draw| draw[index]).sum::<f64>() / 4_000.0;
        let scatter = |index: usize| {
            let squares = draws
                .iter()
                .map(|draw| (draw[index] - mean(index)) * (draw[index] - mean(index)))
                .sum::<f64>();
            (squares / 4_000.0).sqrt()
        };
        let mad = mean(1);
        assert!((deviation_from_mad(mad, 25).unwrap() - 1.0).abs() < 0.02, "{mad}");
        assert!((scatter(0) / error_of_mean(mad, 25).unwrap() - 1.0).abs() < 0.04, "{}", scatter(0));
        assert!((scatter(1) / error_of_mad(mad, 25, 25).unwrap() - 1.0).abs() < 0.04, "{}", scatter(1));
    }

    #[test]
    fn the_mad_of_two_samples_scatters_as_half_of_their_difference_does() {
        // The difference of two samples of a normal distribution is normal with √2 of its standard deviation σ, and the
        // deviation of the absolute value of a normal one is √(1 − 2/π) of its own: half of it is σ √((1 − 2/π) / 2).
        let deviation = deviation_from_mad(1.0, 2).unwrap();
        let expected = deviation * ((1.0 - 2.0 / PI) / 2.0).sqrt();
        let found = error_of_mad(1.0, 2, 2).unwrap();
        assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
    }

    #[test]
    fn the_papers_improvements_follow_from_its_table_2() {
        let percent = |sm, cm| (aet_improvement(sm, cm) * 100.0).round();
        assert_eq!((percent(6477.0, 3729.0), percent(8971.0, 7617.0)), (42.0, 15.0));
    }
}
