//! The gate: it passes on the unchanged program, fails for a millisecond, and explains a baseline that does not fit
//! the run.

use std::path::Path;

use bench::verbs::gate::{Baseline, judge};
use planning::Application;
use plc_node::ExecutionType;
use records::schedule::Schedule;
use setup::Setup;
use stands::virtual_run::whole;

use crate::program::{Finished, bench};

fn setup_a() -> (Setup, Application) {
    let (setup, found) = planning::setup_with_application("A").unwrap();
    (setup, found.application)
}

/// Returns the baseline of the unchanged program; with fewer repetitions than the committed one.
fn baseline(setup: &Setup, application: &Application) -> Baseline {
    let results = whole(setup, application, &Schedule::new(&ExecutionType::ALL, 5, 1)).unwrap();
    Baseline::of(&results, None)
}

fn gate(directory: &Path, arguments: &[&str]) -> Finished {
    bench(directory, ["gate"].iter().chain(arguments))
}

#[test]
fn a_run_of_the_same_program_passes_to_the_microsecond() {
    let (setup, application) = setup_a();
    let baseline = baseline(&setup, &application);
    let verdict = judge(&setup, &application, &baseline).unwrap();
    assert!(verdict.is_pass());
    assert!(verdict.changes.iter().all(|change| change.difference() == Some(0.0)));
}

#[test]
fn a_millisecond_more_in_the_plcs_scan_fails_and_sm_pays_it_in_every_call() {
    let (mut setup, application) = setup_a();
    let baseline = baseline(&setup, &application);
    setup.plc.scan_cost_us.value += 1_000;
    let verdict = judge(&setup, &application, &baseline).unwrap();
    assert!(!verdict.is_pass());
    let sm = verdict
        .changes
        .iter()
        .find(|change| change.expected.as_ref().is_some_and(|expected| expected.figure == "SM AET"));
    let by = sm.unwrap().difference().unwrap();
    // One for each of 13 skill calls on average; the robot's cycle rounds each up or down.
    assert!(by > 5.0, "{by} ms");
}

#[test]
fn the_committed_baseline_of_each_setup_holds() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    for (name, _) in bench::verbs::gate::BASELINES {
        let finished = gate(root, &["--setup", name]);
        assert_eq!(finished.code, Some(0), "{}{}", finished.stdout, finished.stderr);
    }
}

#[test]
fn a_slower_plc_gives_exit_code_3_and_the_update_accepts_it() {
    let directory = tempfile::tempdir().unwrap();
    let setup = setup::SETUPS.iter().find(|(name, _)| *name == "A").unwrap().1;
    std::fs::write(directory.path().join("A.toml"), setup).unwrap();
    let options = ["--setup", "A.toml", "--baseline", "mine.json"];
    let update = ["--setup", "A.toml", "--baseline", "mine.json", "--update"];

    let none = gate(directory.path(), &options);
    assert_eq!(none.code, Some(2));
    insta::assert_snapshot!(none.stderr, @"error: there is no baseline mine.json for setup A; make one by --update, or name another by --baseline");

    let made = gate(directory.path(), &update);
    assert_eq!(made.code, Some(0), "{}", made.stderr);
    assert!(made.stdout.contains("+ SM AET"), "{}", made.stdout);
    let green = gate(directory.path(), &options);
    assert_eq!(green.code, Some(0), "{}", green.stdout);

    // Twice the scan cycle and a millisecond more scan time, as a slower PLC has.
    let slower = setup
        .replace("scan_cycle_us = { value = 1000", "scan_cycle_us = { value = 2000")
        .replace("scan_cost_us = { value = 150", "scan_cost_us = { value = 1150");
    assert_ne!(slower, setup);
    std::fs::write(directory.path().join("A.toml"), slower).unwrap();
    let red = gate(directory.path(), &options);
    assert_eq!(red.code, Some(3), "{}", red.stderr);
    assert!(red.stdout.contains("Fail: ") && red.stdout.contains("SM AET: "), "{}", red.stdout);

    let mut tolerant: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(directory.path().join("mine.json")).unwrap()).unwrap();
    tolerant["figures"][0]["tolerance"] = 7.0.into();
    std::fs::write(directory.path().join("mine.json"), tolerant.to_string()).unwrap();
    let taken = gate(directory.path(), &update);
    assert!(taken.stdout.contains("- SM AET") && taken.stdout.contains("+ SM AET"), "{}", taken.stdout);
    assert!(taken.stdout.contains("± 7 ms"), "a tolerance outlives an update: {}", taken.stdout);
    assert_eq!(gate(directory.path(), &options).code, Some(0));
}

