//! One step of Newton's method towards the least time, with a barrier before each limit.
//!
//! All values of the polygon change at once. What is sought is the least time, less the logarithms of what is left of each limit
//! at the knots and in the middles of the cells. Speed and acceleration are linear in the values; a jerk is taken as linear
//! for one step. Each cell depends on three values, so the matrix has two bands beside its diagonal.

use super::super::extremes::larger;
use super::super::knot::{Knot, largest};
use super::super::load::Ramps;
use super::super::slopes::Slopes;
use super::Law;
use crate::arm::{AXES, dot};

/// What is left of a limit counts as this share of it at least.
pub(super) const LEAST_LEFT: f64 = 2e-3;

/// Least share by which the joints' speed at a knot is below that of the middles around it, to be looked at.
const LEAST_BELOW: f64 = 1e-6;

/// Largest share of what is left of a limit that one step uses.
const USED: f64 = 0.9;

/// Largest share of its value by which one step lowers it.
const LOWERED: f64 = 0.5;

type Vector = [f64; 3];

/// The square of the speed, the acceleration and its growth with the way, by the value before a cell, in it and behind it.
type Map = [Vector; 3];

/// A load, and how it changes with the first `BY` figures of a [`Map`]; with the others it does not change.
type Load<const BY: usize> = (f64, [f64; BY]);

/// Receiver of each limit of a place.
trait Limits {
    /// Looks at the limit that the squares of these loads together come to at most `whole`.
    fn limit<const LOADS: usize, const BY: usize>(&mut self, loads: [Load<BY>; LOADS], whole: f64);
}

/// The barrier before the limits at a place: its slope by the three figures of a [`Map`], and how it bends. Of the matrix
/// only what is not above the diagonal counts.
#[derive(Default)]
struct Barrier {
    slope: Vector,
    bend: [Vector; 3],
}

impl Limits for Barrier {
    #[expect(
        clippy::needless_range_loop,
        reason = "the indices of a matrix and of a vector, as one writes them"
    )]
    #[inline]
    fn limit<const LOADS: usize, const BY: usize>(&mut self, loads: [Load<BY>; LOADS], whole: f64) {
        let used: f64 = loads.iter().map(|(load, _)| load * load).sum();
        let left = whole - used;
        // A limit that is exceeded is to be kept after one step, not to give way by what is left of it.
        let (left, softness) = match left >= LEAST_LEFT {
            true => (left, 1.0),
            false => (LEAST_LEFT, LEAST_LEFT / (2.0 * LEAST_LEFT - left)),
        };
        let weight = 2.0 / left;
        let mut slope = [0.0; BY];
        for (load, by) in loads {
            let (first, second) = (weight * load, by.map(|factor| weight * factor));
            for i in 0..BY {
                slope[i] += first * by[i];
                for j in 0..=i {
                    self.bend[i][j] += second[i] * by[j];
                }
            }
        }
        for i in 0..BY {
            self.slope[i] += slope[i];
            for j in 0..=i {
                self.bend[i][j] += softness * slope[i] * slope[j];
            }
        }
    }
}

impl Barrier {
    fn row(&self, i: usize) -> Vector {
        core::array::from_fn(|j| if j <= i { self.bend[i][j] } else { self.bend[j][i] })
    }
}

/// Returns the loads of a joint or of a coordinate of the tool: acceleration and jerk.
#[inline]
fn loads([slope, bend, twist]: Vector, pace: Vector, [fast, half]: [f64; 2]) -> (Load<2>, Load<3>) {
    let [square, acceleration, growth] = pace;
    let jerk = slope * growth + 3.0 * bend * acceleration + twist * square;
    (
        (slope * acceleration + bend * square, [bend, slope]),
        (jerk * fast, [twist * fast + jerk * half, 3.0 * bend * fast, slope * fast]),
    )
}

/// A place of a cell with the shares of its limits that may be used.
struct Site<'a> {
    map: Map,
    slopes: &'a Slopes,
    tightness: [f64; 2],
    ramps: &'a Ramps,
    /// The square of the highest speed that the joints allow; infinite where it is looked at elsewhere.
    top: f64,
}

