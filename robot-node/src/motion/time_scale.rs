//! The override as the rate at which a law's time goes.
//!
//! The law of a path is made for the programmed speeds. Its time passes at the rate σ, 0…1, of real time. The arm stays
//! on its path whatever σ is. With the law's speed v, acceleration a and jerk j it has
//!
//! ```text
//! speed: σ·v        acceleration: σ²·a + σ'·v        jerk: σ³·j + 3·σ·σ'·a + σ''·v
//! ```
//!
//! At a constant override f the speeds are the share f of those at 100 %, as the PLC expects. From one override to
//! another the rate follows a [`Ramp`], whose phases have constant second derivatives.

/// Largest slope of a ramp, per s, and largest second derivative, per s²: from 1 to 0 in about five cycles.
const STEEPEST: f64 = 50.0;
pub(super) const MOST_BENT: f64 = 5_000.0;

/// The rate and its derivatives at a time.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Rate {
    /// σ, 0…1.
    pub(super) share: f64,
    /// Its first derivative, per s.
    pub(super) change: f64,
    /// Its second derivative, per s².
    pub(super) bend: f64,
}

impl Rate {
    /// A constant rate.
    pub(super) const fn steady(share: f64) -> Self {
        Self { share, change: 0.0, bend: 0.0 }
    }

    /// Returns the rate after some time within a phase, and the law's time until then.
    pub(super) fn after(&self, seconds: f64) -> (Self, f64) {
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
    /// Returns the rate after some of its time, and the law's time since its start.
    pub(super) fn at(&self, seconds: f64) -> (Rate, f64) {
        self.start.after(seconds)
    }

    /// Returns the rate at its extreme value, or at the start if it has none.
    fn turn(&self) -> Rate {
        let Rate { change, bend, .. } = self.start;
        let seconds = if change * bend < 0.0 { (-change / bend).min(self.seconds) } else { 0.0 };
        self.at(seconds).0
    }
}

/// Number of phases of a ramp's step.
pub(super) const BENDS: usize = 4;

/// A ramp: a step, and two phases that level the rate out.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Ramp {
    phases: [Phase; BENDS + 2],
    target: f64,
}

impl Ramp {
    /// A ramp that has ended.
    const fn steady(share: f64) -> Self {
        Self { phases: [Phase { start: Rate::steady(share), seconds: 0.0 }; BENDS + 2], target: share }
    }

    /// A step of `seconds` with these second derivatives in its parts, after which the rate keeps its slope for `hold`
    /// seconds and then levels out with `level`, per s². None where that leads beyond `share`, or leaves 0…1 on the
    /// way.
    pub(super) fn stepping(
        from: Rate,
        bends: [f64; BENDS],
        seconds: f64,
        [hold, level]: [f64; 2],
        share: f64,
    ) -> Option<Self> {
        let mut ramp = Self::steady(share);
        let mut start = from;
        let each = seconds / BENDS as f64;
        for (phase, bend) in ramp.phases.iter_mut().zip(bends) {
            *phase = Phase { start: Rate { bend, ..start }, seconds: each };
            start = phase.at(each).0;
        }
        let end = ramp.level_out(start, hold, level)?;
        let is_there = (end - share).abs() < 1e-9;
        ramp.target = if is_there { share } else { end.clamp(0.0, 1.0) };
        let is_beyond = !is_there && (share - from.share) * (share - end) <= 0.0;
        (!is_beyond && start.change.abs() <= STEEPEST).then_some(ramp)
    }

    /// A step of `seconds` after which levelling out with `level`, per s², ends at `share`. None where it would leave
    /// 0…1 on the way.
    pub(super) fn landing(from: Rate, seconds: f64, level: f64, share: f64) -> Option<Self> {
        let mut ramp = Self::steady(share);
        let level = level.min(MOST_BENT);
        let missing = share - from.share - from.change * seconds / 2.0;
        let width = level * seconds;
        let root = (width * width + 8.0 * level * missing.abs()).sqrt();
        let change = 0.5 * (root - width).copysign(missing);
        let bend = (change - from.change) / seconds;
        ramp.phases[0] = Phase { start: Rate { bend, ..from }, seconds };
        let start = ramp.phases[0].at(seconds).0;
        ramp.level_out(start, 0.0, level)?;
        (change.abs() <= STEEPEST && bend.abs() <= MOST_BENT).then_some(ramp)
    }

    /// Adds the phases after the step. Returns the rate at the end; none where that or a rate before is not within 0…1.
    fn level_out(&mut self, start: Rate, hold: f64, level: f64) -> Option<f64> {
        let level = level.min(MOST_BENT);
        let [.., holding, leveling] = &mut self.phases;
        *holding = Phase { start: Rate { bend: 0.0, ..start }, seconds: hold };
        let start = holding.at(hold).0;
        let bend = -level.copysign(start.change);
        *leveling = Phase { start: Rate { bend, ..start }, seconds: start.change.abs() / level };
        let end = leveling.at(leveling.seconds).0.share;
        let within = |share: f64| (-1e-9..=1.0 + 1e-9).contains(&share);
        let turns = self.phases.iter().all(|phase| within(phase.turn().share));
        (within(end) && turns).then_some(end)
    }

