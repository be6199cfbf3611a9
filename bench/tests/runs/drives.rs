//! Runs of a robot whose axes are emulated drives behind an EtherCAT segment of its controller.

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
    assert!(blocked.contains("(axis 1, error code 0x8611)"), "{blocked}");
    let stopped = failure_with_drives("B", "drive-stop=6@1500ms");
    assert!(stopped.contains("the drive of an axis stopped though nobody told it to (axis 6)"), "{stopped}");
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
