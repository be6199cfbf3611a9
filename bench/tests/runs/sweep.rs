//! The starvation sweep on a few points: its output, and that the round trip predicts it.

use std::sync::atomic::AtomicBool;

use studies::engine::listed::ListedStudy;
use studies::sweep::{Predicted, Sweep, SweepGrid, csv, render};

fn sweep(name: &str, grid: &SweepGrid) -> Sweep {
    let (setup, found) = planning::setup_with_application(name).unwrap();
    Sweep::new(
        &setup,
        grid,
        grid.run(&setup, &found.application, &ListedStudy::in_memory("sweep", true, &AtomicBool::new(false)))
            .unwrap(),
    )
}

fn grid() -> SweepGrid {
    SweepGrid {
        depths: vec![1, 2, 5],
        bus_cycles_us: vec![1_000, 16_000, 64_000],
        lengths_mm: vec![1.0, 20.0],
        motions: 12,
        reps: 1,
        seed: 1,
    }
}

#[test]
fn the_sweep_of_setup_a_shows_where_each_depth_starves() {
    let sweep = sweep("A", &grid());
    insta::assert_snapshot!(render(&sweep));
    assert_eq!(csv(&sweep).lines().count(), 1 + 3 * 3 * 2);
}

#[test]
fn no_blend_is_lost_if_the_slots_cover_the_round_trip_and_some_are_lost_if_they_do_not() {
    for name in ["A", "B"] {
        let sweep = sweep(name, &grid());
        for point in &sweep.points {
            match point.predicted {
                Predicted::KeepsUp => assert_eq!(point.blends_suppressed, 0.0, "{name}: {point:?}"),
                Predicted::Starves => assert!(point.blends_suppressed > 0.0, "{name}: {point:?}"),
                Predicted::Open => {}
            }
        }
        let predicted = |predicted| sweep.points.iter().filter(|point| point.predicted == predicted).count();
        assert!(predicted(Predicted::KeepsUp) > 0 && predicted(Predicted::Starves) > 0, "{name} has both");
    }
}
