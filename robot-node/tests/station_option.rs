//! `robot-node run` is one station of a setup with several, and refuses what does not fit before it opens an interface.

#![cfg(all(feature = "real", target_os = "linux"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::process::Command;

/// Runs the node of a setup with these options; returns its exit code and what it says. Its interface does not exist.
fn run(setup: &str, more: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_robot-node"));
    command.args(["run", "--setup", setup, "--interface", "nosuch0"]).args(more);
    let output = command.output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn a_setup_of_several_robots_needs_the_name_of_one_of_them() {
    for (more, reason) in [
        (&[][..], "setup E has 2 robots: choose one with --station left or --station right"),
        (&["--station", "rigth"], "setup E has no station `rigth`: did you mean `right`?"),
        (&["--station", "middle"], "setup E has no station `middle`: there is left, right"),
        (&["--station", "left", "--direct"], "setup E has several stations: leave --direct out"),
        (
            &["--station", "left", "--application", "gluing"],
            "setup E has several stations with applications of their own: leave --application out",
        ),
    ] {
        let (code, said) = run("E", more);
        assert!(code == Some(2) && said.contains(reason), "{more:?}: {code:?}: {said}");
    }
}

/// Writes a setup in which both robots of F are on EtherCAT into a directory.
fn line(directory: &Path) -> PathBuf {
    let (mut cell, _) = setup::cell("F").unwrap();
    cell.stations[0].bus = cell.stations[1].bus.clone();
    let path = directory.join("line.toml");
    std::fs::write(&path, setup::cell_to_toml(&cell).unwrap()).unwrap();
    path
}

#[test]
fn a_robot_that_leads_on_to_another_one_of_an_ethercat_line_needs_two_ports() {
    let place = tempfile::tempdir().unwrap();
    let path = line(place.path());
    let setup = path.to_str().unwrap();
    let (code, said) = run(setup, &["--station", "left"]);
    assert_eq!(code, Some(5), "its interface does not exist: {said}");
    let node = |interface: &str, station: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_robot-node"));
        command.args(["run", "--setup", setup, "--station", station, "--interface", interface]);
        let output = command.output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    // The loopback interface exists everywhere.
    let cases = [
        ("lo", "left", "station left leads on to station right of the EtherCAT line: give it two interfaces"),
        ("lo,lo", "left", "interface lo is both ports of the SubDevice"),
        ("lo,lo", "right", "interface lo is both ports of the SubDevice"),
    ];
    for (interface, station, reason) in cases {
        let (code, said) = node(interface, station);
        assert!(code == Some(2) && said.contains(reason), "{interface} {station}: {code:?}: {said}");
    }
}

#[test]
fn a_station_looks_for_its_own_interface_and_a_setup_of_one_robot_needs_no_name() {
    for (setup, station) in [("E", "left"), ("E", "right"), ("F", "right"), ("A", "robot")] {
        let (code, said) = run(setup, &["--station", station]);
        assert!(
            code == Some(5) && said.contains("there is no network interface `nosuch0`"),
            "{code:?}: {said}"
        );
    }
    let (code, said) = run("A", &["--station", "left"]);
    assert!(
        code == Some(2) && said.contains("setup A has no station `left`: there is robot"),
        "{code:?}: {said}"
    );
}
