//! Laws of one joint from where it moves.

use super::*;

const WAY: f64 = 300.0;
const LIMITS: [f64; 3] = [200.0, 1_000.0, 20_000.0];

/// The law of the way from this speed and this acceleration to rest.
fn law_from([speed, acceleration]: [f64; 2]) -> Option<Vec<Cell>> {
    let (nodes, ratings) = one_joint_at(200, WAY, LIMITS, 1.0);
    let part =
        Part { nodes: &nodes, ratings: &ratings, from: 0.0, to: 1.0, unit: 1.0, motion: 0, in_blend: false };
    let mut law = Box::<Law>::default();
    law.find(&[part], Pace { square: (speed / WAY) * (speed / WAY), acceleration: acceleration / WAY })?;
    Some((0..law.cells()).map(|cell| law.cell(cell)).collect())
}

/// The least time from there to rest, in s; none where the highest speed or acceleration is not reached.
fn optimum([begin, beginning]: [f64; 2]) -> Option<f64> {
    let [speed, acceleration, jerk] = LIMITS;
    let (up, down) = ((acceleration - beginning) / jerk, acceleration / jerk);
    let hold =
        (speed - begin - (beginning + acceleration) / 2.0 * up - acceleration / 2.0 * down) / acceleration;
    let (mut time, mut way, mut pace) = (0.0, 0.0, [begin, beginning]);
    for (jerk, seconds) in [(jerk, up), (0.0, hold), (-jerk, down)] {
        let [speed, acceleration] = pace;
        way += seconds * (speed + seconds * (acceleration / 2.0 + seconds * jerk / 6.0));
        pace = [speed + seconds * (acceleration + seconds * jerk / 2.0), acceleration + seconds * jerk];
        time += seconds;
    }
    let braking = speed / acceleration + acceleration / jerk;
    let cruise = (WAY - way - braking * speed / 2.0) / speed;
    (hold >= 0.0 && cruise >= 0.0).then_some(time + cruise + braking)
}

/// The largest shares of speed, acceleration behind the first cell, and jerk.
fn used(cells: &[Cell]) -> [f64; 3] {
    let mut most = [0.0_f64; 3];
    for (number, cell) in cells.iter().enumerate() {
        for part in 0..=16 {
            let pace = cell.at(cell.duration * f64::from(part) / 16.0).1;
            let acceleration = if number == 0 { 0.0 } else { pace.acceleration.abs() };
            let used = [pace.square.sqrt(), acceleration, cell.jerk(&pace).abs()];
            most = core::array::from_fn(|i| most[i].max(WAY * used[i] / LIMITS[i]));
        }
    }
    most
}

/// The speed by which an acceleration still changes the speed while it goes back to none.
fn change(acceleration: f64) -> f64 {
    acceleration * acceleration / (2.0 * LIMITS[2])
}

#[test]
fn from_nearly_any_pace_one_joint_takes_hardly_longer_than_the_optimum_that_is_known() {
    let (mut found, mut none) = (0, 0);
    for pace in
        (0..400).map(|number| [20.0 + f64::from(number % 20) * 5.1, -690.0 + f64::from(number / 20) * 83.0])
    {
        let [speed, acceleration] = pace;
        // The cells are too long for a law that brakes nearly to rest and goes on.
        let Some(least) = optimum(pace).filter(|_| acceleration > 0.0 || speed > 40.0) else { continue };
        let Some(cells) = law_from(pace) else {
            none += 1;
            continue;
        };
        let (ratio, used) = (duration(&cells) / least, used(&cells));
        assert!((0.995..1.03).contains(&ratio), "{ratio} of the optimum from {pace:?}");
        assert!(used.iter().all(|used| *used < 1.012), "{used:?} of the limits from {pace:?}");
        found += 1;
    }
    assert!(found >= 350 && none <= 3, "{found} laws are found, and {none} not");
}

proptest! {
    #[test]
    fn where_the_arm_can_only_stop_or_become_too_fast_there_is_no_law(
        acceleration in 300.0..900.0_f64,
        share in 0.1..0.8_f64,
    ) {
        let least = change(acceleration);
        prop_assert!(law_from([share * least, -acceleration]).is_none(), "it stops");
        prop_assert!(law_from([LIMITS[0] - share * least, acceleration]).is_none(), "it becomes too fast");
    }
}

#[test]
fn what_cannot_be_changed_any_more_is_no_reason_against_a_law() {
    // The acceleration was allowed by another rule.
    let cells = law_from([50.0, 1.03 * LIMITS[1]]).expect("a law that goes on from there");
    assert!(used(&cells).iter().all(|used| *used < 1.012), "{:?}", used(&cells));
    assert!(law_from([1.02 * LIMITS[0], 0.0]).is_none(), "the speed is not");
}
