//! Means with their confidence intervals.
//!
//! The interval of a mean is that of Student's distribution, the interval of a difference that of Welch (1947): the types of
//! a run scatter differently.

use crate::statistics::deviation_from_mad;

/// Fewest samples of an interval: fewer do not show their spread.
pub const FEWEST: usize = 5;

/// 97.5 % quantile of the standard normal distribution.
const Z: f64 = 1.959_964;

/// A mean, or a difference of means, with what its confidence interval needs.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Mean {
    /// The mean, in ms.
    pub ms: f64,
    /// Its standard error, in ms.
    pub error_ms: f64,
    /// Degrees of freedom of that error.
    freedom: f64,
}

impl Mean {
    /// Returns the mean of measured times; `None` with fewer than [`FEWEST`].
    #[must_use]
    pub fn of(samples_ms: &[f64]) -> Option<Self> {
        if samples_ms.len() < FEWEST {
            return None;
        }
        let count = samples_ms.len() as f64;
        let ms = samples_ms.iter().sum::<f64>() / count;
        let squares: f64 = samples_ms.iter().map(|sample| (sample - ms) * (sample - ms)).sum();
        let freedom = count - 1.0;
        Some(Self { ms, error_ms: (squares / freedom / count).sqrt(), freedom })
    }

    /// Returns the mean that was published with this mean absolute deviation, of so many samples.
    #[must_use]
    pub fn published(aet_ms: f64, mad_ms: f64, count: u32) -> Option<Self> {
        let deviation = deviation_from_mad(mad_ms, count)?;
        let count = f64::from(count);
        Some(Self { ms: aet_ms, error_ms: deviation / count.sqrt(), freedom: count - 1.0 })
    }

    /// Returns an estimate with its standard error and the degrees of freedom of that error, such as a slope.
    #[must_use]
    pub const fn with_error(ms: f64, error_ms: f64, freedom: f64) -> Self {
        Self { ms, error_ms, freedom }
    }

    /// Subtracts the mean of other samples.
    #[must_use]
    pub fn less(self, other: Self) -> Self {
        let [own, others] = [self, other].map(|mean| mean.error_ms * mean.error_ms);
        let sum = own + others;
        let spent = own * own / self.freedom + others * others / other.freedom;
        // Two means without scatter have no error either.
        let freedom = if spent > 0.0 { sum * sum / spent } else { self.freedom.min(other.freedom) };
        Self { ms: self.ms - other.ms, error_ms: sum.sqrt(), freedom }
    }

    /// Returns half the width of the 95 % interval, in ms.
    #[must_use]
    pub fn margin_ms(&self) -> f64 {
        quantile(self.freedom) * self.error_ms
    }

    /// Returns the ends of the 95 % interval, in ms.
    #[must_use]
    pub fn interval_ms(&self) -> (f64, f64) {
        (self.ms - self.margin_ms(), self.ms + self.margin_ms())
    }
}

/// Returns the 97.5 % quantile of Student's distribution by its expansion about the normal one (Fisher and Cornish, 1960);
/// from four degrees of freedom on it is within 0.3 %.
fn quantile(freedom: f64) -> f64 {
    let square = Z * Z;
    let one = (square + 1.0) / 4.0;
    let two = ((5.0 * square + 16.0) * square + 3.0) / 96.0;
    let three = (((3.0 * square + 19.0) * square + 17.0) * square - 15.0) / 384.0;
    Z * (1.0 + (one + (two + three / freedom) / freedom) / freedom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quantiles_are_those_of_students_table() {
        for (freedom, expected) in [(4.0, 2.776), (9.0, 2.262), (24.0, 2.064), (1e6, 1.960)] {
            assert!((quantile(freedom) / expected - 1.0).abs() < 3e-3, "{freedom}: {}", quantile(freedom));
        }
    }

    #[test]
    fn the_interval_of_a_mean_is_known_from_five_samples_on() {
        // Standard deviation √2.5, of the mean √0.5; 2.776 times that is 1.963.
        let mean = Mean::of(&[1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        assert_eq!(mean.ms, 3.0);
        assert!((mean.margin_ms() - 1.963).abs() < 6e-3, "{}", mean.margin_ms());
        assert_eq!(Mean::of(&[1.0, 2.0, 3.0, 4.0]), None);
    }

    #[test]
    fn a_difference_has_the_freedom_of_welch() {
        // Errors 3 and 4 of 5 and 10 samples: 25² / (81/4 + 256/9) = 12.84.
        let mean = |error_ms, freedom| Mean { ms: 0.0, error_ms, freedom };
        let difference = mean(3.0, 4.0).less(mean(4.0, 9.0));
        assert_eq!(difference.error_ms, 5.0);
        assert!((difference.freedom - 12.836).abs() < 1e-3, "{}", difference.freedom);
        assert_eq!(mean(0.0, 4.0).less(mean(0.0, 9.0)).interval_ms(), (0.0, 0.0));
    }

    #[test]
    fn a_published_mean_has_the_error_that_follows_from_its_mad() {
        // 1.279 · 3.6 / 5, times 2.064.
        let margin = Mean::published(3725.0, 3.6, 25).unwrap().margin_ms();
        assert!((margin - 1.901).abs() < 5e-3, "{margin}");
    }
}
