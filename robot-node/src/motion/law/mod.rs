//! The time law of a stretch of path: as fast as joints and tool allow, from the present state of the arm to the next
//! rest.
//!
//! It is found over the way s, as b = v², where the limits of speed and acceleration are straight lines:
//!
//! ```text
//! a = b'/2        jerk = b''/2·√b
//! ```
//!
//! b is a quadratic spline: in each cell between two knots it is a parabola, so that speed, acceleration and jerk are known
//! exactly everywhere. The spline is given by one value a cell, and at a knot b and b' are those of the polygon through these
//! values. In the cells beside a rest the jerk is constant instead, and b grows as s^(4/3).
//!
//! The highest values that the limits at the knots allow are found in three passes. The first goes backward from the
//! rest at the end, as steeply as deceleration and jerk allow. The second goes forward and does the same for the
//! acceleration. The third rounds the corners at the top, where the acceleration falls, with the jerk: with the
//! parabola of the jerk added, this is a convex hull. Then the result is compared with the limits at all knots. Where
//! it exceeds them, they are reduced and the passes are repeated.

mod newton;
mod recalled;
mod refine;
mod round;
mod tighten;

use core::iter::zip;

use super::capacity::Capacity;
use super::cell::Cell;
use super::grid::{Grid, Part};
use super::knot::Knot;
use super::node::Pace;
use recalled::{LastRound, Pass};

pub(super) use refine::{MOST_STEPS, Progress};

/// By how much a law may exceed the limits that it is planned with, as a share: hardly, and a little where the arm
/// already moves. The reserve covers both.
const EXACT: f64 = 5e-3;
const SLACK: f64 = 8e-3;

/// Largest number of rounds.
const ROUNDS: usize = 12;
const MOST_POWER: usize = 4;

/// Least share of the highest square of the speed.
const LEAST_SQUARE: f64 = 1e-6;

/// This many times the highest square of the speed over a cell's length is more than any acceleration.
const MUCH: f64 = 10.0;

/// With room for each knot.
type List = Vec<f64>;

/// A law over the knots of a grid. It has room for the longest stretch, so planning does not allocate.
#[derive(Debug)]
pub(super) struct Law {
    grid: Grid,
    /// For each cell at whose end another part begins: the number of that border among [`Grid::ends`], from 1; else 0.
    ends_at: Vec<u16>,
    start: Pace,
    /// The ways at which the values of the polygon are given, one for each cell.
    places: List,
    values: List,
    /// The squares of the highest speeds that the joints allow in the middles of the cells.
    tops: List,
    /// Squares of speeds up to which no joint reaches its rated speed anywhere in a cell.
    calm: List,
    /// Reciprocals of twice the distance from each of these ways to the next.
    steps: List,
    /// Speed and acceleration at the knots.
    paces: Vec<Pace>,
    /// The values of the best round so far.
    best: List,
    /// The values before the rounding of the top, those for which it was rounded, what is added to them, and the corners of the hull.
    corners: List,
    assumed: List,
    added: List,
    hull: Vec<u16>,
    last_round: LastRound,
    refinement: refine::Refinement,
    /// What a step of Newton's method solves: its matrix, and then the change of the values.
    rows: Vec<[f64; 3]>,
    change: List,
}

impl Default for Law {
    fn default() -> Self {
        Self::with_room(Capacity::default())
    }
}

impl Law {
    /// Creates a law with room for the stretches of a queue.
    pub(super) fn with_room(capacity: Capacity) -> Self {
        let list = || Vec::with_capacity(capacity.knots);
        Self {
            grid: Grid::with_room(capacity),
            ends_at: Vec::with_capacity(capacity.knots),
            start: Pace::REST,
            places: list(),
            values: list(),
            tops: list(),
            calm: list(),
            steps: list(),
            paces: Vec::with_capacity(capacity.knots + 1),
            best: list(),
            corners: list(),
            assumed: list(),
            added: list(),
            hull: Vec::with_capacity(capacity.knots),
            last_round: LastRound::with_room(capacity.knots),
            refinement: refine::Refinement::default(),
            rows: Vec::with_capacity(capacity.knots),
            change: list(),
        }
    }

