//! What holds for every plan, whatever the obstacles and frames.

#![expect(clippy::expect_used, reason = "a test fails by panicking")]

use planning::{
    Action, Application, Course, Cuboid, Error, Labels, Motion, Obstacle, Place, Plan, Point, Pose, Role,
    Segment, Step, Tool, Ways, Why, Zones, plan,
};
use proptest::prelude::*;
use protocol::image::MotionKind;

const WAYS: Ways = Ways {
    clearance_mm: 12.0,
    ceiling_mm: 400.0,
    height_step_mm: 10.0,
    ptp_radius_mm: 250.0,
    detour_percent: 5.0,
};

/// How far the property on accurate paths lets a path be left, in mm.
const TOLERANCE_MM: f64 = 0.1;

fn place(name: &str, [x, y, z]: [f64; 3], a: f64) -> Place {
    Place {
        name: name.into(),
        pose: Pose::new([x, y, z, a, 0.0, 180.0]),
        grid: None,
        joints_deg: None,
        configuration: None,
    }
}

fn point(z: std::ops::Range<f64>) -> impl Strategy<Value = [f64; 3]> {
    (-300.0..300.0, -300.0..300.0, z).prop_map(|(x, y, z)| [x, y, z])
}

fn obstacle() -> impl Strategy<Value = Obstacle> {
    let size = (1.0..150.0, 1.0..150.0, 5.0..250.0);
    (point(0.0..50.0), size).prop_map(|(lower, (width, depth, height))| {
        let lower = Point::from(lower);
        let space = Cuboid { lower, upper: lower + Point::new(width, depth, height) };
        Obstacle { name: "box".into(), space }
    })
}

fn segment() -> impl Strategy<Value = Segment> {
    // A turn is an obstacle to blending straight on, so there must be lines without one.
    let turn = || prop_oneof![3 => Just(0.0), 1 => -90.0..90.0];
    let to = move || (point(0.0..200.0), turn()).prop_map(|(at, a)| place("to", at, a));
    prop_oneof![
        4 => to().prop_map(Segment::Line),
        2 => (to(), to()).prop_map(|(through, to)| Segment::Circle { through, to }),
        1 => prop::collection::vec(to(), 1..4).prop_map(Segment::Spline),
        1 => to().prop_map(|to| Segment::Press { to, force_n: [0.0, 0.0, -9.0] }),
    ]
}

