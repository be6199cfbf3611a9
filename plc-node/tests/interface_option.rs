//! `plc-node run` refuses interfaces that do not fit the buses of its setup before it opens one.

#![cfg(all(feature = "real", target_os = "linux"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::process::Command;

/// Runs the node of a setup; returns its exit code and what it says.
fn run(setup: &str, interface: &str) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plc-node"));
    let output = command.args(["run", "--setup", setup, "--interface", interface]).output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn an_interface_for_a_bus_that_the_setup_does_not_have_is_refused() {
    for (setup, bus, wrong) in
        [("A", "profinet", "ethernet-ip"), ("B", "ethernet-ip", "ethercat"), ("C", "ethercat", "profinet")]
    {
        // No interface of this name exists, and nobody looks for it.
        let (code, said) = run(setup, &format!("{wrong}=nosuch0,{bus}=nosuch1"));
        let reason = format!("the setup has no {wrong} bus, only {bus}: leave {wrong}=IF out of --interface");
        assert!(code == Some(2) && said.contains(&reason), "{code:?}: {said}");
        let (code, said) = run(setup, &format!("{bus}=nosuch0,{bus}=nosuch1"));
        assert!(
            code == Some(2) && said.contains(&format!("bus {bus} has two interfaces")),
            "{code:?}: {said}"
        );
        let (code, said) = run(setup, &format!("{bus}=nosuch0"));
        assert!(
            code != Some(2) && said.contains("there is no network interface `nosuch0`"),
            "{code:?}: {said}"
        );
    }
}

#[test]
fn a_bus_of_several_stations_that_has_no_interface_is_named() {
    let (code, said) = run("E", "profinet=nosuch0");
    let reason = "bus ethernet-ip of the setup has no interface: add ethernet-ip=IF to --interface";
    assert!(code == Some(2) && said.contains(reason), "{code:?}: {said}");
    let (code, said) = run("F", "profinet=nosuch0,ethernet-ip=nosuch1");
    let reason = "the setup has no ethernet-ip bus, only profinet and ethercat";
    assert!(code == Some(2) && said.contains(reason), "{code:?}: {said}");
    let (code, said) = run("F", "lo");
    let reason = "bus ethercat shares interface lo with bus profinet: give it an interface of its own";
    assert!(code == Some(2) && said.contains(reason), "{code:?}: {said}");
}
