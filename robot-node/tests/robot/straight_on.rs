//! Lines that go on straight: they are driven as one, however many there are and whatever their zone is.

use protocol::image::{Motion, MotionKind, SLOTS};
use robot_node::RobotConfig;
use robot_node::arm::Joints;
use robot_node::motion::{Interpolator, Segment};

/// How far one line of a chain goes, in mm.
const LENGTH_MM: f64 = 10.0;

fn config(setup: &str) -> RobotConfig {
    RobotConfig::from_setup(&setup::setup(setup).unwrap()).unwrap()
}

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

/// How long the motions but the first one take, fed as a PLC that is never late would, in s; and the speed of the tool in
/// each cycle, in mm/s.
fn driven(motions: &[Motion], config: &RobotConfig) -> (f64, Vec<f64>) {
    let (start, motions) = motions.split_first().unwrap();
    let start = Motion { kind: MotionKind::PtpCartesian, velocity: 10_000, acceleration: 10_000, ..*start };
    let from: Joints = Segment::prepare(&start, &config.home, config).unwrap().end;
    let cycle_s = config.cycle.as_secs_f64();
    let mut interpolator = Interpolator::at_rest(config.arm.clone(), from, cycle_s);
    let (mut appended, mut seconds, mut speeds) = (0, 0.0, Vec::new());
    loop {
        while appended < motions.len() && appended - (interpolator.path().executed() as usize) < SLOTS {
            let segment = interpolator.path().prepare(&motions[appended], config).unwrap();
            appended += 1;
            interpolator.append(segment, appended == motions.len());
        }
        let step = interpolator.drive(1.0).unwrap();
        assert_eq!(step.suppressed, None, "every motion is there in time");
        seconds += cycle_s;
        speeds.push(interpolator.path_speed());
        if let Some(left) = step.ended {
            return (seconds - left, speeds);
        }
    }
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
