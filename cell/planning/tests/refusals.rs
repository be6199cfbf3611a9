//! What is refused, and in which words.

#![expect(clippy::expect_used, clippy::panic, reason = "a test fails by panicking")]

use std::fmt::Write;

use planning::{APPLICATIONS, Application, Error, plan, stream};
use setup::Setup;

fn text(name: &str) -> &'static str {
    APPLICATIONS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text).expect("shipped")
}

/// Reads and plans a shipped application in which one passage is replaced.
fn refusal_on(setup: &Setup, name: &str, old: &str, new: &str) -> String {
    let text = text(name);
    assert!(text.contains(old), "{name} no longer has {old:?}");
    let edited = text.replacen(old, new, 1);
    match Application::parse(&format!("{name}.toml"), &edited)
        .and_then(|application| plan(&application, setup))
    {
        Ok(plan) => panic!("planned in spite of {new:?}:\n{plan}"),
        Err(error) => error.to_string(),
    }
}

/// Returns Setup A with fixed speeds and blends, so that a new calibration does not change the messages.
fn setup_a() -> Setup {
    let mut setup = setup::setup("A").expect("built in");
    setup.motions.velocity_percent.value = 25.0;
    setup.motions.approximation_mm.value = 10.0;
    setup.robot.path_velocity_mm_s.value = 2000.0;
    setup
}

const MEASURED: &str = "pick-and-place";

/// The chord from `wave-start` to `wave-1` passes it by 0.6 mm; the spline bends 2 mm to that side.
const BESIDE_THE_WAVE: &str = "[ways]
clearance_mm = 0.0
ceiling_mm = 200.0
height_step_mm = 10.0
ptp_radius_mm = 200.0
detour_percent = 5.0

[[obstacle]]
name = \"post\"
lower_mm = [-31.0, 35.0, 15.0]
upper_mm = [-29.0, 50.0, 25.0]

[[step]]";

