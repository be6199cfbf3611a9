//! Runs of a robot whose axes are emulated drives on an EtherCAT segment of its controller.

use std::process::Command;

use plc_node::ExecutionType;
use records::schedule::Schedule;
use setup::{Drives, Setup};
use stands::virtual_run::whole;

use crate::failure::failure;

fn with_drives(name: &str) -> (Setup, planning::Found) {
    let (setup, found) = planning::setup_with_application(name).unwrap();
    (setup.with_drives(Drives::Ethercat), found)
}

/// Runs CM once with drives and a fault, and returns the reason of its failure.
fn failure_with_drives(name: &str, fault: &str) -> String {
    let (setup, found) = with_drives(name);
    failure(&setup, &found.application, fault).unwrap()
}

#[test]
fn on_every_setup_all_types_run_as_without_drives_but_for_two_robot_cycles() {
    for name in ["A", "B", "C", "D"] {
        let (setup, found) = planning::setup_with_application(name).unwrap();
        let schedule = Schedule::new(&ExecutionType::ALL, 3, 1);
        // Each repetition is held against the plan as well.
        let without = whole(&setup, &found.application, &schedule).unwrap();
        let driven = setup.clone().with_drives(Drives::Ethercat);
        let with = whole(&driven, &found.application, &schedule).unwrap();
        let delay_ms = f64::from(setup.robot.cycle_us.value) * 2.0 / 1e3;
        for execution_type in ExecutionType::ALL {
            let [without_ms, with_ms] =
                [&without, &with].map(|results| results.results.get(execution_type).unwrap().aet_ms.unwrap());
            // Phases are drawn anew where a run begins elsewhere: half a quantum in the mean.
            let quantum_ms = f64::from(setup.robot.interpreter_quantum_us.value) / 1e3;
            assert!(
                (without_ms - with_ms).abs() <= delay_ms + quantum_ms,
                "{name} {execution_type}: {without_ms} and {with_ms} ms"
            );
        }
    }
}

#[test]
fn a_drive_that_stops_the_arm_is_named_by_the_plc_with_axis_and_code() {
    let fault = failure_with_drives("C", "drive-fault=2@1s");
    assert!(
        fault.contains("the drive of an axis has a fault (axis 2, error code 0x2310); see to"),
        "{fault}"
    );
    let blocked = failure_with_drives("A", "drive-block=1@1s..9s");
    assert!(blocked.contains("following error") && blocked.contains("(axis 1 is "), "{blocked}");
    let stopped = failure_with_drives("B", "drive-stop=6@1500ms");
    assert!(stopped.contains("the drive of an axis stopped without a command (axis 6)"), "{stopped}");
}

#[test]
fn the_command_line_runs_drives_and_refuses_faults_of_drives_that_are_not_there() {
    let directory = tempfile::tempdir().unwrap();
    let run = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bench"));
        let options = ["--setup", "C", "--mode", "virtual", "--reps", "1", "--quiet"];
        command.current_dir(directory.path()).args(options);
        command.args(more).output().unwrap()
    };
    let good = run(&["--drives", "ethercat", "--out", "good"]);
    assert_eq!(good.status.code(), Some(0), "{good:?}");
    let text = std::fs::read_to_string(directory.path().join("good/setup.toml")).unwrap();
    assert!(text.contains("drives = \"ethercat\""), "the run directory's setup says it: {text}");
    let failed = run(&["--drives", "ethercat", "--fault", "drive-fault=1@1s", "--out", "failed"]);
    assert_eq!(failed.status.code(), Some(4), "{failed:?}");
    let refused = run(&["--fault", "drive-fault=1@1s"]);
    assert_eq!(refused.status.code(), Some(2), "{refused:?}");
}

/// Runs the bench with drives in virtual time; returns its exit code, what it said, and its results.
fn driven(options: &str) -> (Option<i32>, String, serde_json::Value) {
    let directory = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_bench"));
    command.current_dir(directory.path()).args(["--mode", "virtual", "--quiet", "--out", "run"]);
    command.args(options.split_whitespace());
    let output = command.output().unwrap();
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
    let results = std::fs::read_to_string(directory.path().join("run/results.json")).unwrap();
    (output.status.code(), said, serde_json::from_str(&results).unwrap())
}

#[test]
fn an_axis_that_is_held_on_its_way_never_passes_and_never_hangs() {
    for (options, axis) in [
        ("--setup A --types rc --seed 67346 --fault drive-block=1@1.6678s..1.7678s", 1),
        ("--setup A --types rc --seed 4 --fault drive-block=1@1.690s..1.790s", 1),
        ("--setup B --types rc --seed 8 --fault drive-block=1@0.403s..0.603s", 1),
        ("--setup C --types cm --fault drive-block=2@1s", 2),
        ("--setup A --types rc --seed 298184 --fault drive-block=2@1.7540s", 2),
    ] {
        let (code, said, results) = driven(&format!("--drives ethercat --reps 1 {options}"));
        assert_eq!(code, Some(4), "{options}: {said}");
        assert!(
            said.contains(&format!("(axis {axis} is ")) && said.contains(" degrees or mm away"),
            "{said}"
        );
        assert_eq!(results["positions"], "drives");
    }
}

#[test]
fn a_block_that_no_window_of_the_robot_notices_fails_the_repetition_by_what_the_tool_did() {
    // 20 ms at a fiftieth of the speed: far within the following error window.
    let options = "--setup C --types rc --reps 1 --override 2";
    let (code, said, results) = driven(&format!("{options} --drives ethercat"));
    assert_eq!(code, Some(0), "{said}");
    let healthy_mm = results["results"]["rc"]["quality"]["path_deviation_mm"].as_f64().unwrap();
    let (_, _, set) = driven(options);
    let set_mm = set["results"]["rc"]["quality"]["path_deviation_mm"].as_f64().unwrap();
    assert!((healthy_mm - set_mm).abs() < 1e-3, "{healthy_mm} and {set_mm}");
    assert_eq!((&results["positions"], &set["positions"]), (&"drives".into(), &"set-points".into()));
    let (code, said, _) = driven(&format!("{options} --drives ethercat --fault drive-block=1@20s..20.4s"));
    assert_eq!(code, Some(4), "{said}");
    assert!(said.contains("off its path") && said.contains("are allowed"), "{said}");
}

#[test]
fn of_random_blocks_and_other_faults_of_drives_on_each_setup_none_passes_altered_and_none_hangs() {
    for (setup, kinds, draws) in [
        ("A", "drive-block", 20),
        ("B", "drive-block", 20),
        ("C", "drive-block,drive-stop", 20),
        ("D", "drive-block,drive-fault", 20),
    ] {
        let place = tempfile::tempdir().unwrap();
        let draws = draws.to_string();
        let output = Command::new(env!("CARGO_BIN_EXE_bench"))
            .current_dir(place.path())
            .args(["explore", "--quiet", "--out", "out", "--drives", "ethercat", "--seed", "31"])
            .args(["--setup", setup, "--kinds", kinds, "--draws", &draws])
            .output()
            .unwrap();
        let said = String::from_utf8(output.stdout).unwrap();
        assert_eq!(output.status.code(), Some(0), "{said}");
        assert!(said.contains("0 ended otherwise"), "{said}");
        assert!(said.contains("following error") || said.contains("off its path"), "{said}");
    }
}

#[test]
fn faults_of_drives_are_drawn_only_where_there_are_drives() {
    let place = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_bench"))
        .current_dir(place.path())
        .args(["explore", "--quiet", "--out", "out", "--kinds", "drive-block", "--draws", "3"])
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("add --drives ethercat"), "{said}");
}
