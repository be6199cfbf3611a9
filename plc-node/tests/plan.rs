//! `plc-node plan`: what goes to which stream, and what is said of an application that cannot be planned.

#![expect(clippy::unwrap_used, reason = "a helper of a test may panic as the test may")]

use std::fs;
use std::path::Path;
use std::process::Command;

use tempfile::TempDir;

/// What a call printed and how it ended.
struct Finished {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

fn plan_in(directory: &Path, arguments: &[&str]) -> Finished {
    let output = Command::new(env!("CARGO_BIN_EXE_plc-node"))
        .current_dir(directory)
        .arg("plan")
        .args(arguments)
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Finished { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

fn plan(arguments: &[&str]) -> Finished {
    plan_in(Path::new("."), arguments)
}

/// Creates a directory with the shipped pick and place, as `my.toml`, in which one passage is replaced.
fn with_change(from: &str, to: &str) -> TempDir {
    let directory = tempfile::tempdir().unwrap();
    let (_, text) = planning::APPLICATIONS[0];
    assert!(text.contains(from), "{from}");
    fs::write(directory.path().join("my.toml"), text.replacen(from, to, 1)).unwrap();
    directory
}

/// Plans the changed application and returns the output.
fn changed(from: &str, to: &str) -> Finished {
    plan_in(with_change(from, to).path(), &["my.toml", "--setup", "A"])
}

#[test]
fn every_application_that_is_built_in_is_planned_on_every_arm_without_a_warning() {
    for ((name, _), setup) in planning::APPLICATIONS.iter().flat_map(|it| ["A", "B", "D"].map(|on| (it, on)))
    {
        let finished = plan(&[name, "--setup", setup]);
        assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""), "{name} on {setup}");
        assert!(finished.stdout.starts_with(&format!("{name} on setup {setup}: ")), "{}", finished.stdout);
    }
}

#[test]
fn without_an_application_that_of_the_setup_is_planned_for_each_of_its_stations() {
    let [alone, named] = [plan(&[]), plan(&["pick-and-place"])];
    assert_eq!((alone.code, alone.stdout, alone.stderr), (named.code, named.stdout, named.stderr));
    for (setup, application, arms) in
        [("E", "hand-over", ["giver", "taker"]), ("F", "carry-plate", ["left-edge", "right-edge"])]
    {
        let finished = plan(&["--setup", setup]);
        assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""), "{setup}");
        let mut rest = finished.stdout.as_str();
        for (station, arm) in ["left", "right"].into_iter().zip(arms) {
            let begin = format!("station {station}\n{application}-{arm} on setup {setup}-{station}: ");
            rest = rest.split_once(&begin).unwrap_or_else(|| panic!("{begin}: {rest}")).1;
        }
        assert!(rest.contains("\nmarks\n") && rest.contains("left after motion"), "{rest}");
    }
}

#[test]
fn an_application_for_several_arms_is_planned_on_a_setup_that_does_not_name_it() {
    let named = plan(&["take-turns", "--setup", "G"]);
    let own = plan(&["--setup", "G"]);
    assert_eq!((named.code, &named.stdout, &named.stderr), (Some(0), &own.stdout, &own.stderr));
    let another = plan(&["carry-plate", "--setup", "G"]);
    assert_eq!(another.code, Some(2));
    assert!(another.stderr.contains("left-edge"), "{}", another.stderr);
}

#[test]
fn a_setup_of_several_stations_is_not_planned_for_one_arm() {
    let finished = plan(&["pick-and-place", "--setup", "E"]);
    assert_eq!(finished.code, Some(2));
    assert!(
        finished.stderr.contains("built in are hand-over, carry-plate, take-turns"),
        "{}",
        finished.stderr
    );
    let finished = plan(&["hand-over"]);
    assert_eq!(finished.code, Some(2));
    assert!(finished.stderr.contains("2 arms (giver, taker)"), "{}", finished.stderr);
}

#[test]
fn of_a_grid_one_cycle_is_shown_unless_all_are_asked_for() {
    let cycles =
        |finished: Finished| finished.stdout.lines().filter(|line| line.starts_with("cycle ")).count();
    assert_eq!(cycles(plan(&["palletising"])), 1);
    assert_eq!(cycles(plan(&["palletising", "--all"])), 200);
}