#[test]
fn what_cannot_be_planned_is_refused_with_step_motion_quantity_and_limit() {
    // Longer than a screen, because it is one table of cases.
    let wall = "upper_mm = [180.0, 200.0, 125.0]";
    let cases = [
        ("zero length", MEASURED, "line = \"grip\"", "line = \"carrier-rim\""),
        (
            "circle through three points on a line",
            "gluing",
            "through = \"right-bottom-arc\"",
            "through = \"right-bottom\"",
        ),
        (
            "turn on the spot with a pre-movement",
            MEASURED,
            "grip = { mm_deg = [0.0, 0.0, 0.0, 0.0, 0.0, 180.0] }\ncarrier-rim = { on = \"grip\", shift_mm = [0.0, 0.0, 30.0] }",
            "grip = { mm_deg = [0.0, 0.0, 30.0, 0.0, 0.0, 180.0] }\ncarrier-rim = { mm_deg = [0.0, 0.0, 30.0, 9.0, 0.0, 180.0] }",
        ),
        (
            "turn on the spot within a spline",
            "gluing",
            "wave-2 = { on = \"seam-start\", shift_mm = [0.0, 30.0, 0.0] }",
            "wave-2 = { mm_deg = [-20.0, 38.0, 20.0, 30.0, 0.0, 180.0] }",
        ),
        (
            "circle back to its start",
            "gluing",
            "circle = { through = \"right-bottom-arc\", to = \"right-low\" }",
            "circle = { through = \"right-bottom-arc\", to = \"right-bottom\" }",
        ),
        ("unknown tool", MEASURED, "gripper = 0", "gripper = 3"),
        ("unknown base", MEASURED, "table = 1", "table = 2"),
        ("speed 0", "gluing", "speed_mm_s = 60.0", "speed_mm_s = 0.0"),
        ("speed above the robot's", "gluing", "speed_mm_s = 60.0", "speed_mm_s = 6000.0"),
        ("speed that is no number", "gluing", "speed_mm_s = 60.0", "speed_mm_s = nan"),
        ("speed share 0", "gluing", "speed_mm_s = 60.0", "speed_percent = 0.0"),
        (
            "obstacle that encloses a process frame",
            MEASURED,
            "[[step]]",
            "[[obstacle]]\nname = \"block\"\nlower_mm = [-5.0, -5.0, -9.0]\nupper_mm = [5.0, 5.0, 9.0]\n[[step]]",
        ),
        (
            "obstacle that encloses the target of a way",
            MEASURED,
            "[[step]]",
            "[[obstacle]]\nname = \"block\"\nlower_mm = [-5.0, -5.0, 92.0]\nupper_mm = [5.0, 5.0, 120.0]\n[[step]]",
        ),
        (
            "path through an obstacle",
            MEASURED,
            "[[step]]",
            "[[obstacle]]\nname = \"lid\"\nlower_mm = [-5.0, -5.0, 10.0]\nupper_mm = [5.0, 5.0, 12.0]\n[[step]]",
        ),
        (
            "path nearer to an obstacle than the clearance",
            MEASURED,
            "[[step]]",
            "[[obstacle]]\nname = \"fixture\"\nlower_mm = [6.0, -5.0, 0.0]\nupper_mm = [16.0, 5.0, 12.0]\n[[step]]",
        ),
        ("spline through an obstacle that its chord passes", "gluing", "[[step]]", BESIDE_THE_WAVE),
        ("no way below the ceiling", MEASURED, wall, "upper_mm = [180.0, 200.0, 185.0]"),
        (
            "no way at any height",
            MEASURED,
            "[[step]]",
            "[[obstacle]]\nname = \"roof\"\nlower_mm = [140.0, -900.0, 141.0]\nupper_mm = [900.0, 900.0, 3000.0]\n[[step]]",
        ),
        ("too near", MEASURED, "lower_mm = [120.0, -200.0, -25.0]", "lower_mm = [5.0, -200.0, -25.0]"),
        ("no force", "insertion-with-force", "force_n = [0.0, 0.0, -25.0]", "force_n = [0.0, 0.0, 0.0]"),
    ];
    let mut all = String::new();
    for (case, name, old, new) in cases {
        writeln!(all, "{case}\n  {}", refusal_on(&setup_a(), name, old, new)).expect("a string takes all");
    }
    let mut slow = setup_a();
    slow.motions.velocity_percent.value = 0.0;
    writeln!(all, "setup at rest\n  {}", refusal_on(&slow, MEASURED, "schema", "schema"))
        .expect("a string takes all");
    insta::assert_snapshot!(all);
}

