//! Laws of paths that are the same in other units, and of paths of special shapes.

use super::bent::{Bent, duration, is_kept, law};
use super::*;

const SEEDS: u32 = 6;

#[test]
fn a_path_that_is_driven_faster_or_measured_otherwise_has_the_same_law() {
    for seed in 0..SEEDS {
        let bent = Bent::random(seed);
        let found = duration(&bent.law());
        for (factor, unit) in [(32.0, 1.0), (1.0, 256.0), (1.0 / 16.0, 1.0 / 64.0)] {
            let other = Bent::random(seed).faster(factor).in_unit(unit);
            let law = law(&[other.part(0.0, unit)], Pace::REST).expect("there is a law from rest");
            let ratio = factor * duration(&law) / found;
            assert!((ratio - 1.0).abs() < 1e-6, "{ratio} with seed {seed}, {factor} times as fast");
        }
    }
}

#[test]
fn so_has_one_that_is_refined() {
    for seed in 0..SEEDS {
        let refined = |factor: f64| {
            let mut law = Bent::random(seed).faster(factor).law_to_refine();
            let mut ends = (0..MOST_STEPS).map(|_| law.refine());
            let end = ends.find(|progress| *progress != Progress::Unfinished);
            (end, factor * duration(&law))
        };
        let (end, found) = refined(1.0);
        for factor in [32.0, 1.0 / 16.0] {
            let (other_end, other) = refined(factor);
            assert_eq!(other_end, end, "seed {seed}");
            assert!((other / found - 1.0).abs() < 1e-6, "{other} s for {found} s with seed {seed}");
        }
    }
}

/// Finds a law of these limits in one round; returns the bits of its values, and what it uses of its limits.
fn round(law: &mut Law, tightness: &[[f64; 2]]) -> (Vec<u64>, (f64, f64)) {
    for (knot, tightness) in law.grid.knots.iter_mut().zip(tightness) {
        knot.tightness = *tightness;
    }
    law.limit().expect("it begins at rest");
    law.backward();
    law.forward();
    law.find_paces();
    let used = law.tighten(1.0);
    (law.values.iter().map(|value| value.to_bits()).collect(), used)
}

#[test]
fn a_round_that_recalls_the_last_one_finds_the_same_bits_as_one_that_recalls_nothing() {
    for seed in 0..SEEDS {
        let mut law = Bent::random(seed).law();
        let cells = law.cells();
        let mut tightness = vec![[1.0; 2]; cells + 1];
        round(&mut law, &tightness);
        for knot in (1..cells).step_by(3) {
            tightness[knot][knot % 2] *= 0.8;
            let recalled = round(&mut law, &tightness);
            law.last_round.forget(cells);
            assert_eq!(recalled, round(&mut law, &tightness), "knot {knot} with seed {seed}");
        }
    }
}

#[test]
fn on_a_circle_a_constant_speed_has_the_whole_acceleration() {
    let circle = Bent::circle().even();
    let law = circle.law();
    let squares = (0..law.cells()).map(|cell| law.cell(cell).at(0.0).1.square);
    let highest = squares.fold(0.0, f64::max);
    // The acceleration across is square · bend.
    let [x, y, _] = circle.slopes(0.5).tool[1];
    let used = highest * (x * x + y * y).sqrt();
    assert!((0.99..1.006).contains(&used), "{used} of the acceleration across");
}

#[test]
fn a_law_from_rest_stops_nowhere_however_bent_the_path_is() {
    for seed in 0..60 {
        let law = Bent::random(seed).rough().law();
        for cell in 1..law.cells() {
            let pace = law.cell(cell).at(0.0).1;
            assert!(pace.square > 0.0, "it stops in cell {cell} with seed {seed}");
        }
        assert!(duration(&law) < 1e3, "{} s", duration(&law));
    }
}

#[test]
fn a_refined_law_keeps_the_speed_of_the_slower_part_from_its_begin_on() {
    for seed in 0..SEEDS {
        let bent = Bent::random(seed).even();
        let slower = Bent::random(seed).even().slower(0.4);
        let parts = [bent.part(0.0, 0.5), slower.part(0.5, 1.0)];
        let mut law = Box::<Law>::default();
        law.begin_to_refine(&parts, Pace::REST, 1e3).expect("it can be refined");
        let mut ends = (0..MOST_STEPS).map(|_| law.refine());
        let end = ends.find(|progress| *progress != Progress::Unfinished);
        assert_eq!(end, Some(Progress::Faster), "seed {seed}");
        is_kept(&law, &[(&bent, [0.0, 0.5]), (&slower, [0.5, 1.0])], &format!("seed {seed}"));
    }
}

#[test]
fn any_law_from_any_pace_keeps_its_limits_and_stops_only_at_its_end() {
    let (mut found, mut none) = (0, 0);
    for number in 0..1200 {
        let [place, speed, acceleration] = [7, 11, 13].map(|step| f64::from(number * step % 97) / 97.0);
        let bent = Bent::random(number % SEEDS);
        let begin = 0.9 * place;
        // Speeds and accelerations up to what the path allows there, and a little more.
        let slopes = bent.slopes(begin);
        let steepest = slopes.slope.iter().fold(0.0, |most: f64, slope| most.max(slope.abs()));
        let pace =
            Pace { square: 1.5 * speed * speed, acceleration: 1.2 * (2.0 * acceleration - 1.0) / steepest };
        let Some(law) = law(&[bent.part(begin, 1.0)], pace) else {
            none += 1;
            continue;
        };
        is_kept(
            &law,
            &[(&bent, [begin, 1.0])],
            &format!("from {begin} with {pace:?} with seed {}", number % SEEDS),
        );
        let paces = (1..law.cells()).map(|cell| law.cell(cell).at(0.0).1);
        assert!(paces.into_iter().all(|pace| pace.square > 0.0), "from {begin} with {pace:?}");
        found += 1;
    }
    assert!(found >= 660, "{found} laws are found, and {none} not");
}

#[test]
fn the_refined_law_of_one_joint_is_the_optimum_that_is_known() {
    for limits in [[200.0, 1_000.0, 20_000.0], [100.0, 1_000.0, 30_000.0], [250.0, 700.0, 9_000.0]] {
        let (nodes, ratings) = one_joint_at(96, 300.0, limits, 1.0);
        let part = Part {
            nodes: &nodes,
            ratings: &ratings,
            from: 0.0,
            to: 1.0,
            unit: 1.0,
            motion: 0,
            in_blend: false,
        };
        let mut law = Box::<Law>::default();
        law.begin_to_refine(&[part], Pace::REST, 1e3).expect("it can be refined");
        let mut ends = (0..MOST_STEPS).map(|_| law.refine());
        let end = ends.find(|progress| *progress != Progress::Unfinished);
        let [speed, acceleration, jerk] = limits;
        let ratio = duration(&law) / (300.0 / speed + speed / acceleration + acceleration / jerk);
        assert_eq!(end, Some(Progress::Faster));
        assert!((0.999..1.001).contains(&ratio), "{ratio} of the optimum with {limits:?}");
    }
}
