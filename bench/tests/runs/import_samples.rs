//! Runs of execution times that were read out of a PLC, beside runs of captures and of the bench.

use std::fs;

use crate::program::bench;

#[test]
fn an_imported_run_is_reported_compared_and_listed_as_one_and_has_no_simulated_figures() {
    let place = tempfile::tempdir().unwrap();
    let table =
        "type;repetition;sample_us\n1;0;3725000,5\n1;1;3726000\n2;0;6477000\n3;0;3729000\n3;1;3731000\n";
    fs::write(place.path().join("samples.csv"), table).unwrap();
    let all =
        ["import-samples", "samples.csv", "--setup", "A", "--plc", "S7-1517, V3.1", "--out", "runs/imported"];
    let finished = bench(place.path(), all);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let words = finished.stdout.split_whitespace().collect::<Vec<_>>().join(" ");
    let origin = "Imported from samples.csv, as the PLC measured it: PLC S7-1517, V3.1; robot not named.";
    assert!(words.contains(origin) && words.contains("3725.5") && !words.contains("h = 0"), "{words}");
    assert!(!words.contains("Cyclic frames") && !words.contains("calibrated"), "{words}");
    let run = ["--setup", "A", "--mode", "virtual", "--reps", "2", "--out", "runs/virtual", "-q"];
    assert_eq!(bench(place.path(), run).code, Some(0));
    let report = bench(place.path(), ["report", "runs/imported"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let html = fs::read_to_string(place.path().join("runs/imported/report.html")).unwrap();
    assert!(html.contains("S7-1517, V3.1") && html.contains("· imported ·"));
    let compared = bench(place.path(), ["compare", "runs/virtual", "runs/imported"]);
    assert_eq!(compared.code, Some(0), "{}", compared.stderr);
    assert!(compared.stdout.contains("imported"), "{}", compared.stdout);
    let listed = bench(place.path(), ["history", "runs"]);
    assert_eq!(listed.code, Some(0), "{}", listed.stderr);
    assert!(listed.stdout.contains("imported") && listed.stdout.contains("virtual"), "{}", listed.stdout);
}

#[test]
fn samples_with_a_gap_are_refused_and_nothing_is_written() {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("gap.csv"), "type,repetition,sample_us\nsm,1,6477000\nsm,3,6478000\n")
        .unwrap();
    let finished = bench(place.path(), ["import-samples", "gap.csv", "--setup", "A", "--out", "run"]);
    assert_eq!(finished.code, Some(2));
    assert_eq!(
        finished.stderr,
        "error: gap.csv: SM has repetitions up to 3, but not 2: read the samples out again, or number them anew\n"
    );
    assert!(!place.path().join("run").exists());
}

#[test]
fn times_in_another_unit_than_their_column_says_are_refused_with_the_column_that_fits() {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("ms.csv"), "type,repetition,sample_us\nrc,1,3725\nrc,2,3726\n").unwrap();
    let import = ["import-samples", "ms.csv", "--setup", "A", "--out", "run"];
    let finished = bench(place.path(), import);
    assert_eq!(finished.code, Some(2));
    let reason = "error: ms.csv: RC sample 1 is 3.725 ms by the column sample_us, and 3720 ms in a virtual run of this setup: if its column has another unit, name it sample_ms; --any-times takes the times as they are\n";
    assert_eq!(finished.stderr, reason);
    assert!(!place.path().join("run").exists());
    let taken = bench(place.path(), [&import[..], &["--any-times"]].concat());
    assert_eq!(taken.code, Some(0), "{}", taken.stderr);
    fs::write(place.path().join("ms.csv"), "type,repetition,sample_ms\nrc,1,3725\nrc,2,3726.5\n").unwrap();
    let finished = bench(place.path(), ["import-samples", "ms.csv", "--setup", "A", "--out", "other"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(finished.stdout.contains("3725.8"), "{}", finished.stdout);
}
