//! What the bench says of a setup or an application that it cannot use, and that it runs one that it can.

use std::fs;

use crate::program::bench;

#[test]
fn the_error_for_a_broken_setup_file_gives_line_key_and_expectation() {
    let directory = tempfile::tempdir().unwrap();
    let broken = setup::SETUPS[0].1.replace("scan_cost_us", "scan_costs");
    fs::write(directory.path().join("my.toml"), broken).unwrap();
    let finished = bench(directory.path(), ["--setup", "my.toml", "--mode", "virtual"]);
    assert_eq!(finished.code, Some(2));
    insta::assert_snapshot!(finished.stderr, @r#"
    error: my.toml:16: in `plc.scan_costs`: unknown key `scan_costs`: did you mean `scan_cost_us`?
       16 | scan_costs = { value = 150, from = "assumed", note = "a short program on a fast PLC" }
    "#);
}

/// Returns the error for Setup A in a directory whose application is the shipped one with one passage replaced.
fn refused_application(from: &str, to: &str) -> String {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("my.toml"), naming("jobs/mine.toml")).unwrap();
    fs::create_dir(directory.path().join("jobs")).unwrap();
    let (_, text) = planning::APPLICATIONS[0];
    assert!(text.contains(from), "{from}");
    fs::write(directory.path().join("jobs/mine.toml"), text.replacen(from, to, 1)).unwrap();
    let finished = bench(directory.path(), ["--setup", "my.toml", "--mode", "virtual", "--reps", "1"]);
    assert_eq!((finished.code, finished.stdout.as_str()), (Some(2), ""), "{}", finished.stderr);
    assert!(!directory.path().join("runs").exists(), "nothing is written");
    finished.stderr
}

/// Returns Setup A with another application.
fn naming(application: &str) -> String {
    let named = format!("application = \"{application}\"");
    setup::SETUPS[0].1.replace("application = \"pick-and-place\"", &named)
}

#[test]
fn the_error_for_a_broken_application_file_gives_line_key_and_expectation() {
    insta::assert_snapshot!(refused_application("approach_mm", "aproach_mm"), @"
    error: jobs/mine.toml:43: in `step[0].aproach_mm`: unknown key `aproach_mm`: did you mean `approach_mm`?
       43 | aproach_mm = 70.0
    ");
    insta::assert_snapshot!(refused_application("reach = \"home\"", "reach = \"hom\""), @"error: jobs/mine.toml:71: reach: there is no frame `hom`; did you mean `home`?");
}

#[test]
fn the_error_for_an_application_that_cannot_be_planned_gives_step_motion_quantity_and_limit() {
    insta::assert_snapshot!(refused_application("line = \"grip\"", "line = \"carrier-rim\""), @"error: jobs/mine.toml on setup A: step `A`, motion 3: its length is 0.000 mm and it does not turn; a motion needs at least 0.01 mm: remove it or move its frame");
    insta::assert_snapshot!(refused_application("table = 1", "table = 2"), @"error: jobs/mine.toml on setup A: step `A`, motion 1: the setup's robot has no base 2; it has 0, 1");
}

#[test]
fn an_application_that_the_arm_does_not_reach_is_refused_before_the_run_with_motion_place_and_what_is_missing()
 {
    insta::assert_snapshot!(refused_application("inserted = { mm_deg = [300.0", "inserted = { mm_deg = [600.0"), @"error: jobs/mine.toml on setup A: motion 7 `PTP before C`, its target: the target is 540.833 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; 40.8 mm are missing: change frame `above-assembly` or the step's approach_mm, or base 1 in the setup");
}

#[test]
fn the_error_for_an_unknown_application_lists_the_existing_ones() {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("my.toml"), naming("juggle")).unwrap();
    let finished = bench(directory.path(), ["--setup", "my.toml", "--mode", "virtual"]);
    assert_eq!(finished.code, Some(2));
    insta::assert_snapshot!(finished.stderr, @"error: there is no application `juggle`: built in are pick-and-place, pick-and-place-gripper, gluing, palletising, engraving, insertion-with-force; or give the path of a .toml file");
}

#[test]
fn a_built_in_application_runs_by_its_name_and_its_text_is_saved() {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("my.toml"), naming("pick-and-place-gripper")).unwrap();
    let arguments = ["--setup", "my.toml", "--mode", "virtual", "--reps", "1", "--out", "run"];
    let finished = bench(directory.path(), arguments);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let kept = fs::read_to_string(directory.path().join("run/application.toml")).unwrap();
    let (_, text) = planning::APPLICATIONS[1];
    assert_eq!(kept, text);
}
