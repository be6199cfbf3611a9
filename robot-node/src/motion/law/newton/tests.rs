//! The step of Newton's method against what it is derived from: differences of what it seeks the least value of.

use super::super::super::load::Load;
use super::super::super::node::Pace;
use super::super::tests::bent::Bent;
use super::*;

/// A law along a bent path of which all limits have room, since the squares of its speeds are this share of the fastest.
fn slack_law(bent: &Bent, share: f64) -> Box<Law> {
    let mut law = bent.law_to_refine();
    for value in &mut law.values {
        *value *= share;
    }
    law.find_paces();
    law
}

/// For each limit what the squares of the loads come to, and what they may.
struct Used(Vec<(f64, f64)>);

impl Limits for Used {
    fn limit<const LOADS: usize, const BY: usize>(&mut self, loads: [super::Load<BY>; LOADS], whole: f64) {
        self.0.push((loads.iter().map(|(load, _)| load * load).sum(), whole));
    }
}

/// The sum of the logarithms of what is left of limits.
struct LogarithmsLeft(f64);

impl Limits for LogarithmsLeft {
    fn limit<const LOADS: usize, const BY: usize>(&mut self, loads: [super::Load<BY>; LOADS], whole: f64) {
        let left = whole - loads.iter().map(|(load, _)| load * load).sum::<f64>();
        assert!(left > LEAST_LEFT, "{left} of {whole} is left");
        self.0 += libm::log(left);
    }
}

/// The sum of the logarithms of what is left of the limits in a cell.
fn room(law: &Law, cell: usize) -> f64 {
    let mut room = LogarithmsLeft(0.0);
    for site in law.sites(cell) {
        site.each_limit(around(&law.values, cell), &mut room);
    }
    room.0
}

/// The slope of a figure of a law by one of its values.
fn slope(law: &mut Law, cell: usize, figure: impl Fn(&Law) -> f64) -> f64 {
    let value = law.values[cell];
    let step = 1e-5 * value;
    let [less, more] = [value - step, value + step].map(|value| {
        law.values[cell] = value;
        figure(law)
    });
    law.values[cell] = value;
    (more - less) / (2.0 * step)
}

/// The second derivative of a figure by two values.
fn bend(law: &mut Law, [one, other]: [usize; 2], figure: impl Fn(&Law) -> f64) -> f64 {
    let steps = [one, other].map(|cell| 1e-3 * law.values[cell]);
    let mut moved = |[first, second]: [f64; 2]| {
        let kept = [law.values[one], law.values[other]];
        law.values[one] += first * steps[0];
        law.values[other] += second * steps[1];
        let found = figure(law);
        (law.values[one], law.values[other]) = (kept[0], kept[1]);
        found
    };
    let corners = moved([1.0, 1.0]) - moved([1.0, -1.0]) - moved([-1.0, 1.0]) + moved([-1.0, -1.0]);
    corners / (4.0 * steps[0] * steps[1])
}

fn is_near(one: f64, other: f64, share: f64) -> bool {
    (one - other).abs() <= share * (1e-3 + one.abs().max(other.abs()))
}

fn clear(law: &mut Law) {
    let cells = law.cells();
    law.rows = (0..cells).map(|_| [0.0; 3]).collect();
    law.change = (0..cells).map(|_| 0.0).collect();
}

#[test]
fn the_places_of_a_cell_have_the_pace_of_its_law() {
    for seed in 0..4 {
        let law = slack_law(&Bent::random(seed), 0.8);
        for cell in 1..law.cells() - 1 {
            let [from, to] = [law.paces[cell], law.paces[cell + 1]];
            let (length, sites) = (law.length(cell), law.sites(cell));
            let growth = (to.acceleration - from.acceleration) / length;
            for (site, share) in sites.iter().zip([0.0, 0.5, 1.0]) {
                let way = share * length;
                let square = from.square + way * (2.0 * from.acceleration + way * growth);
                let acceleration = from.acceleration + way * growth;
                let found = site.figures(around(&law.values, cell));
                for (found, expected) in found.into_iter().zip([square, acceleration, growth]) {
                    assert!(is_near(found, expected, 1e-6), "{found} for {expected} in cell {cell}");
                }
            }
        }
    }
}

