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
