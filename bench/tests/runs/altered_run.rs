//! Saved figures that were changed by accident are found by every verb that reads a run, and runs that ended early or that
//! an older version wrote are read.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::program::{Finished, bench};

/// Executes a virtual run of two repetitions in `runs/run`.
fn a_run() -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    let arguments =
        ["--setup", "B", "--mode", "virtual", "--reps", "2", "--seed", "31", "--out", "runs/run", "--quiet"];
    let finished = bench(directory.path(), arguments);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    directory
}

/// Calls each verb that reads a run: `report`, `compare`, `history`, and `gate --run`.
fn readers(directory: &Path) -> [Finished; 4] {
    [
        &["report", "runs/run"][..],
        &["compare", "runs/run", "runs/run"],
        &["history", "runs"],
        &["gate", "--run", "runs/run"],
    ]
    .map(|arguments| bench(directory, arguments))
}

/// Returns what the verbs say of a changed run, once all of them refuse it in the same words.
fn refused(directory: &Path) -> String {
    let said = readers(directory).map(|finished| {
        assert_eq!(finished.code, Some(4), "{}{}", finished.stdout, finished.stderr);
        let line = finished.stderr.lines().next().unwrap_or_default();
        line.replacen("error: ", "", 1).replacen("warning: left out: ", "", 1)
    });
    assert!(said.iter().all(|one| *one == said[0]), "{said:?}");
    said[0].clone()
}

/// Changes the results of a run, as an editor would, and returns what the verbs say of it. The run is then as it was.
fn with_results(directory: &Path, change: impl FnOnce(&mut Value)) -> String {
    let path = directory.join("runs/run/results.json");
    let before = fs::read_to_string(&path).unwrap();
    let mut results = serde_json::from_str(&before).unwrap();
    change(&mut results);
    fs::write(&path, serde_json::to_string_pretty(&results).unwrap()).unwrap();
    let said = refused(directory);
    fs::write(&path, before).unwrap();
    said
}

/// Changes a file of a run likewise.
fn with_file(directory: &Path, name: &str, change: impl FnOnce(String) -> String) -> String {
    let path = directory.join("runs/run").join(name);
    let before = fs::read_to_string(&path).unwrap();
    let after = change(before.clone());
    assert_ne!(after, before, "{name}");
    fs::write(&path, after).unwrap();
    let said = refused(directory);
    fs::write(&path, before).unwrap();
    said
}

#[test]
fn a_changed_figure_is_found_with_its_name_the_value_found_and_the_one_its_samples_give() {
    let directory = a_run();
    let place = directory.path();
    insta::assert_snapshot!(with_results(place, |it| it["results"]["sm"]["aet_ms"] = json!(3000.0)), @"runs/run/results.json: aet_ms of SM is 3000, its samples give 8982; restore the file, or run again");
    insta::assert_snapshot!(with_results(place, |it| it["results"]["rc"]["mad_ms"] = json!(0.25)), @"runs/run/results.json: mad_ms of RC is 0.25, its samples give 0; restore the file, or run again");
    insta::assert_snapshot!(with_results(place, |it| it["aet_improvement"] = json!(0.5)), @"runs/run/results.json: aet_improvement is 0.5, its samples give 0.15403028278779782; restore the file, or run again");
    insta::assert_snapshot!(with_results(place, |it| it["without_skill_overhead"]["aet_improvement"] = json!(0.1)), @"runs/run/results.json: aet_improvement of without_skill_overhead is 0.1, its samples give 0.10694084374263493; restore the file, or run again");
    let read = readers(place);
    assert_eq!([0, 1, 2].map(|verb| read[verb].code), [Some(0); 3], "the run is as it was");
}

