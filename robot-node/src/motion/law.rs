//! The time law of a stretch of path: as fast as joints and tool allow, from where the arm is to the next rest.
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
//! Values as high as the limits of the knots allow are found in three passes: backward, from the rest at the end, as steep as
//! slowing down and its end may be; forward the same for speeding up; and the corners at the top, where the acceleration falls, are
//! rounded by the jerk (a convex hull once its parabola is added). What comes out is held against the limits at all knots, and
//! where it takes too much the limits are drawn tighter.

use arrayvec::ArrayVec;

use super::grid::{Grid, KNOTS, Part};
use super::node::{Knot, Pace};

/// How much more than is planned with a law may take: of the reserve, nothing to speak of, and where the arm already moves, a
/// little.
const EXACT: f64 = 5e-3;
const SLACK: f64 = 8e-3;

/// So often limits are drawn tighter at most.
const ROUNDS: usize = 5;

/// The share of a limit that is left at least where it is drawn tighter.
const TIGHTEST: f64 = 0.2;

/// The least share of the highest square of the speed that is kept.
const SLOWEST: f64 = 1e-6;

/// So many times the highest square of the speed over a cell's length is more than any acceleration.
const MUCH: f64 = 10.0;

/// How the speed goes within a cell.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Shape {
    /// The acceleration grows evenly with the way, by this much.
    Even(f64),
    /// With a constant jerk from rest.
    FromRest(f64),
    /// With a constant jerk to rest.
    ToRest(f64),
}

/// A piece of a law between two knots.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Cell {
    pub(super) length: f64,
    /// How long it takes, in s.
    pub(super) duration: f64,
    speed: f64,
    acceleration: f64,
    shape: Shape,
}

impl Cell {
    /// From one knot to the next, with the pace at both.
    fn new(length: f64, from: Pace, to: Pace) -> Self {
        let [speed, exit] = [from, to].map(|pace| pace.square.max(0.0).sqrt());
        if from.is_rest() || to.is_rest() {
            let speed_there = speed.max(exit);
            let jerk = 2.0 / 9.0 * speed_there * speed_there * speed_there / (length * length);
            let shape = if from.is_rest() { Shape::FromRest(jerk) } else { Shape::ToRest(jerk) };
            let duration = 3.0 * length / speed_there;
            return Self { length, duration, speed, acceleration: from.acceleration, shape };
        }
        let mean = (speed + exit) / 2.0;
        let bend = (to.acceleration - from.acceleration) * length / (4.0 * mean * mean);
        let duration = length / mean * area_tangent(bend);
        let shape = Shape::Even((to.acceleration - from.acceleration) / length);
        Self { length, duration, speed, acceleration: from.acceleration, shape }
    }

    /// Way and pace after some time, in s.
    pub(super) fn at(&self, time: f64) -> (f64, Pace) {
        match self.shape {
            Shape::Even(change) => {
                let (sine, cosine) = hyperbolic(change, time);
                let way = self.speed * sine + self.acceleration * cosine;
                let growth = 1.0 + change * cosine;
                let speed = self.speed * growth + self.acceleration * sine;
                let acceleration = self.acceleration * growth + change * self.speed * sine;
                (way.min(self.length), Pace { square: speed * speed, acceleration })
            }
            Shape::FromRest(jerk) => {
                let speed = jerk / 2.0 * time * time;
                (speed * time / 3.0, Pace { square: speed * speed, acceleration: jerk * time })
            }
            Shape::ToRest(jerk) => {
                let left = (self.duration - time).max(0.0);
                let speed = jerk / 2.0 * left * left;
                (self.length - speed * left / 3.0, Pace { square: speed * speed, acceleration: -jerk * left })
            }
        }
    }

    /// The jerk after some time, with the pace then.
    pub(super) fn jerk(&self, pace: &Pace) -> f64 {
        match self.shape {
            Shape::Even(change) => change * pace.square.sqrt(),
            Shape::FromRest(jerk) | Shape::ToRest(jerk) => jerk,
        }
    }

