//! The set-points that an arm was sent last, to compare where it is with where it should be.

/// Set-points that are kept: 60 ms ahead and more than 100 ms back at a scan of 1 ms.
const KEPT: usize = 256;

/// Set-points by the time of the robot's clock at which they hold, in a ring.
#[derive(Clone, Debug)]
pub(super) struct SentSetPoints {
    ring: [(u64, f64); KEPT],
    count: usize,
}

impl Default for SentSetPoints {
    fn default() -> Self {
        Self { ring: [(0, 0.0); KEPT], count: 0 }
    }
}

impl SentSetPoints {
    pub(super) const fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds a set-point: the time on the law in s that holds at a time of the robot's clock.
    pub(super) fn push(&mut self, holds_at_ns: u64, law_s: f64) {
        if let Some(place) = self.ring.get_mut(self.count % KEPT) {
            *place = (holds_at_ns, law_s);
        }
        self.count = self.count.saturating_add(1);
    }

    /// Returns the time on the law that was to be reached at a time of the robot's clock, in s; none before the first set-point
    /// that is kept.
    pub(super) fn at(&self, clock_ns: u64) -> Option<f64> {
        let mut later: Option<(u64, f64)> = None;
        for back in 1..=self.count.min(KEPT) {
            let (at_ns, law_s) = *self.ring.get((self.count - back) % KEPT)?;
            if at_ns <= clock_ns {
                let Some((later_ns, later_s)) = later.filter(|(later_ns, _)| *later_ns > at_ns) else {
                    return Some(law_s);
                };
                let share = (clock_ns - at_ns) as f64 / (later_ns - at_ns) as f64;
                return Some(law_s + (later_s - law_s) * share);
            }
            later = Some((at_ns, law_s));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_two_set_points_the_law_passes_evenly_and_before_the_first_one_nothing_is_known() {
        let mut sent = SentSetPoints::default();
        assert_eq!(sent.at(5), None);
        (0..1_000_u64).for_each(|index| sent.push(1_000 + index * 10, index as f64));
        assert_eq!(sent.at(10_985), Some(998.5));
        assert_eq!(sent.at(20_000), Some(999.0));
        assert_eq!(sent.at(1_005), None, "it is not kept any more");
        sent.clear();
        assert_eq!(sent.at(20_000), None);
    }
}
