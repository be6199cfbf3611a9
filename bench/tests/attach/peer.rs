//! `bench doctor --peer` on real networks, with our own nodes as the foreign ends.

use std::process::{Command, Stdio};

use protocol_linux::namespace::NetworkNamespace;
use serde_json::Value;

use crate::stations::Node;
use crate::{bench, cable};

/// Two hosts and the cable between them.
struct DirectCable([NetworkNamespace; 2]);

impl DirectCable {
    fn new() -> Self {
        let ends = [(); 2].map(|()| NetworkNamespace::new().unwrap());
        cable((&ends[0], "eth0", None), (&ends[1], "eth0", None));
        Self(ends)
    }

    fn command(&self, end: usize, arguments: &[&str]) -> Command {
        let mut command = bench();
        command.args(arguments).args(["--interface", "eth0"]);
        command.env_remove("STATE_DIRECTORY").env("XDG_STATE_HOME", "/dev/null").stdout(Stdio::piped());
        self.0[end].confine(&mut command).unwrap();
        command
    }

    /// Looks at a peer and returns the exit code with the steps.
    fn doctor(&self, end: usize, role: &str, setup: &str) -> (Option<i32>, Vec<Value>) {
        let output =
            self.command(end, &["doctor", "--setup", setup, "--peer", role, "--json"]).output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let steps = serde_json::from_str(&text);
        (output.status.code(), steps.unwrap_or_else(|error| panic!("{error}: {text}")))
    }
}

#[track_caller]
fn found<'a>(steps: &'a [Value], what: &str) -> (&'a str, &'a str) {
    let step = steps.iter().find(|step| step["what"] == what);
    let step = step.unwrap_or_else(|| panic!("no {what} in {steps:#?}"));
    (step["verdict"].as_str().unwrap(), step["found"].as_str().unwrap())
}

pub(crate) fn the_doctor_sees_every_step_of_a_robot_that_runs_on_each_bus() {
    for setup in ["A", "B", "C"] {
        let wire = DirectCable::new();
        let mut robot = Node::start(wire.command(1, &["__robot-node", "run", "--setup", setup]));
        robot.read_to(if setup == "A" { "IO-Device" } else { "robot" });
        let (code, steps) = wire.doctor(0, "robot", setup);
        assert_eq!(code, Some(0), "{setup}: {steps:#?}");
        assert!(found(&steps, "state").1.starts_with("Halted"), "{steps:#?}");
        if setup == "A" {
            let (verdict, modules) = found(&steps, "plugged modules");
            assert!(verdict == "good" && modules.contains("slot 1 0x00000100"), "{modules}");
            assert!(found(&steps, "version").1.contains("firmware V"), "{steps:#?}");
        }
        if setup == "B" {
            let (verdict, sizes) = found(&steps, "assembly sizes");
            assert!(verdict == "good" && sizes.contains("assembly 150 (command) has 256 bytes"), "{sizes}");
        }
        let said = robot.end();
        assert!(!said.iter().any(|line| line.contains("command ")), "nothing was commanded: {said:#?}");
    }
}

pub(crate) fn the_doctor_names_assemblies_whose_size_or_number_is_not_that_of_the_setup() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("other.toml");
    // The image, and 8 bytes more; and an assembly that our robot does not have.
    let adapter = "[bus.ethernet_ip.adapter]\nconsumed_assembly = 150\nconsumed_bytes = 264\n\
                   produced_assembly = 101\nproduced_bytes = 256\n";
    let setup = include_str!("../../../cell/setups/B.toml");
    std::fs::write(&path, format!("{setup}\n{adapter}")).unwrap();
    let wire = DirectCable::new();
    let mut robot = Node::start(wire.command(1, &["__robot-node", "run", "--setup", "B"]));
    robot.read_to("robot");
    let (code, steps) = wire.doctor(0, "robot", path.to_str().unwrap());
    assert_eq!((code, found(&steps, "assembly sizes").0), (Some(5), "missing"), "{steps:#?}");
    let said = found(&steps, "assembly sizes").1;
    assert!(said.contains("assembly 150 (command) has 256 bytes, the setup 264"), "{said}");
    assert!(said.contains("no assembly 101 (feedback)"), "{said}");
    robot.end();
}

pub(crate) fn the_doctor_sees_every_step_of_a_plc_up_to_its_first_command_on_each_bus() {
    for setup in ["A", "B", "C"] {
        let wire = DirectCable::new();
        let plc = Node::start(wire.command(0, &["__plc-node", "run", "--setup", setup]));
        let (code, steps) = wire.doctor(1, "plc", setup);
        assert_eq!(code, Some(0), "{setup}: {steps:#?}");
        assert_eq!(found(&steps, "first command").0, "good", "{steps:#?}");
        plc.end();
    }
}

pub(crate) fn the_doctor_names_the_first_step_that_a_missing_peer_lacks() {
    for (setup, first) in [("A", "name"), ("B", "address"), ("C", "identity")] {
        let wire = DirectCable::new();
        let (code, steps) = wire.doctor(0, "robot", setup);
        assert_eq!((code, found(&steps, first).0), (Some(5), "not-seen"), "{setup}: {steps:#?}");
        assert_eq!(found(&steps, "link").0, "good");
    }
}