#[test]
fn what_cannot_be_read_is_refused_with_file_line_key_and_expectation() {
    // Longer than a screen, because it is one table of cases.
    let cases = [
        ("unknown key", MEASURED, "approach_mm", "aproach_mm"),
        ("wrong type", MEASURED, "ceiling_mm = 180.0", "ceiling_mm = \"high\""),
        ("unknown segment", MEASURED, "path = [{ line", "path = [{ lien"),
        ("unknown label", MEASURED, "labels = [\"accurate-path\"]", "labels = [\"exact\"]"),
        ("no label", MEASURED, "labels = [\"accurate-path\"]", "labels = []"),
        (
            "labels that exclude each other",
            MEASURED,
            "labels = [\"accurate-path\"]",
            "labels = [\"blending\", \"accurate-path\"]",
        ),
        ("another schema", MEASURED, "schema = 2", "schema = 1"),
        ("step without a frame", MEASURED, "reach = \"home\"", ""),
        ("unknown frame", MEASURED, "reach = \"home\"", "reach = \"hom\""),
        ("unknown tool name", MEASURED, "tool = \"gripper\"", "tool = \"nozzle\""),
        ("tool number beyond the wire", MEASURED, "gripper = 0", "gripper = 16"),
        ("frame on itself", MEASURED, "{ on = \"grip\",", "{ on = \"carrier-rim\","),
        ("frame out of this world", MEASURED, "[-100.0, 100.0,", "[-100.0, 1e30,"),
        ("obstacle inside out", MEASURED, "upper_mm = [180.0,", "upper_mm = [110.0,"),
        (
            "obstacles without ways",
            "gluing",
            "[[step]]",
            "[[obstacle]]\nname = \"wall\"\nlower_mm = [0.0, 0.0, 0.0]\nupper_mm = [1.0, 1.0, 1.0]\n[[step]]",
        ),
        (
            "end without a stop",
            MEASURED,
            "labels = [\"blending\", \"accurate-stop\"]",
            "labels = [\"blending\"]",
        ),
        (
            "action without a stop",
            "pick-and-place-gripper",
            "labels = [\"accurate-path\", \"accurate-stop\"]",
            "labels = [\"accurate-path\"]",
        ),
        ("unknown action", "pick-and-place-gripper", "then = \"grip\"", "then = \"grab\""),
        ("pre-movement without a beginning", MEASURED, "from = \"carrier-rim\"\n", ""),
        ("empty grid", "palletising", "count = [8, 5, 5]", "count = [8, 0, 5]"),
        (
            "status that no arm has",
            MEASURED,
            "home = {",
            "home = { configuration = { status = 8, turn = 0 },",
        ),
        (
            "turn of a seventh axis",
            MEASURED,
            "home = {",
            "home = { configuration = { status = 2, turn = 64 },",
        ),
        ("turn without a status", MEASURED, "home = {", "home = { configuration = { turn = 2 },"),
        (
            "configuration beside joints",
            MEASURED,
            "home = {",
            "home = { joints_deg = [-60.0, 90.0, 150.0, 0.0, 0.0, 0.0], configuration = { status = 2 },",
        ),
        (
            "configuration at the end of a circle",
            "gluing",
            "right-low = {",
            "right-low = { configuration = { status = 2 },",
        ),
        ("height step too fine", MEASURED, "height_step_mm = 10.0", "height_step_mm = 0.001"),
        ("height of 309 digits", MEASURED, "ceiling_mm = 180.0", "ceiling_mm = 1e308"),
        ("control character in a step", MEASURED, "name = \"A\"", "name = \"A\\u001b[2J\""),
        ("control character in the title", MEASURED, "title = \"", "title = \"\\r"),
    ];
    let mut all = String::new();
    for (case, name, old, new) in cases {
        let refusal = refusal_on(&setup_a(), name, old, new);
        writeln!(all, "{case}\n  {}", refusal.trim_end().replace('\n', "\n  ")).expect("a string takes all");
    }
    insta::assert_snapshot!(all);
}

#[test]
fn steps_of_one_name_are_told_apart_by_the_numbers_of_their_motions() {
    let twice = text(MEASURED).replace("name = \"B\"", "name = \"A\"");
    let parse = |text: &str| Application::parse("twice", text).expect("reads");
    let (own, same) = (plan(&parse(text(MEASURED)), &setup_a()), plan(&parse(&twice), &setup_a()));
    let targets = |plan: planning::Plan| plan.motions.iter().map(|motion| motion.target).collect::<Vec<_>>();
    assert_eq!(targets(own.expect("plans")), targets(same.expect("plans")));
    let refused = plan(&parse(&twice.replacen("retreat_mm = 70.0", "retreat_mm = 0.001", 1)), &setup_a());
    let refused = refused.expect_err("a motion without length").to_string();
    assert!(refused.starts_with("step `A`, motion 5: "), "{refused}");
}

#[test]
fn a_blend_larger_than_half_a_motion_shrinks_with_a_warning_that_names_both() {
    let short = text(MEASURED).replacen("retreat_mm = 70.0", "retreat_mm = 12.0", 1);
    let application = Application::parse("short", &short).expect("reads");
    let plan = plan(&application, &setup_a()).expect("plans");
    let zone = plan.motions.iter().find(|motion| motion.name == "LIN after B").map(|motion| motion.zone_mm);
    assert_eq!(zone, Some(6.0));
    assert_eq!(
        plan.warnings(),
        [
            "motion 5 `LIN after B` blends into motion 6 `PTP over the wall` by 6.00 mm instead of 10 mm: it is only \
          12.00 mm long and gives at most half"
        ]
    );
}