#[test]
fn a_blend_that_had_to_shrink_is_a_warning_beside_the_plan() {
    let directory = with_change("approach_mm = 70.0", "approach_mm = 12.0");
    let finished = plan_in(directory.path(), &["my.toml", "--setup", "B"]);
    assert_eq!(finished.code, Some(0));
    assert!(!finished.stdout.contains("warning"), "{}", finished.stdout);
    insta::assert_snapshot!(finished.stderr, @"warning: motion 1 `PTP before A` blends into motion 2 `LIN before A` by 6.00 mm instead of 10 mm: motion 2 `LIN before A` is only 12.00 mm long and gives at most half");
}

#[test]
fn readers_that_went_away_are_no_failure_of_a_plan_with_warnings() {
    let directory = with_change("approach_mm = 70.0", "approach_mm = 12.0");
    let without_reader = || std::io::pipe().unwrap().1;
    let mut command = Command::new(env!("CARGO_BIN_EXE_plc-node"));
    command.current_dir(directory.path()).args(["plan", "my.toml", "--setup", "B"]);
    let ended = command.stdout(without_reader()).stderr(without_reader()).status().unwrap();
    assert_eq!(ended.code(), Some(0));
}

#[test]
fn what_cannot_be_read_or_planned_is_a_fault_of_usage_with_file_and_place() {
    let unknown = plan(&["juggle"]);
    let key = changed("approach_mm", "aproach_mm");
    let value = changed("labels = [\"accurate-path\"]", "labels = []");
    let step = changed("line = \"grip\"", "line = \"carrier-rim\"");
    let finished = [unknown, key, value, step].map(|finished| {
        assert_eq!((finished.code, finished.stdout.as_str()), (Some(2), ""), "{}", finished.stderr);
        finished.stderr
    });
    insta::assert_snapshot!(finished.concat(), @r#"
    error: there is no application `juggle`: built in are pick-and-place, pick-and-place-gripper, gluing, palletising, engraving, insertion-with-force; or give the path of a .toml file
    error: my.toml:43: in `step[0].aproach_mm`: unknown key `aproach_mm`: did you mean `approach_mm`?
       43 | aproach_mm = 70.0
    error: my.toml:40: labels: step `A`: is empty; expected some of "blending", "accurate-path", "accurate-stop"
    error: my.toml on setup A: step `A`, motion 3: its length is 0.000 mm and it does not turn; a motion needs at least 0.01 mm: remove it or move its frame
    "#);
}

#[test]
fn where_the_end_is_not_the_start_the_plan_shows_the_way_back_over_the_obstacles() {
    let finished = changed("start = \"home\"", "start = \"above-assembly\"");
    assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""));
    let way_back = finished.stdout.split("stops exactly\n").nth(1);
    insta::assert_snapshot!(way_back.unwrap_or(&finished.stdout), @r"
    the end is not the start: the PLC moves the arm back before a repetition, not measured
            PTP over the wall    300.0     0.0   140.0     0.0    0.0  180.0
            PTP to the start     300.0     0.0    30.0     0.0    0.0  180.0

    15 motions in 1 continuous motion
    the arm reaches all of it; at its start home_deg would be
    [81.134, -96.379, 55.000, 105.245]
    ");
}

#[test]
fn what_the_arm_does_not_reach_is_a_fault_of_usage_beside_the_plan_with_the_distance() {
    let finished = changed("start = \"home\"", "start = \"above-assembly\"");
    let joints = finished.stdout.lines().last().unwrap();
    insta::assert_snapshot!(joints, @"[81.134, -96.379, 55.000, 105.245]");
    let directory = with_change("start = \"home\"", "start = \"home\"");
    let setup = setup::SETUPS[0].1.replacen("mm_deg = { value = [300.0, ", "mm_deg = { value = [600.0, ", 1);
    fs::write(directory.path().join("cell.toml"), setup).unwrap();
    let finished = plan_in(directory.path(), &["my.toml", "--setup", "cell.toml"]);
    assert_eq!(finished.code, Some(2), "{}", finished.stderr);
    assert!(
        finished.stdout.contains("PTP before A") && !finished.stdout.contains("reaches"),
        "{}",
        finished.stdout
    );
    insta::assert_snapshot!(finished.stderr, @"error: my.toml on setup A: the arm cannot stand at the start: the target is 559.017 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; 59.0 mm are missing: change frame `home`, or base 1 in the setup");
}
