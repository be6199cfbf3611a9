//! How near the planned laws come to the time optimum of the same path within the same limits: a table of ratios, by
//! kind of motion and by shipped application, on both arms. `-- --nocapture` prints it.
//!
//! The optimum is that of [`fastest`], which the first tests hold against what is known.

#![expect(clippy::disallowed_methods, reason = "last bits of a reference decide nothing")]

use std::fmt::Write as _;

use protocol::image::{Motion, MotionKind};
use rand_core::Rng as _;
use rand_pcg::Pcg64Mcg;
use robot_node::RobotConfig;
use robot_node::arm::{AXES, Joints};
use robot_node::motion::Segment;

use crate::fastest::{Bounds, Point, fastest, fastest_from};
use crate::fed::{config, driven};
use crate::recorded;

/// Random motions, or rows of motions, of each kind.
const CASES: usize = 40;

/// A step of the reference in s, as a rule.
const STEP_S: f64 = 5e-3;

/// So many steps it has at least, and at most.
const STEPS: [usize; 2] = [60, 900];

/// How far the reference is off at most, as a share of its times: what a halved step and another start change.
const UNCERTAIN: f64 = 6e-3;

/// One joint from rest to rest along a parameter 0…1, and half of its step. By the parameter the joint goes as
/// `way` says.
fn one_joint(steps: usize, limits: [f64; 3], way: impl Fn(f64) -> f64) -> (Vec<Point>, f64) {
    let half = 0.5 / steps as f64;
    let only_first = |value: f64, others: f64| core::array::from_fn(|i| if i == 0 { value } else { others });
    let bounds =
        Bounds { joints: limits.map(|limit| only_first(limit, f64::INFINITY)), tool: [f64::INFINITY; 3] };
    let point = |index| Point {
        joints: only_first(way(index as f64 * half), 0.0),
        tool: [0.0; 3],
        ways: None,
        bounds,
    };
    ((0..=2 * steps).map(point).collect(), half)
}

/// From 0 to 1, at rest at both ends.
fn smooth(u: f64) -> f64 {
    u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
}

/// The same another way round: slow at first.
fn slow_at_first(u: f64) -> f64 {
    smooth(0.3 * u + 0.7 * u * u)
}

#[test]
fn the_reference_finds_the_law_that_is_known_to_be_the_fastest_by_any_parameter() {
    let limits @ [speed, acceleration, jerk] = [100.0, 1_000.0, 50_000.0];
    // With a cruise; without one; without constant acceleration either.
    let known = |way: f64| way / speed + speed / acceleration + acceleration / jerk;
    let ramp: f64 = acceleration / jerk;
    let without_cruise = |way: f64| ramp + (ramp * ramp + 4.0 * way / acceleration).sqrt();
    let of_ramps = |way: f64| 4.0 * (way / (2.0 * jerk)).cbrt();
    for (way, least) in [(30.0, known(30.0)), (5.0, without_cruise(5.0)), (0.3, of_ramps(0.3))] {
        for by in [smooth, slow_at_first] {
            let (points, half) = one_joint(200, limits, |u| way * by(u));
            let found = fastest(&points, half).duration;
            assert!((found / least - 1.0).abs() < 2e-3, "{way}°: {found} s, {least} s is the optimum");
        }
    }
}

#[test]
fn the_reference_turns_a_circle_as_fast_as_the_acceleration_across_allows() {
    // Long enough that all but the ends is driven at the speed √(acceleration · radius).
    let (radius, acceleration) = (10.0, 1_000.0);
    let way = 40.0 * radius;
    let bounds = Bounds { joints: [[f64::INFINITY; AXES]; 3], tool: [f64::INFINITY, acceleration, 1e9] };
    let half = 0.5 / 800.0;
    let point = |index| {
        let (sin, cos) = (way * smooth(index as f64 * half) / radius).sin_cos();
        Point { joints: [0.0; AXES], tool: [radius * cos, radius * sin, 0.0], ways: None, bounds }
    };
    let points: Vec<_> = (0..=1600).map(point).collect();
    let found = fastest(&points, half).duration;
    // From rest, with v' = √(a² − (v²/r)²), the speed comes up over a quarter of a turn in 1.311·√(r/a): that is
    // ∫dx/√(1 − x⁴).
    let top = (acceleration * radius).sqrt();
    let up = (1.311_029 * (radius / acceleration).sqrt(), core::f64::consts::FRAC_PI_4 * radius);
    let least = 2.0 * up.0 + (way - 2.0 * up.1) / top;
    assert!((found / least - 1.0).abs() < 3e-3, "{found} s, {least} s is the optimum");
}

