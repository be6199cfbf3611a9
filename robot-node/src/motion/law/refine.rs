//! Makes a law faster where its passes leave room, in steps of which some fit into each robot cycle.
//!
//! The passes find the speed of one place after another, with an acceleration of 0 as the least that each place allows. So
//! they never use that a joint which turns ever faster along a bend may keep its limit because the arm slows down. On
//! splines this can cost a fifth of the time, and as much on lines past a singular position and in turns at one place.
//! Steps of [Newton's method](super::newton) find what is left.

use super::super::grid::Part;
use super::super::node::Pace;
use super::newton::LEAST_LEFT;
use super::{EXACT, Law, SLACK};

/// The first cell whose value changes. Those before follow from the pace at the start.
const FIRST: usize = 2;

/// Number of steps, of more for each repair, and of repairs.
const STEPS: usize = 8;
const REPAIR_STEPS: usize = 2;
const REPAIRS: usize = 2;

/// Largest number of steps that a refinement takes.
pub(crate) const MOST_STEPS: usize = STEPS + REPAIRS * REPAIR_STEPS;

/// What the time of the whole law counts in the first step, for each cell; and by how much more in each next step.
const WEIGHT: f64 = 60.0;
const SHARPER: f64 = 1.7;

/// What it counts after the steps, if the law exceeds limits between the places that the steps look at.
const BLUNTER: f64 = 0.1;

/// Steps after which it is known of most laws that nothing is to be gained: their time grows at first, because the barriers push
/// them away from their limits, and in the second step by at least this share of the growth in the first. Of 36,000 laws of random
/// lists this ended 79 %, and 2 of the 3,755 that would have become faster by a hundredth, both by less than 1.2 %.
const TRIED_STEPS: usize = 2;
const GROWS_ON: f64 = 0.7;

/// Least share of the time by which a refined law is to be faster. The laws that the passes find are mostly nearer than that to the
/// fastest ones, and stay.
const LEAST_GAIN: f64 = 1e-2;

/// How far the refinement of a law is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Refinement {
    steps: usize,
    weight: f64,
    /// The duration that it is to fall below, in s.
    duration: f64,
    /// The duration after the last one of the tried steps, and by how much it grew in that step, in s.
    tried: f64,
    grown: f64,
}

/// What has come of a step.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Progress {
    /// More steps follow.
    Unfinished,
    /// The law is faster, and keeps its limits.
    Faster,
    /// There is nothing to gain.
    Useless,
}

impl Law {
    /// Begins to refine a law for these parts from this pace on, which is to become faster than one of this duration, in s.
    /// None where the arm cannot go on from that pace, or where there are hardly any cells.
    pub(in super::super) fn begin_to_refine(
        &mut self,
        parts: &[Part<'_>],
        start: Pace,
        duration: f64,
    ) -> Option<()> {
        // What it exceeds is repaired by the steps.
        self.find_roughly(parts, start)?;
        if self.cells() < FIRST + 3 {
            return None;
        }
        // What the joints allow at the knots is looked at there: the value of a cell may be above that of one end of it. What the
        // passes lowered was for their law.
        self.find_tops();
        for cell in 0..self.cells() {
            self.tops[cell] = self.top(cell);
        }
        for knot in self.grid.knots.iter_mut().chain(&mut self.grid.ends) {
            knot.tightness = [1.0; 2];
        }
        self.keep_below_tops();
        let weight = WEIGHT * self.cells() as f64 / self.duration();
        self.find_paces();
        self.refinement = Refinement { steps: 0, weight, duration, tried: self.duration(), grown: 0.0 };
        Some(())
    }

    /// Takes one step.
    pub(in super::super) fn refine(&mut self) -> Progress {
        let Refinement { weight, duration, .. } = self.refinement;
        self.step(FIRST, weight);
        self.refinement.steps += 1;
        let steps = self.refinement.steps;
        if steps <= TRIED_STEPS {
            let grows_on = self.compare_with_last_step();
            if steps == TRIED_STEPS && grows_on {
                return Progress::Useless;
            }
        }
        if steps < STEPS {
            self.refinement.weight *= SHARPER;
            return Progress::Unfinished;
        }
        if !(steps - STEPS).is_multiple_of(REPAIR_STEPS) {
            return Progress::Unfinished;
        }
        self.find_paces();
        let allowed = if self.start.is_rest() { EXACT } else { SLACK };
        let (most, _) = self.tighten(1.0);
        if most > 1.0 + allowed {
            self.keep_below_tops();
            self.refinement.weight *= BLUNTER;
            return if steps < MOST_STEPS { Progress::Unfinished } else { Progress::Useless };
        }
        if self.duration() < (1.0 - LEAST_GAIN) * duration { Progress::Faster } else { Progress::Useless }
    }

    /// Notes the duration after this step. Returns true where the law is slower than it is to be, and this step made it slower by about
    /// as much as the one before.
    fn compare_with_last_step(&mut self) -> bool {
        self.find_paces();
        let now = self.duration();
        let Refinement { duration, tried, grown, .. } = &mut self.refinement;
        let before = core::mem::replace(grown, now - *tried);
        *tried = now;
        now > *duration && before > 0.0 && *grown >= GROWS_ON * before
    }

    /// Returns the square of the highest speed that is programmed for a cell, and that the joints reach in its middle. Where a
    /// slower part follows, its speed holds at the border.
    fn top(&self, cell: usize) -> f64 {
        let ends = [&self.grid.knots[cell], &self.grid.knots[cell + 1], self.end_of(cell)]
            .map(|knot| knot.programmed);
        ends.into_iter().fold(self.tops[cell], f64::min)
    }

    /// Brings the values a little below the highest speeds, which no step exceeds.
    fn keep_below_tops(&mut self) {
        for cell in FIRST..self.cells() - 2 {
            self.values[cell] = self.values[cell].min((1.0 - LEAST_LEFT) * self.tops[cell]);
        }
    }

    fn duration(&self) -> f64 {
        (0..self.cells()).map(|cell| self.cell(cell).duration).sum()
    }
}
