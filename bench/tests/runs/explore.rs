//! `bench explore`: every run with a fault ends as without it, later, or with a reason, and can be run again.

use std::fs;
use std::path::Path;
use std::process::Command;

use setup::Refill;

fn bench(place: &Path, args: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_bench")).args(args).current_dir(place).output().unwrap();
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
    (output.status.code(), text)
}

/// Runs an exploration into the directory `out` of this place.
fn explore(place: &Path, options: &str) -> (Option<i32>, String) {
    let out = if options.contains("--out") { &[][..] } else { &["--out", "out"] };
    let args: Vec<_> = ["explore", "--quiet"].iter().chain(out).copied().chain(options.split(' ')).collect();
    bench(place, &args)
}

/// Returns the command that the first reason with these words is told with, as arguments.
fn command<'a>(said: &'a str, words: &str) -> Vec<&'a str> {
    let mut lines = said.lines().skip_while(|line| !line.contains(words));
    lines.nth(1).unwrap().split_whitespace().skip(1).collect()
}

/// Explores CM with every kind of fault, and checks that each run ends as it may.
fn explored_well(place: &Path, options: &str) -> String {
    let (code, said) = explore(place, options);
    assert_eq!(code, Some(0), "{said}");
    let rows: Vec<Vec<&str>> = said
        .lines()
        .filter(|line| line.trim_start().starts_with("CM "))
        .map(|line| line.split_whitespace().collect())
        .collect();
    assert_eq!(rows.len(), 9, "{said}");
    for row in rows {
        assert_eq!(row[row.len() - 4..], ["0"; 4], "too late, stuck, altered, panicked: {said}");
    }
    assert!(said.contains("0 ended otherwise"), "{said}");
    said
}

/// Writes the files of a setup whose PLC sends compact points, and of a circle of sixty.
fn write_compact(place: &Path, name: &str) {
    let setup = setup::setup(name).unwrap().with_queue_motions(64).with_refill(Refill::Accepted);
    fs::write(place.join("compact.toml"), setup::setup_to_toml(&setup.with_form_compact()).unwrap()).unwrap();
    let circle = include_str!("../../../cell/planning/tests/circle.toml");
    fs::write(place.join("circle.toml"), circle).unwrap();
}

#[test]
fn no_single_fault_alters_a_run_of_compact_points_on_any_bus() {
    for name in ["A", "B", "C"] {
        let place = tempfile::tempdir().unwrap();
        write_compact(place.path(), name);
        let options = "--setup compact.toml --application circle.toml --types cm --every 397";
        let said = explored_well(place.path(), options);
        let again = command(&said, "refused: ");
        let (code, of_run) = bench(place.path(), &again);
        assert_eq!(code, Some(4), "{again:?}: {of_run}");
    }
}

/// Writes the files of Setup F with two arms on circles of sixty points, whose PLC sends compact points.
fn write_compact_cell(place: &Path) {
    let (mut cell, _) = setup::cell("F").unwrap();
    cell.application = Some("circles.toml".to_owned());
    for station in &mut cell.stations {
        station.application = format!("{}-circle", station.name);
    }
    let cell = cell.with_each_station(|setup| {
        setup.with_queue_motions(64).with_refill(Refill::Accepted).with_form_compact()
    });
    fs::write(place.join("cell.toml"), setup::cell_to_toml(&cell).unwrap()).unwrap();
    let circles = include_str!("../../../cell/planning/tests/two-circles.toml");
    fs::write(place.join("circles.toml"), circles).unwrap();
}

#[test]
fn no_single_fault_alters_a_run_of_two_arms_that_get_compact_points() {
    let place = tempfile::tempdir().unwrap();
    write_compact_cell(place.path());
    let (code, said) = explore(place.path(), "--setup cell.toml --types cm --every 997");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("0 ended otherwise"), "{said}");
    let (code, said) = bench(place.path(), &["soak", "--setup", "cell.toml", "--hours", "0.02", "--quiet"]);
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn no_single_fault_of_any_kind_lets_an_altered_run_pass_or_keeps_the_next_one_from_passing_on_any_bus() {
    for setup in ["A", "B", "C"] {
        let place = tempfile::tempdir().unwrap();
        let said = explored_well(place.path(), &format!("--setup {setup} --types cm --every 197"));
        let sentence: Vec<_> = said.lines().skip_while(|line| !line.starts_with("Of ")).collect();
        assert!(sentence.iter().take(2).all(|line| line.chars().count() <= 100), "{said}");
        let page = fs::read_to_string(place.path().join("out/explore.html")).unwrap();
        assert!(page.contains("to PLC, robot restarts") && page.contains("--fault to-robot:restart-robot="));
    }
}

#[test]
fn an_exploration_that_was_interrupted_goes_on_and_says_the_same_in_the_end() {
    let place = tempfile::tempdir().unwrap();
    let options = "--types rc --every 150 --kinds lose,restart-plc";
    let (_, whole) = explore(place.path(), options);
    let outcomes = place.path().join("out/outcomes.csv");
    let all = fs::read_to_string(&outcomes).unwrap();
    let cut = all.len() / 2;
    fs::write(&outcomes, &all[..cut]).unwrap();
    assert_eq!(explore(place.path(), options), (Some(0), whole));
    assert_eq!(fs::read_to_string(&outcomes).unwrap(), all);
    let one = explore(place.path(), &format!("{options} --threads 1 --out one"));
    assert_eq!(fs::read_to_string(place.path().join("one/outcomes.csv")).unwrap(), all, "{one:?}");
    let (code, said) = explore(place.path(), "--types rc --every 150 --kinds lose");
    assert!(code != Some(0) && said.contains("out: has jobs of other options; use another --out"), "{said}");
}