#[test]
fn a_baseline_of_another_setup_or_version_and_a_broken_one_are_refused_and_kept() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("b.json");
    let (setup, application) = setup_a();
    let good = baseline(&setup, &application);
    let refused = |text: &str, update: &[&str]| {
        std::fs::write(&path, text).unwrap();
        let finished = gate(directory.path(), &[&["--baseline", "b.json"], update].concat());
        assert_eq!((finished.code, finished.stdout.as_str()), (Some(2), ""), "{}", finished.stderr);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        finished.stderr
    };
    let other = Baseline { setup: "B".to_owned(), ..good.clone() }.to_json().unwrap();
    for update in [&[][..], &["--update"]] {
        insta::allow_duplicates! {
            insta::assert_snapshot!(refused(&other, update), @"error: cannot use b.json: it is the baseline of setup B with pick-and-place, and setup A with pick-and-place was to be run; name the one of A with pick-and-place by --baseline, or leave the option out");
        }
    }
    let older = good.to_json().unwrap().replace("\"schema_version\": 1", "\"schema_version\": 0");
    insta::assert_snapshot!(refused(&older, &[]), @"error: cannot use b.json: it has schema version 0, and this program reads 1; move it away and make a new one by --update");
    insta::assert_snapshot!(refused("{}", &[]), @"error: cannot use b.json: it is not a baseline: missing field `schema_version` at line 1 column 2; make a new one by --update after moving this file away");
    let senseless = good.to_json().unwrap().replace("\"tolerance\": 0.5", "\"tolerance\": -0.5");
    insta::assert_snapshot!(refused(&senseless, &[]), @"error: cannot use b.json: the value and the tolerance of its figure `RC AET` must be numbers from zero up; correct it by hand");
}

#[test]
fn the_error_for_an_update_that_cannot_be_written_says_where_to_run_it() {
    let directory = tempfile::tempdir().unwrap();
    let finished = gate(directory.path(), &["--update"]);
    assert_eq!((finished.code, finished.stdout.as_str()), (Some(1), ""));
    insta::assert_snapshot!(finished.stderr, @"error: no baseline was changed; run this from the repository's root, or name a file that can be written by --baseline: cannot write bench/baselines/A.json: No such file or directory (os error 2)");
}

#[test]
fn an_export_of_a_cell_replaces_none_of_its_applications() {
    let place = tempfile::tempdir().unwrap();
    let place = place.path();
    let application = include_str!("../../../cell/applications/carry-plate.toml");
    let setup = include_str!("../../../cell/setups/F.toml");
    std::fs::write(place.join("cell.toml"), setup.replacen("\"carry-plate\"", "\"task.toml\"", 1)).unwrap();
    std::fs::write(place.join("task.toml"), application).unwrap();
    for option in ["--export-json", "--export-csv"] {
        let refused = gate(place, &["--setup", "cell.toml", option, "task.toml"]);
        assert_eq!(refused.code, Some(2), "{}", refused.stdout);
        let said = format!("{option} would replace task.toml, the application");
        assert!(refused.stderr.contains(&said), "{}", refused.stderr);
    }
    assert_eq!(std::fs::read_to_string(place.join("task.toml")).unwrap(), application);
}