/// A list of random figures that is the same every time.
struct Random(Pcg64Mcg);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() as f64 / u64::MAX as f64)
    }

    /// A target within the part of base 1 that both arms reach, at most this share of it from another one.
    fn target(&mut self, setup: &str, near: Option<&[f32; 6]>, share: f64) -> [f32; 6] {
        let tilt = if setup == "A" { 0.0 } else { 12.0 };
        let lowest = [-60.0, -60.0, 10.0, -60.0, -tilt, 180.0 - tilt];
        let highest = [330.0, 110.0, 150.0, 60.0, tilt, 180.0 + tilt];
        let any: [f64; 6] = core::array::from_fn(|i| self.between(lowest[i], highest[i]));
        core::array::from_fn(|i| {
            let near = near.map_or(any[i], |near| f64::from(near[i]));
            (near + share * (any[i] - near)) as f32
        })
    }

    /// A motion of this kind with random limits.
    fn motion(&mut self, kind: MotionKind, target: [f32; 6]) -> Motion {
        let (rated_speed, rated_acceleration) =
            if kind.is_point_to_point() { (1e4, 1e4) } else { (2e4, 5e3) };
        Motion {
            kind,
            target,
            velocity: (self.between(0.02, 1.0) * rated_speed) as u16,
            acceleration: (self.between(0.1, 1.0) * rated_acceleration) as u16,
            base: 1,
            ..Motion::EMPTY
        }
    }
}

/// A row of the table.
#[derive(Clone, Copy)]
enum Row {
    /// One motion, at most so much of the cell long.
    Single(MotionKind, f64),
    /// Four motions of a spline.
    Spline,
    /// Eight motions of any kind with corners, all of them with half of the highest speed or each with its own.
    Corners { same_speed: bool },
}

