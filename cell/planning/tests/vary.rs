//! The shipped application in other sizes and in other pieces.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use planning::{Application, Plan, plan, setup_with_application};
use setup::Setup;

fn setup_a() -> (Setup, Application) {
    let (setup, found) = setup_with_application("A").unwrap();
    (setup, found.application)
}

fn planned() -> Plan {
    let (setup, application) = setup_a();
    plan(&application, &setup).unwrap()
}

fn assert_connected(plan: &Plan) {
    for pair in plan.motions.windows(2) {
        assert!((pair[1].start.point - pair[0].target.point).length() < 1e-9, "{pair:?}");
    }
    for motion in &plan.motions {
        assert!(((motion.target.point - motion.start.point).length() - motion.length_mm).abs() < 1e-9);
        assert!(motion.zone_mm <= motion.length_mm / 2.0 + 1e-9, "{motion:?}");
    }
    assert_eq!(plan.continuous.last().unwrap().motions.end, plan.motions.len());
}

#[test]
fn an_application_scaled_is_planned_to_the_same_motions_and_starts_at_the_same_place() {
    let (setup, application) = setup_a();
    let (whole, half) = (planned(), plan(&application.scaled(0.5), &setup).unwrap());
    assert_eq!(half.motions[0].start, whole.motions[0].start);
    assert_eq!(half.motions.len(), whole.motions.len());
    // The intermediate position lies on a raster of heights, so that its ways do not halve exactly.
    assert!((half.length_mm() / whole.length_mm() - 0.5).abs() < 0.01, "{} mm", half.length_mm());
    let (line, halved) = (&whole.motions[2], &half.motions[2]);
    assert!((halved.length_mm - line.length_mm / 2.0).abs() < 1e-9);
}

#[test]
fn a_plan_in_pieces_goes_the_same_way_and_stops_nowhere_else() {
    let (whole, pieces) = (planned(), planned().divided(3, 10.0));
    assert_eq!(pieces.motions.len(), 3 * whole.motions.len());
    assert_connected(&pieces);
    assert!((pieces.length_mm() - whole.length_mm()).abs() < 1e-6);
    let stops = |plan: &Plan| plan.motions.iter().filter(|motion| motion.zone_mm == 0.0).count();
    assert_eq!(stops(&pieces), stops(&whole));
    assert_eq!(planned().divided(1, 10.0).motions, whole.motions);
}

#[test]
fn pre_and_post_movements_join_the_paths_that_they_lead_to() {
    let (whole, joined) = (planned(), planned().joined());
    // A and C have a pre-movement, B and D a post-movement.
    assert_eq!((whole.motions.len(), joined.motions.len()), (13, 9));
    assert_connected(&joined);
    assert!((joined.length_mm() - whole.length_mm()).abs() < 1e-6);
}
