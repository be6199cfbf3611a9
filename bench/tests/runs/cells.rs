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
fn two_robots_in_line_on_ethercat_run_in_virtual_time_in_the_order_of_their_positions() {
    let directory = tempfile::tempdir().unwrap();
    let of_f = include_str!("../../../cell/setups/F.toml");
    let both = of_f.replacen("kind = \"profinet\"", "kind = \"ethercat\"", 1);
    let both = both.replacen("name = \"left\"\n", "name = \"left\"\nposition = 1\n", 1);
    let both = both.replacen("name = \"right\"\n", "name = \"right\"\nposition = 0\n", 1);
    fs::write(directory.path().join("line.toml"), both).unwrap();
    let finished = run(directory.path(), "line.toml", "line", &[]);
    assert_eq!(finished.code, Some(0), "{}{}", finished.stdout, finished.stderr);
    let results = fs::read(directory.path().join("line/results.json")).unwrap();
    let results: serde_json::Value = serde_json::from_slice(&results).unwrap();
    assert_eq!(
        (&results["status"], &results["stations"][0]["bus"]),
        (&"complete".into(), &"ethercat".into())
    );
}

#[test]
fn the_time_for_which_arms_stood_before_a_shared_zone_is_in_table_and_results() {
    let directory = tempfile::tempdir().unwrap();
    let finished = run(directory.path(), "G", "turns", &[]);
    assert_eq!(finished.code, Some(0), "{}{}", finished.stdout, finished.stderr);
    assert!(finished.stdout.contains("left zones ms"), "{}", finished.stdout);
    let text = fs::read_to_string(directory.path().join("turns/results.json")).unwrap();
    let results: serde_json::Value = serde_json::from_str(&text).unwrap();
    for kind in ["rc", "sm", "cm"] {
        let waited = |station: usize| {
            let waits = results["results"][kind]["stations"][station]["zone_waiting_ms"].as_array().unwrap();
            assert_eq!(waits.len(), 2, "{kind}");
            waits.iter().map(|wait| wait.as_f64().unwrap()).sum::<f64>()
        };
        assert!(waited(0) + waited(1) > 100.0, "{kind}");
    }
    // A cell without zones has no such figures.
    let without = run(directory.path(), "E", "without", &["--types", "rc"]);
    assert!(!without.stdout.contains("zones ms"));
    let text = fs::read_to_string(directory.path().join("without/results.json")).unwrap();
    assert!(!text.contains("zone_waiting_ms"));
}

#[test]
fn what_cells_do_not_have_yet_is_refused_by_its_name() {
    let directory = tempfile::tempdir().unwrap();
    for (more, named) in [
        (&["--live"] as &[&str], "--live shows a run in real time"),
        (&["--plc-program", "."], "exported code commands one robot, and setup E has several"),
        (&["--application", "pick-and-place"], "built in are hand-over, carry-plate, take-turns"),
    ] {
        let finished = run(directory.path(), "E", "refused", more);
        assert_eq!(finished.code, Some(2), "{more:?}: {}", finished.stderr);
        assert!(finished.stderr.contains(named), "{}", finished.stderr);
        assert!(!directory.path().join("refused").exists());
    }
}

#[test]
fn what_a_cell_does_not_have_in_real_mode_is_refused_before_any_node_starts() {
    let directory = tempfile::tempdir().unwrap();
    let virtual_only = "is for virtual time only: add --mode virtual";
    for (more, named) in [
        (["--plc-program", "."], "exported code commands one robot, and setup E has several"),
        (["--fault", "left/to-robot:restart-robot=17@100ms"], virtual_only),
        (["--fault", "right/to-robot:restart-plc=17@100ms"], virtual_only),
        (["--fault", "left/to-plc:cut-frame=17@10ms"], virtual_only),
    ] {
        let arguments = ["--setup", "E", "--mode", "real", "--reps", "1", "--out", "refused"];
        let finished = bench(directory.path(), arguments.iter().chain(&more));
        assert_eq!(finished.code, Some(2), "{more:?}: {}", finished.stderr);
        assert!(finished.stderr.contains(named), "{}", finished.stderr);
        assert!(!directory.path().join("refused").exists());
    }
}