#[test]
fn a_run_that_ends_too_late_fails_the_exploration_and_is_shrunk_to_the_one_fault_that_does_it() {
    let place = tempfile::tempdir().unwrap();
    let options = "--types rc --pairs 24 --kinds double,restart-plc --late-ms 0 --seed 1";
    let (code, said) = explore(place.path(), options);
    assert_eq!(code, Some(4), "{said}");
    let command = command(&said, "too late: the run ended too late");
    assert_eq!(command.iter().filter(|word| **word == "--fault").count(), 1, "{said}");
    assert!(command.last().unwrap().contains(":restart-plc="), "{said}");
}

#[test]
fn the_command_of_a_refused_run_is_refused_for_the_same_reason() {
    let place = tempfile::tempdir().unwrap();
    let (_, said) = explore(place.path(), "--types sm --every 900 --kinds restart-robot");
    let (code, again) =
        bench(place.path(), &[&command(&said, "refused: sm failed")[..], &["--quiet"]].concat());
    assert_eq!(code, Some(4), "{again}");
    assert!(again.contains("no frame came from the robot for 500 scans"), "{again}");
}

#[test]
fn the_first_frame_of_a_connection_that_is_lost_is_sent_again_and_the_fault_can_be_asked_for() {
    let place = tempfile::tempdir().unwrap();
    let run = ["--mode", "virtual", "--types", "cm", "--reps", "1", "--fault"];
    let (code, said) = bench(place.path(), &[&run[..], &["to-robot:lose-frame=1"]].concat());
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("Faults put in (to-robot:lose-frame=1): 1 frames lost, 0 twice"), "{said}");
    let (code, said) = bench(place.path(), &["--mode", "virtual", "--fault", "lose-frame=1"]);
    assert_eq!(code, Some(2), "{said}");
}

#[test]
fn the_setup_of_an_exploration_of_any_application_runs_again_from_where_it_is() {
    let place = tempfile::tempdir().unwrap();
    let short = include_str!("../../studies/src/explore/short.toml");
    fs::create_dir(place.path().join("tasks")).unwrap();
    fs::write(place.path().join("tasks/mine.toml"), short.replace("\"short\"", "\"mine\"")).unwrap();
    for application in ["tasks/mine.toml", "pick-and-place-gripper"] {
        let out = application.replace(['/', '.'], "-");
        let options = ["--application", application, "--types", "rc", "--every", "2000", "--kinds", "lose"];
        let explore = [&["explore", "--quiet", "--out", &out], &options[..]].concat();
        let (code, said) = bench(place.path(), &explore);
        assert_eq!(code, Some(0), "{said}");
        let setup = format!("{out}/setup.toml");
        let run = ["--setup", &setup, "--mode", "virtual", "--types", "rc", "--reps", "1"];
        let (code, said) = bench(place.path(), &run);
        assert_eq!(code, Some(0), "{said}");
        let name = application.trim_start_matches("tasks/").trim_end_matches(".toml");
        assert!(said.contains(name), "{said}");
        let (code, again) = bench(place.path(), &explore);
        assert_eq!(code, Some(0), "it goes on: {again}");
    }
}

#[test]
fn no_single_fault_at_any_station_of_a_cell_breaks_its_laws_or_lets_an_altered_run_pass() {
    for (setup, stations) in [("E", ["left", "right"]), ("F", ["left", "right"]), ("G", ["left", "right"])] {
        let place = tempfile::tempdir().unwrap();
        let (code, said) = explore(place.path(), &format!("--setup {setup} --types cm --every 3001"));
        assert_eq!(code, Some(0), "{setup}: {said}");
        for station in stations {
            let rows: Vec<Vec<&str>> = said
                .lines()
                .filter(|line| line.trim_start().starts_with("CM ") && line.contains(&format!("{station}: ")))
                .map(|line| line.split_whitespace().collect())
                .collect();
            assert_eq!(rows.len(), 9, "{setup}: {said}");
            for row in rows {
                let zeros = ["0"; 5];
                assert_eq!(
                    row[row.len() - 5..],
                    zeros,
                    "too late, stuck, altered, law broken, panicked: {said}"
                );
            }
        }
        let page = fs::read_to_string(place.path().join("out/explore.html")).unwrap();
        for part in ["left to PLC, robot restarts", "restart-robot=", "bench --setup"] {
            assert!(page.contains(part), "{setup}: {part}");
        }
    }
}

#[test]
fn the_command_of_a_refused_run_of_a_cell_is_refused_for_the_same_reason_and_an_exploration_of_one_goes_on() {
    let place = tempfile::tempdir().unwrap();
    let options = "--setup E --types sm --every 4001 --kinds restart-robot,restart-plc";
    let (code, said) = explore(place.path(), options);
    assert_eq!(code, Some(0), "{said}");
    for words in ["station left: sm failed", "station right: sm failed"] {
        let (code, again) = bench(place.path(), &[&command(&said, words)[..], &["--quiet"]].concat());
        assert_eq!(code, Some(4), "{again}");
        assert!(again.contains(words), "{again}");
    }
    let outcomes = place.path().join("out/outcomes.csv");
    let all = fs::read_to_string(&outcomes).unwrap();
    fs::write(&outcomes, &all[..all.len() / 2]).unwrap();
    assert_eq!(explore(place.path(), options), (Some(0), said));
    assert_eq!(fs::read_to_string(&outcomes).unwrap(), all);
}
