//! The command line: its messages on bad input, its exit codes, and the files of a run.

use std::fs;

use assert_cmd::Command;

use crate::program::{Finished, bench};

fn refused(arguments: &[&str]) -> String {
    let directory = tempfile::tempdir().unwrap();
    let finished = bench(directory.path(), arguments);
    assert_eq!((finished.code, finished.stdout.as_str()), (Some(2), ""), "{}", finished.stderr);
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0, "nothing is written");
    finished.stderr
}

#[test]
fn the_error_for_an_unknown_setup_lists_the_existing_ones() {
    insta::assert_snapshot!(refused(&["--setup", "Z", "--mode", "virtual"]), @"error: there is no setup `Z`: built in are A, B, C, D, E, F, G; or give the path of a .toml file");
}

#[cfg(feature = "real")]
#[test]
fn a_measurement_that_ends_before_its_first_repetition_leaves_no_run_and_keeps_a_directory_of_the_user() {
    let directory = tempfile::tempdir().unwrap();
    fs::create_dir(directory.path().join("mine")).unwrap();
    let attached = ["--attach", "plc=127.0.0.1:9", "--reps", "1"];
    let exported = ["--mode", "virtual", "--reps", "1", "--export-json", "nowhere/results.json"];
    for (arguments, code, reason) in [
        (&attached[..], 5, "no plc-node answers at 127.0.0.1:9"),
        (&exported, 1, "cannot write nowhere/results.json"),
    ] {
        for out in ["new", "mine"] {
            let finished = bench(directory.path(), [arguments, &["--out", out]].concat());
            assert_eq!(finished.code, Some(code), "{}", finished.stderr);
            assert!(finished.stderr.contains(reason), "{}", finished.stderr);
        }
        assert!(!directory.path().join("new").exists());
        assert_eq!(fs::read_dir(directory.path().join("mine")).unwrap().count(), 0);
    }
}

#[cfg(feature = "real")]
#[test]
fn a_file_in_place_of_a_directory_or_of_a_case_is_refused_with_what_would_do() {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("file"), "").unwrap();
    for arguments in [["new", "file"], ["man", "file"]] {
        let finished = bench(directory.path(), arguments);
        assert_eq!(finished.code, Some(2), "{}", finished.stderr);
        insta::allow_duplicates!(
            insta::assert_snapshot!(finished.stderr, @"error: file is a file; name another directory")
        );
    }
    for verb in ["overhead", "explore"] {
        let finished = bench(directory.path(), [verb, "--out", "file"]);
        assert_eq!(finished.code, Some(2), "{}", finished.stderr);
        insta::allow_duplicates!(
            insta::assert_snapshot!(finished.stderr, @"error: file is a file; choose another directory by --out")
        );
    }
    let case = bench(directory.path(), ["judge", "--case", "file"]);
    assert_eq!(case.code, Some(2), "{}", case.stderr);
    insta::assert_snapshot!(case.stderr, @"
    error: file:1: missing key `schema`
        1 |
    ");
}

/// Runs Setup C in virtual mode, with these lines in its section of the bus.
fn setup_c_with(lines: &str, options: &[&str]) -> Finished {
    let directory = tempfile::tempdir().unwrap();
    let shipped = include_str!("../../../cell/setups/C.toml");
    let changed = shipped.replacen("\n[robot]\n", &format!("\n{lines}\n[robot]\n"), 1);
    fs::write(directory.path().join("c.toml"), changed).unwrap();
    let arguments = ["--setup", "c.toml", "--mode", "virtual", "--reps", "1", "--quiet", "--out", "run"];
    bench(directory.path(), [&arguments[..], options].concat())
}

#[test]
fn a_robot_with_another_identity_or_other_process_data_than_the_setup_wants_is_refused_with_both() {
    let device = |product: u32, output_bytes: u32| {
        let finished = setup_c_with(
            &format!(
                "[bus.ethercat.device]\nvendor = 0xFFFFFFFF\nproduct = {product}\n\
                 output_bytes = {output_bytes}\ninput_bytes = 256\n"
            ),
            &[],
        );
        assert_eq!(finished.code, Some(2), "{}", finished.stderr);
        finished.stderr
    };
    insta::assert_snapshot!(device(9, 256), @"error: no connection to the robot: the EtherCAT cable has other devices: expected 1: vendor 0xFFFFFFFF, product 0x00000009; found 1: `skillbench-robot` (vendor 0xFFFFFFFF, product 0x00000001, revision 0x00010000)");
    insta::assert_snapshot!(device(1, 64), @"error: no connection to the robot: device 1, `skillbench-robot` (vendor 0xFFFFFFFF, product 0x00000001, revision 0x00010000), has 256 bytes of outputs and 256 of inputs; expected 64 and 256");
}