#[test]
fn cyclic_sets_the_transport_of_each_profinet_station_and_is_refused_where_there_is_none() {
    let directory = tempfile::tempdir().unwrap();
    let more = ["--cyclic", "rt1", "--types", "cm", "--capture", "always"];
    let finished = run(directory.path(), "E", "rt1", &more);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let setup = fs::read_to_string(directory.path().join("rt1/setup.toml")).unwrap();
    assert!(setup.contains("cyclic = \"rt1\"") && !setup.contains("cyclic = \"udp\""), "{setup}");
    let capture = fs::read(directory.path().join("rt1/robot-left.pcapng")).unwrap();
    // EtherType 0x8892 and the FrameIDs of RT_CLASS_1, from 0x8000 on.
    let frames = capture.windows(4).filter(|bytes| bytes.starts_with(&[0x88, 0x92, 0x80])).count();
    assert!(frames > 1_000, "{frames}");
    let without =
        include_str!("../../../cell/setups/F.toml").replacen("kind = \"profinet\"", "kind = \"ethercat\"", 1);
    fs::write(directory.path().join("line.toml"), without).unwrap();
    let finished = run(directory.path(), "line.toml", "refused", &["--cyclic", "rt1"]);
    assert_eq!(finished.code, Some(2), "{}", finished.stderr);
    assert!(finished.stderr.contains("--cyclic: no station of setup F uses PROFINET"), "{}", finished.stderr);
}