    /// Returns the highest rate on the way (`sign` 1), or the lowest one (−1).
    pub(super) fn farthest(&self, sign: f64) -> f64 {
        let turns = self.phases.iter().map(|phase| sign * phase.turn().share);
        turns.fold(sign * self.target, f64::max) * sign
    }

    /// Returns the slope of the rate at the end of the step.
    pub(super) const fn change(&self) -> f64 {
        self.phases[BENDS].start.change
    }

    pub(super) const fn phases(&self) -> [Phase; BENDS + 2] {
        self.phases
    }

    pub(super) fn step(&self) -> [Phase; BENDS] {
        core::array::from_fn(|index| self.phases[index])
    }

    /// The phases after the step.
    pub(super) const fn leveling(&self) -> [Phase; 2] {
        [self.phases[BENDS], self.phases[BENDS + 1]]
    }

    pub(super) fn seconds(&self) -> f64 {
        self.phases.iter().map(|phase| phase.seconds).sum()
    }
}

/// The ramp of the override, and the time on it.
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

    /// Returns whether the rate is constant at this share.
    pub(super) fn is_steadily(&self, share: f64) -> bool {
        self.is_steady() && self.ramp.target == share
    }

    pub(super) const fn start(&mut self, ramp: Ramp) {
        *self = Self { ramp, time: 0.0 };
    }

    pub(super) fn now(&self) -> Rate {
        self.ahead().next().map_or(Rate::steady(self.ramp.target), |phase| phase.start)
    }

    /// Returns the rest of the ramp, phase by phase.
    pub(super) fn ahead(&self) -> impl Iterator<Item = Phase> {
        let mut begun = self.time;
        self.ramp.phases.into_iter().filter_map(move |phase| {
            let passed = begun.min(phase.seconds);
            begun -= passed;
            let (start, _) = phase.at(passed);
            (passed < phase.seconds).then_some(Phase { start, seconds: phase.seconds - passed })
        })
    }

    /// Returns the law's time that passes in the next seconds.
    pub(super) fn law_seconds(&self, seconds: f64) -> f64 {
        let (mut left, mut law_s) = (seconds, 0.0);
        for phase in self.ahead() {
            let here = left.min(phase.seconds);
            law_s += phase.at(here).1;
            left -= here;
        }
        law_s + left * self.ramp.target
    }

    /// Returns how many of the next seconds pass until `law_seconds` of the law's time have passed.
    pub(super) fn seconds_until(&self, law_seconds: f64, most: f64) -> f64 {
        let (mut low, mut high) = (0.0, most);
        // This is less than a picosecond of a cycle.
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if self.law_seconds(middle) < law_seconds { low = middle } else { high = middle }
        }
        high
    }

    /// Returns the rate after some seconds.
    pub(super) fn after(&self, seconds: f64) -> Rate {
        let mut left = seconds;
        for phase in self.ahead() {
            if left < phase.seconds {
                return phase.at(left).0;
            }
            left -= phase.seconds;
        }
        Rate::steady(self.ramp.target)
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

    fn rates() -> impl Strategy<Value = Rate> {
        (0.0..1.0_f64, -30.0..30.0_f64).prop_map(|(share, change)| Rate { share, change, bend: 0.0 })
    }

    /// Drives a ramp in a hundred parts: the rate stays between 0 and 1, and the law's time adds up.
    fn drives(ramp: Ramp) -> Result<TimeScale, TestCaseError> {
        let mut scale = TimeScale::steady(1.0);
        scale.start(ramp);
        let (end, whole) = (ramp.seconds(), scale.law_seconds(ramp.seconds()));
        let mut sum = 0.0;
        for _ in 0..100 {
            prop_assert!((-1e-9..=1.0 + 1e-9).contains(&scale.now().share), "{:?}", scale.now());
            let gone = scale.law_seconds(end / 100.0);
            let seconds = scale.seconds_until(gone / 2.0, end / 100.0);
            prop_assert!((scale.law_seconds(seconds) - gone / 2.0).abs() < 1e-9, "{seconds}");
            sum += gone;
            scale.advance(end / 100.0);
        }
        prop_assert!((sum - whole).abs() < 1e-9 * (1.0 + whole), "{sum} {whole}");
        let Rate { share, change, .. } = ramp.phases()[BENDS + 1].at(ramp.phases()[BENDS + 1].seconds).0;
        prop_assert!((share - ramp.target).abs() < 1e-8 && change.abs() < 1e-8, "{share} {change}");
        agrees(ramp)?;
        Ok(scale)
    }

    /// Rate and law's time along a ramp follow from each other, whatever is asked.
    fn agrees(ramp: Ramp) -> Result<(), TestCaseError> {
        let mut scale = TimeScale::steady(0.5);
        scale.start(ramp);
        let end = ramp.seconds();
        // The lowest and the highest rate: behind the first phase, and on the whole way.
        let (mut later, mut whole) = ([ramp.target; 2], [ramp.target; 2]);
        let step = end / 400.0;
        for part in 0..400 {
            let time = step * f64::from(part);
            let [one, middle, two] = [time, time + step / 2.0, time + step].map(|time| scale.after(time));
            // Within a phase this is exact.
            let passed = step * (one.share + 4.0 * middle.share + two.share) / 6.0;
            let law_s = scale.law_seconds(time + step) - scale.law_seconds(time);
            prop_assert!((law_s - passed).abs() < 1e-3 * step, "{law_s} s for {passed} s");
            let most = 1.1
                * step
                * (one.bend.abs().max(two.bend.abs()) * step + one.change.abs().max(two.change.abs()));
            prop_assert!((two.share - one.share).abs() <= most + 1e-9, "{one:?} to {two:?}");
            whole = [whole[0].min(one.share), whole[1].max(one.share)];
            if time >= ramp.phases()[0].seconds {
                later = [later[0].min(one.share), later[1].max(one.share)];
            }
            let mut scale = scale;
            scale.advance(time);
            prop_assert!((scale.now().share - one.share).abs() < 1e-9, "{:?} for {one:?}", scale.now());
            prop_assert!(!scale.is_steady() && scale.target() == ramp.target);
        }
        // Where the first phase turns, its start does not count.
        let [most, least] = [ramp.farthest(1.0), ramp.farthest(-1.0)];
        let near = 1e-9 + STEEPEST * step;
        prop_assert!((later[1] - 1e-9..=whole[1] + near).contains(&most), "{most} for {whole:?}");
        prop_assert!((whole[0] - near..=later[0] + 1e-9).contains(&least), "{least} for {whole:?}");
        scale.advance(end);
        prop_assert!(scale.is_steadily(ramp.target) && scale.now() == Rate::steady(ramp.target));
        prop_assert_eq!(scale.after(1.0), Rate::steady(ramp.target));
        Ok(())
    }

    proptest! {
        #[test]
        fn a_ramp_that_lands_ends_steadily_at_the_share(
            from in rates(),
            share in prop_oneof![Just(0.0), Just(1.0), 0.0..1.0_f64],
            level in 1.0..6_000.0_f64,
        ) {
            let Some(ramp) = Ramp::landing(from, 0.004, level, share) else { return Ok(()) };
            prop_assert!(drives(ramp)?.target() == share);
            let [first, ..] = ramp.step();
            prop_assert!(first.start.bend.abs() <= MOST_BENT && ramp.change().abs() <= STEEPEST, "{ramp:?}");
        }

        #[test]
        fn a_step_never_leads_beyond_the_share(
            from in rates(),
            share in 0.0..1.0_f64,
            bends in prop::array::uniform4(-5_000.0..5_000.0_f64),
            hold in prop_oneof![Just(0.0), 0.0..0.1_f64],
            level in 1.0..6_000.0_f64,
        ) {
            let Some(ramp) = Ramp::stepping(from, bends, 0.004, [hold, level], share) else { return Ok(()) };
            drives(ramp)?;
            let [holding, leveling] = ramp.leveling();
            let kept = Rate { bend: 0.0, ..holding.start };
            prop_assert!(holding.start == kept && holding.seconds == hold, "the slope is kept: {holding:?}");
            prop_assert!(leveling.start.bend.abs() == level.min(MOST_BENT), "{leveling:?}");
            prop_assert!((share - from.share) * (share - ramp.target) >= 0.0, "{}", ramp.target);
        }
    }

    #[test]
    fn a_steady_override_takes_its_share_of_the_time() {
        assert_eq!(TimeScale::steady(1.0).law_seconds(0.004), 0.004);
        assert_eq!(TimeScale::steady(0.25).law_seconds(0.004), 0.001);
        assert_eq!(TimeScale::steady(0.0).law_seconds(0.004), 0.0);
    }
    #[test]
    fn a_step_that_ends_at_the_share_is_taken_and_one_that_leads_beyond_is_not() {
        let steady = Rate::steady(0.4);
        let stepping = |from: Rate, bend: f64, share: f64| {
            Ramp::stepping(from, [bend; BENDS], 0.004, [0.0, MOST_BENT], share)
        };
        assert_eq!(stepping(steady, 0.0, 0.4).map(|ramp| ramp.target), Some(0.4));
        assert_eq!(stepping(steady, 1_000.0, 0.4), None, "it was there");
        let steepest = Rate { change: STEEPEST, ..Rate::steady(0.1) };
        assert!(stepping(steepest, 0.0, 1.0).is_some());
        assert_eq!(stepping(steepest, 1.0, 1.0), None, "too steep");
    }
}
