//! Finds whether a law leaves limits unused, so that it is worth a refinement.

use super::Law;

/// Largest share of an acceleration or of a jerk that a cell uses whose speed could be higher. A law that is near the optimum is at
/// a limit nearly everywhere.
const IDLE: f64 = 0.9;

/// Least share of the time that highest speeds in such cells would save and that makes a law worth a refinement.
const LEAST: f64 = 0.01;

impl Law {
    /// Returns whether joints and tool are far from all their limits for a good part of the time. So it is around places
    /// where a joint's share of the motion peaks: beside the axis of the shoulder, or in a turn at one place.
    pub(in super::super) fn idles(&self) -> bool {
        let (mut lost, mut whole) = (0.0, 0.0);
        for cell in 1..self.cells() - 1 {
            let (value, top) = (self.values[cell], self.top(cell));
            let seconds = self.length(cell) / value.sqrt();
            whole += seconds;
            if self.used[cell] < IDLE {
                lost += seconds * (1.0 - (value / top).sqrt());
            }
        }
        lost > LEAST * whole
    }

    /// Returns the square of the highest speed that is programmed for a cell, and that the joints reach in its middle. Where a
    /// slower part follows, its speed holds at the border.
    pub(super) fn top(&self, cell: usize) -> f64 {
        let ends = [&self.grid.knots[cell], &self.grid.knots[cell + 1], self.end_of(cell)]
            .map(|knot| knot.programmed);
        ends.into_iter().fold(self.tops[cell], f64::min)
    }
}