#[test]
fn a_fault_of_a_cell_names_its_station_and_a_wrong_one_is_answered_by_the_right_ones() {
    let directory = tempfile::tempdir().unwrap();
    let refused = |fault: &str| {
        let finished = run(directory.path(), "E", "refused", &["--fault", fault]);
        assert_eq!(finished.code, Some(2), "{fault}: {}", finished.stderr);
        finished.stderr.trim().to_owned()
    };
    let said: Vec<_> = ["loss=0.01", "lefft/loss=0.01", "middle/loss=0.01", "left/kill-plc-at=1s"]
        .into_iter()
        .map(refused)
        .collect();
    insta::assert_snapshot!(said.join("\n"), @"
    error: `loss=0.01` names no station: write left/loss=0.01 or right/loss=0.01
    error: `lefft/loss=0.01`: setup E has no station `lefft`: did you mean `left`?
    error: `middle/loss=0.01`: setup E has no station `middle`: there is left, right
    error: `left/kill-plc-at=1s` ends the PLC of all stations: write it without the station and its `/`
    ");
    let one = bench(directory.path(), ["--setup", "A", "--mode", "virtual", "--fault", "left/loss=0.1"]);
    assert_eq!(one.code, Some(2));
    assert!(one.stderr.contains("setup A has one robot: write `left/loss=0.1` without"), "{}", one.stderr);
    let more = ["--types", "cm", "--fault", "left/to-robot:loss=0.01"];
    let finished = run(directory.path(), "E", "lossy", &more);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let results = fs::read_to_string(directory.path().join("lossy/results.json")).unwrap();
    let results: serde_json::Value = serde_json::from_str(&results).unwrap();
    assert_eq!(results["faults"]["asked"], serde_json::json!(["left/to-robot:loss=0.01"]));
    assert!(results["faults"]["lost"].as_u64().unwrap() > 10, "{}", results["faults"]);
}

#[test]
fn a_cell_whose_stations_have_applications_of_their_own_runs_again_from_its_directory() {
    let directory = tempfile::tempdir().unwrap();
    let (mut cell, _) = setup::cell("E").unwrap();
    let [a, b] = ["A", "B"].map(|name| setup::setup(name).unwrap());
    cell.application = None;
    for (station, alone) in cell.stations.iter_mut().zip([a, b]) {
        (station.application, station.robot, station.motions) =
            (alone.application, alone.robot, alone.motions);
    }
    fs::write(directory.path().join("own.toml"), setup::cell_to_toml(&cell).unwrap()).unwrap();
    let first = run(directory.path(), "own.toml", "first", &["--types", "cm"]);
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    let again = run(directory.path(), "first/setup.toml", "again", &["--types", "cm"]);
    assert_eq!(again.code, Some(0), "{}", again.stderr);
    let samples = |run: &str| fs::read(directory.path().join(run).join("samples.csv")).unwrap();
    assert_eq!(samples("first"), samples("again"));
}

#[test]
fn a_soak_of_a_cell_puts_its_faults_at_every_station() {
    let directory = tempfile::tempdir().unwrap();
    let finished = bench(directory.path(), ["soak", "--setup", "E", "--hours", "0.05", "--quiet"]);
    assert_eq!(finished.code, Some(0), "{}{}", finished.stdout, finished.stderr);
    assert!(
        finished.stdout.contains("Setup E, ") && finished.stdout.contains(" 0 altered"),
        "{}",
        finished.stdout
    );
}

#[test]
fn a_run_of_a_cell_has_pages_traces_and_captures_of_each_station() {
    let directory = tempfile::tempdir().unwrap();
    let more = ["--types", "cm", "--trace", "--capture", "always"];
    let finished = run(directory.path(), "F", "cell", &more);
    assert_eq!(finished.code, Some(0), "{}{}", finished.stdout, finished.stderr);
    let path = directory.path().join("cell");
    for station in ["left", "right"] {
        let robot = fs::read_to_string(path.join(format!("trace-robot-{station}.csv"))).unwrap();
        assert!(robot.lines().next().unwrap().ends_with("positions,progress,true_ns"), "{station}");
        let plc = fs::read_to_string(path.join(format!("trace-plc-{station}.csv"))).unwrap();
        assert!(plc.lines().next().unwrap().ends_with("marks_come,marks_passed,true_ns"), "{station}");
        assert!(plc.lines().last().unwrap().contains(",4,4,"), "{station} passes four marks");
        for end in ["plc", "robot"] {
            let capture = fs::metadata(path.join(format!("{end}-{station}.pcapng"))).unwrap();
            assert!(capture.len() > 100_000, "{end} {station}");
        }
    }
    let text = |name: &str| fs::read_to_string(path.join(name)).unwrap();
    let (report, race, timeline) = (text("report.html"), text("race.html"), text("trace.json"));
    for part in ["left waits, ms", "gripped, together from here", "relative pose off, mm", "race.html"] {
        assert!(report.contains(part), "{part}");
    }
    let is_hyphen = |(at, _): (usize, &str)| report[at + 2..].starts_with(|next: char| next.is_ascii_digit());
    assert!(
        !report.match_indices(">-").any(is_hyphen),
        "no figure has a hyphen for its sign, or is a negative zero"
    );
    assert!(race.contains("CM left") && race.contains("CM right"));
    assert!(timeline.contains("robot right") && timeline.contains("waits at mark 1"));
    fs::remove_file(path.join("report.html")).unwrap();
    let again = bench(directory.path(), ["report", "cell"]);
    assert_eq!(again.code, Some(0), "{}", again.stderr);
    assert_eq!(text("report.html"), report, "drawn again it is the same");
}

#[test]
fn runs_of_cells_are_compared_listed_and_checked_as_those_of_one_robot() {
    let directory = tempfile::tempdir().unwrap();
    for (setup, out, seed) in [("E", "runs/one", "1"), ("E", "runs/other", "2"), ("F", "runs/third", "1")] {
        let finished = run(directory.path(), setup, out, &["--types", "rc", "--seed", seed]);
        assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    }
    assert_eq!(
        bench(directory.path(), ["--mode", "virtual", "--reps", "1", "--types", "rc", "--out", "A"]).code,
        Some(0)
    );
    let compared = bench(directory.path(), ["compare", "runs/one", "runs/other", "runs/third", "A"]);
    assert_eq!(compared.code, Some(0), "{}", compared.stderr);
    let differing = compared.stdout.lines().filter(|line| line.contains("not under the conditions of run 1"));
    assert_eq!(differing.count(), 2, "{}", compared.stdout);
    assert!(compared.stdout.contains("setup F, in run 1 E"), "{}", compared.stdout);
    let history = bench(directory.path(), ["history", "--json"]);
    let entries: serde_json::Value = serde_json::from_str(&history.stdout).unwrap();
    assert_eq!(entries.as_array().unwrap().len(), 3, "{}{}", history.stdout, history.stderr);
    let other = entries.as_array().unwrap().iter().find(|entry| entry["run"] == "other").unwrap();
    assert_eq!(other["compared_with"]["rc"], "one", "{other}");
    let gate = bench(directory.path(), ["gate", "--run", "runs/one"]);
    assert_eq!(gate.code, Some(2));
    assert!(gate.stderr.contains("is a virtual run"), "{}", gate.stderr);

    let path = directory.path().join("runs/other/results.json");
    let text = fs::read_to_string(&path).unwrap();
    let results: serde_json::Value = serde_json::from_str(&text).unwrap();
    let altered = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut changed = results.clone();
        change(&mut changed);
        fs::write(&path, serde_json::to_string_pretty(&changed).unwrap()).unwrap();
        let finished = bench(directory.path(), ["report", "runs/other"]);
        (finished.code, finished.stderr)
    };
    let of_rc =
        |value: &mut serde_json::Value, key: &str, to: serde_json::Value| value["results"]["rc"][key] = to;
    for (key, to, said) in [
        ("aet_ms", serde_json::json!(1.0), "aet_ms of RC is 1"),
        ("samples_ms", serde_json::json!([1.0]), "has 1 entries"),
        ("start_skew_us", serde_json::json!([]), "start_skew_us of RC has 0 entries"),
        ("relative_pose_mm", serde_json::json!([0.5, 0.5]), "its digest is"),
    ] {
        let (code, stderr) = altered(&|value| of_rc(value, key, to.clone()));
        assert_eq!(code, Some(4), "{key}: {stderr}");
        assert!(stderr.contains(said) || stderr.contains("its samples_ms"), "{key}: {stderr}");
    }
    let (code, stderr) = altered(&|value| value["stations"][0]["waits"][0]["after"] = serde_json::json!(9));
    assert_eq!(code, Some(4), "{stderr}");
    fs::write(&path, text).unwrap();
    let samples = directory.path().join("runs/other/samples.csv");
    let text = fs::read_to_string(&samples).unwrap();
    let line = text.lines().find(|line| line.contains(",right,")).unwrap();
    fs::write(&samples, text.replace(line, &line.replacen(",right,", ",right,9", 1))).unwrap();
    let finished = bench(directory.path(), ["report", "runs/other"]);
    assert_eq!(finished.code, Some(4), "{}", finished.stderr);
    assert!(finished.stderr.contains("station right"), "{}", finished.stderr);
}

