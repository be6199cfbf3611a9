//! `plc-node export --station`: the code of one station of a cell, and what it cannot have.
#![cfg(all(feature = "real", target_os = "linux"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::Command;

/// Exports with these options; returns the exit code, the messages, and whether the directory was written.
fn export(place: &Path, options: &[&str]) -> (Option<i32>, String, bool) {
    let out = place.join("kit");
    let _ = std::fs::remove_dir_all(&out);
    let mut command = Command::new(env!("CARGO_BIN_EXE_plc-node"));
    command.args(["export", "--for", "st"]).args(options).arg("--out").arg(&out);
    let output = command.output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap(), out.exists())
}

/// Writes Setup E with robot and application of Setup A at one station and of B at the other, and returns its path.
fn each_with_its_own(place: &Path) -> String {
    let (mut cell, _) = setup::cell("E").unwrap();
    cell.application = None;
    for (station, name) in cell.stations.iter_mut().zip(["A", "B"]) {
        let alone = setup::setup(name).unwrap();
        (station.application, station.robot, station.motions) =
            (alone.application, alone.robot, alone.motions);
    }
    let path = place.join("own.toml");
    std::fs::write(&path, setup::cell_to_toml(&cell).unwrap()).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn the_code_of_a_station_that_works_alone_is_that_of_its_robot_alone() {
    let place = tempfile::tempdir().unwrap();
    let own = each_with_its_own(place.path());
    let (code, said, is_written) = export(place.path(), &["--setup", &own, "--station", "left"]);
    assert_eq!((code, is_written), (Some(0), true), "{said}");
    assert!(said.contains("13 motions in ") && said.contains("commands this robot alone"), "{said}");
}

#[test]
fn a_station_that_waits_for_others_and_a_cell_without_a_chosen_station_are_refused() {
    let place = tempfile::tempdir().unwrap();
    for (options, reasons) in [
        (
            &["--setup", "E", "--station", "left"][..],
            ["E-left waits for other arms at mark 1", "are not exported"],
        ),
        (
            &["--setup", "F", "--station", "right"],
            ["F-right waits for other arms at mark 1", "are not exported"],
        ),
        (&["--setup", "G", "--station", "left"], ["G-left waits for ", "are not exported"]),
        (&["--setup", "E"], ["setup E has 2 robots", "--station left or --station right"]),
        (&["--setup", "E", "--station", "middle"], ["no station `middle`", "left, right"]),
    ] {
        let (code, said, is_written) = export(place.path(), options);
        assert_eq!((code, is_written), (Some(2), false), "{said}");
        assert!(reasons.iter().all(|reason| said.contains(reason)), "{said}");
    }
}
