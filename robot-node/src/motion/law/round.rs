//! Rounds the top of a law, where speeding up turns into slowing down, with the jerk.

use core::iter::zip;

use super::Law;

/// Largest number of times that the top is rounded in a round, and how much higher a value is than its rounded one if it is rounded
/// once more.
const ROUNDINGS: usize = 4;
const MUCH_FASTER: f64 = 1.25;

impl Law {
    /// Rounds the corners at the top, where the acceleration falls faster than the jerk allows. How fast it may fall depends on the
    /// speed: where that comes out much lower than it was, it is rounded once more.
    pub(super) fn round_off(&mut self) -> Option<()> {
        self.corners.clone_from(&self.values);
        for _ in 0..ROUNDINGS {
            self.add_rooms();
            self.values.clone_from(&self.corners);
            self.span()?;
            let mut lowered = zip(&self.corners, &self.values);
            if !lowered.any(|(corner, rounded)| *corner > MUCH_FASTER * rounded) {
                break;
            }
        }
        Some(())
    }

    /// Finds what to add to the values, so that a straight line through the sums falls as fast as the jerk allows.
    fn add_rooms(&mut self) {
        let cells = self.cells();
        let moves = !self.start.is_rest();
        let (mut slope, mut sum) = (0.0, 0.0);
        let mut before = if moves { self.start.acceleration } else { self.acceleration(0) };
        self.added.clear();
        self.added.push(0.0);
        for cell in 1..cells {
            let inner = cell - 1;
            if inner > 0 || moves {
                let next = self.acceleration(inner);
                let mean = (before + next) / 2.0;
                slope += 2.0 * self.change_room(inner, self.values[inner], mean, -1.0);
                before = next;
            }
            sum += slope * (self.places[cell] - self.places[cell - 1]);
            self.added.push(sum);
        }
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
