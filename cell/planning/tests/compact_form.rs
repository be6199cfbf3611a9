//! `plc.form = "compact"`: a plan as compact points, or why it has none.

#![expect(clippy::unwrap_used, reason = "a helper of a test may panic as the test may")]

use planning::{Application, plan};
use protocol::image::Skill;
use setup::Setup;

const CIRCLE: &str = include_str!("circle.toml");

/// The same for two arms, which meet half-way.
const TWO_CIRCLES: &str = include_str!("two-circles.toml");

fn compact() -> Setup {
    setup::setup("A").unwrap().with_queue_motions(64).with_form_compact()
}

fn refused(text: &str) -> String {
    let planned = plan(&Application::parse("circle.toml", text).unwrap(), &compact());
    planned.map(|plan| plan.motions.len()).unwrap_err().to_string()
}

#[test]
fn the_points_of_a_plan_are_its_motions_within_half_a_step() {
    let application = Application::parse("circle.toml", CIRCLE).unwrap();
    let planned = plan(&application, &compact()).unwrap();
    let path = planned.wire_points(&compact()).unwrap().unwrap();
    // 3.14 mm from point to point, in a step of 16 bits.
    assert_eq!((path.differences.len(), path.head.coordinates, path.head.resolution), (60, 3, 10));
    let full = planned.wire_motions(&setup::setup("A").unwrap());
    let rounded = planned.wire_motions(&compact());
    assert_eq!(full.len(), rounded.len());
    for (one, other) in full.iter().zip(&rounded) {
        let off = one.target.iter().zip(other.target).map(|(one, other)| (one - other).abs());
        assert!(off.fold(0.0, f32::max) < 1e-4, "{one:?} and {other:?}");
        assert_eq!(one.velocity, other.velocity);
    }
    assert_eq!(planned.wire_points(&setup::setup("A").unwrap()), Ok(None));
    assert_eq!(u8::from(Skill::MoveTrajectory), 18);
}

#[test]
fn a_plan_without_a_compact_form_is_refused_with_its_first_motion_that_differs() {
    let begin = "path = [ { spline = [";
    let before = |step: &str| CIRCLE.replace(begin, &format!("path = [ {step}, {{ spline = ["));
    let frame = |line: &str| CIRCLE.replace("\nhome = ", &format!("\n{line}\nhome = "));
    let again = "\n[[step]]\nname = \"again\"\ndoes = \"goes back\"\nlabels = [\"accurate-path\", \"accurate-stop\"]\n\
                 from = \"home\"\npath = [ { spline = [\"p1\", \"p2\"] } ]\n";
    let far = frame("far = { on = \"home\", shift_mm = [400.0, 0.0, 0.0] }");
    let refusals = [
        refused(&before("{ line = \"p2\" }")),
        refused(&far.replace(begin, "path = [ { spline = [\"far\", ")),
        refused(&format!("{CIRCLE}{again}")),
        refused(&CIRCLE.replace("p2 = { on", "p2 = { configuration = { status = 2 }, on")),
    ];
    insta::assert_snapshot!(refusals.join("\n"), @r#"
    plc.form = "compact": motion 2 has another kind than motion 1: compact points are alike but for their targets
    plc.form = "compact": point 0: x is 400 mm from the point before: a difference carries at most 327.67 mm; choose a coarser resolution or a closer spacing
    plc.form = "compact": the arm stops after motion 60 of 62: compact points are one continuous motion, so leave out its stops
    plc.form = "compact": motion 2 has a configuration, which compact points do not carry: leave it out
    "#);
}

/// Plans an application for two arms on Setup F, whose PLC sends compact points.
fn planned_cell(text: &str) -> Result<planning::PlannedCell, String> {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("task.toml"), text).unwrap();
    let (mut cell, _) = setup::cell("F").unwrap();
    cell.application = Some("task.toml".to_owned());
    for station in &mut cell.stations {
        station.application = format!("{}-circle", station.name);
    }
    let cell = cell.with_each_station(|setup| setup.with_queue_motions(64).with_form_compact());
    setup::check_cell(&cell).unwrap();
    let found = planning::applications_of("F", &cell, Some(place.path())).unwrap();
    let shown = place.path().display().to_string();
    found.plan(&cell).map_err(|error| error.to_string().replace(&shown, "DIR"))
}

#[test]
fn each_arm_of_a_cell_has_points_of_its_own_and_rests_at_marks_among_them() {
    let planned = planned_cell(TWO_CIRCLES).unwrap();
    for station in &planned.stations {
        let path = station.plan.wire_points(&station.setup).unwrap().unwrap();
        assert_eq!(path.differences.len(), 60);
        assert_eq!(station.plan.waits.iter().map(|wait| wait.after).collect::<Vec<_>>(), [30]);
        // The zone of the point at the mark is that of the others: the arm rests there since no point follows.
        let zones: Vec<u16> =
            station.plan.wire_motions(&station.setup).iter().map(|motion| motion.approximation).collect();
        assert!(zones.iter().all(|zone| *zone == zones[0] && *zone > 0), "{zones:?}");
    }
}

#[test]
fn an_arm_of_a_cell_whose_motions_have_no_compact_form_is_refused_with_its_station() {
    let led = TWO_CIRCLES.replace(
        "name = \"half-way\"",
        "name = \"half-way\"\ntogether = true\n\n[[mark]]\nnumber = 2\nname = \"end\"",
    );
    let led = led
        .replace("[[arm.step]]\nname = \"back\"", "[[arm.step]]\nmark = 2\n\n[[arm.step]]\nname = \"back\"");
    let mark = "[[arm.step]]\nmark = 1\n";
    let (left, right) = TWO_CIRCLES.rsplit_once(mark).unwrap();
    let slower = format!("{left}{mark}{}", right.replace("speed_mm_s = 100.0", "speed_mm_s = 50.0"));
    let refusals = [led, slower].map(|text| planned_cell(&text).unwrap_err());
    insta::assert_snapshot!(refusals.join("\n"), @r#"
    DIR/task.toml on setup F-left: plc.form = "compact": the arm moves together with others from mark `half-way`: their master counts the law of full motions, which compact points do not share; leave plc.form out, or `together` of the mark
    DIR/task.toml on setup F-right: plc.form = "compact": motion 31 has another velocity than motion 1: compact points are alike but for their targets
    "#);
}
