//! A small correction of the pace where the law, as it was planned, would take an axis beyond a limit.
//!
//! A law holds its limits at the nodes of the path, and with an estimate of what lies between them. Near a singular
//! position a joint turns so unevenly that the estimate can be too low by some percent. Then the law's time passes a
//! little slower or faster in this cycle, so that the axis just keeps its limit. The arm stays on its path; over the
//! next cycles the correction fades, within the same limits.

/// What is left of a correction after a cycle: it fades as a critically damped oscillator does.
const LEFT: f64 = 0.9;

/// A correction below this share of the cycle has no effect that a joint's limits could notice.
const NOTHING: f64 = 1e-10;

/// By how much the law's time passes more than the override lets it, from cycle to cycle.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Correction {
    /// In this cycle, in s.
    seconds: f64,
    /// In the cycle before, in s.
    before: f64,
}

impl Correction {
    /// The law's time passes as the override lets it.
    pub(super) const NONE: Self = Self { seconds: 0.0, before: 0.0 };

    pub(super) const fn seconds(&self) -> f64 {
        self.seconds
    }

    /// The same with some seconds more in this cycle.
    pub(super) fn plus(self, seconds: f64) -> Self {
        self.with(self.seconds + seconds)
    }

    /// The same with these seconds in this cycle.
    pub(super) const fn with(self, seconds: f64) -> Self {
        Self { seconds, ..self }
    }

    /// Returns its size as a share of the cycle.
    pub(super) fn share(&self, cycle_s: f64) -> f64 {
        self.seconds.abs() / cycle_s
    }

    /// The correction of the next cycle if nothing is to be corrected anew.
    pub(super) fn faded(self, cycle_s: f64) -> Self {
        let Self { seconds, before } = self;
        let next = Self { seconds: LEFT * (2.0 * seconds - LEFT * before), before: seconds };
        if next.seconds.abs().max(seconds.abs()) < NOTHING * cycle_s { Self::NONE } else { next }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_correction_fades_within_two_hundred_cycles() {
        let mut correction = Correction::NONE.plus(4e-5);
        let mut sizes = Vec::new();
        while correction != Correction::NONE {
            sizes.push(correction.share(0.004));
            correction = correction.faded(0.004);
            assert!(sizes.len() < 300, "{correction:?}");
        }
        assert!(sizes.iter().all(|size| *size < 0.04), "{sizes:?}");
        assert!(sizes[40..].iter().all(|size| *size < 0.01), "{sizes:?}");
    }
}
