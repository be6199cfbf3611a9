//! Laws of one joint, whose optimum is known.

mod alike;
pub(super) mod bent;
mod moving;

use proptest::prelude::*;

use super::super::grid::Part;
use super::super::node::{Node, Ratings};
use super::*;
use crate::arm::AxisLimits;

/// One joint that turns by `way`, with a share of its acceleration for slowing down.
fn one_joint(way: f64, limits: [f64; 3], deceleration: f64) -> (Vec<Node>, Ratings) {
    one_joint_at(16, way, limits, deceleration)
}

/// The same with this number of nodes behind the first.
fn one_joint_at(
    count: u8,
    way: f64,
    [speed, acceleration, jerk]: [f64; 3],
    deceleration: f64,
) -> (Vec<Node>, Ratings) {
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
    let nodes = (0..=count)
        .map(|node| Node::of_axes(f64::from(node) / f64::from(count), speed / way, &ways, &ratings));
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
    let [highest, lowest] = [f64::max, f64::min].map(|pick| accelerations.iter().copied().fold(0.0, pick));
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