    pub(super) const fn is_from_rest(&self) -> bool {
        matches!(self.shape, Shape::FromRest(_))
    }

    pub(super) const fn is_to_rest(&self) -> bool {
        matches!(self.shape, Shape::ToRest(_))
    }

    /// When its acceleration becomes negative and stays so until the cell's end, in s; none where it is not negative there.
    pub(super) fn brakes_from(&self) -> Option<f64> {
        let Shape::Even(change) = self.shape else {
            return matches!(self.shape, Shape::ToRest(_)).then_some(0.0);
        };
        let end = self.acceleration + change * self.length;
        if end >= 0.0 {
            None
        } else if self.acceleration <= 0.0 {
            Some(0.0)
        } else {
            // Where a = 0: tanh(√change·t)/√change = −a/(change·v), and change is negative here.
            let root = (-change).sqrt();
            Some((libm::atan(self.acceleration / (root * self.speed)) / root).min(self.duration))
        }
    }
}

/// artanh(√x)/√x, for a negative x as well.
fn area_tangent(x: f64) -> f64 {
    if x.abs() < 0.05 {
        // 1 + x/3 + x²/5 + …
        let mut sum = 0.0;
        for order in (0..11).rev() {
            sum = sum * x + 1.0 / f64::from(2 * order + 1);
        }
        sum
    } else if x > 0.0 {
        let root = x.min(1.0 - f64::EPSILON).sqrt();
        libm::atanh(root) / root
    } else {
        let root = (-x).sqrt();
        libm::atan(root) / root
    }
}

/// sinh(√x·t)/√x and (cosh(√x·t) − 1)/x, for a negative x as well.
fn hyperbolic(x: f64, time: f64) -> (f64, f64) {
    let square = x * time * time;
    if square.abs() < 1.0 {
        let (mut sine, mut cosine) = (0.0, 0.0);
        for order in (1..9).rev() {
            let order = f64::from(order);
            sine = (sine + 1.0) * square / ((2.0 * order) * (2.0 * order + 1.0));
            cosine = (cosine + 1.0) * square / ((2.0 * order + 1.0) * (2.0 * order + 2.0));
        }
        ((1.0 + sine) * time, (1.0 + cosine) * time * time / 2.0)
    } else if x > 0.0 {
        let root = x.sqrt();
        let angle = root * time;
        (libm::sinh(angle) / root, (libm::cosh(angle) - 1.0) / x)
    } else {
        let root = (-x).sqrt();
        let (sin, cos) = libm::sincos(root * time);
        (sin / root, (cos - 1.0) / x)
    }
}

type List = ArrayVec<f64, KNOTS>;

/// A law over the knots of a grid. It has room for the longest stretch, so that none is allocated.
#[derive(Debug, Default)]
pub(super) struct Law {
    grid: Grid,
    /// For each cell the number of its end among the grid's, counted from 1, if another part begins there.
    ends_at: ArrayVec<u8, KNOTS>,
    start: Pace,
    /// Where the values of the polygon stand, one for each cell.
    places: List,
    values: List,
    /// One over twice the distance from each place to the next one.
    steps: List,
    /// How the arm moves at the knots.
    paces: ArrayVec<Pace, KNOTS>,
    /// The values of the round that was best so far.
    best: List,
    /// What the rounding of the top adds to the values, and its corners.
    added: List,
    hull: ArrayVec<u16, KNOTS>,
}

impl Law {
    /// Finds the fastest law for these parts, from a pace at the start to rest at the end; none where the arm cannot go on so from
    /// there.
    pub(super) fn find(&mut self, parts: &[Part<'_>], start: Pace) -> Option<()> {
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
            let (most, ratio) = self.tighten(1.0 + 0.5 * round as f64);
            if most <= 1.0 + EXACT || (round > 1 && most <= 1.0 + allowed) {
                return Some(());
            }
            if start.is_rest() && ratio < least {
                least = ratio;
                self.best.clone_from(&self.values);
            }
        }
        // From rest all of it may be slower.
        if !start.is_rest() || !least.is_finite() {
            return None;
        }
        self.values.clear();
        self.values.extend(self.best.iter().map(|value| value / (least * least)));
        self.find_paces();
        Some(())
    }