#[test]
fn over_ethercat_a_run_survives_lost_doubled_and_late_frames_and_a_short_cut() {
    let faults = ["loss=0.002", "duplicate=0.01", "reorder=0.01@2ms", "cut-at=2s..2.1s"];
    let options: Vec<_> = faults.iter().flat_map(|fault| ["--fault", fault]).collect();
    let finished = setup_c_with("", &options);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let longer = setup_c_with("", &["--fault", "cut-at=2s..3s"]);
    assert_eq!(longer.code, Some(4), "{}", longer.stderr);
    assert!(longer.stderr.contains("error: repetition rc 1 of 1 failed"), "{}", longer.stderr);
}

#[test]
fn a_closed_pipe_is_no_failure_and_the_run_is_saved() {
    let directory = tempfile::tempdir().unwrap();
    let arguments = ["--mode", "virtual", "--reps", "1", "--out", "run"];
    let without_reader = || std::io::pipe().unwrap().1;
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_bench"));
    command.current_dir(directory.path()).args(arguments);
    let ended = command.stdout(without_reader()).stderr(without_reader()).status().unwrap();
    assert_eq!(ended.code(), Some(0));
    let results = fs::read_to_string(directory.path().join("run/results.json")).unwrap();
    assert!(results.contains("\"complete\""), "{results}");
}

#[test]
fn output_to_a_full_disk_is_an_error_and_the_run_is_saved() {
    let directory = tempfile::tempdir().unwrap();
    let full = fs::File::options().write(true).open("/dev/full").unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_bench"))
        .current_dir(directory.path())
        .args(["--mode", "virtual", "--reps", "1", "--quiet", "--out", "run"])
        .stdout(full)
        .output()
        .unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("error: cannot write to standard output: No space left on device"), "{stderr}");
    assert!(directory.path().join("run/results.json").exists());
}

