//! `bench study report`: what it writes, that it depends on the rows alone, and studies that go on by their saved jobs.

use std::fs;
use std::path::Path;

use crate::program::{Finished, bench};

/// The speed is known to a few per cent by CM's execution time.
const SPEED: &str = "[study]
setup = \"A\"
types = [\"cm\"]
reps = 25
seeds = \"1..=23\"

[[vary]]
key = \"motions.velocity_percent\"
uniform = { min = 15.0, max = 35.0 }
";

fn run(directory: &Path, arguments: &str) -> Finished {
    bench(directory, arguments.split(' ').collect::<Vec<_>>())
}

fn report(directory: &Path, name: &str) -> serde_json::Value {
    let finished = run(directory, &format!("study report {name}"));
    assert_eq!(finished.code, Some(0), "{}{}", finished.stdout, finished.stderr);
    assert!(fs::read_to_string(directory.join(name).join("report.html")).unwrap().contains("<svg"));
    serde_json::from_str(&fs::read_to_string(directory.join(name).join("report.json")).unwrap()).unwrap()
}

#[test]
fn the_report_of_shards_is_that_of_their_merge_and_finds_the_speed() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    fs::write(place.join("study.toml"), SPEED).unwrap();
    for index in 0..2 {
        let ran = run(place, &format!("study run study.toml --out parts/{index} --shard {index}/2 --quiet"));
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    }
    assert_eq!(run(place, "study merge parts --out whole").code, Some(0));
    let (parts, whole) = (report(place, "parts"), report(place, "whole"));
    assert_eq!(parts, whole);
    let identified = &whole["identification"]["variants"][0];
    assert_eq!(identified["posterior"][0]["knowledge"], "identified", "{identified}");
    let speed = identified["posterior"][0]["mean"].as_f64().unwrap();
    // Calibrated: 23.3 %.
    assert!((22.0..25.0).contains(&speed), "{speed}");
    assert_eq!(identified["predicted"].as_array().unwrap().len(), 2, "AET and MAD");
    let slope = whole["effects"][0]["figures"][0]["slope"]["over_range"]["value"].as_f64().unwrap();
    assert!(slope < -300.0, "faster is sooner: {slope}");
    let nothing = run(place, "study report .");
    assert_eq!(nothing.code, Some(2));
    assert!(nothing.stderr.contains("no study here"), "{}", nothing.stderr);
}

#[test]
fn a_varied_application_is_found_beside_the_study_and_its_jobs_are_executed_again_without_it() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    let text = "[study]\nsetup = \"A\"\ntypes = [\"cm\"]\nreps = 1\n[[vary]]\nkey = \"application\"\nvalues = [\"mine.toml\"]\n";
    fs::create_dir(place.join("file")).unwrap();
    fs::write(place.join("file/study.toml"), text).unwrap();
    let application = include_str!("../../studies/examples/pick-and-place-joined.toml");
    fs::write(place.join("file/mine.toml"), application).unwrap();
    let ran = run(place, "study run file/study.toml --out rows --quiet");
    assert_eq!(ran.code, Some(0), "{}{}", ran.stdout, ran.stderr);
    fs::remove_file(place.join("file/mine.toml")).unwrap();
    let jobs = fs::read_to_string(place.join("rows/jobs.csv")).unwrap();
    let job = jobs.lines().nth(1).unwrap().split(',').next().unwrap().to_owned();
    let again = run(place, &format!("study rerun rows {job}"));
    assert_eq!(again.code, Some(0), "{}", again.stderr);
}

#[test]
fn an_interrupted_sweep_goes_on_with_the_jobs_that_it_saved() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    let small = "sweep --depths 1,5 --cycles 1,8 --lengths 5 --reps 1 --motions 6 --quiet --out";
    let whole = run(place, &format!("{small} whole"));
    assert_eq!(whole.code, Some(0), "{}", whole.stderr);
    // As after a kill: four of six jobs, and a part of the next.
    fs::create_dir(place.join("killed")).unwrap();
    let first = |name: &str, lines: usize, more: &str| {
        let text = fs::read_to_string(place.join("whole").join(name)).unwrap();
        let kept: Vec<&str> = text.split_inclusive('\n').take(lines).collect();
        fs::write(place.join("killed").join(name), kept.concat() + more).unwrap();
    };
    first("study.json", usize::MAX, "");
    first("rows.csv", 5, "0123456789abcdef,1,cm");
    first("jobs.csv", 5, "");
    assert_eq!(run(place, &format!("{small} killed")).code, Some(0));
    let read = |name: &str| fs::read_to_string(place.join(name)).unwrap();
    assert_eq!(read("killed/sweep.json"), read("whole/sweep.json"));
    let sorted = |text: String| {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        lines.sort();
        lines
    };
    assert_eq!(sorted(read("killed/rows.csv")), sorted(read("whole/rows.csv")));
    // Other options do not mix their rows with these.
    let other = run(place, &format!("{small} killed").replace("--reps 1", "--reps 2"));
    assert_eq!(other.code, Some(2));
    assert!(other.stderr.contains("rows of another study"), "{}", other.stderr);
}
