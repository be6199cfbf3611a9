//! Arguments of every verb follow the same rules.

use std::fs;

use crate::program::bench;

fn refused(arguments: &[&str]) -> String {
    let directory = tempfile::tempdir().unwrap();
    let finished = bench(directory.path(), arguments);
    assert_eq!((finished.code, finished.stdout.as_str()), (Some(2), ""), "{}", finished.stderr);
    finished.stderr.lines().next().unwrap().to_owned()
}

#[test]
fn a_negative_number_is_out_of_range_and_not_an_unknown_option() {
    insta::assert_snapshot!(refused(&["--reps", "-1"]), @"error: invalid value '-1' for '--reps <N>': -1 is not in 1..=100000");
    insta::assert_snapshot!(refused(&["--override", "-5"]), @"error: invalid value '-5' for '--override <PERCENT[@TIME],...>': `-5`: an override of -5 % was asked for; it is 0 (the arm stops on its path) to 100 %");
    insta::assert_snapshot!(refused(&["sweep", "--lengths", "5", "-1"]), @"error: invalid value '-1' for '--lengths <MM>...': a length is 0.01 to 10000 mm");
    insta::assert_snapshot!(refused(&["sweep", "--lengths", "0.0001"]), @"error: invalid value '0.0001' for '--lengths <MM>...': a length is 0.01 to 10000 mm");
}

#[cfg(feature = "real")]
#[test]
fn every_option_that_takes_several_values_takes_commas_and_blanks_and_names_the_wrong_value() {
    insta::assert_snapshot!(refused(&["timing", "--buses", "ethercat, profinet"]), @"error: invalid value 'ethercat, profinet' for '--buses <BUS>...': there is no bus `profinet`; the buses are profinet-udp, profinet-rt1, ethernet-ip and ethercat");
    insta::assert_snapshot!(refused(&["--types", "rc", "cn"]), @"error: invalid value 'cn' for '--types <TYPE>...': there is no execution type `cn`: rc runs the robot's program, sm single motions, cm one MoveContinuousSkill");
    let law = refused(&["judge", "--ignore", "finite jump"]);
    assert!(law.contains("there is no law `jump`; the laws are finite, range, "), "{law}");
}

#[test]
fn a_list_of_motions_that_the_disk_does_not_take_is_no_wrong_argument() {
    let directory = tempfile::tempdir().unwrap();
    let written = |file| bench(directory.path(), ["long", "--motions", "100", "--write", file]);
    let full = written("/dev/full");
    assert_eq!(full.code, Some(1), "{}", full.stderr);
    insta::assert_snapshot!(full.stderr, @"error: cannot write /dev/full: No space left on device (os error 28)");
    assert_eq!(written("list").code, Some(0));
    assert_eq!(fs::read_to_string(directory.path().join("list")).unwrap().lines().count(), 101);
}

#[cfg(feature = "real")]
#[test]
fn a_device_in_place_of_a_file_is_refused_before_it_is_read() {
    let directory = tempfile::tempdir().unwrap();
    let device = "/dev/zero";
    std::os::unix::fs::symlink(device, directory.path().join("path.csv")).unwrap();
    for arguments in [
        &["--mode", "virtual", "--setup", device][..],
        &["--mode", "virtual", "--application", device],
        &["judge", "--case", device],
        &["study", "run", device],
        &["gate", "--baseline", device],
        &["import-samples", device],
        &["trajectory", "path.csv"],
        &["long", "--motions", "3", "--from", device],
        &["--attach", "plc=127.0.0.1:9", "--control-token", device],
    ] {
        let finished = bench(directory.path(), arguments);
        let said = &finished.stderr;
        assert!(
            said.contains("is a pipe or a device") || said.contains("would replace"),
            "{arguments:?}: {said}"
        );
        assert!(finished.code.is_some_and(|code| code == 2 || code == 1), "{arguments:?}: {said}");
    }
}

#[test]
fn control_characters_of_an_argument_are_shown_and_not_sent_to_the_terminal() {
    let directory = tempfile::tempdir().unwrap();
    for arguments in [
        &["--mode", "virtual", "--setup", "\u{1b}[31mA.toml"][..],
        &["--reps", "\u{1b}]0;title\u{7}"],
        &["--fault", "\u{1b}[2J"],
        &["report", "\u{1b}[31m"],
        &["\u{1b}[31m"],
    ] {
        let finished = bench(directory.path(), arguments);
        let said = format!("{}{}", finished.stdout, finished.stderr);
        assert!(said.contains("\\u001b"), "{arguments:?}: {said}");
        assert!(!said.contains('\u{1b}') && !said.contains('\u{7}'), "{arguments:?}: {said:?}");
        assert_eq!(finished.code, Some(2), "{said}");
    }
}

#[cfg(feature = "real")]
#[test]
fn a_limit_of_a_files_size_ends_a_run_with_an_error_and_not_with_a_signal() {
    let directory = tempfile::tempdir().unwrap();
    let script = format!(
        "ulimit -f 16; {} --mode virtual --types cm --reps 100 --quiet --without report,race,traces --out run",
        env!("CARGO_BIN_EXE_bench")
    );
    let output = std::process::Command::new("bash")
        .args(["-c", &script])
        .current_dir(directory.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("File too large"), "{said}");
    let samples = fs::read_to_string(directory.path().join("run/samples.csv")).unwrap();
    assert!(samples.ends_with('\n'), "half a line is left");
}
