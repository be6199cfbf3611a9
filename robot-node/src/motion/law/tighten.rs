//! How much of the limits a law uses, and reduced limits where that is too much.

use super::super::extremes::larger;
use super::super::load::Load;
use super::super::node::Pace;
use super::super::slopes::Slopes;
use super::recalled::Loads;
use super::{EXACT, Law};
use crate::arm::dot;

/// Least share to which a limit is reduced.
const TIGHTEST: f64 = 0.2;

/// Shares of the square of the speed and of the acceleration half-way to or from a rest: ½^(4/3) and ½^(1/3).
const HALF_WAY: [f64; 2] = [0.396_850_262_992_049_86, 0.793_700_525_984_099_7];

/// Returns the larger one of each.
fn larger_of_each(one: [f64; 2], other: [f64; 2]) -> [f64; 2] {
    [larger(one[0], other[0]), larger(one[1], other[1])]
}

/// Number of parts of a cell at whose borders the deceleration along the path is looked at.
const PLACES: u32 = 16;

/// The same for the speeds of joints.
const SPEED_PLACES: u32 = 8;

impl Law {
    /// Reduces the limits where the law exceeds them, and lowers the tops of cells in which a joint is too fast. Returns the largest
    /// used share of a limit, and the ratio by which the law is too fast.
    pub(super) fn tighten(&mut self, power: f64) -> (f64, f64) {
        let cells = self.cells();
        let mut most = [0.0_f64; 2];
        let mut before = [0.0_f64; 2];
        let mut fastest = 0.0;
        for cell in 0..cells {
            let speed = self.speed_between(cell);
            fastest = larger(fastest, speed);
            self.lower_top(cell, speed);
            let [start, middle, end] = self.loads_again(cell);
            for loads in [start, middle, end] {
                most = larger_of_each(most, loads);
            }
            self.draw(cell..=cell, larger_of_each(before, start), power);
            self.draw(cell..=cell + 1, middle, power);
            before = end;
        }
        self.draw(cells..=cells, before, power);
        let ratio = most[0].sqrt().max(libm::cbrt(most[1])).max(fastest);
        (most[0].max(most[1]).max(fastest), ratio)
    }

    /// Returns the largest share of a joint's rated speed that the law uses within a cell; 0 where surely none reaches it.
    fn speed_between(&self, cell: usize) -> f64 {
        let ([from, to], length) = ([self.paces[cell], self.paces[cell + 1]], self.length(cell));
        let is_beside_rest = from.is_rest() || to.is_rest();
        let change = (to.acceleration - from.acceleration) / length;
        // A parabola is nowhere above its highest control point.
        let between = from.square + from.acceleration * length;
        let highest = if is_beside_rest { 0.0 } else { between };
        if from.square.max(to.square).max(highest) <= self.calm[cell] {
            return 0.0;
        }
        let (start, end) = (&self.grid.knots[cell], self.end_of(cell));
        let square_at = |share: f64| {
            let (way, left) = (share * length, 1.0 - share);
            match (from.is_rest(), to.is_rest()) {
                (false, false) => from.square + way * (2.0 * from.acceleration + way * change),
                (true, _) => to.square * share * libm::cbrt(share),
                (false, true) => from.square * left * libm::cbrt(left),
            }
        };
        let shares = (1..SPEED_PLACES).map(|place| {
            let share = f64::from(place) / f64::from(SPEED_PLACES);
            let slope = start.slopes.slope_toward(&end.slopes, length, share);
            square_at(share) / start.rates.highest(&slope)
        });
        shares.fold(0.0, larger).sqrt()
    }

    /// Lowers the squares of the highest speeds in a cell by that of a ratio, where it is above 1. The speed in the first and in the
    /// last cell follows from that in the next one to it.
    fn lower_top(&mut self, cell: usize, ratio: f64) {
        if ratio <= 1.0 + EXACT {
            return;
        }
        let top = cell.clamp(1, self.cells() - 2);
        if let Some(top) = self.tops.get_mut(top) {
            *top /= ratio * ratio;
        }
    }

