//! Many random cases, one after another.

use core::ops::Range;
use core::time::Duration;

use robot_node::ConfigError;
use setup::Setup;

use crate::violation::{Class, Violation};
use crate::{Case, driver};

/// Results of many cases.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Tally {
    /// Cases.
    pub cases: u64,
    /// Robot cycles that were judged.
    pub cycles: u64,
    /// How long they would have taken.
    pub plant: Duration,
    /// Motions that were executed.
    pub motions: u64,
    /// Skills that are done, were aborted, ended by an error.
    pub ended: [u64; 3],
    /// The cases that broke a law, by number, with the first law that each broke.
    pub found: Vec<(u64, Violation)>,
}

impl Tally {
    /// Adds another one.
    pub fn add(&mut self, other: Self) {
        self.cases += other.cases;
        self.cycles += other.cycles;
        self.plant += other.plant;
        self.motions += other.motions;
        for (sum, other) in self.ended.iter_mut().zip(other.ended) {
            *sum += other;
        }
        self.found.extend(other.found);
    }
}

/// What draws the case of a number of a seed: a function of the [`generator`](crate::generator).
pub type Draw = fn(&Setup, u64, u64) -> Case;

/// Runs the cases of these numbers of a seed, and looks for violations of the `classes`.
///
/// # Errors
///
/// A random arm makes no sense: an error of the generator.
pub fn hunt(
    draw: Draw,
    setup: &Setup,
    seed: u64,
    numbers: Range<u64>,
    classes: &[Class],
) -> Result<Tally, ConfigError> {
    let mut tally = Tally::default();
    for number in numbers {
        let case = draw(setup, seed, number);
        let outcome = driver::run(&case, setup, classes)?;
        let ended = outcome.ended;
        let found = outcome.violation.map(|violation| (number, violation)).into_iter().collect();
        tally.add(Tally {
            cases: 1,
            cycles: outcome.cycles,
            plant: outcome.plant,
            motions: outcome.motions,
            ended,
            found,
        });
    }
    Ok(tally)
}
