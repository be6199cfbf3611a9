//! The override as the rate at which a law's time goes.
//!
//! The law of a path is made for the programmed speeds. Its time goes at the rate σ, 0…1, of real time: the arm stays on its path
//! whatever σ does, and with the law's speed v, acceleration a and jerk j it has
//!
//! ```text
//! speed: σ·v        acceleration: σ²·a + σ'·v        jerk: σ³·j + 3·σ·σ'·a + σ''·v
//! ```
//!
//! At a steady override f the speeds are the share f of those at 100 %, as the PLC expects. To another override σ goes on a
//! [`Ramp`] whose second derivative is constant in each of three phases.

/// A ramp is at most this steep, per s, and its steepness changes by at most this, per s²: from 1 to 0 in about five cycles.
const STEEPEST: f64 = 50.0;
const MOST_BENT: f64 = 5_000.0;

/// How the rate goes, at a time.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Rate {
    /// σ, 0…1.
    pub(super) share: f64,
    /// Its change, per s.
    pub(super) change: f64,
    /// The change of that, per s².
    pub(super) bend: f64,
}

impl Rate {
    /// One that stays as it is.
    pub(super) const fn steady(share: f64) -> Self {
        Self { share, change: 0.0, bend: 0.0 }
    }

    /// After some time within a phase, and the law's time until then.
    fn after(&self, seconds: f64) -> (Self, f64) {
        let Self { share, change, bend } = *self;
        let law_s = seconds * (share + seconds * (change / 2.0 + seconds * bend / 6.0));
        let share = share + seconds * (change + seconds * bend / 2.0);
        (Self { share, change: change + seconds * bend, bend }, law_s)
    }
}

/// One phase of a ramp.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Phase {
    pub(super) start: Rate,
    pub(super) seconds: f64,
}

impl Phase {
    /// After some of its time: the rate, and the law's time since its start.
    pub(super) fn at(&self, seconds: f64) -> (Rate, f64) {
        self.start.after(seconds)
    }
}

/// From one rate to a steady one.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Ramp {
    phases: [Phase; 3],
    target: f64,
}

impl Ramp {
    /// One that is over.
    const fn steady(share: f64) -> Self {
        Self { phases: [Phase { start: Rate::steady(share), seconds: 0.0 }; 3], target: share }
    }

    /// The quickest one from a rate to a share, no steeper than `steepest`, per s, and no more bent than `bend`, per s². None where
    /// it would leave 0…1 on the way.
    pub(super) fn new(from: Rate, target: f64, steepest: f64, bend: f64) -> Option<Self> {
        let (steepest, bend) = (steepest.min(STEEPEST), bend.min(MOST_BENT));
        // Where it would come to if its steepness were taken back at once.
        let at_least = from.share + from.change * from.change.abs() / (2.0 * bend);
        if !(-1e-9..=1.0 + 1e-9).contains(&at_least) {
            return None;
        }
        let sign = 1.0_f64.copysign(target - at_least);
        let (missing, change) = (sign * (target - from.share), sign * from.change);
        let peak = (bend * missing + change * change / 2.0).max(0.0).sqrt().min(steepest).max(change);
        let evenly = missing - (peak * peak - change * change / 2.0) / bend;
        let evenly_s = if peak > 0.0 { (evenly / peak).max(0.0) } else { 0.0 };
        let seconds = [(peak - change) / bend, evenly_s, peak / bend];
        let mut start = from;
        let phases = core::array::from_fn(|index| {
            start.bend = [sign * bend, 0.0, -sign * bend][index];
            let phase = Phase { start, seconds: seconds[index] };
            start = phase.at(phase.seconds).0;
            phase
        });
        Some(Self { phases, target })
    }

    pub(super) const fn phases(&self) -> [Phase; 3] {
        self.phases
    }

    pub(super) fn seconds(&self) -> f64 {
        self.phases.iter().map(|phase| phase.seconds).sum()
    }
}

/// The rate now, and the ramp that it is on.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct TimeScale {
    ramp: Ramp,
    /// Seconds since the start of the ramp.
    time: f64,
}

impl TimeScale {
    pub(super) const fn steady(share: f64) -> Self {
        Self { ramp: Ramp::steady(share), time: 0.0 }
    }

    pub(super) const fn target(&self) -> f64 {
        self.ramp.target
    }

    pub(super) fn is_steady(&self) -> bool {
        self.time >= self.ramp.seconds()
    }

    /// Whether it is this share, and stays so.
    pub(super) fn is_steadily(&self, share: f64) -> bool {
        self.is_steady() && self.ramp.target == share
    }

    pub(super) const fn start(&mut self, ramp: Ramp) {
        *self = Self { ramp, time: 0.0 };
    }

    pub(super) fn now(&self) -> Rate {
        self.ahead().next().map_or(Rate::steady(self.ramp.target), |phase| phase.start)
    }

    /// What is left of the ramp, phase by phase.
    pub(super) fn ahead(&self) -> impl Iterator<Item = Phase> {
        let mut begun = self.time;
        self.ramp.phases.into_iter().filter_map(move |phase| {
            let passed = begun.min(phase.seconds);
            begun -= passed;
            let (start, _) = phase.at(passed);
            (passed < phase.seconds).then_some(Phase { start, seconds: phase.seconds - passed })
        })
    }

    /// By how much the law's time goes on in the next seconds.
    pub(super) fn law_seconds(&self, seconds: f64) -> f64 {
        let (mut left, mut law_s) = (seconds, 0.0);
        for phase in self.ahead() {
            let here = left.min(phase.seconds);
            law_s += phase.at(here).1;
            left -= here;
        }
        law_s + left * self.ramp.target
    }

    pub(super) fn advance(&mut self, seconds: f64) {
        self.time += seconds;
        if self.is_steady() {
            *self = Self::steady(self.ramp.target);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_ramp_ends_steadily_at_its_target_and_stays_between_0_and_1(
            share in 0.0..1.0_f64,
            target in prop_oneof![Just(0.0), Just(1.0), 0.0..1.0_f64],
            change in -10.0..10.0_f64,
            steepest in 0.1..60.0_f64,
            bend in 1.0..6_000.0_f64,
        ) {
            let from = Rate { share, change, bend: 0.0 };
            let Some(ramp) = Ramp::new(from, target, steepest, bend) else { return Ok(()) };
            let mut scale = TimeScale::steady(share);
            scale.start(ramp);
            let (end, whole) = (ramp.seconds(), scale.law_seconds(ramp.seconds()));
            let last = ramp.phases[2].at(ramp.phases[2].seconds).0;
            prop_assert!((last.share - target).abs() < 1e-9 && last.change.abs() < 1e-9, "{last:?}");
            let mut sum = 0.0;
            for _ in 0..100 {
                prop_assert!((-1e-9..=1.0 + 1e-9).contains(&scale.now().share), "{:?}", scale.now());
                sum += scale.law_seconds(end / 100.0);
                scale.advance(end / 100.0);
            }
            prop_assert!((sum - whole).abs() < 1e-9 * (1.0 + whole), "{sum} {whole}");
        }
    }

    #[test]
    fn a_steady_override_takes_its_share_of_the_time() {
        assert_eq!(TimeScale::steady(1.0).law_seconds(0.004), 0.004);
        assert_eq!(TimeScale::steady(0.25).law_seconds(0.004), 0.001);
        assert_eq!(TimeScale::steady(0.0).law_seconds(0.004), 0.0);
    }
}
