//! Refines laws while the arm drives: some steps in each robot cycle.
//!
//! A law is refined when no motion can change it any more: the last motion of its stretch stops. Meanwhile the arm follows
//! the law as it was found. When the steps are done, the refined pieces take the place of those that the arm has not reached.

use super::law::{Law, MOST_STEPS, Progress};
use super::path::Path;
use super::refinement::{Range, State};
use super::replan::{Stretch, pieces};

/// Number of cells that the steps of one robot cycle look at, beside those of one step.
const CELLS_IN_A_CYCLE: usize = 256;

/// Largest number of cells that a law is taken to have, for the time until it is refined: hardly any has more.
const USUAL_CELLS: usize = 128;

/// What the arm may drive until the steps are done, for each cycle that they take: corrections may hurry a little.
const HURRY: f64 = 1.25;

/// Cycles until the first steps, and after the last ones.
const MORE_CYCLES: usize = 2;

/// Pieces ahead from which a refined law is sought, one in each cycle: where no law goes on from the arm's pace, one may from a
/// later piece.
const LATER_PIECES: [usize; 5] = [0, 1, 2, 4, 8];

impl Path {
    /// Takes the steps of a robot cycle.
    pub(super) fn refine(&mut self, cycle_s: f64) {
        if core::mem::take(&mut self.refinement.has_planned) {
            return;
        }
        let Some(mut law) = self.refinement.law.take() else { return };
        self.refinement.state = match self.refinement.state {
            State::Idle => State::Idle,
            State::Planned => self.begin_to_refine(&mut law, cycle_s).unwrap_or(State::Idle),
            State::Refining(range) => {
                let mut made = (0..steps_in_a_cycle(law.cells())).map(|_| law.refine());
                match made.find(|progress| *progress != Progress::Unfinished) {
                    None => State::Refining(range),
                    Some(Progress::Faster) => State::Ready(range),
                    Some(_) => State::Planned,
                }
            }
            // Whether a ramp of the override keeps the limits was found out along the former law.
            State::Ready(range) if !self.scale.is_steady() => State::Ready(range),
            State::Ready(range) => {
                self.take_refined(&law, range);
                State::Planned
            }
        };
        self.refinement.law = Some(law);
    }

    /// Finds the law of the next final stretch that is worth it once more, from where the arm is not before the steps are
    /// done. None where there is none.
    fn begin_to_refine(&mut self, law: &mut Law, cycle_s: f64) -> Option<State> {
        let cells = self.pieces.len().min(USUAL_CELLS);
        let cycles = MOST_STEPS.div_ceil(steps_in_a_cycle(cells)) + MORE_CYCLES;
        let ahead = LATER_PIECES.get(self.refinement.failures).copied().unwrap_or_default();
        let mut begin = self.piece_after(HURRY * cycle_s * cycles as f64) + ahead;
        loop {
            let (spot, pace) = self.pieces.get(begin)?.at(0.0);
            let mut stretch = Stretch::default();
            stretch.take(&self.queue, self.left_behind, spot)?;
            let Stretch { parts, next } = &stretch;
            let is_final = next.is_some() || self.queue.back().is_some_and(|last| last.stops);
            let next_motion = parts.last()?.motion + 1;
            let rest = self.pieces.range(begin..).position(|piece| piece.cell.is_to_rest())?;
            let end = begin + rest + 1;
            if !is_final {
                return None;
            }
            if next_motion > self.refinement.done {
                let found = self.pieces.range(begin..end).map(|piece| piece.cell.duration).sum();
                if law.begin_to_refine(parts, pace, found).is_some() {
                    self.refinement.note_looked_at(next_motion);
                    return Some(State::Refining(Range { begin, end, spot }));
                }
                self.refinement.failures += 1;
                if !pace.is_rest() && self.refinement.failures < LATER_PIECES.len() {
                    return Some(State::Planned);
                }
                self.refinement.note_looked_at(next_motion);
            }
            begin = end;
        }
    }

    /// Puts the refined law in the place of its pieces.
    fn take_refined(&mut self, law: &Law, range: Range) {
        let Range { begin, end, spot } = range;
        if self.pieces.len() + law.cells() > self.capacity.pieces {
            return;
        }
        {
            let mut stretch = Stretch::default();
            if stretch.take(&self.queue, self.left_behind, spot).is_none() {
                return;
            }
            self.pieces.extend(pieces(law, &stretch.parts));
        }
        // From the former pieces, those behind them and the new ones to the new ones and those behind them.
        let all = self.pieces.len();
        let changed = self.pieces.make_contiguous().get_mut(begin..).unwrap_or_default();
        changed.rotate_left(end - begin);
        let kept = all - (end - begin);
        self.pieces.truncate(kept);
        let changed = self.pieces.make_contiguous().get_mut(begin..).unwrap_or_default();
        changed.rotate_right(law.cells());
        self.find_braking();
    }

    /// The number of the first piece that begins no sooner than after some of the law's seconds.
    fn piece_after(&self, seconds: f64) -> usize {
        let mut begin = -self.time;
        let sooner = self.pieces.iter().enumerate().take_while(|(number, piece)| {
            let is_sooner = *number == 0 || begin < seconds;
            begin += piece.cell.duration;
            is_sooner
        });
        sooner.count()
    }
}

/// Number of steps that one robot cycle takes on so many cells.
const fn steps_in_a_cycle(cells: usize) -> usize {
    let steps = CELLS_IN_A_CYCLE / if cells == 0 { 1 } else { cells };
    if steps == 0 { 1 } else { steps }
}
