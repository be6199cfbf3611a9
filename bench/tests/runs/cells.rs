//! Runs of cells with several stations.

use std::fs;

use crate::program::bench;

fn run(directory: &std::path::Path, setup: &str, out: &str, more: &[&str]) -> crate::program::Finished {
    let arguments = ["--setup", setup, "--mode", "virtual", "--reps", "2", "--out", out];
    bench(directory, arguments.iter().chain(more))
}

#[test]
fn a_cell_of_two_arms_runs_in_every_type_and_gives_the_same_bytes_with_the_same_seed() {
    let directory = tempfile::tempdir().unwrap();
    for setup in ["E", "F"] {
        let read = |out: &str, more: &[&str]| {
            let finished = run(directory.path(), setup, out, more);
            assert_eq!(finished.code, Some(0), "{setup}: {}{}", finished.stdout, finished.stderr);
            ["results.json", "samples.csv"]
                .map(|file| fs::read(directory.path().join(out).join(file)).unwrap())
        };
        let first = read(&format!("{setup}-1"), &[]);
        assert_eq!(first, read(&format!("{setup}-2"), &[]), "{setup}");
        assert_ne!(first, read(&format!("{setup}-3"), &["--seed", "2"]), "{setup}");
        let results: serde_json::Value = serde_json::from_slice(&first[0]).unwrap();
        assert_eq!(results["schema_version"], 2);
        assert_eq!(results["status"], "complete");
        for kind in ["rc", "sm", "cm"] {
            let result = &results["results"][kind];
            assert_eq!(result["samples_ms"].as_array().unwrap().len(), 2, "{setup} {kind}");
            let marks = result["marks"].as_array().unwrap();
            assert!(
                marks.iter().all(|mark| mark["skew_us"].as_array().unwrap().len() == 2),
                "{setup} {kind}"
            );
            let waited = |station: usize| result["stations"][station]["waiting_ms"][0].as_f64().unwrap();
            // One of the arms comes to each mark first.
            assert!(waited(0) + waited(1) > 0.0, "{setup} {kind}");
        }
    }
}

#[test]
fn what_cells_do_not_have_yet_is_refused_by_its_name() {
    let directory = tempfile::tempdir().unwrap();
    for (more, named) in [
        (&["--trace"] as &[&str], "--trace is for setups of one station"),
        (&["--override", "50"], "--override is for"),
        (&["--fault", "loss=0.1"], "--fault is for"),
        (&["--capture", "always"], "--capture is for"),
        (&["--cyclic", "udp"], "--cyclic is for"),
        (&["--export-csv", "x.csv"], "--export-csv is for"),
    ] {
        let finished = run(directory.path(), "E", "refused", more);
        assert_eq!(finished.code, Some(2), "{more:?}: {}", finished.stderr);
        assert!(finished.stderr.contains(named), "{}", finished.stderr);
        assert!(!directory.path().join("refused").exists());
    }
    let real = bench(directory.path(), ["--setup", "E", "--reps", "1"]);
    assert_eq!(real.code, Some(2));
    assert!(real.stderr.contains("add `--mode virtual`"), "{}", real.stderr);
}

#[test]
fn verbs_that_read_runs_of_one_robot_refuse_the_run_of_a_cell() {
    let directory = tempfile::tempdir().unwrap();
    assert_eq!(run(directory.path(), "E", "cell", &["--types", "rc"]).code, Some(0));
    for verb in [&["report", "cell"] as &[&str], &["compare", "cell", "cell"], &["gate", "--run", "cell"]] {
        let finished = bench(directory.path(), verb);
        assert_eq!(finished.code, Some(2), "{verb:?}: {}{}", finished.stdout, finished.stderr);
        assert!(finished.stderr.contains("several stations"), "{verb:?}: {}", finished.stderr);
    }
}