    /// Returns the same as [`loads_of`](Self::loads_of): what the last round found, if the law is the same in the cell.
    fn loads_again(&mut self, cell: usize) -> Loads {
        let [from, to] = [self.paces[cell], self.paces[cell + 1]];
        // The jerk beside a rest depends on the reduced limits too.
        if from.is_rest() || to.is_rest() {
            return self.loads_of(cell);
        }
        let paces = [from.square, from.acceleration, to.square, to.acceleration];
        if let Some(loads) = self.last_round.loads(cell, paces) {
            return loads;
        }
        let loads = self.loads_of(cell);
        self.last_round.note_loads(cell, paces, loads);
        loads
    }

    /// Returns the shares of the limits that the law uses in a cell: at its start, in between and at its end.
    fn loads_of(&self, cell: usize) -> Loads {
        let [from, to] = [self.paces[cell], self.paces[cell + 1]];
        let [start, end] = [&self.grid.knots[cell], self.end_of(cell)];
        let (between, length) = (&self.grid.middles[cell], self.length(cell));
        let load = |slopes: &Slopes, pace: Pace, jerk: f64| {
            Load::new(slopes, [pace.square, pace.acceleration, jerk], &start.rates.ramps)
        };
        let most = |load: Load, pace: Pace| load.most(pace.acceleration < 0.0, &start.rates.ramps);
        if from.is_rest() || to.is_rest() {
            let (knot, pace) = if from.is_rest() { (end, to) } else { (start, from) };
            let jerk = 2.0 / 9.0 * pace.square * pace.square.sqrt() / (length * length);
            let there = most(load(&knot.slopes, pace, jerk), pace);
            let at_rest = if from.is_rest() { start } else { end };
            let rest = [0.0, jerk / at_rest.jerk_at_rest() * at_rest.tightness[1]];
            // They grow with s^(4/3) and s^(1/3).
            let half =
                Pace { square: HALF_WAY[0] * pace.square, acceleration: HALF_WAY[1] * pace.acceleration };
            let middle = most(load(between, half, jerk), pace);
            return if from.is_rest() { [rest, middle, there] } else { [there, middle, rest] };
        }
        let change = (to.acceleration - from.acceleration) / length;
        let square = (from.square + to.square) / 2.0 - change * length * length / 4.0;
        let middle = Pace { square, acceleration: (from.acceleration + to.acceleration) / 2.0 };
        let at = |slopes: &Slopes, pace: Pace| load(slopes, pace, change * pace.square.max(0.0).sqrt());
        let (before, after) = (at(&start.slopes, from), at(&end.slopes, to));
        let mut first = most(before, from);
        if cell == 0 {
            // The acceleration at the start is given; the jerk there is not.
            first[0] = 0.0;
        }
        // It may be higher than at both ends.
        let turned = at(between, middle).with_turns(&before, &after);
        let [accelerated, jerked] = most(turned, middle);
        [first, [accelerated.max(self.slowing_between(cell)), jerked], most(after, to)]
    }

    /// Returns the largest share of the tool's deceleration along its path that the law uses within a cell. In a corner the path can
    /// turn almost back within a small part of it, so it is looked at in many places.
    fn slowing_between(&self, cell: usize) -> f64 {
        let [start, end] = [&self.grid.knots[cell], self.end_of(cell)];
        let most = start.rates.ramps.tool_deceleration;
        if most >= 1.0 {
            return 0.0;
        }
        let ([from, to], length) = ([self.paces[cell], self.paces[cell + 1]], self.length(cell));
        let slowing = (1..PLACES).map(|place| {
            let share = f64::from(place) / f64::from(PLACES);
            let acceleration = from.acceleration + share * (to.acceleration - from.acceleration);
            let square = from.square + share * length * (from.acceleration + acceleration);
            let by = start.slopes.along_path_toward(&end.slopes, length, share);
            -dot(by, [square, acceleration, 0.0])
        });
        slowing.fold(0.0, f64::max) / most
    }

    /// Reduces the limits at some knots where the law exceeds them.
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
}