impl Row {
    /// With the worst ratio to the optimum that is allowed on Setup A and on B.
    const ALL: [(&'static str, Self, [f64; 2]); 7] = [
        ("PTP", Self::Single(MotionKind::PtpCartesian, 1.0), [1.02, 1.02]),
        ("LIN", Self::Single(MotionKind::LinCartesian, 1.0), [1.035, 1.035]),
        ("LIN, at most 60 mm", Self::Single(MotionKind::LinCartesian, 0.15), [1.03, 1.03]),
        ("CIRC", Self::Single(MotionKind::Circular, 1.0), [1.04, 1.05]),
        ("SPLINE of four", Self::Spline, [1.035, 1.05]),
        ("eight with corners", Self::Corners { same_speed: true }, [1.04, 1.05]),
        ("eight, other speeds", Self::Corners { same_speed: false }, [1.04, 1.05]),
    ];

    /// Random motions, and the joints that they start from.
    fn motions(
        self,
        random: &mut Random,
        setup: &str,
        config: &RobotConfig,
    ) -> Option<(Vec<Motion>, Joints)> {
        let mut place = random.target(setup, None, 1.0);
        let start = random.motion(MotionKind::PtpCartesian, place);
        let start = Segment::prepare(&start, &config.home, config).ok()?.end;
        let (count, share) = match self {
            Self::Single(_, share) => (1, share),
            Self::Spline => (4, 0.3),
            Self::Corners { .. } => (8, 1.0),
        };
        let motions = (0..count).map(|_| {
            let target = random.target(setup, Some(&place), share);
            let kind = match self {
                Self::Single(kind, _) => kind,
                Self::Spline => MotionKind::Spline,
                Self::Corners { .. } => [
                    MotionKind::LinCartesian,
                    MotionKind::LinCartesian,
                    MotionKind::PtpCartesian,
                    MotionKind::Circular,
                ][random.between(0.0, 4.0) as usize % 4],
            };
            let beside: [f32; 3] =
                core::array::from_fn(|i| (place[i] + target[i]) / 2.0 + random.between(-40.0, 40.0) as f32);
            place = target;
            let auxiliary = if kind == MotionKind::Circular { beside } else { [0.0; 3] };
            let zone = random.between(100.0, 4_000.0) as u16;
            let approximation = if matches!(self, Self::Single(..)) { 0 } else { zone };
            let motion = random.motion(kind, target);
            let velocity = match self {
                Self::Corners { same_speed: true } if kind.is_point_to_point() => 5_000,
                Self::Corners { same_speed: true } => 10_000,
                _ => motion.velocity,
            };
            Motion { auxiliary, approximation, velocity, ..motion }
        });
        Some((motions.collect(), start))
    }
}

fn steps(duration: f64) -> usize {
    ((duration / STEP_S) as usize).clamp(STEPS[0], STEPS[1])
}

#[test]
fn the_reference_depends_neither_on_its_step_nor_on_where_it_starts() {
    for setup in ["A", "B"] {
        let config = config(setup);
        for (name, row, _) in Row::ALL {
            let mut random = Random(Pcg64Mcg::new(31));
            let mut cases = 0;
            while cases < 3 {
                let Some((motions, from)) = row.motions(&mut random, setup, &config) else { continue };
                let Some(sections) = recorded::sections(&motions, &from, &config) else { continue };
                cases += 1;
                for section in sections {
                    let steps = steps(section.duration);
                    let (points, half) = section.points(steps, &motions, &config);
                    let found = fastest(&points, half).duration;
                    let wave = |node: usize| 1.0 + 0.8 * (node as f64 / 7.0).sin();
                    let other_start = fastest_from(&points, half, wave).duration;
                    let (points, half) = section.points(2 * steps, &motions, &config);
                    let finer = fastest(&points, half).duration;
                    for (what, other) in [("another start", other_start), ("half the step", finer)] {
                        let change = (other / found - 1.0).abs();
                        assert!(change < UNCERTAIN, "{name} on {setup}, {what}: {other} s for {found} s");
                    }
                }
            }
        }
    }
}

/// How long motions take as planned, and how long they would at the optimum, in s.
fn times(motions: &[Motion], from: &Joints, config: &RobotConfig) -> Option<[f64; 2]> {
    let mut times = [0.0; 2];
    for section in recorded::sections(motions, from, config)? {
        let (points, half) = section.points(steps(section.duration), motions, config);
        times[0] += section.duration;
        times[1] += fastest(&points, half).duration;
    }
    Some(times)
}

#[test]
fn random_motions_are_near_the_time_optimum() {
    let mut table = String::new();
    let mut wrong = Vec::new();
    for (index, setup) in ["A", "B"].into_iter().enumerate() {
        let config = config(setup);
        for (name, row, most) in Row::ALL {
            let mut random = Random(Pcg64Mcg::new(13));
            let mut ratios = Vec::new();
            while ratios.len() < CASES {
                let Some((motions, from)) = row.motions(&mut random, setup, &config) else { continue };
                let Some([planned, least]) = times(&motions, &from, &config) else { continue };
                ratios.push(planned / least);
            }
            ratios.sort_by(f64::total_cmp);
            let mean = ratios.iter().sum::<f64>() / CASES as f64;
            let [best, nine_of_ten, worst] = [0, CASES * 9 / 10, CASES - 1].map(|index| ratios[index]);
            writeln!(
                table,
                "{setup}  {name:20} mean {mean:.3}  nine of ten {nine_of_ten:.3}  worst {worst:.3}"
            )
            .unwrap();
            if worst > most[index] || best < 1.0 - UNCERTAIN {
                wrong.push(format!("{name} on {setup}: {best:.3} to {worst:.3}, at most {}", most[index]));
            }
        }
    }
    println!("{table}");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_line_on_which_the_jerk_alone_counts_is_near_the_time_optimum() {
    for setup in ["A", "B"] {
        let config = config(setup);
        for (length_mm, jerk) in
            [(0.1, 500.0), (0.5, 500.0), (1.0, 50_000.0), (10.0, 50_000.0), (80.0, 5_000.0)]
        {
            let jerk_s3 = RobotConfig { path_jerk_mm_s3: jerk, ..config.clone() };
            let line = |x: f64| Motion {
                kind: MotionKind::LinCartesian,
                target: [100.0 + x, 40.0, 90.0, 0.0, 0.0, 180.0].map(|coordinate| coordinate as f32),
                velocity: 20_000,
                acceleration: 5_000,
                base: 1,
                ..Motion::EMPTY
            };
            let (took, _) = driven(&[line(0.0), line(length_mm)], &jerk_s3);
            // A quarter of the time each with the highest jerk, twice with the lowest, and again with the highest.
            let least = (32.0 * length_mm / jerk).cbrt();
            assert!(took < 1.04 * least, "{setup}, {length_mm} mm, {jerk} mm/s³: {took} s for {least} s");
        }
    }
}

#[test]
fn a_higher_acceleration_or_velocity_does_not_make_a_motion_slower() {
    let config = config("A");
    let circle = |acceleration: u16| {
        let line = Motion {
            kind: MotionKind::LinCartesian,
            target: [100.0, 0.0, 90.0, 0.0, 0.0, 180.0],
            velocity: 600,
            acceleration,
            base: 1,
            ..Motion::EMPTY
        };
        let kind = MotionKind::Circular;
        let circle = Motion { kind, target: [150.0, -50.0, 90.0, 0.0, 0.0, 180.0], ..line };
        let slow = RobotConfig { path_jerk_mm_s3: 5_000.0, ..config.clone() };
        driven(&[line, Motion { auxiliary: [150.0, 50.0, 90.0], ..circle }], &slow).0
    };
    let [low, high] = [500, 5_000].map(circle);
    assert!(high <= 1.005 * low, "{high} s with ten times the acceleration, {low} s without");
    let short = |velocity: u16| {
        let from = Motion {
            kind: MotionKind::PtpCartesian,
            target: [100.0, 40.0, 90.0, 0.0, 0.0, 180.0],
            velocity,
            acceleration: 1_000,
            base: 1,
            ..Motion::EMPTY
        };
        let mut to = from;
        to.target[0] += 0.05;
        driven(&[from, to], &config).0
    };
    let [slow, fast] = [2_500, 10_000].map(short);
    assert!(fast <= 1.005 * slow, "{fast} s at the full velocity, {slow} s at a quarter");
}

#[test]
fn shipped_applications_are_near_the_time_optimum() {
    // The worst ratios to the optimum that are allowed on Setup A and on B, of the whole and of its motions one by one.
    let applications = [
        ("pick-and-place", [[1.04, 1.025], [1.02, 1.02]]),
        ("gluing", [[1.02, 1.02], [1.02, 1.02]]),
        ("palletising", [[1.04, 1.025], [1.04, 1.02]]),
        ("engraving", [[1.035, 1.03], [1.03, 1.03]]),
        ("insertion-with-force", [[1.035, 1.02], [1.03, 1.02]]),
    ];
    let mut table = String::new();
    let mut wrong = Vec::new();
    for (index, setup) in ["A", "B"].into_iter().enumerate() {
        let (config, setup) = (config(setup), setup::setup(setup).unwrap());
        for (name, most) in applications {
            let plan = planning::application(name, None).unwrap().plan(&setup).unwrap();
            let mut motions: Vec<Motion> = plan.wire_motions(&setup);
            // Of the long ones the first rows. What a LIN force does on its way is a line.
            motions.truncate(40);
            for motion in &mut motions {
                if motion.kind == MotionKind::LinForceCartesian {
                    motion.kind = MotionKind::LinCartesian;
                }
            }
            let one_by_one: Vec<Motion> =
                motions.iter().map(|motion| Motion { approximation: 0, ..*motion }).collect();
            let ratios = [motions, one_by_one].map(|motions| {
                let [planned, least] = times(&motions, &config.home, &config).unwrap();
                planned / least
            });
            let [whole, single] = ratios;
            writeln!(table, "{}  {name:22} whole {whole:.3}  one by one {single:.3}", setup.name).unwrap();
            if ratios.iter().zip(most[index]).any(|(ratio, most)| *ratio > most) {
                wrong.push(format!("{name} on {}: {ratios:.3?}, at most {:?}", setup.name, most[index]));
            }
        }
    }
    println!("{table}");
    assert!(wrong.is_empty(), "{wrong:#?}");
}
