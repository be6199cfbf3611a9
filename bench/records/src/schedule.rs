//! The order of the runs: the types are interleaved, with a random pause before each start.

use std::time::Duration;

use plc_node::{ExecutionType, OverrideSchedule};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::counted::counted;

/// Seed of runs without a given seed.
pub const SEED: u64 = 1;

/// Repetitions of each type in the paper (section 6.2).
pub const REPETITIONS: u32 = 25;

/// Shortest pause before a start edge: the arm has settled and every node has seen the end of the previous run.
pub const PAUSE: Duration = Duration::from_millis(40);

/// Largest random extension of the pause, evenly distributed: several times the longest cycle, so that start edges
/// meet all phases of every cycle equally often.
const SPREAD: Duration = Duration::from_millis(60);

/// One run of a schedule.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Step {
    /// Its execution type.
    pub execution_type: ExecutionType,
    /// Number of the repetition of its type, counted from 1.
    pub repetition: u32,
    /// Pause before the start edge.
    pub pause: Duration,
    /// Changes of the override during the run.
    pub overrides: Option<OverrideSchedule>,
}

/// All runs of a measurement, in an order in which a drift affects all types equally.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Schedule {
    /// Execution types in the order of each round, each once.
    pub types: Vec<ExecutionType>,
    /// Repetitions of each type.
    pub reps: u32,
    /// Seed of the pauses.
    pub seed: u64,
    /// Changes of the override during each run.
    pub overrides: Option<OverrideSchedule>,
}

/// Formats a number of repetitions as text.
pub fn repetitions(count: u32) -> String {
    counted(count, "repetition")
}

impl Schedule {
    /// Creates a schedule of `reps` rounds over `types`; a type that is given twice counts once.
    #[must_use]
    pub fn new(types: &[ExecutionType], reps: u32, seed: u64) -> Self {
        let mut once = Vec::new();
        for execution_type in types {
            if !once.contains(execution_type) {
                once.push(*execution_type);
            }
        }
        Self { types: once, reps, seed, overrides: None }
    }

    /// Returns the runs in order.
    pub fn steps(&self) -> impl Iterator<Item = Step> + '_ {
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        (1..=self.reps)
            .flat_map(move |repetition| {
                self.types.iter().map(move |execution_type| (*execution_type, repetition))
            })
            .map(move |(execution_type, repetition)| Step {
                execution_type,
                repetition,
                pause: PAUSE + below(&mut random, SPREAD),
                overrides: self.overrides,
            })
    }
}

/// Draws a time from zero up to `bound`, exclusive.
pub fn below(random: &mut Pcg64Mcg, bound: Duration) -> Duration {
    let share = u128::from(random.next_u64());
    let nanos = (share * bound.as_nanos()) >> 64;
    Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ExecutionType::{Cm, Rc, Sm};

    #[test]
    fn the_types_are_interleaved() {
        let schedule = Schedule::new(&[Rc, Sm, Cm, Rc], 2, 1);
        let order: Vec<_> = schedule.steps().map(|step| (step.execution_type, step.repetition)).collect();
        assert_eq!(order, [(Rc, 1), (Sm, 1), (Cm, 1), (Rc, 2), (Sm, 2), (Cm, 2)]);
    }

    #[test]
    fn the_pauses_depend_on_the_seed_and_cover_their_range() {
        let pauses =
            |seed| -> Vec<_> { Schedule::new(&[Rc], 1_000, seed).steps().map(|step| step.pause).collect() };
        assert_eq!(pauses(1), pauses(1));
        assert_ne!(pauses(1), pauses(2));
        let (shortest, longest) = (*pauses(1).iter().min().unwrap(), *pauses(1).iter().max().unwrap());
        assert!(shortest >= PAUSE && shortest < PAUSE + SPREAD / 100, "{shortest:?}");
        assert!(longest < PAUSE + SPREAD && longest > PAUSE + SPREAD * 99 / 100, "{longest:?}");
    }
}
