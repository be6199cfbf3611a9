use super::*;
use crate::geometry::Cuboid;

const WAYS: Ways = Ways {
    clearance_mm: 10.0,
    ceiling_mm: 200.0,
    height_step_mm: 10.0,
    ptp_radius_mm: f64::INFINITY,
    detour_percent: 5.0,
};

fn wall(x: f64, top: f64) -> Obstacle {
    let space = Cuboid { lower: Point::new(x - 10.0, -200.0, 0.0), upper: Point::new(x + 10.0, 200.0, top) };
    Obstacle { name: "wall".into(), space }
}

fn way(obstacles: &[Obstacle], ways: &Ways, from: [f64; 3], to: [f64; 3]) -> Result<Way, Refusal> {
    Space { obstacles, ways, approximation_mm: 0.0, bows_sideways: false, blends: [true; 2] }.way(
        from.into(),
        to.into(),
        &[],
    )
}

#[test]
fn the_crossing_is_the_lowest_height_on_the_raster_that_clears_the_grown_wall() {
    // The grown wall reaches x = 80 at z = 90; from (0, 0, 50) over (100, 0, z) that needs 50 + 0.8·(z − 50) ≥ 90.
    let over = way(&[wall(100.0, 80.0)], &WAYS, [0.0, 0.0, 50.0], [200.0, 0.0, 50.0]);
    let via = Some(Point::new(100.0, 0.0, 100.0));
    assert_eq!(over, Ok(Way::Over { points: [via, None], obstacle: 0, again: false }));
}

#[test]
fn a_bowing_ptp_crosses_higher() {
    let bowing = Ways { ptp_radius_mm: 200.0, ..WAYS };
    let over = way(&[wall(100.0, 80.0)], &bowing, [0.0, 0.0, 50.0], [200.0, 0.0, 50.0]);
    assert!(matches!(over, Ok(Way::Over { points: [Some(via), None], .. }) if via.z > 100.0), "{over:?}");
}

#[test]
fn an_arc_of_the_named_radius_stays_within_the_bow_up_to_half_a_turn() {
    let ways = Ways { ptp_radius_mm: 300.0, ..WAYS };
    let space =
        Space { obstacles: &[], ways: &ways, approximation_mm: 0.0, bows_sideways: true, blends: [false; 2] };
    for half_deg in (5..=90).step_by(5) {
        let at = |share: f64| {
            let (sine, cosine) = libm::sincos(f64::from(half_deg).to_radians() * (2.0 * share - 1.0));
            Point::new(cosine, sine, 0.0) * 300.0
        };
        let (from, to) = (at(0.0), at(1.0));
        let bow_mm = space.bow_mm(from, to);
        for share in (0..=100).map(|share| f64::from(share) / 100.0) {
            let off_mm = (at(share) - from.toward(to, share)).length();
            let most_mm = 4.0 * bow_mm * share * (1.0 - share);
            assert!(off_mm <= most_mm + 1e-6, "{half_deg}° at {share}: {off_mm} mm, {most_mm} mm");
        }
    }
    // Farther apart than any arc of this radius reaches, a half circle is the least.
    let bow_mm = space.bow_mm(Point::new(0.0, -400.0, 0.0), Point::new(0.0, 400.0, 0.0));
    assert!(bow_mm > 400.0, "{bow_mm}");
}

#[test]
fn an_end_that_is_not_blended_needs_the_clearance_alone() {
    let walls = [wall(100.0, 80.0)];
    let way = |blends| {
        let space =
            Space { obstacles: &walls, ways: &WAYS, approximation_mm: 20.0, bows_sideways: false, blends };
        space.way(Point::new(75.0, 0.0, 50.0), Point::new(0.0, 0.0, 50.0), &[])
    };
    assert_eq!(way([false, true]), Ok(Way::Direct));
    let refused = way([true, false]);
    assert!(matches!(refused, Err(Refusal::TooNear { distance_mm: 20.0, .. })), "{refused:?}");
}

