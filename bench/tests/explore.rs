//! `bench explore`: every run with one fault ends as without it, later, or with a reason, and can be run again.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::process::Command;

fn bench(args: &[&str]) -> (Option<i32>, String) {
    let place = tempfile::tempdir().unwrap();
    let output =
        Command::new(env!("CARGO_BIN_EXE_bench")).args(args).current_dir(place.path()).output().unwrap();
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
    (output.status.code(), text)
}

#[test]
fn no_single_fault_lets_an_altered_run_pass_on_any_bus() {
    for setup in ["A", "B", "C"] {
        let (code, said) = bench(&["explore", "--setup", setup, "--types", "cm", "--every", "97", "--quiet"]);
        assert_eq!(code, Some(0), "{said}");
        let rows: Vec<Vec<&str>> = said
            .lines()
            .filter(|line| line.trim_start().starts_with("CM"))
            .map(|line| line.split_whitespace().collect())
            .collect();
        assert_eq!(rows.len(), 3, "{said}");
        for row in rows {
            assert_eq!(row[row.len() - 2..], ["0", "0"], "altered and panicked: {said}");
        }
    }
}

#[test]
fn the_first_frame_of_a_connection_that_is_lost_is_sent_again_and_the_fault_can_be_asked_for() {
    let (code, said) = bench(&[
        "--mode",
        "virtual",
        "--types",
        "cm",
        "--reps",
        "1",
        "--fault",
        "to-robot:lose-frame=1",
        "--quiet",
    ]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("Faults put in (to-robot:lose-frame=1): 1 frames lost, 0 twice"), "{said}");
    let (code, said) = bench(&["--mode", "virtual", "--fault", "lose-frame=1"]);
    assert_eq!(code, Some(2), "{said}");
}
