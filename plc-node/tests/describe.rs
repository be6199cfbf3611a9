//! `plc-node describe` and files of `plc-node io`: what goes to which stream, and how a refused file ends.

#![expect(clippy::unwrap_used, reason = "a helper of a test may panic as the test may")]

use std::process::{Command, Output};

fn describe(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plc-node")).arg("describe").args(arguments).output().unwrap()
}

#[test]
fn the_json_of_a_file_has_its_version_name_and_format() {
    let directory = tempfile::tempdir().unwrap();
    for ((name, text), format) in devices::files().into_iter().zip(["eds", "gsdml", "esi"]) {
        let path = directory.path().join(&name);
        std::fs::write(&path, text).unwrap();
        let output = describe(&["--json", path.to_str().unwrap()]);
        assert_eq!((output.status.code(), output.stderr.len()), (Some(0), 0));
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(json["schema_version"], 1);
        assert_eq!(json["file"], name);
        assert_eq!(json["device"]["format"], format);
    }
}

#[test]
fn a_file_that_is_refused_prints_the_reason_alone() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.eds");
    std::fs::write(&path, "[FileInfo]\n[DeviceInfo]\n").unwrap();
    let output = describe(&[path.to_str().unwrap()]);
    assert!(output.stdout.is_empty() && output.status.code() == Some(2));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("a.eds:0: file: an EDS of CANopen; expected one of EtherNet/IP"), "{said}");
    assert_eq!(describe(&["no-such-file.xml"]).status.code(), Some(2));
}

#[test]
fn a_script_or_choice_that_is_not_text_ends_with_the_exit_code_of_usage_and_its_byte() {
    let directory = tempfile::tempdir().unwrap();
    let (name, text) = devices::files().into_iter().find(|(name, _)| name.ends_with(".eds")).unwrap();
    let [device, other] = [name.as_str(), "other.toml"].map(|name| directory.path().join(name));
    std::fs::write(&device, text).unwrap();
    std::fs::write(&other, b"# \xE9").unwrap();
    for option in ["--script", "--config"] {
        let output = Command::new(env!("CARGO_BIN_EXE_plc-node"))
            .args(["io", "--interface", "lo", "--at", "127.0.0.1", "--device"])
            .args([device.as_path(), option.as_ref(), &other])
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains("other.toml: byte 2 is not UTF-8; save the file as UTF-8 text"), "{said}");
        assert_eq!(output.status.code(), Some(2), "{said}");
    }
}