/// Measures a cell of several stations in virtual time, and lets its results say that it was a real run.
fn as_real_run(place: &Path, setup: &str, run: &str) {
    let options = ["--mode", "virtual", "--reps", "5", "--without", "report,race,traces", "--quiet"];
    let measured = bench(place, ["--setup", setup, "--out", run].iter().chain(&options));
    assert_eq!(measured.code, Some(0), "{}", measured.stderr);
    let path = place.join(run).join("results.json");
    let mut results: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    results["mode"] = "real".into();
    // As an older version writes it: without the digest of the mode.
    results.as_object_mut().unwrap().remove("digests");
    std::fs::write(path, results.to_string()).unwrap();
}

#[test]
fn the_ratios_of_a_real_run_of_several_stations_are_those_of_the_whole_cell() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path();
    for setup in ["E", "F", "G"] {
        as_real_run(place, setup, setup);
        let passed = gate(place, &["--run", setup]);
        assert_eq!(passed.code, Some(0), "{setup}: {}{}", passed.stdout, passed.stderr);
        assert!(passed.stdout.contains("CM / RC") && passed.stdout.contains("SM / RC"), "{}", passed.stdout);
    }
    // A robot that takes 100 ms longer for each call of a skill, which CM makes once and SM for each motion.
    let slower = include_str!("../../../cell/setups/E.toml");
    let (head, left) = slower.split_once("skill_overhead_us = { value = ").unwrap();
    let (value, tail) = left.split_once(',').unwrap();
    let value = value.replace('_', "").parse::<u32>().unwrap() + 100_000;
    std::fs::write(place.join("slower.toml"), format!("{head}skill_overhead_us = {{ value = {value},{tail}"))
        .unwrap();
    as_real_run(place, "slower.toml", "slower");
    let failed = gate(place, &["--run", "slower", "--export-csv", "ratios.csv"]);
    assert_eq!(failed.code, Some(3), "{}{}", failed.stdout, failed.stderr);
    assert!(failed.stdout.contains("SLOWER") && failed.stdout.contains("Fail: "), "{}", failed.stdout);
    let ratios = std::fs::read_to_string(place.join("ratios.csv")).unwrap();
    assert!(ratios.lines().any(|line| line.starts_with("SM / RC,") && line.ends_with(",beyond")), "{ratios}");
}

#[test]
fn a_baseline_of_a_cell_is_found_by_the_name_of_its_application_and_not_by_its_path() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path();
    let setup = include_str!("../../../cell/setups/F.toml");
    std::fs::write(place.join("cell.toml"), setup.replacen("\"carry-plate\"", "\"task.toml\"", 1)).unwrap();
    std::fs::write(place.join("task.toml"), include_str!("../../../cell/applications/carry-plate.toml"))
        .unwrap();
    // Each arm does its own work, without marks, and far from the other one.
    let own = setup.replacen("application = \"carry-plate\"\n", "", 1);
    let own = own.replacen("root_mm_deg = { value = [1200.0", "root_mm_deg = { value = [5000.0", 1);
    let mut applications = ["gluing", "gluing"].into_iter();
    let own: Vec<String> = own
        .lines()
        .map(|line| match line.strip_prefix("application = ") {
            Some(_) => format!("application = \"{}\"", applications.next().unwrap()),
            None => line.to_owned(),
        })
        .collect();
    std::fs::write(place.join("own.toml"), own.join("\n")).unwrap();
    for (setup, application) in [("cell.toml", "carry-plate"), ("own.toml", "gluing, gluing")] {
        let baseline = format!("{setup}.json");
        let made = gate(place, &["--setup", setup, "--baseline", &baseline, "--update"]);
        assert_eq!(made.code, Some(0), "{setup}: {}", made.stderr);
        let saved = Baseline::parse(&std::fs::read_to_string(place.join(&baseline)).unwrap()).unwrap();
        assert_eq!(saved.application, application);
        as_real_run(place, setup, "run");
        let passed = gate(place, &["--run", "run", "--baseline", &baseline]);
        assert_eq!(passed.code, Some(0), "{setup}: {}{}", passed.stdout, passed.stderr);
        std::fs::remove_dir_all(place.join("run")).unwrap();
    }
}
