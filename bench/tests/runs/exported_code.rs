//! Exported code in the place of the PLC's function blocks: the same samples, and what is said about edited code.

use std::fs;
use std::path::Path;
use std::time::Duration;

use plc_node::{Execution, ExecutionType, ExportedCode, OverrideSchedule, PlcConfig};
use records::schedule::Step;
use stands::virtual_run::{Extras, VirtualRun};

use crate::program::{Finished, bench};

/// Returns the exported code of a setup and an application.
fn exported(setup: &str, application: Option<&str>, with_check: bool) -> String {
    let (setup, found) = planning::setup_and_application(setup, application).unwrap();
    let plan = found.plan(&setup).unwrap();
    plc_export::structured_text(&PlcConfig::of_plan(&setup, &plan).exported(with_check)).unwrap()
}

/// Runs each execution type twice; returns what the PLC reports of each.
fn run(
    setup: &str,
    application: Option<&str>,
    code: Option<&str>,
    overrides: Option<OverrideSchedule>,
) -> Vec<Execution> {
    let code = code.map(|text| ExportedCode::compile(text).unwrap());
    let (setup, found) = planning::setup_and_application(setup, application).unwrap();
    let extras = Extras { code, ..Extras::default() };
    let mut run = VirtualRun::start_with(&setup, &found.application, 7, &extras).unwrap();
    let types = [ExecutionType::ALL, ExecutionType::ALL].concat();
    let pauses = [13, 50, 21, 34, 8, 55].map(Duration::from_millis);
    let steps = types.into_iter().zip(pauses);
    steps
        .map(|(execution_type, pause)| {
            let step = Step { execution_type, repetition: 2, pause, overrides };
            run.execute_unrecorded(step).unwrap().execution
        })
        .collect()
}

#[test]
fn exported_code_gives_the_samples_of_the_function_blocks_to_the_nanosecond() {
    for (setup, application) in
        [("A", None), ("B", None), ("A", Some("pick-and-place-gripper")), ("D", Some("gluing"))]
    {
        let by_blocks = run(setup, application, None, None);
        for with_check in [true, false] {
            let text = exported(setup, application, with_check);
            assert_eq!(
                run(setup, application, Some(&text), None),
                by_blocks,
                "{setup} {application:?} {with_check}"
            );
        }
    }
}

#[test]
fn exported_code_follows_a_schedule_of_overrides_as_the_function_blocks_do() {
    let overrides: OverrideSchedule = "80,0@500ms,60@700ms".parse().unwrap();
    let text = exported("B", None, true);
    assert_eq!(run("B", None, Some(&text), Some(overrides)), run("B", None, None, Some(overrides)));
}

/// Runs RC of Setup A by code in which `from` became `to`.
fn edited(directory: &Path, from: &str, to: &str) -> Finished {
    run_edited(directory, "rc", from, to)
}

/// Runs a type of Setup A by code in which `from` became `to`.
fn run_edited(directory: &Path, execution_type: &str, from: &str, to: &str) -> Finished {
    let text = exported("A", None, true);
    assert!(text.contains(from), "{from}");
    fs::create_dir_all(directory.join("kit")).unwrap();
    fs::write(directory.join("kit/skillbench.st"), text.replacen(from, to, 1)).unwrap();
    let run = [
        "--mode",
        "virtual",
        "--reps",
        "1",
        "--types",
        execution_type,
        "--quiet",
        "--plc-program",
        "kit",
        "--out",
        "run",
    ];
    bench(directory, run)
}

#[test]
fn a_mistake_in_edited_code_is_told_with_its_file_and_place_before_anything_runs() {
    let directory = tempfile::tempdir().unwrap();
    for (from, to, expected) in [
        ("was_start := start;", "was_start := repetitions;", "skillbench.st:"),
        ("was_start := start;", "was_start := start", "expected `;`"),
        (
            "    now_us : UDINT;\n    start : BOOL;",
            "    now_us : UINT;\n    start : BOOL;",
            "expected UDINT, found UINT",
        ),
        ("FUNCTION_BLOCK SB_Core", "FUNCTION_BLOCK SB_Kern", "function block `SB_Core` not found"),
    ] {
        let Finished { code, stdout, stderr } = edited(directory.path(), from, to);
        assert_eq!((code, stdout.as_str()), (Some(2), ""), "{stderr}");
        assert!(stderr.contains(expected), "{stderr}");
        assert!(!directory.path().join("run").exists(), "nothing is written");
    }
    let missing = bench(directory.path(), ["--mode", "virtual", "--plc-program", "nowhere"]);
    assert_eq!(missing.code, Some(2));
    assert!(
        missing.stderr.contains("name the directory that `plc-node export --for st` wrote"),
        "{}",
        missing.stderr
    );
}