#[test]
fn the_loads_of_a_place_are_those_that_a_law_is_compared_with() {
    for seed in 0..4 {
        let law = slack_law(&Bent::random(seed), 0.8);
        for cell in 1..law.cells() - 1 {
            for site in law.sites(cell) {
                let figures = site.figures(around(&law.values, cell));
                let [square, acceleration, growth] = figures;
                let pace = Pace { square, acceleration };
                let load = Load::new(site.slopes, [square, acceleration, growth * square.sqrt()], site.ramps);
                let expected = load.most(pace.acceleration < 0.0, site.ramps);
                let mut used = Used(Vec::new());
                site.each_load(figures, &mut used);
                // One after the other: accelerations and jerks.
                let mut most = [0.0_f64; 2];
                for (limit, (used, whole)) in used.0.into_iter().enumerate() {
                    let order = limit % 2;
                    most[order] = most[order].max((used / whole).sqrt() * site.tightness[order]);
                }
                for (found, expected) in most.into_iter().zip(expected) {
                    assert!(is_near(found, expected, 1e-6), "{found} for {expected} in cell {cell}");
                }
            }
        }
    }
}

#[test]
fn reduced_limits_leave_as_much_less() {
    let mut law = slack_law(&Bent::random(1).even(), 0.5);
    let cell = law.cells() / 2;
    let wholes = |law: &Law| {
        let mut used = Used(Vec::new());
        for site in law.sites(cell) {
            site.each_load(site.figures(around(&law.values, cell)), &mut used);
        }
        used.0.into_iter().map(|(_, whole)| whole).collect::<Vec<_>>()
    };
    let before = wholes(&law);
    law.grid.knots[cell].tightness = [0.9, 0.8];
    law.grid.knots[cell + 1].tightness = [0.7, 0.95];
    // At the start, in the middle, where both count, and at the end.
    let shares = [[0.9, 0.8], [0.7, 0.8], [0.7, 0.95]];
    for (index, (before, after)) in before.iter().zip(wholes(&law)).enumerate() {
        let share: f64 = shares[index / (2 * AXES + 2)][index % 2];
        assert!(is_near(after, before * share * share, 1e-9), "{after} for {before}");
    }
}

#[test]
fn the_change_is_the_slope_of_what_is_left_of_the_limits() {
    for seed in 0..4 {
        let mut law = slack_law(&Bent::random(seed).even(), 0.6);
        for cell in FIRST..law.cells() - 2 {
            clear(&mut law);
            law.add_barriers(cell);
            let found = around(&law.change, cell);
            for (near, found) in (cell - 1..).zip(found) {
                let expected = slope(&mut law, near, |law| room(law, cell));
                assert!(is_near(found, expected, 1e-3), "{found} for {expected} by {near} in cell {cell}");
            }
        }
    }
}

#[test]
fn the_matrix_is_how_that_slope_bends_where_no_jerk_counts() {
    for seed in 0..4 {
        let mut law = slack_law(&Bent::random(seed).even(), 0.6);
        for knot in law.grid.knots.iter_mut().chain(&mut law.grid.ends) {
            (knot.rates.ramps.ramp_s, knot.rates.ramps.tool_ramp_s) = ([0.0; AXES], 0.0);
        }
        for cell in FIRST..law.cells() - 2 {
            clear(&mut law);
            law.add_barriers(cell);
            for first in cell - 1..=cell + 1 {
                for other in first..=cell + 1 {
                    let found = law.rows[first][other - first];
                    let expected = -bend(&mut law, [first, other], |law| room(law, cell));
                    assert!(is_near(found, expected, 1e-3), "{found} for {expected} in cell {cell}");
                }
            }
        }
    }
}

#[test]
fn a_limit_that_is_exceeded_is_kept_after_one_step() {
    for used in [1.0, 1.01, 1.1, 1.3] {
        let load = f64::sqrt(used);
        let mut barrier = Barrier::default();
        barrier.limit([(load, [1.0])], 1.0);
        let rest = load - barrier.slope[0] / barrier.row(0)[0];
        assert!(
            (0.99..1.0 + 0.15 * (used - 1.0) + 1e-9).contains(&(rest * rest)),
            "{used} becomes {}",
            rest * rest
        );
    }
}

#[test]
fn the_solution_solves_the_equations() {
    let mut law = slack_law(&Bent::random(2).even(), 0.6);
    let (cells, first, end) = (law.cells(), 3, law.cells() - 2);
    let number = |index: usize| libm::sin(1.0 + 1.7 * index as f64);
    law.rows = (0..cells).map(|row| [3.0 + number(row), number(row + 50), number(row + 90)]).collect();
    law.change = (0..cells).map(|row| number(row + 130)).collect();
    let (rows, right) = (law.rows.clone(), law.change.clone());
    law.solve(first, end);
    for row in 0..cells {
        let change = &law.change;
        if !(first..end).contains(&row) {
            assert_eq!(change[row], 0.0, "the value of cell {row} stays");
            continue;
        }
        let below = (1..3).filter(|distance| row + distance < end);
        let above = (1..3).filter(|distance| row >= first + distance);
        let sum = rows[row][0] * change[row]
            + below.map(|distance| rows[row][distance] * change[row + distance]).sum::<f64>()
            + above.map(|distance| rows[row - distance][distance] * change[row - distance]).sum::<f64>();
        assert!(is_near(sum, right[row], 1e-9), "{sum} for {} in row {row}", right[row]);
    }
}

