//! Shared zones of a cell: which motions are in them, and what is refused.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a cell that cannot be planned fails the test")]

use arm::{Frame, Installation};
use planning::{FoundCell, PlannedCell, cell_with_applications};
use setup::{Cell, Provenance, SharedZone, Sourced};

fn found(name: &str) -> (Cell, FoundCell) {
    cell_with_applications(name).unwrap()
}

fn planned(name: &str) -> PlannedCell {
    let (cell, found) = found(name);
    found.plan(&cell).unwrap_or_else(|error| panic!("{error}"))
}

fn assumed<T>(value: T) -> Sourced<T> {
    Sourced { value, from: Provenance::Assumed, note: String::new() }
}

fn zone(name: &str, corner: [f64; 3], size: [f64; 3]) -> SharedZone {
    SharedZone { name: name.to_owned(), corner_mm: assumed(corner), size_mm: assumed(size) }
}

#[test]
fn the_arms_of_setup_g_come_into_the_fixture_twice_each_and_wait_outside() {
    let cell = planned("G");
    insta::assert_snapshot!(cell.to_string(), @"
    shared zones
      fixture  left in motions 5 to 8 and 13 to 16, right in motions 5 to 8 and 13 to 16
    ");
    for station in &cell.stations {
        let zones = station.zones.as_ref().unwrap();
        for visit in &station.plan.visits {
            let before = visit.after.checked_sub(1).map_or(zones.start, |last| station.reached.targets[last]);
            assert!(zones.volume.at(&before).is_empty(), "{}: {visit:?}", station.name);
            assert!(zones.volume.at(&station.reached.targets[visit.until - 1]).is_empty(), "{visit:?}");
            let inside = &station.reached.targets[visit.after..visit.until];
            assert!(inside.iter().any(|joints| !zones.volume.at(joints).is_empty()), "{visit:?}");
        }
        // A program of the robot for each section: what comes before a visit is one of its own.
        let starts: Vec<_> = station.plan.sections().iter().map(|section| section.motions.start).collect();
        assert!(station.plan.visits.iter().all(|visit| starts.contains(&visit.after)), "{starts:?}");
    }
}

#[test]
fn between_visits_every_place_along_the_way_keeps_its_distance_from_the_zone() {
    let cell = planned("G");
    for station in &cell.stations {
        let (zones, plan) = (station.zones.as_ref().unwrap(), &station.plan);
        let targets = &station.reached.targets;
        let starts = std::iter::once(&zones.start).chain(targets);
        for (index, (motion, (from, to))) in plan.motions.iter().zip(starts.zip(targets)).enumerate() {
            let is_inside = plan.visits.iter().any(|visit| (visit.after..visit.until).contains(&index));
            if !motion.kind.is_point_to_point() || is_inside {
                continue;
            }
            for step in 0..=1_000 {
                let share = f64::from(step) / 1_000.0;
                let joints = std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]));
                assert!(zones.volume.at(&joints).is_empty(), "{} {index} {share}", station.name);
            }
        }
    }
}

#[test]
fn an_arm_is_in_a_zone_with_its_tool_its_links_and_its_radius() {
    let (cell, _) = found("G");
    let station = &cell.stations[0];
    let arm = Installation::from_setup(&cell.setup_of(station)).unwrap();
    let joints = [20.0, 40.0, 80.0, 0.0, 0.0, 0.0];
    let flange = arm.arm.forward(&joints);
    let root = Frame::from_mm_deg(station.root_mm_deg.value);
    let tip = root.point(flange.origin_of(&arm.tools[1].unwrap()));
    let is_in = |at: [f64; 3], tools: &[u8]| {
        let mut cell = cell.clone();
        cell.shared_zones = vec![zone("box", at, [1.0, 1.0, 1.0])];
        planning::ArmVolume::new(&cell, &cell.stations[0], tools).unwrap().at(&joints).contains(0)
    };
    let beside = |by: [f64; 3]| [0, 1, 2].map(|axis| tip[axis] + by[axis]);
    assert!(is_in(beside([0.0, 0.0, -44.0]), &[1]), "below the tip, nearer than the radius of 45 mm");
    assert!(!is_in(beside([0.0, 0.0, -47.0]), &[1]));
    assert!(!is_in(beside([0.0, 0.0, -44.0]), &[]), "without the tool it is the flange");
    assert!(is_in([100.0, 40.0, 200.0], &[]), "the first link");
    assert!(!is_in([100.0, 40.0, 100.0], &[]), "below it");
}

#[test]
fn starts_ends_and_rings_that_no_grant_can_solve_are_refused_in_words() {
    let (cell, found) = found("G");
    let said = |zones: Vec<SharedZone>| {
        let mut cell = cell.clone();
        cell.shared_zones = zones;
        setup::check_cell(&cell).unwrap();
        found.plan(&cell).map(|_| ()).unwrap_err().to_string()
    };
    let mut close = cell.clone();
    close.stations[1].robot.link_radius_mm = Some(assumed(400.0));
    close.shared_zones = vec![zone("far", [5000.0; 3], [1.0; 3])];
    let said = [
        said(vec![zone("home", [150.0, -300.0, 0.0], [100.0, 100.0, 150.0])]),
        said(vec![zone("all", [-500.0, -500.0, 0.0], [1500.0, 1000.0, 500.0])]),
        said(vec![
            zone("over", [240.0, -100.0, 80.0], [60.0, 200.0, 70.0]),
            zone("under", [330.0, -100.0, 0.0], [50.0, 200.0, 60.0]),
        ]),
        found.plan(&close).map(|_| ()).unwrap_err().to_string(),
    ];
    insta::assert_snapshot!(said.join("\n"), @"
    built-in setup G: `shared_zone.home`: arm `left` starts in it; move its start or zone `home`
    built-in setup G: `shared_zone.all`: the arms `left`, `right` all start in it; move their starts or zone `all`
    built-in setup G: `shared_zone`: arm `left` waits for zone `under`, which `right` is in, arm `right` waits for zone `over`, which `left` is in: let an arm leave its zone before it waits
    built-in setup G: `station.right.root_mm_deg`: at their starts the arms `left` and `right` are 200.0 mm in each other; move a start or a root_mm_deg
    ");
}

#[test]
fn a_cell_without_zones_is_planned_as_before() {
    for name in ["E", "F"] {
        let cell = planned(name);
        assert!(
            cell.stations.iter().all(|station| station.zones.is_none() && station.plan.visits.is_empty())
        );
        assert!(!cell.to_string().contains("zone"));
    }
}

#[test]
fn arms_that_are_in_each_other_at_their_starts_are_refused_also_in_a_cell_without_zones() {
    for name in ["E", "F"] {
        let (mut cell, found) = found(name);
        assert!(cell.shared_zones.is_empty() && found.plan(&cell).is_ok());
        cell.stations[1].robot.link_radius_mm = Some(assumed(900.0));
        let said = found.plan(&cell).map(|_| ()).unwrap_err().to_string();
        assert!(
            said.contains("`station.right.root_mm_deg`: at their starts the arms `left` and `right` are"),
            "{said}"
        );
        // One whose radius is not known counts as a line, and two lines are beside each other.
        cell.stations[0].robot.link_radius_mm = None;
        assert!(found.plan(&cell).is_err());
        cell.stations[1].robot.link_radius_mm = None;
        assert!(found.plan(&cell).is_ok());
    }
}