impl Site<'_> {
    /// The figures of the [`Map`] for these values.
    fn figures(&self, values: Vector) -> Vector {
        self.map.map(|row| dot(row, values))
    }

    /// Passes each limit to `limits`, with its loads at these values.
    #[inline]
    fn each_limit(&self, values: Vector, limits: &mut impl Limits) {
        let pace = self.figures(values);
        self.each_load(pace, limits);
        if self.top.is_finite() {
            limits.limit([(pace[0] / self.top, [1.0 / self.top])], 1.0);
        }
    }

    /// The same with the accelerations and jerks, by turns.
    #[inline]
    fn each_load(&self, pace: Vector, limits: &mut impl Limits) {
        let speed = pace[0].max(f64::MIN_POSITIVE).sqrt();
        let speeds = |ramp_s: f64| [speed * ramp_s, 0.5 * ramp_s / speed];
        let (slows, Ramps { ramp_s, tool_ramp_s, .. }) = (pace[1] < 0.0, self.ramps);
        let [accelerated, jerked] = self.tightness.map(|share| share * share);
        let slowed = if slows { self.ramps.deceleration } else { 1.0 };
        let Slopes { slope, bend, twist, tool: [along, across, around] } = self.slopes;
        for axis in 0..AXES {
            // A joint that stands, or that the arm does not have.
            if [slope, bend, twist].iter().all(|by| by[axis].abs() <= 0.0) {
                continue;
            }
            let (one, other) = loads([slope[axis], bend[axis], twist[axis]], pace, speeds(ramp_s[axis]));
            limits.limit([one], accelerated * slowed * slowed);
            limits.limit([other], jerked);
        }
        let slowed = if slows { self.ramps.bent_tool_deceleration() } else { 1.0 };
        let fast = speeds(*tool_ramp_s);
        let tool: [_; 3] = core::array::from_fn(|i| loads([along[i], across[i], around[i]], pace, fast));
        limits.limit(tool.map(|(one, _)| one), accelerated * slowed * slowed);
        limits.limit(tool.map(|(_, other)| other), jerked);
        let slowed = self.ramps.tool_deceleration;
        if slowed < 1.0 {
            let by = self.slopes.along_path();
            let load = dot(by, pace);
            if load < 0.0 {
                let [by_square, by_acceleration, _] = by;
                limits.limit([(load, [by_square, by_acceleration])], accelerated * slowed * slowed);
            }
        }
    }
}

/// The share of a change up to which all limits are kept.
struct Share {
    /// Change of the three figures of a [`Map`].
    change: Vector,
    share: f64,
}

impl Limits for Share {
    #[expect(clippy::needless_range_loop, reason = "a scalar product without its first term")]
    #[inline]
    fn limit<const LOADS: usize, const BY: usize>(&mut self, loads: [Load<BY>; LOADS], whole: f64) {
        let (mut used, mut along, mut square) = (0.0, 0.0, 0.0);
        for (load, by) in loads {
            let mut changed = by[0] * self.change[0];
            for i in 1..BY {
                changed += by[i] * self.change[i];
            }
            (used, along, square) = (used + load * load, along + load * changed, square + changed * changed);
        }
        let left = USED * larger(whole - used, LEAST_LEFT);
        if square + 2.0 * along > left {
            self.share = self.share.min(largest(square, along, -left));
        }
    }
}

impl Law {
    /// Changes the values of the cells from `first`, which is 2 at least, up to the last but two: one step towards the least
    /// time, where a second counts `weight`.
    pub(super) fn step(&mut self, first: usize, weight: f64) {
        let (cells, end) = (self.cells(), self.cells() - 2);
        self.rows.clear();
        self.rows.extend((0..cells).map(|_| [0.0; 3]));
        self.change.clear();
        self.change.extend((0..cells).map(|_| 0.0));
        for cell in first..end {
            let value = self.values[cell];
            let (rest, length) = (1.0 / self.left_of_speed(cell), weight * self.length(cell));
            let slope = 0.5 * length / (value * value.sqrt());
            self.change[cell] = slope - rest;
            self.rows[cell][0] = 1.5 * slope / value + rest * rest;
        }
        (first - 1..=end).for_each(|cell| self.add_barriers(cell));
        self.solve(first, end);
        let share = self.share(first, end);
        for cell in first..end {
            self.values[cell] += share * self.change[cell];
        }
    }

    /// What is left to the highest square of the speed in a cell: more than nothing, as no step uses it all.
    fn left_of_speed(&self, cell: usize) -> f64 {
        (self.tops[cell] - self.values[cell]).max(f64::EPSILON * self.values[cell])
    }

