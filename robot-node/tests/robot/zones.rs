//! A larger zone makes a path no slower, whatever the angle of its corners.

use proptest::prelude::*;
use protocol::image::{Motion, MotionKind};
use robot_node::{Program, RobotConfig};

use crate::driven::{Driven, bare, lin, ptp};
use crate::fed::{config, driven};

/// Returns the time of lines through these places, in s.
fn duration(places: &[[f64; 2]], limits: &Motion, zone_mm: f64, config: &RobotConfig) -> f64 {
    let motions = places.iter().map(|[x, y]| Motion {
        target: [*x as f32, *y as f32, 60.0, 0.0, 0.0, 180.0],
        approximation: (zone_mm * 100.0) as u16,
        ..*limits
    });
    driven(&motions.collect::<Vec<_>>(), config).0
}

/// Two lines of these lengths with a corner of this angle, 0 where they are straight on.
fn corner(lengths: [f64; 2], angle_deg: f64) -> [[f64; 2]; 3] {
    let (sin, cos) = libm::sincos(angle_deg.to_radians());
    [[60.0, 0.0], [60.0 + lengths[0], 0.0], [60.0 + lengths[0] + lengths[1] * cos, lengths[1] * sin]]
}

/// A law is refined only where that makes it 1 % faster: the one with the larger zone may be just below that, the other one just above.
const ALLOWED: f64 = 1.012;

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_larger_zone_is_never_slower(
        setup in prop_oneof![Just("A"), Just("B")],
        angle_deg in 0.0..180.0_f64,
        lengths in [20.0..90.0_f64, 20.0..90.0_f64],
        speed in 500..15_000_u16,
        acceleration in 300..5_000_u16,
        zones in [0.01..40.0_f64, 0.01..40.0_f64],
    ) {
        let config = config(setup);
        let limits = Motion { kind: MotionKind::LinCartesian, velocity: speed, acceleration, base: 1, ..Motion::EMPTY };
        let places = corner(lengths, angle_deg);
        let times = [zones[0].min(zones[1]), zones[0].max(zones[1])]
            .map(|zone_mm| duration(&places, &limits, zone_mm, &config));
        prop_assert!(times[1] <= times[0] * ALLOWED, "{times:?} s");
    }
}

/// A corner brakes with the lower deceleration of its motions, not with the product of the lower acceleration and the lower share
/// of it.
#[test]
fn higher_limits_on_either_side_of_a_corner_make_no_corner_slower() {
    let config = bare("A");
    let run = |limits: [[u16; 2]; 2]| {
        let mut robot = Driven::ready(config.clone(), Program::default());
        robot.run(vec![ptp(-100.0, 0.0, 90.0)]);
        let places = [[100.0, 0.0], [100.0, 110.0], [-100.0, 110.0], [-100.0, 0.0]];
        let lines = places.iter().cycle().zip(limits.iter().cycle()).take(24);
        let motions = lines.map(|([x, y], [acceleration, deceleration])| Motion {
            velocity: 6_000,
            acceleration: *acceleration,
            deceleration: *deceleration,
            approximation: 4_500,
            ..lin(*x, *y, 90.0)
        });
        robot.run(motions.collect());
        assert!(robot.is_done(), "{:?}", robot.feedback());
        robot.feedback().execution_ns
    };
    let low = run([[500, 500], [500, 500]]);
    for higher in [[[5_000, 500], [500, 5_000]], [[5_000, 500], [500, 500]], [[500, 5_000], [500, 5_000]]] {
        let took = run(higher);
        assert!(took <= low, "{higher:?}: {took} ns for {low} ns");
    }
}