#[test]
fn a_dropped_or_changed_sample_is_found_wherever_it_was_dropped() {
    let directory = a_run();
    let place = directory.path();
    insta::assert_snapshot!(with_results(place, |it| drop(it["results"]["cm"]["samples_ms"].as_array_mut().unwrap().pop())), @"runs/run/results.json: robot_samples_ms of CM has 2 entries, its samples_ms 1; restore the file, or run again");
    let without_last = |it: &mut Value| {
        for list in ["samples_ms", "robot_samples_ms", "blends_suppressed", "missed_cycles"] {
            it["results"]["cm"][list].as_array_mut().unwrap().pop();
        }
        it["results"]["cm"]["aet_ms"] = it["results"]["cm"]["samples_ms"][0].clone();
        it["results"]["cm"]["mad_ms"] = json!(0.0);
    };
    insta::assert_snapshot!(with_results(place, without_last), @"runs/run/results.json: CM has 1 sample, and the complete run 2 repetitions; restore the file, or run again");
    insta::assert_snapshot!(with_file(place, "samples.csv", |text| {
        text.lines().filter(|line| !line.starts_with("sm,2")).map(|line| format!("{line}\n")).collect()
    }), @"runs/run/samples.csv: has 1 repetition of SM, results.json has 2; restore the file, or run again");
    let changed = |text: String| text.replacen("rc,1,", "rc,1,1", 1);
    let said = with_file(place, "samples.csv", changed);
    assert!(said.contains("samples.csv: execution_ms of RC 1 is 1"), "{said}");
    insta::assert_snapshot!(with_file(place, "samples.csv", |text| text + "rc,3,37"), @"runs/run/samples.csv: line 8 is not a complete repetition; restore the file, or run again");
}

