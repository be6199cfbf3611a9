//! A calibration from the command line: what it prints, what it writes into a setup's file, and what it refuses.

use std::path::Path;

use crate::program::{Finished, bench};

fn calibrate(directory: &Path, arguments: &str) -> Finished {
    bench(directory, ["calibrate"].into_iter().chain(arguments.split(' ')))
}

fn shipped(name: &str) -> &'static str {
    setup::SETUPS.iter().find(|(known, _)| *known == name).unwrap().1
}

#[test]
fn the_numbers_go_into_the_setups_file_and_everything_else_in_it_stays() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("mine.toml");
    // A programmed speed far off, a call that costs much less, and a quantum that a datasheet gives.
    let number = |line: &str, value: &str, from: &str| {
        let key = line.split_once(" = ").map_or(line, |(key, _)| key);
        format!("{key} = {{ value = {value}, from = \"{from}\", note = \"of the test\" }}")
    };
    let text: Vec<_> = shipped("A")
        .lines()
        .map(|line| match line.split_once(" = ").map(|(key, _)| key) {
            Some("velocity_percent") => number(line, "60.0", "calibrated"),
            Some("skill_overhead_us") => number(line, "20000", "calibrated"),
            Some("interpreter_quantum_us") => number(line, "12000", "datasheet"),
            _ => line.to_owned(),
        })
        .collect();
    let text = text.join("\n") + "\n";
    std::fs::write(&file, &text).unwrap();
    let finished = calibrate(place.path(), "--setup mine.toml --seeds 3 --reps 4 --write");
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let written = std::fs::read_to_string(&file).unwrap();
    let key = |line: &str| line.split_once(" = ").map_or_else(|| line.to_owned(), |(key, _)| key.to_owned());
    let changed: Vec<_> = text.lines().zip(written.lines()).filter(|(old, new)| old != new).collect();
    assert_eq!(written.lines().count(), text.lines().count());
    for (old, new) in &changed {
        assert_eq!(key(old), key(new));
        assert!(new.contains("from = \"calibrated\", note = \"`bench calibrate` on "), "{new}");
        assert!(finished.stdout.contains(new), "what is printed is what is written: {new}");
    }
    let keys: Vec<_> = changed.iter().map(|(old, _)| key(old)).collect();
    assert!(
        keys.iter().any(|key| key == "velocity_percent") && keys.iter().any(|key| key == "skill_overhead_us")
    );
    // What a datasheet gives stays, and the figures' opinion is printed.
    assert!(!keys.iter().any(|key| key == "interpreter_quantum_us"), "{keys:?}");
    assert!(
        finished.stdout.contains("# interpreter_quantum_us = 12000 is from \"datasheet\" and stays"),
        "{}",
        finished.stdout
    );
    let setup = setup::setup(file.to_str().unwrap()).unwrap();
    assert!(
        (15.0..45.0).contains(&setup.motions.velocity_percent.value),
        "{:?}",
        setup.motions.velocity_percent
    );
    assert!(
        (120_000..180_000).contains(&setup.robot.skill_overhead_us.value),
        "{:?}",
        setup.robot.skill_overhead_us
    );
    let line = |name: &str| finished.stdout.lines().find(|line| line.contains(name)).unwrap_or_default();
    assert!(line("# SM AET").contains("paper 6477.0 ± 2.9"), "{}", finished.stdout);
    assert!(line("# RC's AET changes by −").contains("1 % more velocity_percent"), "{}", finished.stdout);
}

#[test]
fn a_built_in_setup_is_not_written_and_one_without_figures_is_not_calibrated() {
    let place = tempfile::tempdir().unwrap();
    let finished = calibrate(place.path(), "--setup A --write");
    assert_eq!((finished.code, finished.stdout.as_str()), (Some(2), ""));
    insta::assert_snapshot!(finished.stderr, @"error: --write changes a setup's file, and A is built in: name its file by --setup");
    let figures = shipped("A").find("[paper]").unwrap();
    let plc = shipped("A").find("[plc]").unwrap();
    let without = format!("{}{}", &shipped("A")[..figures], &shipped("A")[plc..]);
    std::fs::write(place.path().join("mine.toml"), without).unwrap();
    let finished = calibrate(place.path(), "--setup mine.toml");
    insta::assert_snapshot!(finished.stderr, @"error: setup A has no section [paper], and calibration needs its figures: give rc, sm and cm there, or calibrate a setup that has them, such as A");
    assert_eq!(finished.code, Some(2));
}
