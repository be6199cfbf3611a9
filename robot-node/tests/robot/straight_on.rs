//! Lines that go on straight: they are driven as one, however many there are and whatever their zone is.

#![expect(clippy::disallowed_methods, reason = "last bits of a way decide nothing")]

use protocol::image::{Motion, MotionKind, SLOTS};
use robot_node::RobotConfig;

use crate::fed::{config, driven};

/// How far one line of a chain goes, in mm.
const LENGTH_MM: f64 = 10.0;

fn line(target: [f32; 6], acceleration: u16, zone_mm: f64) -> Motion {
    Motion {
        kind: MotionKind::LinCartesian,
        target,
        velocity: 20_000,
        acceleration,
        approximation: (zone_mm * 100.0) as u16,
        base: 1,
        ..Motion::EMPTY
    }
}

/// Lines of 10 mm in one direction across base 1, the tool turning by `turn` degrees on each.
fn chain(count: usize, turn: f64, acceleration: u16, zone_mm: f64) -> Vec<Motion> {
    let target = |index: usize| {
        let index = index as f64;
        let (along, across) = (0.9 * LENGTH_MM * index, 0.19_f64.sqrt() * LENGTH_MM * index);
        [along, across - 30.0, 60.0, turn * index, 0.0, 180.0].map(|coordinate| coordinate as f32)
    };
    (0..=count).map(|index| line(target(index), acceleration, zone_mm)).collect()
}

#[test]
fn a_larger_zone_does_not_make_a_straight_chain_slower() {
    for setup in ["A", "B"] {
        let config = config(setup);
        for (turn, acceleration) in [(0.0, 300), (0.0, 2_500), (0.0, 5_000), (1.5, 2_500)] {
            let times = [0.01, 0.5, 5.0, 20.0]
                .map(|zone_mm| driven(&chain(24, turn, acceleration, zone_mm), &config).0);
            let slowest = times[1..].iter().copied().fold(0.0, f64::max);
            assert!(slowest <= times[0] * 1.005, "{setup}, {turn}°, {acceleration} mm/s²: {times:?} s");
        }
    }
}

#[test]
fn a_straight_chain_is_as_fast_as_four_lines_ahead_allow() {
    for setup in ["A", "B"] {
        let config = config(setup);
        for acceleration in [100, 300, 1_000] {
            let (_, speeds) = driven(&chain(24, 0.0, acceleration, 5.0), &config);
            // With four lines known beyond the present one.
            let bound = (2.0 * f64::from(acceleration) * 4.0 * LENGTH_MM).sqrt();
            let middle = &speeds[speeds.len() / 3..speeds.len() * 2 / 3];
            let mean = middle.iter().sum::<f64>() / middle.len() as f64;
            assert!(mean >= 0.97 * bound, "{setup}, {acceleration} mm/s²: {mean} mm/s of {bound}");
        }
    }
}

#[test]
fn as_many_lines_as_are_known_at_once_take_as_long_as_one() {
    for setup in ["A", "B"] {
        let config = config(setup);
        for acceleration in [300, 1_000] {
            let lines = chain(SLOTS, 0.0, acceleration, 5.0);
            let one = [lines[0], lines[SLOTS]];
            let (together, single) = (driven(&lines, &config).0, driven(&one, &config).0);
            assert!(together <= single * 1.01, "{setup}, {acceleration} mm/s²: {together} s for {single} s");
        }
    }
}

#[test]
fn a_chain_of_lines_whose_limits_change_along_it_does_not_stop() {
    // On this way of a UR5e the joints allow less and less.
    let config = RobotConfig { home: [10.0, -70.0, -90.0, -20.0, 80.0, 10.0], ..config("D") };
    let lines = |count: usize| -> Vec<Motion> {
        let target = |index: usize| {
            let way = index as f64 / count as f64;
            let [x, y, z] = [342.5454 - 94.072 * way, -92.5185 + 28.2216 * way, 795.7097 + 18.8144 * way];
            [x, y, z, -90.0, 10.0, -90.0].map(|coordinate| coordinate as f32)
        };
        let line = |index| Motion { velocity: 3_750, base: 0, ..line(target(index), 2_500, 5.0) };
        (0..=count).map(line).collect()
    };
    let [together, single] = [6, 1].map(|count| driven(&lines(count), &config).0);
    assert!(together <= single * 1.02, "{together} s for {single} s");
}

#[test]
fn corners_that_leave_hardly_anything_of_a_line_make_it_no_slower() {
    // Lines of 10 mm that bend by 0.003° each, rounded to the coordinates of the wire.
    let bent = |zone_mm: f64| -> Vec<Motion> {
        let (mut place, mut lines) = ([0.0, -30.0], Vec::new());
        for index in 0..=24 {
            let [x, y] = place.map(|coordinate: f64| coordinate as f32);
            lines.push(line([x, y, 60.0, 0.0, 0.0, 180.0], 2_500, zone_mm));
            let (sin, cos) = (0.5 + 0.003_f64.to_radians() * f64::from(index)).sin_cos();
            place = [place[0] + LENGTH_MM * cos, place[1] + LENGTH_MM * sin];
        }
        lines
    };
    for setup in ["A", "B"] {
        let config = config(setup);
        let [smaller, half, larger] = [4.9, 5.0, 5.1].map(|zone_mm| driven(&bent(zone_mm), &config).0);
        assert!(half.max(larger) <= smaller * 1.005, "{setup}: {smaller} s, {half} s and {larger} s");
    }
}