fn course() -> impl Strategy<Value = Course> {
    let follow = (
        prop::option::of(point(0.0..200.0)),
        prop::collection::vec(segment(), 1..4),
        prop_oneof![Just(0.0), 1.0..60.0],
        prop_oneof![Just(0.0), 1.0..60.0],
    );
    prop_oneof![
        point(0.0..300.0).prop_map(|at| Course::Reach(place("reach", at, 0.0))),
        follow.prop_map(|(from, segments, approach_mm, retreat_mm)| Course::Follow {
            approach_mm: if from.is_some() { approach_mm } else { 0.0 },
            from: from.map(|at| place("from", at, 0.0)),
            segments,
            retreat_mm,
        }),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    (course(), any::<bool>(), any::<bool>(), any::<bool>()).prop_map(|(course, accurate, stop, acts)| Step {
        name: "step".into(),
        does: String::new(),
        labels: Labels {
            accurate_path: accurate && matches!(course, Course::Follow { .. }),
            accurate_stop: stop,
        },
        tool: Tool { name: "flange".into(), number: 0 },
        base: None,
        course,
        speed_mm_s: None,
        speed_percent: 100.0,
        then: (stop && acts).then(|| Action { name: "grip".into(), output: 0, set: true, wait_ms: 1.0 }),
    })
}

fn application(
    steps: impl Strategy<Value = Vec<Step>>,
    obstacles: std::ops::Range<usize>,
) -> impl Strategy<Value = Application> {
    (steps, prop::collection::vec(obstacle(), obstacles), point(250.0..300.0)).prop_map(
        |(mut steps, obstacles, start)| {
            if let Some(last) = steps.last_mut() {
                last.labels.accurate_stop = true;
            }
            Application {
                name: "random".into(),
                title: String::new(),
                base: 0,
                start: (place("start", start, 0.0), Tool { name: "flange".into(), number: 0 }),
                zones: Zones { approximation_mm: None, path_tolerance_mm: TOLERANCE_MM },
                ways: Some(WAYS),
                grids: Vec::new(),
                surfaces: Vec::new(),
                waits: Vec::new(),
                unused: Vec::new(),
                obstacles,
                steps,
            }
        },
    )
}

fn on_setup_a(application: &Application) -> Result<Plan, Error> {
    let mut setup = setup::setup("A").expect("built in");
    setup.motions.approximation_mm.value = 10.0;
    plan(application, &setup)
}

/// Generates applications whose frames the arm reaches; among obstacles, other generators give too few plans that are not
/// refused.
fn reaching() -> impl Strategy<Value = Application> {
    let reach = point(0.0..300.0).prop_map(|at| Course::Reach(place("reach", at, 0.0)));
    let step = (step(), reach).prop_map(|(step, course)| Step {
        labels: Labels { accurate_path: false, ..step.labels },
        course,
        ..step
    });
    application(prop::collection::vec(step, 1..5), 1..6)
}

/// Returns the least distance in mm that a point of a line has from a box, of a hundred.
fn distance_mm(space: &Cuboid, from: Point, to: Point) -> f64 {
    let points = (0..=100_u32).map(|share| from.toward(to, f64::from(share) / 100.0));
    points.map(|point| space.distance_mm(point)).fold(f64::INFINITY, f64::min)
}

/// Returns whether a PTP of a SCARA from an exact stop to an intermediate position keeps its distances from every face of a
/// box, along each axis; the approximation distance is 10 mm.
fn is_free(space: &Cuboid, stop: Point, via: Point) -> bool {
    let chord = Point { z: 0.0, ..via - stop }.length();
    let radius = WAYS.ptp_radius_mm.max(chord / 2.0);
    let half_turn = libm::asin((chord / 2.0 / radius).min(1.0));
    let bow = radius * half_turn * half_turn / 2.0;
    (1..1000_u32).map(|number| f64::from(number) / 1000.0).all(|share| {
        let is_blended = (1.0 - share) * (via - stop).length() < 10.0;
        let distance = WAYS.clearance_mm + if is_blended { 5.0 } else { 0.0 };
        let aside = 4.0 * bow * share * (1.0 - share);
        let by = Point::new(distance + aside, distance + aside, distance);
        let grown = Cuboid { lower: space.lower - by, upper: space.upper + by };
        // Between two of these places the way may come nearer by half a millimetre.
        grown.depth_mm(stop.toward(via, share)) <= -0.5
    })
}

/// Returns the farthest, in mm, that a blend of a zone can get from both paths at a junction.
fn rounding_mm(motion: &Motion, next: &Motion) -> f64 {
    match (motion.arrives, next.leaves) {
        (Some(arrives), Some(leaves))
            if motion.kind == MotionKind::LinCartesian && next.kind != MotionKind::Circular =>
        {
            motion.zone_mm / 2.0 * libm::sin(arrives.angle_deg(leaves).to_radians()).abs()
        }
        _ => motion.zone_mm,
    }
}

#[test]
fn the_random_applications_are_planned_often_enough_to_prove_something() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let mut sample = |strategy: BoxedStrategy<Application>| {
        let mut plans: Vec<Plan> = Vec::new();
        for _ in 0..1000 {
            let application = strategy.new_tree(&mut runner).expect("generates").current();
            plans.extend(on_setup_a(&application));
        }
        plans
    };
    let reaching = sample(reaching().boxed());
    let crosses = |plan: &&Plan| plan.motions.iter().any(|motion| motion.role == Role::Crossing);
    let crossing = reaching.iter().filter(crosses).count();
    assert!(reaching.len() > 300 && crossing > 150, "{} plans, {crossing} cross", reaching.len());

    let following = sample(application(prop::collection::vec(step(), 1..5), 0..1).boxed());
    let accurate = |plan: &&Plan| plan.motions.iter().any(|motion| motion.accurate_path);
    let accurate = following.iter().filter(accurate).count();
    assert!(following.len() > 800 && accurate > 400, "{} plans, {accurate} accurate", following.len());
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 1000, ..ProptestConfig::default() })]

    #[test]
    fn no_secondary_motion_comes_nearer_to_an_obstacle_than_the_clearance(application in reaching()) {
        let Ok(plan) = on_setup_a(&application) else { return Ok(()) };
        for motion in plan.motions.iter().filter(|motion| motion.role.is_secondary()) {
            for obstacle in &application.obstacles {
                let away_mm = distance_mm(&obstacle.space, motion.start.point, motion.target.point);
                prop_assert!(away_mm > WAYS.clearance_mm - 1e-6, "{} mm in\n{}", away_mm, plan);
            }
        }
    }

    #[test]
    fn no_blend_of_secondary_motions_cuts_its_corner_into_the_clearance(application in reaching()) {
        let Ok(plan) = on_setup_a(&application) else { return Ok(()) };
        for (motion, next) in plan.motions.iter().zip(plan.motions.iter().skip(1)) {
            let corner = motion.target.point;
            let begins = corner.toward(motion.start.point, motion.zone_mm / motion.length_mm);
            let ends = corner.toward(next.target.point, motion.zone_mm / next.length_mm);
            for obstacle in &application.obstacles {
                let away_mm = distance_mm(&obstacle.space, begins, ends);
                prop_assert!(away_mm > WAYS.clearance_mm - 1e-6, "{} mm in\n{}", away_mm, plan);
            }
        }
    }

    #[test]
    fn an_intermediate_position_is_needed_and_no_lower_one_of_the_raster_would_do(application in reaching()) {
        let Ok(plan) = on_setup_a(&application) else { return Ok(()) };
        for pair in plan.motions.windows(2) {
            let [over, way] = pair else { continue };
            let one = over.role == Role::Crossing && way.role == Role::Way;
            let fresh = plan.reasons.iter().any(|reason| {
                matches!(&reason.why, Why::Over { again: false, .. })
                    && plan.motions.get(reason.motion) == Some(over)
            });
            let first = plan.motions.iter().all(|motion| {
                motion.role != Role::Crossing || motion.target.point != over.start.point
            });
            // At exact stops a way may come nearer than at blends, so that a lower position alone proves nothing.
            let stops = plan.motions.iter().filter(|motion| motion.zone_mm == 0.0).map(|motion| motion.target.point);
            let stops: Vec<Point> = stops.chain([application.start.0.pose.point]).collect();
            let between_stops = [over.start, way.target].iter().all(|end| stops.contains(&end.point));
            if !(one && fresh && first && between_stops) {
                continue;
            }
            let lower = over.target.point - Point::new(0.0, 0.0, WAYS.height_step_mm);
            let legs = [over.start.point, way.target.point].map(|end| (lower - end).length());
            let full_blends = legs.iter().all(|&leg| leg >= 2.0 * over.zone_mm);
            if lower.z < over.start.point.z.min(way.target.point.z) || !full_blends {
                continue;
            }
            let legs = [[over.start.point, lower], [way.target.point, lower]];
            let is_free = legs.iter().all(|&[stop, via]| {
                application.obstacles.iter().all(|obstacle| is_free(&obstacle.space, stop, via))
            });
            prop_assert!(!is_free, "{:?} is free too in\n{}", lower, plan);
        }
    }

    #[test]
    fn every_accurate_path_is_unblended_on_its_path(
        application in application(prop::collection::vec(step(), 1..5), 0..1)
    ) {
        let Ok(plan) = on_setup_a(&application) else { return Ok(()) };
        for (motion, next) in plan.motions.iter().zip(plan.motions.iter().skip(1)) {
            if (motion.accurate_path || next.accurate_path) && motion.kind != MotionKind::Spline {
                prop_assert!(rounding_mm(motion, next) <= TOLERANCE_MM, "{} in\n{}", motion.name, plan);
            }
        }
    }

    #[test]
    fn each_continuous_motion_ends_in_an_accurate_stop_and_all_together_are_the_plan(
        application in application(prop::collection::vec(step(), 1..5), 0..1)
    ) {
        let Ok(plan) = on_setup_a(&application) else { return Ok(()) };
        let mut end = 0;
        for continuous in &plan.continuous {
            prop_assert_eq!(continuous.motions.start, end);
            end = continuous.motions.end;
            let last = plan.motions.get(end - 1).expect("no continuous motion is empty");
            prop_assert_eq!(last.zone_mm, 0.0);
        }
        prop_assert_eq!(end, plan.motions.len());
    }

    #[test]
    fn every_motion_begins_where_the_one_before_ends_and_no_zone_takes_more_than_half_of_it(
        application in application(prop::collection::vec(step(), 1..5), 0..1)
    ) {
        let Ok(plan) = on_setup_a(&application) else { return Ok(()) };
        for (motion, next) in plan.motions.iter().zip(plan.motions.iter().skip(1)) {
            prop_assert!((motion.target.point - next.start.point).length() < 0.01, "{}", plan);
            let half = motion.length_mm.min(next.length_mm) / 2.0;
            prop_assert!(motion.zone_mm <= half, "{}", plan);
        }
    }

    #[test]
    fn every_motion_has_one_reason_for_its_zone_and_no_zone_is_cut_without_a_warning(
        application in application(prop::collection::vec(step(), 1..5), 0..3)
    ) {
        let Ok(plan) = on_setup_a(&application) else { return Ok(()) };
        for (index, motion) in plan.motions.iter().enumerate() {
            let of_zone: Vec<&Why> = plan
                .reasons
                .iter()
                .filter(|reason| reason.motion == index && reason.why.is_of_zone())
                .map(|reason| &reason.why)
                .collect();
            prop_assert_eq!(of_zone.len(), 1);
            let explained = match of_zone.as_slice() {
                [Why::Blending | Why::Collinear { halved: false }] => motion.zone_mm == 10.0,
                [Why::Shrunk { .. }] => motion.zone_mm < 10.0,
                _ => true,
            };
            prop_assert!(explained, "{}", plan);
        }
    }

    #[test]
    fn no_text_makes_reading_or_planning_panic(
        shipped in 0..planning::APPLICATIONS.len(),
        at in 0..4000_usize,
        remove in 0..60_usize,
        insert in "[a-z0-9\\[\\]{}=\"., -]{0,12}",
    ) {
        let (name, text) = planning::APPLICATIONS.get(shipped).expect("in range");
        let edited: String =
            text.chars().take(at).chain(insert.chars()).chain(text.chars().skip(at + remove)).collect();
        if let Ok(application) = Application::parse(name, &edited) {
            let _ = on_setup_a(&application).map(|plan| plan.to_string());
        }
    }
}