#[test]
fn edited_code_that_goes_wrong_or_loops_for_ever_fails_the_run_with_file_line_and_scan() {
    for (to, reason) in [
        ("WHILE start OR NOT start DO was_start := start; END_WHILE;", "a loop does not end"),
        ("sample_us[UINT_TO_DINT(sample_count) + DINT#100] := 0;", "the index is outside the array"),
        ("remaining := remaining - UINT#1;", "the result is outside its type"),
    ] {
        let directory = tempfile::tempdir().unwrap();
        let Finished { code, stderr, .. } = edited(directory.path(), "was_start := start;", to);
        assert_eq!(code, Some(4), "{stderr}");
        assert!(
            stderr.contains("skillbench.st:") && stderr.contains(": scan ") && stderr.contains(reason),
            "{stderr}"
        );
    }
}

#[test]
fn edited_code_that_stops_in_a_run_fails_that_repetition_alone_and_the_robot_is_not_enabled_any_more() {
    let directory = tempfile::tempdir().unwrap();
    let to = "IF (mode = USINT#4) AND (group.f_executed = UDINT#5) THEN sample_count := sample_count - UINT#1; END_IF;";
    let Finished { code, stderr, .. } = edited(directory.path(), "was_start := start;", to);
    assert_eq!(code, Some(4), "{stderr}");
    assert!(stderr.contains("repetition rc 1 of 1 failed") && stderr.contains(": scan "), "{stderr}");
    let samples = fs::read_to_string(directory.path().join("run/samples.csv")).unwrap();
    assert!(samples.lines().last().unwrap().contains("skillbench.st:"), "{samples}");
}

#[test]
fn edited_code_that_stops_between_two_repetitions_fails_the_next_one_with_file_line_and_scan() {
    let directory = tempfile::tempdir().unwrap();
    let to = "was_start := start; IF done AND NOT start THEN remaining := remaining - UINT#1; END_IF;";
    let Finished { code, stderr, .. } = run_edited(directory.path(), "rc,cm", "was_start := start;", to);
    assert_eq!(code, Some(4), "{stderr}");
    assert!(stderr.contains("repetition cm 1 of 1 failed: cm failed"), "{stderr}");
    assert!(stderr.contains("skillbench.st:") && stderr.contains(": scan "), "{stderr}");
}

#[test]
fn code_that_sends_another_motion_is_found_by_the_comparison_with_the_plan() {
    let directory = tempfile::tempdir().unwrap();
    let from = "latched[index] := motions[first + index];\n    END_FOR;";
    let to = format!("{from}\n    latched[0] := latched[0] + UDINT#1;");
    let Finished { code, stderr, .. } = run_edited(directory.path(), "sm", from, &to);
    assert_eq!(code, Some(4), "{stderr}");
    assert!(stderr.contains("the PLC sent other motions"), "{stderr}");
}

#[test]
fn a_run_of_exported_code_keeps_the_code_and_runs_again_from_its_directory() {
    let directory = tempfile::tempdir().unwrap();
    let first = run_edited(directory.path(), "cm", "was_start := start;", "was_start := start; (* edited *)");
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    let kept = fs::read_to_string(directory.path().join("run/skillbench.st")).unwrap();
    assert!(kept.contains("(* edited *)"));
    assert_eq!(plc_export::FILE, records::occupied::PROGRAM);
    // Whoever edits the code further still has that of the run.
    fs::remove_dir_all(directory.path().join("kit")).unwrap();
    let again = bench(
        directory.path(),
        [
            "--setup",
            "run/setup.toml",
            "--mode",
            "virtual",
            "--reps",
            "1",
            "--types",
            "cm",
            "--quiet",
            "--plc-program",
            "run",
            "--out",
            "again",
        ],
    );
    assert_eq!(again.code, Some(0), "{}", again.stderr);
    let samples = |run: &str| fs::read_to_string(directory.path().join(run).join("samples.csv")).unwrap();
    assert_eq!(samples("run"), samples("again"));
}
