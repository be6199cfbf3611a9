//! Rounds the top of a law, where speeding up turns into slowing down, with the jerk.

use core::iter::zip;

use super::super::knot::Knot;
use super::super::node::Pace;
use super::Law;

/// Largest number of times that the top is rounded in a round, and how much higher or lower a value may be than the one for which it
/// was rounded.
const ROUNDINGS: usize = 4;
const NEAR: f64 = 1.25;

/// How far the values go from those for which they were rounded to the rounded ones, before they are rounded once more. Where
/// the jerk alone counts, a square of x times its right one gives one of 1/√x times that: then this leads to the right one.
const MIXED: f64 = 2.0 / 3.0;

impl Law {
    /// Rounds the corners at the top, where the acceleration falls faster than the jerk allows. How fast it may fall depends on the
    /// speed: where that comes out other than assumed, it is rounded once more.
    pub(super) fn round_off(&mut self) -> Option<()> {
        self.corners.clone_from(&self.values);
        for rounding in 1..=ROUNDINGS {
            self.assumed.clone_from(&self.values);
            self.add_rooms();
            self.values.clone_from(&self.corners);
            self.span()?;
            let mut pairs = zip(&self.assumed, &self.values);
            if rounding == ROUNDINGS || pairs.all(|(one, other)| *one <= NEAR * other && *other <= NEAR * one)
            {
                break;
            }
            for (value, assumed) in zip(&mut self.values, &self.assumed) {
                *value = assumed + MIXED * (*value - assumed);
            }
        }
        Some(())
    }

    /// Finds what to add to the values, so that a straight line through the sums falls as fast as the jerk allows.
    fn add_rooms(&mut self) {
        let cells = self.cells();
        let moves = !self.start.is_rest();
        let (mut slope, mut sum) = (0.0, 0.0);
        let mut before = if moves { self.start } else { self.pace_at(1) };
        // The room at the knot between two cells counts for both: it is found once, unless parts with other limits meet there.
        let mut found = None;
        self.added.clear();
        self.added.push(0.0);
        for cell in 1..cells {
            let inner = cell - 1;
            if inner > 0 || moves {
                let next = self.pace_at(cell);
                let rooms = self.rooms_beside(inner, [before, next], found);
                slope += 2.0 * self.least_change(inner, rooms);
                found = self.other_side(inner).is_none().then_some(rooms[1]);
                before = next;
            }
            sum += slope * (self.places[cell] - self.places[cell - 1]);
            self.added.push(sum);
        }
    }

    /// Returns how fast the acceleration may fall at both ends of a cell; at the first one it may be known already.
    fn rooms_beside(&self, cell: usize, [from, to]: [Pace; 2], known: Option<f64>) -> [f64; 2] {
        let room = |knot: &Knot, pace: Pace| knot.bend_room(pace.square, pace.acceleration, -1.0);
        [known.unwrap_or_else(|| room(&self.grid.knots[cell], from)), room(self.end_of(cell), to)]
    }

    /// Lowers the values so that with what is added to them they are below a convex hull.
    fn span(&mut self) -> Option<()> {
        let cells = self.cells();
        let moves = !self.start.is_rest();
        self.hull.clear();
        // The slope of the present acceleration is kept.
        let kept = 2.0 * self.start.acceleration;
        for cell in 0..cells {
            while let [.., before, last] = self.hull[..] {
                if self.steepness(before.into(), last.into()) >= self.steepness(last.into(), cell) {
                    self.hull.pop();
                } else {
                    break;
                }
            }
            if moves && self.hull.len() == 1 {
                let rise = self.height(0) + kept * (self.places[cell] - self.places[0]);
                if self.height(cell) < rise - 1e-9 * rise.abs() {
                    return None;
                }
            }
            self.hull.push(cell as u16);
        }
        for corner in 1..self.hull.len() {
            let [one, other] = [self.hull[corner - 1], self.hull[corner]].map(usize::from);
            let (slope, height) = (self.steepness(one, other), self.height(one));
            for cell in one + 1..other {
                let line = height + slope * (self.places[cell] - self.places[one]);
                self.values[cell] = (line - self.added[cell]).max(0.0);
            }
        }
        Some(())
    }

    /// Returns a value with what the rounding adds to it.
    fn height(&self, cell: usize) -> f64 {
        self.values[cell] + self.added[cell]
    }

    fn steepness(&self, one: usize, other: usize) -> f64 {
        (self.height(other) - self.height(one)) / (self.places[other] - self.places[one])
    }
}