#[test]
fn the_error_for_an_unknown_execution_type_lists_the_existing_ones() {
    insta::assert_snapshot!(refused(&["--types", "rc,xm"]), @"
    error: invalid value 'rc,xm' for '--types <TYPE>...': there is no execution type `xm`: rc runs the robot's program, sm single motions, cm one MoveContinuousSkill

    For more information, try '--help'.
    ");
}

#[test]
fn an_empty_list_is_refused_and_measures_nothing() {
    insta::assert_snapshot!(refused(&["--types", ""]), @"
    error: invalid value '' for '--types <TYPE>...': it holds no value; leave the option out for its default

    For more information, try '--help'.
    ");
}

#[test]
fn zero_repetitions_are_refused() {
    insta::assert_snapshot!(refused(&["--reps", "0"]), @"
    error: invalid value '0' for '--reps <N>': 0 is not in 1..=100000

    For more information, try '--help'.
    ");
}

#[test]
fn the_error_for_a_wrong_override_shows_a_correct_one() {
    for (text, reason) in [
        ("120", "`120`: an override of 120 % was asked for; it is 0 (the arm stops on its path) to 100 %"),
        (
            "50@2s,0@3s",
            "`50@2s,0@3s` leaves the arm standing for ever; let a later step raise the override, as in 0,100@10s",
        ),
        (
            "half",
            "`half`: invalid override; write percent, and a time after the start of each repetition: 50, 50@2s or 80,0@2s,100@3s",
        ),
    ] {
        let finished = refused(&["--mode", "virtual", "--override", text]);
        let expected =
            format!("error: invalid value '{text}' for '--override <PERCENT[@TIME],...>': {reason}\n");
        assert!(finished.starts_with(&expected), "{finished}");
    }
}

#[test]
fn a_virtual_run_prints_the_table_and_leaves_a_run_directory() {
    let directory = tempfile::tempdir().unwrap();
    let finished = bench(
        directory.path(),
        ["--mode", "virtual", "--reps", "2", "--out", "run", "--export-json", "out.json"],
    );
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(
        finished.stdout.contains("AETi") && finished.stdout.contains("Saved in run."),
        "{}",
        finished.stdout
    );
    for run in ["virtual: ", "with the run without skill overhead beside it: "] {
        let speed = finished.stderr.lines().find_map(|line| line.strip_prefix(run));
        assert!(speed.is_some_and(|speed| speed.contains(" s of the plant in ")), "{}", finished.stderr);
    }
    let mut names: Vec<_> = fs::read_dir(directory.path().join("run"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(
        names,
        [
            "application.toml",
            "host.json",
            "race.html",
            "report.html",
            "results.json",
            "samples.csv",
            "setup.toml",
            "trace-plc.csv",
            "trace-robot.csv",
        ]
    );
    let read = |path: &str| fs::read_to_string(directory.path().join(path)).unwrap();
    assert_eq!(read("run/results.json"), read("out.json"));
    assert_eq!(read("run/samples.csv").lines().count(), 1 + 6);
    let host: serde_json::Value = serde_json::from_str(&read("run/host.json")).unwrap();
    assert!(host["kernel"].is_string() && host["cores"].as_u64() > Some(0), "{host}");
}

#[cfg(feature = "real")]
#[test]
fn the_help_shows_examples_and_exit_codes() {
    let directory = tempfile::tempdir().unwrap();
    let finished = bench(directory.path(), ["--help"]);
    assert_eq!(finished.code, Some(0));
    insta::assert_snapshot!(finished.stdout);
}

#[test]
fn the_error_for_a_directory_that_cannot_be_created_gives_its_path() {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("file"), "").unwrap();
    let finished = bench(directory.path(), ["--mode", "virtual", "--reps", "1", "--out", "file/run"]);
    assert_eq!(finished.code, Some(1));
    insta::assert_snapshot!(finished.stderr, @"error: cannot make the run directory file/run; choose another by --out: Not a directory (os error 20)");
}

#[test]
fn faults_that_delay_frames_longer_than_a_real_cable_can_are_refused() {
    insta::assert_snapshot!(refused(&["--fault", "delay=600ms", "--fault", "reorder=0.01@1s"]), @"error: these faults hold frames for up to 1.6s, and a cable between two processes for 1s at most: ask for less, or add --mode virtual");
}

#[test]
fn faults_are_refused_for_nodes_that_already_run() {
    insta::assert_snapshot!(refused(&["--attach", "plc=127.0.0.1:1", "--fault", "loss=0.01"]), @"error: --fault impairs the cable that the bench lays: leave it out with --attach, and impair the nodes' network, by `tc qdisc add dev IF root netem` for instance");
}

#[test]
#[cfg(not(feature = "mcap"))]
fn a_bench_built_without_mcap_says_how_to_build_it_with_mcap() {
    insta::assert_snapshot!(refused(&["--mode", "virtual", "--mcap"]), @"error: --mcap is not built into this bench: `cargo build -p bench --features mcap` makes one that has it, and `cargo run -p bench --features mcap -- …` runs it");
}

#[test]
fn the_commit_of_a_run_is_that_of_the_build_and_nothing_is_asked_at_run_time() {
    let directory = tempfile::tempdir().unwrap();
    let mut command = Command::cargo_bin("bench").unwrap();
    command.args(["--mode", "virtual", "--types", "rc", "--reps", "1", "--quiet", "--out", "run"]);
    // A repository of another commit, and no Git.
    fs::create_dir(directory.path().join(".git")).unwrap();
    command.current_dir(directory.path()).env("PATH", "").assert().success();
    let host = fs::read_to_string(directory.path().join("run/host.json")).unwrap();
    let host: serde_json::Value = serde_json::from_str(&host).unwrap();
    let built = env!("SKILLBENCH_COMMIT");
    assert_eq!(host["commit"].as_str().unwrap_or_default(), built);
    let hash = built.strip_suffix("-modified").unwrap_or(built);
    assert!(hash.is_empty() || hash.len() == 12 && hash.chars().all(|c| c.is_ascii_hexdigit()), "{built}");
}

#[cfg(feature = "real")]
#[test]
fn a_node_that_is_not_there_is_waited_for_and_then_named() {
    let directory = tempfile::tempdir().unwrap();
    // A port that was free a moment ago, so nobody listens on it.
    let address = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let finished = bench(directory.path(), ["--attach", &format!("plc={address}")]);
    assert_eq!(finished.code, Some(5), "{}", finished.stderr);
    let told = format!("no plc-node answers at {address} within 10 s");
    assert!(finished.stderr.contains(&told), "{}", finished.stderr);
}

#[test]
fn what_cannot_be_asked_of_running_nodes_is_refused() {
    let attached = ["--attach", "plc=127.0.0.1:7700"];
    refused(&[&attached[..], &["--mode", "virtual"]].concat());
    refused(&[&attached[..], &["--capture", "always"]].concat());
    refused(&["--attach", "robot=a:1"]);
}

#[test]
fn a_live_view_of_a_virtual_run_and_one_for_other_hosts_are_refused() {
    insta::assert_snapshot!(refused(&["--mode", "virtual", "--live"]), @"error: --live shows a run in real time, and a virtual one is over in seconds: leave out `--mode virtual`, or open the race.html that every run writes");
    let other_hosts = refused(&["--live", "0.0.0.0:8642"]);
    assert!(other_hosts.contains("0.0.0.0:8642") && other_hosts.contains("loopback"), "{other_hosts}");
}

#[test]
fn a_live_view_on_a_taken_port_is_refused_before_anything_is_written() {
    let directory = tempfile::tempdir().unwrap();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let finished = bench(directory.path(), ["--reps", "1", "--live", &address]);
    assert_eq!((finished.code, finished.stdout.as_str()), (Some(5), ""), "{}", finished.stderr);
    for part in [address.as_str(), "takes another port"] {
        assert!(finished.stderr.contains(part), "{}", finished.stderr);
    }
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0, "nothing is written");
}

#[test]
fn an_occupied_run_directory_is_refused_and_left_as_it_is() {
    let directory = tempfile::tempdir().unwrap();
    let run = |out| bench(directory.path(), ["--mode", "virtual", "--reps", "1", "--out", out]);
    assert_eq!(run("run").code, Some(0));
    let samples = fs::read(directory.path().join("run/samples.csv")).unwrap();
    let finished = run("run");
    assert_eq!((finished.code, finished.stdout.as_str()), (Some(2), ""));
    insta::assert_snapshot!(finished.stderr, @"error: run holds a run already; choose another directory by --out");
    let finished = run("run/samples.csv");
    assert_eq!(finished.code, Some(2));
    insta::assert_snapshot!(finished.stderr, @"error: run/samples.csv is a file; choose another directory by --out");
    assert_eq!(fs::read(directory.path().join("run/samples.csv")).unwrap(), samples);
}

#[test]
fn types_are_separated_by_commas_and_blanks_alike() {
    let directory = tempfile::tempdir().unwrap();
    let types = [&["rc,cm"][..], &["rc", "cm"], &["rc,", "cm"], &["rc, cm"]];
    let tables = types.map(|types| {
        let arguments = [&["--mode", "virtual", "--reps", "2", "--quiet", "--types"], types].concat();
        let finished = bench(directory.path(), &arguments);
        assert_eq!(finished.code, Some(0), "{types:?}: {}", finished.stderr);
        finished.stdout.lines().take_while(|line| !line.contains("Saved")).collect::<Vec<_>>().join("\n")
    });
    assert!(tables.iter().all(|table| *table == tables[0]), "{tables:#?}");
}

#[test]
fn one_repetition_has_no_mad_and_so_none_that_is_calibrated() {
    let directory = tempfile::tempdir().unwrap();
    let finished = bench(directory.path(), ["--mode", "virtual", "--types", "rc", "--reps", "1", "--quiet"]);
    let row = finished.stdout.lines().find(|line| line.starts_with(" RC")).unwrap();
    assert_eq!(row.split_whitespace().nth(2), Some("–"), "{}", finished.stdout);
    assert!(!finished.stdout.contains("MADs"), "no line about a mark that is not there: {}", finished.stdout);
}

#[test]
fn a_file_that_is_not_there_is_told_of_once() {
    let error = refused(&["--setup", "nosuch.toml", "--mode", "virtual"]);
    insta::assert_snapshot!(error, @"error: cannot read the setup file nosuch.toml: No such file or directory (os error 2)");
}

#[test]
fn the_version_names_the_commit() {
    let directory = tempfile::tempdir().unwrap();
    let finished = bench(directory.path(), ["--version"]);
    assert_eq!(finished.stdout.trim(), concat!("bench ", env!("SKILLBENCH_VERSION")));
    let commit = env!("SKILLBENCH_COMMIT");
    assert!(commit.is_empty() || finished.stdout.contains(commit), "{}", finished.stdout);
}

#[cfg(feature = "real")]
#[test]
fn there_are_completions_and_manual_pages_of_all_programs() {
    let directory = tempfile::tempdir().unwrap();
    for (program, option) in
        [("bench", "--capture"), ("plc-node", "--interface"), ("robot-node", "--control")]
    {
        for shell in ["bash", "zsh", "fish"] {
            let finished = bench(directory.path(), ["completions", shell, "--program", program]);
            let option = if shell == "fish" { option.trim_start_matches('-') } else { option };
            assert!(
                finished.code == Some(0) && finished.stdout.contains(option),
                "{shell} {program}: {}",
                finished.stderr
            );
        }
    }
    assert_eq!(bench(directory.path(), ["man"]).code, Some(0));
    for page in ["bench.1", "bench-sweep.1", "plc-node.1", "plc-node-plan.1", "robot-node-run.1"] {
        let text = fs::read_to_string(directory.path().join("man").join(page)).unwrap();
        assert!(text.contains(".SH NAME"), "{page}");
    }
}

#[test]
fn a_new_cell_runs_as_it_is_and_is_not_written_over() {
    let directory = tempfile::tempdir().unwrap();
    let arguments = ["new", "mine", "--setup", "B", "--application", "gluing"];
    let finished = bench(directory.path(), arguments);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let run =
        ["--setup", "mine/setup.toml", "--mode", "virtual", "--types", "rc", "--reps", "1", "--out", "run"];
    let finished = bench(directory.path(), run);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(
        finished.stdout.starts_with("Setup mine: my cell mine\nmine, 1 repetition"),
        "{}",
        finished.stdout
    );
    let finished = bench(directory.path(), arguments);
    assert_eq!(finished.code, Some(2));
    insta::assert_snapshot!(finished.stderr, @"error: mine holds a cell already; name another directory");
}

#[test]
fn a_new_cell_of_several_stations_runs_as_it_is_and_so_does_its_study() {
    for setup in ["E", "F", "G"] {
        let directory = tempfile::tempdir().unwrap();
        let finished = bench(directory.path(), ["new", "mine", "--setup", setup]);
        assert_eq!(finished.code, Some(0), "{}", finished.stderr);
        let run = [
            "--setup",
            "mine/setup.toml",
            "--mode",
            "virtual",
            "--types",
            "cm",
            "--reps",
            "1",
            "--out",
            "run",
        ];
        let finished = bench(directory.path(), run);
        assert_eq!(finished.code, Some(0), "{setup}: {}", finished.stderr);
        let finished = bench(directory.path(), ["study", "run", "mine/study.toml", "--shard", "0/15"]);
        assert_eq!(finished.code, Some(0), "{setup}: {}", finished.stderr);
    }
}

#[test]
fn a_new_cell_takes_an_application_for_as_many_arms_as_its_setup_has() {
    let directory = tempfile::tempdir().unwrap();
    let refused = [("G", "gluing"), ("A", "hand-over")].map(|(setup, application)| {
        let arguments = ["new", "mine", "--setup", setup, "--application", application];
        let finished = bench(directory.path(), arguments);
        assert_eq!(finished.code, Some(2));
        finished.stderr
    });
    assert!(!directory.path().join("mine").exists());
    insta::assert_snapshot!(refused.concat(), @r"
    error: no built-in application for several arms is named `gluing`; choose one of hand-over, carry-plate, take-turns
    error: no built-in application for one arm is named `hand-over`; choose one of pick-and-place, pick-and-place-gripper, gluing, palletising, engraving, insertion-with-force
    ");
}

#[test]
fn an_application_takes_the_place_of_the_setups() {
    let directory = tempfile::tempdir().unwrap();
    let own = planning::APPLICATIONS.iter().find(|(name, _)| *name == "gluing").unwrap().1;
    fs::write(directory.path().join("own.toml"), own).unwrap();
    let tables = ["gluing", "own.toml"].map(|application| {
        let arguments = ["--application", application, "--mode", "virtual", "--types", "rc", "--reps", "1"];
        let finished = bench(directory.path(), arguments);
        assert_eq!(finished.code, Some(0), "{}", finished.stderr);
        assert!(
            finished.stdout.contains("\ngluing, 1 repetition") && !finished.stdout.contains("paper AET"),
            "{}",
            finished.stdout
        );
        finished.stdout.lines().take_while(|line| !line.contains("Saved")).collect::<Vec<_>>().join("\n")
    });
    assert_eq!(tables[0], tables[1]);
}

#[cfg(not(feature = "real"))]
#[test]
fn a_bench_without_real_mode_says_so_and_names_the_mode_that_it_has() {
    let place = tempfile::tempdir().unwrap();
    let Finished { code, stderr, .. } = bench(place.path(), ["--setup", "A", "--reps", "1"]);
    assert_eq!(code, Some(5));
    insta::assert_snapshot!(stderr.trim_end(), @"error: this bench was built without real mode: add `--mode virtual`, or build it on Linux with the feature `real`");
}