#[test]
fn a_changed_condition_of_the_run_is_found_by_its_digest() {
    let directory = a_run();
    let place = directory.path();
    insta::assert_snapshot!(with_results(place, |it| it["mode"] = json!("real")), @r#"runs/run/results.json: `mode` is "real": its digest is `825bc70e8b243b6a`, the saved one `86958e0c3d97c4cc`; restore the file, or run again"#);
    for (key, value) in [
        ("setup", json!("A")),
        ("title", json!("another cell")),
        ("application", json!("gluing")),
        ("seed", json!(32)),
        ("reps", json!(3)),
        ("status", json!("interrupted")),
        ("override", json!("50")),
        ("repeated", json!(1)),
        ("paper", json!(null)),
        ("without_skill_overhead", json!(null)),
    ] {
        let said = with_results(place, |it| it[key] = value);
        assert!(
            said.contains("runs/run/results.json: ") && (said.contains(key) || key == "reps"),
            "{key}: {said}"
        );
    }
    let said = with_results(place, |it| it["results"]["rc"]["quality"]["path_deviation_mm"] = json!(0.1));
    assert!(said.contains("`results.rc`"), "{said}");
    let said = with_results(place, |it| it["cycle"]["plc"]["missed"] = json!(3));
    assert!(said.contains("`cycle`"), "{said}");
    let said = with_file(place, "setup.toml", |text| text.replacen("value = 1000", "value = 2000", 1));
    assert!(said.contains("runs/run/setup.toml: its digest is "), "{said}");
    let said = with_file(place, "application.toml", |text| text + "\n");
    assert!(said.contains("runs/run/application.toml: its digest is "), "{said}");
}

#[test]
fn deleted_results_beside_samples_are_found() {
    let directory = a_run();
    fs::remove_file(directory.path().join("runs/run/results.json")).unwrap();
    insta::assert_snapshot!(refused(directory.path()), @"runs/run/results.json: is missing beside 6 repetitions in samples.csv; restore the file, or run again");
    let directory = a_run();
    fs::remove_file(directory.path().join("runs/run/samples.csv")).unwrap();
    insta::assert_snapshot!(refused(directory.path()), @"runs/run/samples.csv: is missing beside results.json; restore the file, or run again");
}

#[test]
fn results_that_were_only_formatted_otherwise_are_read() {
    let directory = a_run();
    let path = directory.path().join("runs/run/results.json");
    let results: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    fs::write(&path, results.to_string().replace(".0,", ",")).unwrap();
    let finished = bench(directory.path(), ["report", "runs/run"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
}

#[test]
fn a_run_of_an_older_version_is_read_and_marked() {
    let directory = tempfile::tempdir().unwrap();
    let older = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/runs/older-version");
    let run = directory.path().join("runs/run");
    fs::create_dir_all(&run).unwrap();
    for file in fs::read_dir(older).unwrap() {
        let file = file.unwrap();
        fs::copy(file.path(), run.join(file.file_name())).unwrap();
    }
    let [report, compare, history, _] = readers(directory.path());
    assert_eq!(
        [report.code, compare.code, history.code],
        [Some(0); 3],
        "{}{}",
        report.stderr,
        history.stderr
    );
    let html = fs::read_to_string(run.join("report.html")).unwrap();
    assert!(html.contains("seed 1 · written by an older version"));
    assert_eq!(compare.stdout.matches("older version").count(), 2, "{}", compare.stdout);
    assert!(history.stdout.contains("complete, older version"), "{}", history.stdout);
    let said = with_results(directory.path(), |it| it["results"]["sm"]["aet_ms"] = json!(3000.0));
    insta::assert_snapshot!(said, @"runs/run/results.json: aet_ms of SM is 3000, its samples give 6482; restore the file, or run again");
    insta::assert_snapshot!(with_results(directory.path(), |it| it["setup"] = json!("B")), @"runs/run/results.json: `setup` is `B`, setup.toml has `A`; restore the file, or run again");
    insta::assert_snapshot!(with_results(directory.path(), |it| it["application"] = json!("gluing")), @"runs/run/results.json: `application` is `gluing`, application.toml has `pick-and-place`; restore the file, or run again");
    let said = with_file(directory.path(), "samples.csv", |text| text.replacen("cm,2,3722", "cm,2,3721", 1));
    insta::assert_snapshot!(said, @"runs/run/samples.csv: execution_ms of CM 2 is 3721, results.json has 3722; restore the file, or run again");
}

#[test]
fn a_run_that_was_killed_between_its_two_writes_is_read_as_far_as_its_results_go() {
    let directory = a_run();
    let run = directory.path().join("runs/run");
    let path = run.join("results.json");
    let complete = fs::read_to_string(&path).unwrap();
    let samples = fs::read_to_string(run.join("samples.csv")).unwrap();
    let mut results: bench::records::results::Results = serde_json::from_str(&complete).unwrap();
    results.status = bench::records::results::Status::Running;
    fs::write(&path, results.to_json().unwrap()).unwrap();
    let is_read = |samples: &str| {
        fs::write(run.join("samples.csv"), samples).unwrap();
        let finished = bench(directory.path(), ["report", "runs/run"]);
        assert!(matches!(finished.code, Some(0 | 4)), "{}", finished.stderr);
        finished.code == Some(0)
    };
    // The line of the next repetition is there, whole or in part, and its results are not.
    let next = "rc,3,3725.5,3716,0,0,0,\n";
    for cut in 1..=next.len() {
        assert!(is_read(&format!("{samples}{}", &next[..cut])), "{}", &next[..cut]);
    }
    assert!(!is_read(&format!("{samples}{next}sm,3,6480,6428,0,0,0,\n")), "two lines more are not one write");
    // The disk was full when the line was written, and took the results later.
    let last = samples.trim_end().rfind('\n').unwrap() + 1;
    assert!(is_read(&samples[..last]));
    let one_before = samples[..last - 1].rfind('\n').unwrap() + 1;
    assert!(!is_read(&samples[..one_before]), "two lines less are not one write");
    fs::write(&path, complete).unwrap();
    assert!(!is_read(&samples[..last]), "a complete run has all lines");
    assert!(is_read(&samples));
}
