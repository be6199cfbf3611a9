//! Lateness of the runs of a cyclic task: a histogram of fixed size, so that recording allocates nothing.

use crate::{Duration, Tick};

/// Buckets per power of two: the resolution is 1/16 of the value, 6 %.
const SUB_BUCKETS: u64 = 16;

/// Number of buckets: up to 2^40 ns, 18 minutes; later runs count in the last one.
const BUCKETS: usize = 38 * SUB_BUCKETS as usize;

/// A histogram of the lateness of a cyclic task.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Lateness {
    counts: [u32; BUCKETS],
    runs: u64,
    missed: u64,
    max: Duration,
}

impl Default for Lateness {
    fn default() -> Self {
        Self { counts: [0; BUCKETS], runs: 0, missed: 0, max: Duration::ZERO }
    }
}

impl Lateness {
    /// Counts one run and the cycles skipped after it.
    pub fn record(&mut self, tick: &Tick) {
        self.runs += 1;
        self.missed += tick.skipped;
        self.max = self.max.max(tick.lateness);
        if let Some(count) = self.counts.get_mut(bucket(tick.lateness)) {
            *count = count.saturating_add(1);
        }
    }

    /// Returns the number of runs so far.
    #[must_use]
    pub const fn runs(&self) -> u64 {
        self.runs
    }

    /// Returns the number of cycles that passed without a run.
    #[must_use]
    pub const fn missed(&self) -> u64 {
        self.missed
    }

    /// Returns the largest lateness.
    #[must_use]
    pub const fn max(&self) -> Duration {
        self.max
    }

    /// Returns the lateness that a share `quantile` (0…1) of the runs did not exceed, accurate to 6 %; zero without
    /// runs.
    #[must_use]
    pub fn quantile(&self, quantile: f64) -> Duration {
        let wanted = quantile.clamp(0.0, 1.0) * self.runs as f64;
        let mut seen = 0_u64;
        for (index, count) in self.counts.iter().enumerate() {
            seen += u64::from(*count);
            if seen > 0 && seen as f64 >= wanted {
                return upper_end(index).min(self.max);
            }
        }
        self.max
    }

    /// Returns the buckets with runs: each one's upper bound and its number of runs.
    pub fn buckets(&self) -> impl Iterator<Item = (Duration, u32)> {
        let held = self.counts.iter().enumerate().filter(|(_, count)| **count > 0);
        held.map(|(index, count)| (upper_end(index), *count))
    }
}

/// Returns the index of a lateness's bucket. Values below 16 ns have a bucket each; above, the four bits below the
/// highest one choose the bucket.
fn bucket(lateness: Duration) -> usize {
    let nanos = u64::try_from(lateness.as_nanos()).unwrap_or(u64::MAX);
    if nanos < SUB_BUCKETS {
        return nanos as usize;
    }
    let power = u64::from(nanos.ilog2());
    let sub = (nanos >> (power - 4)) - SUB_BUCKETS;
    (((power - 3) * SUB_BUCKETS + sub) as usize).min(BUCKETS - 1)
}

fn upper_end(bucket: usize) -> Duration {
    let bucket = bucket as u64;
    if bucket < SUB_BUCKETS {
        return Duration::from_nanos(bucket);
    }
    let (power, sub) = (bucket / SUB_BUCKETS + 3, bucket % SUB_BUCKETS);
    Duration::from_nanos(((SUB_BUCKETS + sub + 1) << (power - 4)) - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Instant;
    use proptest::prelude::*;

    fn late(nanos: u64) -> Tick {
        Tick { due: Instant::ZERO, lateness: Duration::from_nanos(nanos), skipped: nanos / 1_000_000 }
    }

    #[test]
    fn the_quantiles_of_a_known_distribution_are_found_to_6_percent() {
        let mut lateness = Lateness::default();
        for micros in 1..=1_000 {
            lateness.record(&late(micros * 1_000));
        }
        let p50 = lateness.quantile(0.5).as_nanos() as f64 / 500_000.0;
        let p99 = lateness.quantile(0.99).as_nanos() as f64 / 990_000.0;
        assert!((1.0..1.07).contains(&p50) && (1.0..1.07).contains(&p99), "p50 × {p50}, p99 × {p99}");
        assert_eq!(
            (lateness.max(), lateness.runs(), lateness.missed()),
            (Duration::from_millis(1), 1_000, 1)
        );
        assert_eq!(lateness.buckets().map(|(_, count)| u64::from(count)).sum::<u64>(), 1_000);
    }

    proptest! {
        #[test]
        fn a_value_lies_in_its_bucket(nanos in 0..1_u64 << 40) {
            let index = bucket(Duration::from_nanos(nanos));
            prop_assert!(upper_end(index) >= Duration::from_nanos(nanos));
            prop_assert!(index == 0 || upper_end(index - 1) < Duration::from_nanos(nanos));
        }
    }
}
