//! `robot-node export` as a program: what it writes, and what it refuses without writing anything.
#![cfg(all(feature = "real", target_os = "linux"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the files of an export are what is tested")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Runs the export with these options; returns its exit code and its messages.
fn export(options: &[&str], out: &Path) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_robot-node"));
    command.arg("export").args(options).arg("--out").arg(out);
    let output = command.output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

/// Returns name and text of each file.
fn contents(directory: &Path) -> BTreeMap<String, String> {
    let entries = fs::read_dir(directory).unwrap().map(|entry| entry.unwrap());
    entries
        .map(|entry| (entry.file_name().into_string().unwrap(), fs::read_to_string(entry.path()).unwrap()))
        .collect()
}

#[test]
fn an_export_goes_into_a_new_or_an_empty_directory_and_two_are_equal() {
    let directory = tempfile::tempdir().unwrap();
    for (maker, files) in [
        ("kuka", ["SB_DATA.dat", "SB_MAIN.src", "SB_SIGNALS.dat", "SB_SUBMIT.sub"]),
        ("abb", ["EIO.cfg", "SB_Cyclic.mod", "SB_Motion.mod", "SB_Shared.sys"]),
    ] {
        let [new, empty] = ["new", "empty"].map(|name| directory.path().join(format!("{maker}-{name}")));
        fs::create_dir(&empty).unwrap();
        for out in [&new, &empty] {
            let (code, message) = export(&["--for", maker, "--setup", "A"], out);
            assert!(code == Some(0) && message.contains("13 motions in "), "{code:?}: {message}");
        }
        let written = contents(&new);
        assert_eq!(written.keys().collect::<Vec<_>>(), files);
        assert_eq!(written, contents(&empty));
        let (code, message) = export(&["--for", maker, "--setup", "A"], &new);
        assert!(
            code == Some(2) && message.contains("not empty; name a new or an empty directory"),
            "{message}"
        );
        assert_eq!(written, contents(&new), "the files of before are left alone");
    }
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 4);
}

#[test]
fn what_cannot_be_exported_is_refused_in_words_and_nothing_is_written() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("kit");
    for (options, reasons) in [
        (&["--for", "fanuc", "--setup", "A"][..], &["invalid value 'fanuc'", "kuka, abb"][..]),
        (&["--for", "abb", "--setup", "nowhere"], &["nowhere"]),
        (&["--for", "abb", "--setup", "A", "--application", "nothing"], &["nothing"]),
        (
            &["--for", "abb", "--setup", "A", "--application", "gluing"],
            &[
                "motion 14 of program 1: RAPID has no SPLINE; plan lines and circles in its place, or export for kuka",
            ],
        ),
        (
            &["--for", "kuka", "--setup", "A", "--application", "insertion-with-force"],
            &["motion 9 of program 1: KRL has no LIN force; leave the force step out"],
        ),
    ] {
        let (code, message) = export(options, &out);
        assert_eq!(code, Some(2), "{options:?}: {message}");
        for reason in reasons {
            assert!(message.contains(reason), "{options:?}: {message}");
        }
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0, "{options:?}");
    }
}

#[test]
fn a_station_of_a_cell_is_exported_with_a_program_for_each_section_between_its_waits() {
    let directory = tempfile::tempdir().unwrap();
    for (setup, station, maker, programs) in
        [("E", "left", "kuka", "programs 1 to "), ("G", "right", "abb", "programs 1 to ")]
    {
        let out = directory.path().join(format!("{setup}-{station}"));
        let (code, message) = export(&["--for", maker, "--setup", setup, "--station", station], &out);
        assert!(code == Some(0) && message.contains(programs), "{code:?}: {message}");
        assert!(message.contains("between them the arm waits for others"), "{message}");
        assert!(!contents(&out).is_empty());
    }
}

#[test]
fn an_export_of_a_cell_without_a_station_or_with_a_wrong_one_names_the_stations() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("kit");
    for (options, reason) in [
        (&["--setup", "E"][..], "setup E has 2 robots: choose one with --station left or --station right"),
        (&["--setup", "E", "--station", "middle"], "setup E has no station `middle`: there is left, right"),
        (&["--setup", "A", "--station", "left"], "setup A has no station `left`"),
        (&["--setup", "E", "--station", "left", "--application", "gluing"], "leave --application out"),
    ] {
        let (code, message) = export(&[&["--for", "kuka"], options].concat(), &out);
        assert!(code == Some(2) && message.contains(reason), "{code:?}: {message}");
        assert!(!out.exists());
    }
}