#[test]
fn an_override_of_a_cell_is_followed_by_all_arms_verified_and_named() {
    let directory = tempfile::tempdir().unwrap();
    let aet_ms = |setup: &str, out: &str, more: &[&str]| {
        let finished = run(directory.path(), setup, out, more);
        assert_eq!(finished.code, Some(0), "{setup} {more:?}: {}{}", finished.stdout, finished.stderr);
        let text = fs::read_to_string(directory.path().join(out).join("results.json")).unwrap();
        let results: serde_json::Value = serde_json::from_str(&text).unwrap();
        let aet_ms = ["rc", "sm", "cm"].map(|it| results["results"][it]["aet_ms"].as_f64().unwrap());
        (aet_ms, results["override"].clone(), finished.stdout)
    };
    for setup in ["E", "F", "G"] {
        let (full, none, _) = aet_ms(setup, &format!("{setup}-full"), &[]);
        assert!(none.is_null());
        for given in ["50", "80,0@1s,60@1.5s"] {
            let out = format!("{setup}-{}", given.len());
            let (slow, named, said) = aet_ms(setup, &out, &["--override", given]);
            assert_eq!(named, given);
            assert!(said.contains(&format!("override {given}")), "{said}");
            let later = slow.iter().zip(full).all(|(slow, full)| slow - full > 300.0);
            assert!(later, "{setup} {given}: {slow:?} {full:?}");
        }
    }
}

