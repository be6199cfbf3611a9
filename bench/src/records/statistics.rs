//! The paper's figures from measured execution times.

use std::time::Duration;

/// Average execution time and mean absolute deviation of one execution type.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Figure {
    /// AET: the mean, in ms.
    pub aet_ms: f64,
    /// MAD: the mean absolute deviation from the mean, in ms. It is not the median absolute deviation, which many
    /// tools call MAD.
    pub mad_ms: f64,
}

impl Figure {
    /// Computes the figure of these execution times; `None` without times.
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

/// Computes AETi, the paper's formula (1): the share (0…1) of SM's execution time that CM saves.
#[must_use]
pub fn aet_improvement(sm_aet_ms: f64, cm_aet_ms: f64) -> f64 {
    (sm_aet_ms - cm_aet_ms) / sm_aet_ms
}

#[cfg(test)]
mod tests {
    use super::*;

    fn millis(times: &[u64]) -> Option<Figure> {
        Figure::of(times.iter().map(|time| Duration::from_millis(*time)))
    }

    #[test]
    fn mad_is_the_mean_absolute_deviation_from_the_mean_and_not_from_the_median() {
        // Mean 4; deviations 3, 2, 1, 6. The median is 2.5, and the median deviation from it 1.
        assert_eq!(millis(&[1, 2, 3, 10]), Some(Figure { aet_ms: 4.0, mad_ms: 3.0 }));
    }

    #[test]
    fn one_time_has_no_deviation_and_no_times_have_no_figure() {
        assert_eq!(millis(&[3725]), Some(Figure { aet_ms: 3725.0, mad_ms: 0.0 }));
        assert_eq!(millis(&[]), None);
    }

    #[test]
    fn the_papers_improvements_follow_from_its_table_2() {
        let percent = |sm, cm| (aet_improvement(sm, cm) * 100.0).round();
        assert_eq!((percent(6477.0, 3729.0), percent(8971.0, 7617.0)), (42.0, 15.0));
    }
}