#[test]
fn an_arm_that_bows_sideways_alone_crosses_lower_than_one_that_bows_all_ways() {
    let bowing = Ways { ptp_radius_mm: 150.0, height_step_mm: 1.0, ..WAYS };
    let walls = [wall(100.0, 80.0)];
    let height = |bows_sideways| {
        let space = Space {
            obstacles: &walls,
            ways: &bowing,
            approximation_mm: 0.0,
            bows_sideways,
            blends: [true; 2],
        };
        match space.way(Point::new(0.0, 0.0, 50.0), Point::new(200.0, 0.0, 50.0), &[]) {
            Ok(Way::Over { points: [Some(via), None], .. }) => via.z,
            other => panic!("{other:?}"),
        }
    };
    assert!(height(true) < height(false));
}

#[test]
fn close_to_a_tall_wall_the_way_goes_straight_up_first() {
    let over = way(&[wall(40.0, 150.0)], &WAYS, [15.0, 0.0, 50.0], [400.0, 0.0, 50.0]);
    let points = [Some(Point::new(15.0, 0.0, 180.0)), None];
    assert_eq!(over, Ok(Way::Over { points, obstacle: 0, again: false }));
}

#[test]
fn close_to_a_tall_wall_on_both_sides_it_goes_straight_up_over_and_straight_down() {
    let over = way(&[wall(40.0, 150.0)], &WAYS, [15.0, 0.0, 50.0], [65.0, 0.0, 50.0]);
    let points = [Some(Point::new(15.0, 0.0, 160.0)), Some(Point::new(65.0, 0.0, 160.0))];
    assert_eq!(over, Ok(Way::Over { points, obstacle: 0, again: false }));
}

#[test]
fn a_way_back_uses_the_intermediate_position_of_the_way_there_unless_that_is_a_detour() {
    let walls = [wall(100.0, 80.0)];
    let space = Space {
        obstacles: &walls,
        ways: &WAYS,
        approximation_mm: 0.0,
        bows_sideways: false,
        blends: [true; 2],
    };
    let [near, far] = [Point::new(100.0, 0.0, 100.0), Point::new(100.0, 150.0, 100.0)];
    let back = |crossing| space.way(Point::new(200.0, 0.0, 50.0), Point::new(0.0, 20.0, 50.0), &[crossing]);
    assert_eq!(back(near), Ok(Way::Over { points: [Some(near), None], obstacle: 0, again: true }));
    assert!(matches!(back(far), Ok(Way::Over { again: false, .. })));
}

#[test]
fn a_wall_up_to_the_ceiling_is_refused_by_how_much() {
    let refused = way(&[wall(100.0, 250.0)], &WAYS, [0.0, 0.0, 50.0], [200.0, 0.0, 50.0]);
    let Err(Refusal::NoWay { obstacle, needs_mm: Some(needs), ceiling_mm, .. }) = refused else {
        panic!("{refused:?}");
    };
    // Straight up, over it and straight down; over one intermediate position alone it would be 310 mm.
    assert_eq!((obstacle.as_str(), needs, ceiling_mm), ("wall", 260.0, 200.0));
    let below = |ceiling_mm| {
        let ways = Ways { ceiling_mm, ..WAYS };
        way(&[wall(100.0, 250.0)], &ways, [0.0, 0.0, 50.0], [200.0, 0.0, 50.0]).is_ok()
    };
    assert_eq!([259.0, 260.0].map(below), [false, true]);
}

#[test]
fn a_start_within_the_clearance_is_refused_by_how_much() {
    let refused = way(&[wall(100.0, 80.0)], &WAYS, [84.0, 0.0, 50.0], [200.0, 0.0, 50.0]);
    let expected = Refusal::TooNear {
        target: "the start of the way".into(),
        obstacle: "wall".into(),
        missing_mm: 4.0,
        distance_mm: 10.0,
    };
    assert_eq!(refused, Err(expected));
}

#[test]
fn a_way_past_an_edge_is_straight_if_its_nearest_point_is_far_enough() {
    // 8 mm beside and 8 mm above the edge of the wall: 11.3 mm from it, and each less than the clearance.
    let past = way(&[wall(100.0, 80.0)], &WAYS, [82.0, -150.0, 88.0], [82.0, 150.0, 88.0]);
    assert_eq!(past, Ok(Way::Direct));
}