    /// Puts the values into the middles of the cells, and nearer to a rest beside one.
    fn place(&mut self) {
        let knots = &self.grid.knots;
        let cells = knots.len() - 1;
        self.ends_at.clear();
        self.ends_at.extend((0..cells).map(|_| 0));
        for (part, begin) in self.grid.begins.iter().enumerate().skip(1) {
            self.ends_at[begin - 1] = part as u8;
        }
        self.places.clear();
        self.places.extend(knots.windows(2).map(|pair| (pair[0].way + pair[1].way) / 2.0));
        let length = |cell: usize| knots[cell + 1].way - knots[cell].way;
        if self.start.is_rest() {
            self.places[0] = knots[0].way + 0.25 * length(0);
        }
        self.places[cells - 1] = knots[cells].way - 0.25 * length(cells - 1);
        self.steps.clear();
        self.steps.extend(self.places.windows(2).map(|pair| 0.5 / (pair[1] - pair[0])));
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

    /// The knot at the end of a cell, as the cell's part has it.
    fn end_of(&self, cell: usize) -> &Knot {
        match self.ends_at[cell] {
            0 => &self.grid.knots[cell + 1],
            end => &self.grid.ends[usize::from(end) - 1],
        }
    }

    /// From rest there is always a law: where limits that are drawn tighter leave no speed, a slow one is kept.
    fn keep_moving(&mut self) {
        let last = self.cells() - 1;
        for cell in 1..last {
            let least = SLOWEST * self.grid.knots[cell].highest.min(self.grid.knots[cell + 1].highest);
            self.values[cell] = self.values[cell].max(least);
        }
    }

    /// Whether the arm does not come to a stop before the end.
    fn moves_everywhere(&self) -> bool {
        self.paces[1..self.cells()].iter().all(|pace| pace.square > 0.0)
    }

    /// Starts from the highest speeds.
    fn limit(&mut self) -> Option<()> {
        let last = self.cells() - 1;
        self.values.clear();
        self.values.extend(self.grid.knots.windows(2).map(|pair| pair[0].highest().min(pair[1].highest())));
        self.values[0] = 0.0;
        self.values[last] = 0.0;
        if !self.start.is_rest() {
            // The polygon goes on as the arm moves.
            let first = self.start.square + self.start.acceleration * self.length(0);
            // What the arm is faster than allowed by rounding is no more than that.
            let allowed = self.grid.knots[1].highest * (1.0 + 1e-7);
            if first < 0.0 || last == 0 || first > allowed {
                return None;
            }
            self.values[0] = first;
        }
        Some(())
    }

    /// How steep the polygon is over the knot after a cell: the acceleration there.
    fn acceleration(&self, cell: usize) -> f64 {
        (self.values[cell + 1] - self.values[cell]) * self.steps[cell]
    }

    /// Finds how the arm moves at the knots.
    fn find_paces(&mut self) {
        let cells = self.cells();
        self.paces.clear();
        self.paces.push(self.start);
        for knot in 1..cells {
            let acceleration = self.acceleration(knot - 1);
            let way = self.grid.knots[knot].way - self.places[knot - 1];
            let square = self.values[knot - 1] + 2.0 * acceleration * way;
            self.paces.push(Pace { square: square.max(0.0), acceleration });
        }
        self.paces.push(Pace::REST);
    }

    /// The highest square at the other end of a cell beside a rest, by the jerk.
    fn highest_beside_rest(&self, rest: usize, knot: usize, cell: usize) -> f64 {
        let length = self.length(cell);
        let jerk = self.grid.knots[rest].at_rest().1.min(self.grid.knots[knot].at_rest().1);
        let root = libm::cbrt(4.5 * jerk * length * length);
        root * root
    }

    /// By how much the acceleration may change over a cell with this square of the speed.
    fn change_room(&self, cell: usize, square: f64, acceleration: f64, sign: f64) -> f64 {
        let room = |knot: &Knot| knot.bend_room(square, acceleration, sign);
        let (one, other) = (&self.grid.knots[cell], self.end_of(cell));
        let length = self.length(cell);
        // More than from rest to the highest speed within the cell is no limit.
        (room(one).min(room(other)) * length).min(MUCH * one.highest.max(other.highest) / length)
    }

    /// As fast as slowing down to what comes allows.
    fn backward(&mut self) {
        let last = self.cells() - 1;
        let mut after = 0.0;
        for cell in (1..last).rev() {
            let (knot, next) = (cell + 1, self.values[cell + 1]);
            let distance = self.places[knot] - self.places[cell];
            let weight = (self.places[knot] - self.grid.knots[knot].way) / distance;
            let mut most = self.grid.knots[knot].reach(next, distance, weight, -1.0);
            if knot == last {
                most = most.min(self.highest_beside_rest(knot + 1, knot, knot) / weight);
            } else {
                let room = self.change_room(knot, next, after, 1.0);
                most = most.min(next + 2.0 * distance * (room - f64::min(after, room / 2.0)));
            }
            if most < self.values[cell] {
                self.values[cell] = most.max(0.0);
            }
            after = self.acceleration(cell);
        }
    }

    /// As fast as speeding up from what was allows.
    fn forward(&mut self) {
        let last = self.cells() - 1;
        let mut before = if self.start.is_rest() { 0.0 } else { self.start.acceleration };
        // How the arm comes cannot be helped. What comes later is as the way backward has it.
        let mut is_slowing = before < 0.0;
        for cell in 1..last {
            let (knot, known) = (cell, self.values[cell - 1]);
            let distance = self.places[cell] - self.places[cell - 1];
            let weight = (self.grid.knots[knot].way - self.places[cell - 1]) / distance;
            let mut most = self.grid.knots[knot].reach(known, distance, weight, 1.0);
            if cell == 1 && self.start.is_rest() {
                most = most.min(self.highest_beside_rest(0, 1, 0) / weight);
            } else {
                let room = self.change_room(cell - 1, known, before, 1.0);
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

    /// Rounds the corners at the top, where the acceleration falls faster than the jerk allows.
    fn round_off(&mut self) -> Option<()> {
        let cells = self.cells();
        let moves = !self.start.is_rest();
        // With the parabolas of the jerk added, what is allowed is convex.
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
        self.hull.clear();
        // The slope with which the arm comes is kept.
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

    /// A value with what the rounding adds to it.
    fn height(&self, cell: usize) -> f64 {
        self.values[cell] + self.added[cell]
    }

    fn steepness(&self, one: usize, other: usize) -> f64 {
        (self.height(other) - self.height(one)) / (self.places[other] - self.places[one])
    }

    /// Draws the limits tighter where the law takes more than they are. Returns the most of a limit that it takes, and how much
    /// too fast that is.
    fn tighten(&mut self, power: f64) -> (f64, f64) {
        let cells = self.cells();
        let mut most = [0.0_f64; 2];
        let mut before = [0.0_f64; 2];
        for cell in 0..cells {
            let [start, middle, end] = self.loads_of(cell);
            for loads in [start, middle, end] {
                most = [most[0].max(loads[0]), most[1].max(loads[1])];
            }
            self.draw(cell..=cell, [before[0].max(start[0]), before[1].max(start[1])], power);
            self.draw(cell..=cell + 1, middle, power);
            before = end;
        }
        self.draw(cells..=cells, before, power);
        (most[0].max(most[1]), most[0].sqrt().max(libm::cbrt(most[1])))
    }

    /// What the law takes of the limits in a cell: at its start, in its middle and at its end.
    fn loads_of(&self, cell: usize) -> [[f64; 2]; 3] {
        let [from, to] = [self.paces[cell], self.paces[cell + 1]];
        let [start, end] = [&self.grid.knots[cell], self.end_of(cell)];
        let length = self.length(cell);
        if from.is_rest() || to.is_rest() {
            let square = from.square.max(to.square);
            let jerk = 2.0 / 9.0 * square * square.sqrt() / (length * length);
            let there = if from.is_rest() { (end, to) } else { (start, from) };
            let loads = there.0.loads(there.1.square, there.1.acceleration, jerk);
            let at_rest = if from.is_rest() { start } else { end };
            let rest = [0.0, jerk / at_rest.at_rest().1 * at_rest.tightness[1]];
            // Half-way b and a are these shares of what they are there: they go with s^(4/3) and s^(1/3).
            let (half_square, half) = (libm::cbrt(1.0 / 16.0), libm::cbrt(0.5));
            let middle =
                start.loads_between(end, half_square * there.1.square, half * there.1.acceleration, jerk);
            return if from.is_rest() { [rest, middle, loads] } else { [loads, middle, rest] };
        }
        let change = (to.acceleration - from.acceleration) / length;
        let at =
            |knot: &Knot, pace: Pace| knot.loads(pace.square, pace.acceleration, change * pace.square.sqrt());
        let mut loads = [at(start, from), [0.0; 2], at(end, to)];
        if cell == 0 {
            // What the arm does at the start cannot be helped; how it goes on can.
            loads[0][0] = 0.0;
        }
        let acceleration = (from.acceleration + to.acceleration) / 2.0;
        let square = (from.square + to.square) / 2.0 - change * length * length / 4.0;
        let jerk = change * square.max(0.0).sqrt();
        // It may be more than at both ends.
        loads[1] = start.loads_between(end, square, acceleration, jerk);
        loads
    }

    /// Draws limits tighter where more than they are is taken.
    fn draw(&mut self, knots: core::ops::RangeInclusive<usize>, [accelerated, jerked]: [f64; 2], power: f64) {
        let (first, last) = (*knots.start(), *knots.end());
        let [accelerated, jerked] = [accelerated, jerked].map(|load| 1.0 + power * (load - 1.0));
        if accelerated > 1.0 + EXACT {
            (first..=last).for_each(|knot| self.draw_at(knot, 0, accelerated));
        }
        if jerked > 1.0 + EXACT {
            for knot in first.saturating_sub(1)..=(last + 1).min(self.grid.knots.len() - 1) {
                let is_near = !(first..=last).contains(&knot);
                self.draw_at(knot, 1, if is_near { jerked.sqrt() } else { jerked });
            }
        }
    }

    fn draw_at(&mut self, knot: usize, limit: usize, ratio: f64) {
        let end = knot.checked_sub(1).map_or(0, |cell| self.ends_at[cell]);
        let end = usize::from(end).checked_sub(1).and_then(|end| self.grid.ends.get_mut(end));
        for knot in self.grid.knots.get_mut(knot).into_iter().chain(end) {
            let share = &mut knot.tightness[limit];
            *share = (*share / ratio).max(TIGHTEST);
        }
    }

    /// The cell after a knot.
    pub(super) fn cell(&self, knot: usize) -> Cell {
        Cell::new(self.length(knot), self.paces[knot], self.paces[knot + 1])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::grid::Part;
    use super::super::node::{Node, Ratings};
    use super::*;
    use crate::arm::AxisLimits;

    /// One joint that turns by `way`, with a share of its acceleration for slowing down.
    fn one_joint(way: f64, [speed, acceleration, jerk]: [f64; 3], deceleration: f64) -> (Vec<Node>, Ratings) {
        let all = |value: f64| [value; 6];
        let rated = AxisLimits {
            lower: all(-1e9),
            upper: all(1e9),
            speed: all(speed),
            acceleration: all(acceleration),
            jerk: all(jerk),
        };
        let ratings = Ratings { deceleration, ..Ratings::of_axes(&rated, 1.0, 1.0) };
        let ways = [way, 0.0, 0.0, 0.0, 0.0, 0.0];
        let nodes = (0..=16).map(|node| Node::of_axes(f64::from(node) / 16.0, speed / way, &ways, &ratings));
        (nodes.collect(), ratings)
    }

    /// The law of the whole way from rest to rest, in degrees.
    fn law(nodes: &[Node], ratings: &Ratings) -> Vec<Cell> {
        let part = Part { nodes, ratings, from: 0.0, to: 1.0, unit: 1.0, motion: 0, in_blend: false };
        let mut law = Box::<Law>::default();
        law.find(&[part], Pace::REST).expect("there is a law from rest");
        (0..law.cells()).map(|cell| law.cell(cell)).collect()
    }

    fn duration(cells: &[Cell]) -> f64 {
        cells.iter().map(|cell| cell.duration).sum()
    }

    #[test]
    fn one_joint_takes_hardly_longer_than_the_optimum_that_is_known() {
        // Long enough to reach the speed: way over speed, and the times to get there and back.
        let (nodes, ratings) = one_joint(300.0, [200.0, 1_000.0, 20_000.0], 1.0);
        let optimum = 300.0 / 200.0 + 200.0 / 1_000.0 + 1_000.0 / 20_000.0;
        let ratio = duration(&law(&nodes, &ratings)) / optimum;
        assert!((0.998..1.02).contains(&ratio), "{ratio}");
    }

    #[test]
    fn slowing_down_has_a_limit_of_its_own() {
        let (nodes, ratings) = one_joint(300.0, [200.0, 1_000.0, 20_000.0], 0.25);
        let accelerations: Vec<f64> =
            law(&nodes, &ratings).iter().map(|cell| 300.0 * cell.at(0.0).1.acceleration).collect();
        let [highest, lowest] =
            [f64::max, f64::min].map(|pick| accelerations.iter().copied().fold(0.0, pick));
        assert!((950.0..1_006.0).contains(&highest), "{highest} degrees/s²");
        assert!((-251.5..-235.0).contains(&lowest), "{lowest} degrees/s²");
    }

    proptest! {
        #[test]
        fn a_law_goes_on_at_each_knot_as_it_came_and_keeps_its_limits(
            way in 0.1..500.0_f64,
            speed in 5.0..500.0_f64,
            acceleration in 50.0..5_000.0_f64,
            ramp_s in 0.005..0.1_f64,
            deceleration in 0.2..1.0_f64,
        ) {
            let jerk = acceleration / ramp_s;
            let (nodes, ratings) = one_joint(way, [speed, acceleration, jerk], deceleration);
            let cells = law(&nodes, &ratings);
            let mut came = Pace::REST;
            for cell in &cells {
                let start = cell.at(0.0).1;
                let scale = (speed / way) * (speed / way);
                prop_assert!((start.square - came.square).abs() < 1e-6 * scale, "{start:?} after {came:?}");
                prop_assert!((start.acceleration - came.acceleration).abs() * way < 1e-3 * acceleration);
                for step in 0..=10 {
                    let (_, pace) = cell.at(cell.duration * f64::from(step) / 10.0);
                    prop_assert!(pace.square.sqrt() * way <= speed * 1.001);
                    prop_assert!(pace.acceleration * way <= acceleration * 1.006);
                    prop_assert!(-pace.acceleration * way <= deceleration * acceleration * 1.006);
                    prop_assert!(cell.jerk(&pace).abs() * way <= jerk * 1.006);
                }
                came = cell.at(cell.duration).1;
            }
            prop_assert!(came.square.sqrt() * way < 1e-6 * speed, "it ends at rest: {came:?}");
        }
    }
}