#[test]
fn an_application_of_ones_own_replaces_that_of_a_cell_and_runs_again_from_its_directory() {
    let directory = tempfile::tempdir().unwrap();
    let text = include_str!("../../../cell/applications/hand-over.toml").replace("\"hand-over\"", "\"mine\"");
    fs::create_dir(directory.path().join("tasks")).unwrap();
    fs::write(directory.path().join("tasks/mine.toml"), text).unwrap();
    let more = ["--types", "cm", "--application", "tasks/mine.toml"];
    let first = run(directory.path(), "E", "first", &more);
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    let written = fs::read_to_string(directory.path().join("first/application.toml")).unwrap();
    assert!(written.contains("name = \"mine\""));
    let again = run(directory.path(), "first/setup.toml", "again", &["--types", "cm"]);
    assert_eq!(again.code, Some(0), "{}", again.stderr);
    let samples = |run: &str| fs::read(directory.path().join(run).join("samples.csv")).unwrap();
    assert_eq!(samples("first"), samples("again"));
    let other = run(directory.path(), "E", "other", &["--application", "take-turns"]);
    assert_eq!(other.code, Some(2), "{}", other.stderr);
    assert!(other.stderr.contains("`giver` is not an arm of"), "{}", other.stderr);
}

#[test]
fn drives_of_a_cell_move_every_arm() {
    let directory = tempfile::tempdir().unwrap();
    let finished = run(directory.path(), "E", "driven", &["--types", "cm", "--drives", "ethercat"]);
    assert_eq!(finished.code, Some(0), "{}{}", finished.stdout, finished.stderr);
    let setup = fs::read_to_string(directory.path().join("driven/setup.toml")).unwrap();
    assert_eq!(setup.matches("drives = \"ethercat\"").count(), 2, "{setup}");
    let trace = fs::read_to_string(directory.path().join("driven/trace-robot-right.csv")).unwrap();
    assert!(trace.contains(",drives,"));
}

#[test]
fn every_export_of_a_cell_is_written_and_table_and_report_name_its_faults_and_zone_waits() {
    let directory = tempfile::tempdir().unwrap();
    let more = [
        "--types",
        "cm",
        "--fault",
        "left/to-plc:cut-frame=900@10ms",
        "--export-csv",
        "g.csv",
        "--export-markdown",
        "g.md",
        "--export-junit",
        "g.xml",
        "--export-json",
        "g.json",
    ];
    let finished = run(directory.path(), "G", "turns", &more);
    assert_eq!(finished.code, Some(0), "{}{}", finished.stdout, finished.stderr);
    let text = |name: &str| fs::read_to_string(directory.path().join(name)).unwrap();
    let csv = text("g.csv");
    let lines: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert!(lines.len() == 3 && lines.iter().all(|line| line.len() == lines[0].len()), "{csv}");
    assert_eq!((lines[1][5], lines[1][6], lines[2][6]), ("cm", "left", "right"));
    assert!(text("g.xml").contains("tests=\"2\" failures=\"0\""), "{}", text("g.xml"));
    assert_eq!(text("g.json"), text("turns/results.json"));
    let (markdown, report) = (text("g.md"), text("turns/report.html"));
    let fault = "to-plc:cut-frame=900@10ms): ";
    for shown in [&finished.stdout, &markdown, &report] {
        assert!(
            shown.contains(fault) && shown.contains("Station right: Cyclic frames of the PLC: "),
            "{shown}"
        );
    }
    assert!(markdown.contains("| CM |"), "{markdown}");
    assert!(report.contains("left waits before zones, ms"), "{report}");
}
