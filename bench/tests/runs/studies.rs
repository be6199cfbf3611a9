//! The studies from the command line: their output, their files, and the input that they refuse.

use std::path::Path;

use bench::verbs::sensitivity::{Factor, Sensitivity};
use bench::verbs::sweep::Sweep;

use crate::program::{Finished, bench};

fn study(directory: &Path, arguments: &str) -> Finished {
    bench(directory, arguments.split(' '))
}

fn read(directory: &Path, name: &str) -> String {
    std::fs::read_to_string(directory.join(name)).unwrap()
}

#[test]
fn a_sweep_writes_a_page_a_table_and_the_points() {
    let place = tempfile::tempdir().unwrap();
    let finished = study(
        place.path(),
        "sweep --depths 2 --cycles 1,64 --lengths 2 --motions 8 --reps 1 --out study --export-csv points.csv",
    );
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(
        finished.stdout.contains("2 slots") && finished.stdout.contains("bus 64 ms"),
        "{}",
        finished.stdout
    );
    assert!(finished.stderr.starts_with("sweep "), "progress on stderr: {}", finished.stderr);
    let sweep: Sweep = serde_json::from_str(&read(place.path(), "study/sweep.json")).unwrap();
    assert_eq!(sweep.points.len(), 2);
    assert_eq!(read(place.path(), "points.csv"), read(place.path(), "study/sweep.csv"));
    let page = read(place.path(), "study/sweep.html");
    assert_eq!(page.matches("<svg").count(), 2, "in both widths");
    let page = page.replace("http://www.w3.org/2000/svg", "");
    assert!(!page.contains("http://") && !page.contains("<script"));
    assert!(place.path().join("study/setup.toml").exists());
}

#[test]
fn a_sweep_with_a_bus_cycle_that_the_bus_does_not_support_is_refused_before_it_runs() {
    let place = tempfile::tempdir().unwrap();
    let finished = study(place.path(), "sweep --cycles 1,3 --out study");
    assert_eq!(finished.code, Some(2));
    assert!(finished.stderr.contains("3000 µs is not a PROFINET cycle"), "{}", finished.stderr);
    assert!(!place.path().join("study").exists());
    assert_eq!(study(place.path(), "sweep --depths 6").code, Some(2));
}

#[test]
fn the_sensitivity_of_setup_a_agrees_with_the_model() {
    let place = tempfile::tempdir().unwrap();
    let finished = study(
        place.path(),
        "sensitivity --factors 0,0.5,2 --reps 1 --quiet --export-json figures.json --out study",
    );
    assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""));
    let study: Sensitivity = serde_json::from_str(&read(place.path(), "figures.json")).unwrap();
    let page = read(place.path(), "study/sensitivity.html");
    assert_eq!(page.matches("<svg").count(), 2, "in both widths");
    assert!(page.contains("moves that most") && page.contains("is refused: ") && !page.contains("<script"));
    let share = |factor, times| {
        let row = study.rows.iter().find(|row| (row.factor, row.times) == (factor, times)).unwrap();
        row.calibrated.aet_improvement
    };
    let as_it_is = share(None, 1.0).unwrap();
    let improvement = |factor, times| share(Some(factor), times).unwrap();
    assert!(improvement(Factor::Overhead, 0.0) < improvement(Factor::Overhead, 0.5));
    assert!(improvement(Factor::Overhead, 0.5) < as_it_is && as_it_is < improvement(Factor::Overhead, 2.0));
    assert!(improvement(Factor::Motions, 0.5) < as_it_is && as_it_is < improvement(Factor::Motions, 2.0));
    assert!(improvement(Factor::Approximation, 0.0) < as_it_is, "without blending CM stops as SM does");
    let base = study.rows.first().unwrap();
    assert_eq!(base.without_skill_overhead.aet_improvement, share(Some(Factor::Overhead), 0.0));
    assert!(base.uncalibrated.rc_ms < base.calibrated.rc_ms, "at rated speeds");
    // Twice the size is out of the arm's reach, and half of an acceleration of 0 is none: both rows tell so.
    let refused = |factor, times| {
        let row = study.rows.iter().find(|row| (row.factor, row.times) == (Some(factor), times)).unwrap();
        row.refused.clone().unwrap()
    };
    let told = finished.stdout.replace("\n ", "");
    assert!(told.contains(&refused(Factor::Length, 2.0)), "{}", finished.stdout);
    assert!(refused(Factor::Acceleration, 0.0).contains("motions.acceleration_percent"));
    assert_eq!(read(place.path(), "study/sensitivity.csv").lines().count(), 1 + study.rows.len());
}

#[test]
fn a_study_does_not_write_into_a_run() {
    let place = tempfile::tempdir().unwrap();
    std::fs::create_dir(place.path().join("run")).unwrap();
    std::fs::write(place.path().join("run/samples.csv"), "").unwrap();
    let finished = study(place.path(), "sensitivity --factors 1 --reps 1 --quiet --out run");
    assert!(
        finished.stderr.contains("run holds a run already; choose another directory by --out"),
        "{}",
        finished.stderr
    );
    assert_ne!(finished.code, Some(0));
}