    /// Finds the fastest law for these parts, from a pace at the start to rest at the end; none where the arm cannot go
    /// on from that pace.
    pub(super) fn find(&mut self, parts: &[Part<'_>], start: Pace) -> Option<()> {
        self.find_roughly(parts, start)?.then_some(())
    }

    /// The same, and whether the law keeps its limits.
    fn find_roughly(&mut self, parts: &[Part<'_>], start: Pace) -> Option<bool> {
        self.grid.fill(parts, &start)?;
        self.start = start;
        self.place();
        let allowed = if start.is_rest() { EXACT } else { SLACK };
        let mut least = f64::INFINITY;
        for round in 0..ROUNDS {
            self.limit()?;
            self.backward();
            self.forward();
            self.round_off()?;
            if start.is_rest() {
                self.keep_moving();
            }
            self.find_paces();
            if !start.is_rest() && !self.moves_everywhere() {
                return None;
            }
            let (most, ratio) = self.tighten(1.0 + 0.5 * round.min(MOST_POWER) as f64);
            if most <= 1.0 + EXACT || (round > 1 && most <= 1.0 + allowed) {
                return Some(true);
            }
            if start.is_rest() && ratio < least {
                least = ratio;
                self.best.clone_from(&self.values);
            }
        }
        // From rest the whole law may be slowed down.
        if !start.is_rest() || !least.is_finite() {
            return Some(false);
        }
        self.values.clear();
        self.values.extend(self.best.iter().map(|value| value / (least * least)));
        self.find_paces();
        Some(true)
    }

    /// Places the values in the middles of the cells; beside a rest nearer to the rest.
    fn place(&mut self) {
        let knots = &self.grid.knots;
        let cells = knots.len() - 1;
        self.ends_at.clear();
        self.ends_at.extend((0..cells).map(|_| 0));
        for (part, begin) in self.grid.begins.iter().enumerate().skip(1) {
            self.ends_at[begin - 1] = part as u16;
        }
        self.places.clear();
        self.places.extend(knots.windows(2).map(|pair| (pair[0].way + pair[1].way) / 2.0));
        let length = |cell: usize| knots[cell + 1].way - knots[cell].way;
        if self.start.is_rest() {
            self.places[0] = knots[0].way + 0.25 * length(0);
        }
        self.places[cells - 1] = knots[cells].way - 0.25 * length(cells - 1);
        self.last_round.forget(cells);
        self.grid.middles.clear();
        self.calm.clear();
        for cell in 0..cells {
            let (start, end) = (&self.grid.knots[cell], self.end_of(cell));
            let between = start.slopes.half_way(&end.slopes, end.way - start.way);
            let calm = start.rates.highest(&start.slopes.steepest_toward(&end.slopes, end.way - start.way));
            self.calm.push(calm);
            self.grid.middles.push(between);
        }
        self.find_tops();
        self.steps.clear();
        self.steps.extend(self.places.windows(2).map(|pair| 0.5 / (pair[1] - pair[0])));
    }

    /// Finds the squares of the highest speeds that the joints allow in the middles of the cells.
    fn find_tops(&mut self) {
        let Self { tops, grid, .. } = self;
        tops.clear();
        tops.extend(zip(&grid.knots, &grid.middles).map(|(knot, middle)| knot.rates.highest(&middle.slope)));
    }

    /// Returns true if the last stretch had no law because it is too large for the room.
    pub(super) const fn lacks_room(&self) -> bool {
        self.grid.lacks_room
    }

    /// The knots at which the parts begin.
    pub(super) fn begins(&self) -> &[usize] {
        &self.grid.begins
    }

    pub(super) fn cells(&self) -> usize {
        self.places.len()
    }

    fn length(&self, cell: usize) -> f64 {
        self.grid.knots[cell + 1].way - self.grid.knots[cell].way
    }

    /// The knot at the end of a cell, with the limits of the cell's part.
    fn end_of(&self, cell: usize) -> &Knot {
        self.other_side(cell).unwrap_or(&self.grid.knots[cell + 1])
    }

    /// The knot at the end of a cell with the limits of the part that ends there, if one does.
    fn other_side(&self, cell: usize) -> Option<&Knot> {
        match self.ends_at[cell] {
            0 => None,
            end => Some(&self.grid.ends[usize::from(end) - 1]),
        }
    }

    /// Returns the highest square of the speed at a neighbour of the knot after a cell, within the limits of both parts
    /// that meet there; see [`Knot::reach`].
    fn reach(&mut self, cell: usize, known: f64, [distance, weight]: [f64; 2], pass: Pass) -> f64 {
        let (knot, sign) = (&self.grid.knots[cell + 1], pass.sign());
        // The limits of both parts are reduced together.
        let from = [known, knot.tightness[0], knot.tightness[1]];
        if let Some(most) = self.last_round.reach(pass, cell, from) {
            return most;
        }
        let most = knot.reach(known, distance, weight, sign);
        let most = match self.other_side(cell) {
            None => most,
            Some(other) => most.min(other.reach(known, distance, weight, sign)),
        };
        self.last_round.note_reach(pass, cell, from, most);
        most
    }

    /// Keeps a low speed where the reduced limits leave none: from rest there is always a law.
    fn keep_moving(&mut self) {
        let last = self.cells() - 1;
        let fastest = self.values.iter().fold(0.0_f64, |most, value| most.max(*value));
        let fastest = if fastest > 0.0 { fastest } else { f64::INFINITY };
        for cell in 1..last {
            let highest = self.grid.knots[cell].highest.min(self.grid.knots[cell + 1].highest);
            let least = LEAST_SQUARE * highest.min(fastest);
            self.values[cell] = self.values[cell].max(least);
        }
    }

    /// Returns whether the arm does not stop before the end.
    fn moves_everywhere(&self) -> bool {
        self.paces[1..self.cells()].iter().all(|pace| pace.square > 0.0)
    }

    /// Starts from the highest speeds.
    fn limit(&mut self) -> Option<()> {
        let last = self.cells() - 1;
        self.values.clear();
        let knots = self.grid.knots.windows(2).zip(&self.tops);
        self.values.extend(knots.map(|(pair, top)| pair[0].highest().min(pair[1].highest()).min(*top)));
        self.values[0] = 0.0;
        self.values[last] = 0.0;
        if !self.start.is_rest() {
            // The polygon begins with the present speed and acceleration.
            let first = self.start.square + self.start.acceleration * self.length(0);
            // Rounding may make the arm faster than allowed, but no more than by this.
            let allowed = self.grid.knots[1].highest * (1.0 + 1e-7);
            if first < 0.0 || first > allowed {
                return None;
            }
            self.values[0] = first;
        }
        Some(())
    }

    /// Returns the slope of the polygon over the knot after a cell: the acceleration there.
    fn acceleration(&self, cell: usize) -> f64 {
        (self.values[cell + 1] - self.values[cell]) * self.steps[cell]
    }

    /// Finds speed and acceleration at the knots.
    fn find_paces(&mut self) {
        let cells = self.cells();
        self.paces.clear();
        self.paces.push(self.start);
        for knot in 1..cells {
            self.paces.push(self.pace_at(knot));
        }
        self.paces.push(Pace::REST);
    }

    /// Returns speed and acceleration at a knot between two cells.
    fn pace_at(&self, knot: usize) -> Pace {
        let acceleration = self.acceleration(knot - 1);
        let way = self.grid.knots[knot].way - self.places[knot - 1];
        let square = self.values[knot - 1] + 2.0 * acceleration * way;
        Pace { square: square.max(0.0), acceleration }
    }

    /// Returns the highest square of the speed at the other end of a cell beside a rest, as the jerk allows.
    fn highest_beside_rest(&self, rest: usize, knot: usize, cell: usize) -> f64 {
        let length = self.length(cell);
        let [rest, end] = [rest, knot].map(|knot| self.grid.knots[knot].jerk_at_rest());
        let jerk = rest.min(end);
        let jerk = self.other_side(knot - 1).map_or(jerk, |other| jerk.min(other.jerk_at_rest()));
        let root = libm::cbrt(4.5 * jerk * length * length);
        root * root
    }

    /// Returns how much the acceleration may grow over a cell that is driven with this pace at both ends.
    fn change_room(&mut self, cell: usize, pace: Pace, pass: Pass) -> f64 {
        let Pace { square, acceleration } = pace;
        let [one, other] = [cell, cell + 1].map(|knot| self.grid.knots[knot].tightness[1]);
        let from = [square, acceleration, one, other];
        if let Some(room) = self.last_round.room(pass, cell, from) {
            return room;
        }
        let rooms = [&self.grid.knots[cell], self.end_of(cell)];
        let rooms = rooms.map(|knot| knot.bend_room(square, acceleration, 1.0));
        let room = self.least_change(cell, rooms);
        self.last_round.note_room(pass, cell, from, room);
        room
    }

    /// Returns how much the acceleration may change over a cell by how fast it may change at both ends.
    fn least_change(&self, cell: usize, [one_room, other_room]: [f64; 2]) -> f64 {
        let (one, other) = (&self.grid.knots[cell], self.end_of(cell));
        let length = self.length(cell);
        // A change from rest to the highest speed within the cell is as good as no limit.
        (one_room.min(other_room) * length).min(MUCH * one.highest.max(other.highest) / length)
    }

    /// Lowers the values so that the arm can slow down to those that follow.
    fn backward(&mut self) {
        let last = self.cells() - 1;
        let mut after = 0.0;
        for cell in (1..last).rev() {
            let (knot, next) = (cell + 1, self.values[cell + 1]);
            let distance = self.places[knot] - self.places[cell];
            let weight = (self.places[knot] - self.grid.knots[knot].way) / distance;
            let mut most = self.reach(cell, next, [distance, weight], Pass::Backward);
            if knot == last {
                most = most.min(self.highest_beside_rest(knot + 1, knot, knot) / weight);
            } else {
                let room = self.change_room(knot, Pace { square: next, acceleration: after }, Pass::Backward);
                most = most.min(next + 2.0 * distance * (room - f64::min(after, room / 2.0)));
            }
            if most < self.values[cell] {
                self.values[cell] = most.max(0.0);
            }
            after = self.acceleration(cell);
        }
    }

    /// Lowers the values so that the arm can speed up from those before.
    fn forward(&mut self) {
        let last = self.cells() - 1;
        let mut before = if self.start.is_rest() { 0.0 } else { self.start.acceleration };
        // The present deceleration cannot be undone. Later ones are those of the backward pass.
        let mut is_slowing = before < 0.0;
        for cell in 1..last {
            let (knot, known) = (cell, self.values[cell - 1]);
            let distance = self.places[cell] - self.places[cell - 1];
            let weight = (self.grid.knots[knot].way - self.places[cell - 1]) / distance;
            let mut most = self.reach(cell - 1, known, [distance, weight], Pass::Forward);
            if cell == 1 && self.start.is_rest() {
                most = most.min(self.highest_beside_rest(0, 1, 0) / weight);
            } else {
                let room =
                    self.change_room(cell - 1, Pace { square: known, acceleration: before }, Pass::Forward);
                let change = room + before;
                is_slowing = is_slowing && change < 0.0;
                most = most.min(known + 2.0 * distance * if is_slowing { change } else { change.max(0.0) });
            }
            if most < self.values[cell] {
                self.values[cell] = most.max(0.0);
            }
            before = self.acceleration(cell - 1);
        }
    }

    /// The cell after a knot.
    pub(super) fn cell(&self, knot: usize) -> Cell {
        Cell::new(self.length(knot), self.paces[knot], self.paces[knot + 1])
    }
}

#[cfg(test)]
mod tests;