#[test]
fn a_seam_with_a_corner_stops_there_with_a_warning() {
    let square = text("gluing").replacen(
        "{ circle = { through = \"right-bottom-arc\", to = \"right-low\" } }",
        "{ line = \"right-low\" }",
        1,
    );
    let application = Application::parse("corner", &square).expect("reads");
    let plan = plan(&application, &setup_a()).expect("plans");
    assert_eq!(
        plan.warnings(),
        [
            "step `rectangle`, motions 3 to 4: 2 corners of 45° stop the arm on its path; use `spline` or `circle`, or \
             the label `blending`"
        ]
    );
}

#[test]
fn without_a_path_tolerance_a_seam_stops_between_line_and_arc_with_a_warning() {
    let strict = text("gluing").replacen("path_tolerance_mm = 0.1", "path_tolerance_mm = 0.0", 1);
    let application = Application::parse("strict", &strict).expect("reads");
    let plan = plan(&application, &setup_a()).expect("plans");
    let warnings = plan.warnings();
    insta::assert_snapshot!(warnings.join("\n"), @"step `rectangle`, motions 3 to 10: the arm stops at 8 smooth junctions; allow a deviation by `path_tolerance_mm`");
}

#[test]
fn a_zone_beyond_the_intermediate_point_of_a_circle_is_warned_of() {
    // An arc of 23.6 mm whose intermediate point is 4 mm from its start.
    let blended = text("gluing")
        .replacen(
            "labels = [\"accurate-path\", \"accurate-stop\"]",
            "labels = [\"blending\", \"accurate-stop\"]",
            1,
        )
        .replacen(
            "right-bottom-arc = { on = \"seam-start\", shift_mm = [55.607, 4.393, 0.0] }",
            "right-bottom-arc = { on = \"seam-start\", shift_mm = [48.967, 0.536, 0.0] }",
            1,
        );
    let application = Application::parse("blended", &blended).expect("reads");
    let plan = plan(&application, &setup_a()).expect("plans");
    let warnings = plan.warnings();
    insta::assert_snapshot!(warnings.join("\n"), @"motion 3 `LIN rectangle 1/9`, before motion 4 `CIRC rectangle 2/9`: the zone reaches beyond the intermediate point of the circle, 4.00 mm away, so that the tool does not pass it: lower approximation_mm or move the point");
}

#[test]
fn a_step_that_wants_more_than_the_setup_programs_is_warned_of() {
    let fast = text("gluing").replacen("speed_mm_s = 60.0", "speed_mm_s = 900.0", 1);
    let application = Application::parse("fast", &fast).expect("reads");
    let plan = plan(&application, &setup_a()).expect("plans");
    let first = plan.warnings().into_iter().next();
    assert_eq!(
        first.as_deref(),
        Some("step `rectangle`, motions 3 to 11: the step allows 900 mm/s, the setup programs 500 mm/s")
    );
}

#[test]
fn a_stream_ends_in_an_exact_stop_at_the_last_good_motion_and_names_the_bad_one() {
    // Layers that drop 50 mm run below the table after two layers: there the wall of the table is in the way.
    let table = "[[obstacle]]\nname = \"table\"\nlower_mm = [-300.0, 40.0, -500.0]\nupper_mm = [300.0, 300.0, -60.0]\n[[step]]";
    let edited = text("palletising")
        .replacen("pitch_mm = [20.0, 20.0, 15.0]", "pitch_mm = [20.0, 20.0, -50.0]", 1)
        .replacen("[[step]]", table, 1);
    let application = Application::parse("sinking", &edited).expect("reads");
    let setup = setup_a();
    let items: Vec<_> = stream(&application, &setup, 1).collect();
    let (last, good) = items.split_last().expect("something came");
    let Err(Error::Refused { step, motion, .. }) = last else { panic!("{last:?}") };
    assert_eq!(step, "place");
    assert_eq!(*motion, good.len() as u64 + 1);
    let good: Vec<_> = good.iter().map(|item| *item.as_ref().expect("good")).collect();
    let stop = good.last().expect("some are good");
    assert!(good.len() > 900 && stop.accurate_stop && stop.motion.approximation == 0, "{stop:?}");
}