    /// The start, the middle and the end of a cell.
    fn sites(&self, cell: usize) -> [Site<'_>; 3] {
        let ahead = |knot: usize| {
            let step = self.steps[knot - 1];
            (step, 2.0 * step * (self.grid.knots[knot].way - self.places[knot - 1]))
        };
        let (length, (from, begin), (to, finish)) = (self.length(cell), ahead(cell), ahead(cell + 1));
        let (first, last) = ([-from, from, 0.0], [0.0, -to, to]);
        let growth: Vector = core::array::from_fn(|i| (last[i] - first[i]) / length);
        let (start, end) = ([1.0 - begin, begin, 0.0], [0.0, 1.0 - finish, finish]);
        let between = |i: usize| (start[i] + end[i]) / 2.0 - growth[i] * length * length / 4.0;
        let middle = [core::array::from_fn(between), core::array::from_fn(|i| (first[i] + last[i]) / 2.0)];
        let (one, other) = (&self.grid.knots[cell], self.end_of(cell));
        let both = core::array::from_fn(|i| one.tightness[i].min(other.tightness[i]));
        // The values are limited by what the joints allow in the middles. At a place that matters only where they allow less there
        // than what the values let expect: at a knot, and in a middle where the squares of the speeds lie above their polygon.
        let highest = around(&self.tops, cell);
        let below = |top: f64, at: Vector| {
            if top < (1.0 - LEAST_BELOW) * dot(at, highest) { top } else { f64::INFINITY }
        };
        let top = |knot: &Knot, at: Vector| below(knot.rates.highest(&knot.slopes.slope), at);
        let tops = [
            top(one, start),
            below(self.tops[cell], middle[0]),
            self.other_side(cell).map_or(f64::INFINITY, |end_of_part| top(end_of_part, end)),
        ];
        let site =
            |map: Map, slopes, tightness, top| Site { map, slopes, tightness, ramps: &one.rates.ramps, top };
        [
            site([start, first, growth], &one.slopes, one.tightness, tops[0]),
            site([middle[0], middle[1], growth], &self.grid.middles[cell], both, tops[1]),
            site([end, last, growth], &other.slopes, other.tightness, tops[2]),
        ]
    }

    fn add_barriers(&mut self, cell: usize) {
        let values = around(&self.values, cell);
        let (mut slope, mut bend) = ([0.0; 3], [[0.0; 3]; 3]);
        for site in self.sites(cell) {
            let mut barrier = Barrier::default();
            site.each_limit(values, &mut barrier);
            let rows = [0, 1, 2].map(|i| barrier.row(i));
            let columns: [Vector; 3] = core::array::from_fn(|i| site.map.map(|row| row[i]));
            for i in 0..3 {
                slope[i] += dot(columns[i], barrier.slope);
                let across = rows.map(|row| dot(row, columns[i]));
                for j in i..3 {
                    bend[i][j - i] += dot(across, columns[j]);
                }
            }
        }
        for i in 0..3 {
            self.change[cell - 1 + i] -= slope[i];
            for (sum, bend) in self.rows[cell - 1 + i].iter_mut().zip(bend[i]) {
                *sum += bend;
            }
        }
    }

    /// Solves for the change of the values from `first` up to before `end`. The others stay.
    fn solve(&mut self, first: usize, end: usize) {
        let Self { rows, change, .. } = self;
        change[..first].fill(0.0);
        change[end..].fill(0.0);
        for row in first..end {
            let [diagonal, next, next_but_one] = rows[row];
            for (distance, factor) in [(1, next / diagonal), (2, next_but_one / diagonal)] {
                if row + distance < end {
                    rows[row + distance][0] -= factor * rows[row][distance];
                    if distance == 1 {
                        rows[row + 1][1] -= factor * next_but_one;
                    }
                    change[row + distance] -= factor * change[row];
                }
            }
        }
        for row in (first..end).rev() {
            let [diagonal, bands @ ..] = rows[row];
            for (distance, band) in (1..).zip(bands) {
                if row + distance < end {
                    change[row] -= band * change[row + distance];
                }
            }
            change[row] /= diagonal;
        }
    }

    /// Returns the share of the change up to which all limits are kept.
    fn share(&self, first: usize, end: usize) -> f64 {
        let mut share = 1.0_f64;
        for cell in first..end {
            let (value, change) = (self.values[cell], self.change[cell]);
            let most = USED * self.left_of_speed(cell);
            if change > most {
                share = share.min(most / change);
            } else if change < -LOWERED * value {
                share = share.min(-LOWERED * value / change);
            }
        }
        for cell in first - 1..=end {
            let (values, change) = (around(&self.values, cell), around(&self.change, cell));
            for site in self.sites(cell) {
                let mut limits = Share { change: site.figures(change), share };
                site.each_limit(values, &mut limits);
                share = limits.share;
            }
        }
        share
    }
}

/// The figures of a cell and of those beside it.
fn around(list: &[f64], cell: usize) -> Vector {
    core::array::from_fn(|i| list[cell - 1 + i])
}

#[cfg(test)]
mod tests;