/// What a step leads to the least value of: the time of the cells that change and the logarithms of what is left.
fn sought(law: &Law, weight: f64) -> f64 {
    let (cells, end) = (FIRST..law.cells() - 2, law.cells() - 2);
    let time = |cell: usize| weight * law.length(cell) / law.values[cell].sqrt();
    let left = |cell: usize| libm::log(law.tops[cell] - law.values[cell]);
    let own: f64 = cells.map(|cell| time(cell) - left(cell)).sum();
    own - (FIRST - 1..=end).map(|cell| room(law, cell)).sum::<f64>()
}

/// The first cell that changes.
const FIRST: usize = 2;

#[test]
fn steps_come_to_where_no_value_is_better() {
    for seed in 0..4 {
        let mut law = slack_law(&Bent::random(seed).even(), 0.6);
        let weight =
            20.0 * law.cells() as f64 / (0..law.cells()).map(|cell| law.cell(cell).duration).sum::<f64>();
        for _ in 0..25 {
            law.step(FIRST, weight);
        }
        for cell in FIRST..law.cells() - 2 {
            let slope = slope(&mut law, cell, |law| sought(law, weight));
            let part = weight * law.length(cell) / law.values[cell].sqrt();
            let share = slope * law.values[cell] / part;
            assert!(share.abs() < 1e-5, "{share} of the time of cell {cell}");
        }
    }
}

/// The largest share that a change takes of what a step may use of a limit.
struct Taken {
    change: Vector,
    most: f64,
}

impl Limits for Taken {
    fn limit<const LOADS: usize, const BY: usize>(&mut self, loads: [super::Load<BY>; LOADS], whole: f64) {
        let [used, then] = [0.0, 1.0].map(|share| {
            let changed =
                |by: [f64; BY]| by.iter().zip(self.change).map(|(by, change)| by * change).sum::<f64>();
            let loads = loads.iter().map(|(load, by)| load + share * changed(*by));
            loads.map(|load| load * load).sum::<f64>()
        });
        self.most = self.most.max((then - used) / (USED * (whole - used)));
    }
}

/// The largest share that a step takes of what it may, where the values from `first` on change.
fn share_of_step(bent: &Bent, first: usize, weight: f64) -> f64 {
    let (before, mut law) = (slack_law(bent, 0.6), slack_law(bent, 0.6));
    law.step(first, weight);
    let (end, mut most) = (before.cells() - 2, 0.0_f64);
    for cell in 0..before.cells() {
        let rise = law.values[cell] - before.values[cell];
        assert!((first..end).contains(&cell) || rise == 0.0, "cell {cell} stays");
        most = most.max(rise / (USED * before.left_of_speed(cell)));
        most = most.max(-rise / (LOWERED * before.values[cell]));
    }
    for cell in first - 1..=end {
        let change: Vector = core::array::from_fn(|i| law.values[cell - 1 + i] - before.values[cell - 1 + i]);
        for site in before.sites(cell) {
            let mut taken = Taken { change: site.figures(change), most };
            site.each_limit(around(&before.values, cell), &mut taken);
            most = taken.most;
        }
    }
    most
}

#[test]
fn a_step_uses_no_more_of_any_limit_than_its_share() {
    for (seed, weight) in [(0, 1e2), (1, 1e4), (2, 1e6), (3, 1e8)] {
        let bent = Bent::random(seed).even();
        for first in [2, 3, 5, 8, 13, 21, 34, 55] {
            let most = share_of_step(&bent, first, weight);
            assert!(most <= 1.0 + 1e-9, "{most} of what a step may use");
            // The steps are too long, so that one limit ends them.
            assert!(most > 1.0 - 1e-9 || weight < 1e6, "{most} of what a step may use");
        }
    }
}

#[test]
fn a_step_neither_uses_up_a_speed_nor_lowers_it_by_more_than_its_share() {
    for seed in 0..4 {
        // Where nothing bends only the speed is limited; where time counts nothing the barriers alone push.
        let bent = Bent::random(seed).even().straight();
        for (bent, weight) in [(bent.clone(), 1e-9), (bent.clone(), 1e8), (bent.faster(1.0 / 16.0), 1e-9)] {
            let most = share_of_step(&bent, FIRST, weight);
            assert!((most - 1.0).abs() < 1e-9, "{most} of what a step may use, weight {weight}");
        }
    }
}
