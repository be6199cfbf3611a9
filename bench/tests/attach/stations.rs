//! Who is at the other end: a PLC and two robots on one switch, each a node in a network of its own.

use std::io::{BufRead as _, BufReader, Lines};
use std::process::{Child, ChildStdout, Command, Stdio};

use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Interface, bridge};
use rustix::process::{Pid, Signal, kill_process};

use crate::{bench, cable};

const OLD: &str = "old-robot";
/// The address of the robot in Setup A.
const ROBOT: &str = "192.168.64.2/24";

/// A switch with four ends: the PLC, two robots and a stranger.
pub(crate) struct TestSwitch {
    network: NetworkNamespace,
    pub(crate) ends: [NetworkNamespace; 4],
}

fn ip(network: &NetworkNamespace, arguments: &str) {
    let mut command = Command::new("ip");
    command.args(arguments.split(' '));
    network.confine(&mut command).unwrap();
    assert!(command.status().unwrap().success(), "ip {arguments}");
}

impl TestSwitch {
    pub(crate) fn new() -> Self {
        let network = NetworkNamespace::new().unwrap();
        let open = |name: &str| Interface::open(name).unwrap();
        network.run(|| bridge::new("br0")).unwrap().unwrap();
        network.run(|| open("br0").set_up()).unwrap().unwrap();
        let ends = [(); 4].map(|()| NetworkNamespace::new().unwrap());
        for (end, name) in ends.iter().zip(["s0", "s1", "s2", "s3"]) {
            cable((&network, name, None), (end, "eth0", None));
            network.run(|| bridge::add_port(&open("br0"), &open(name))).unwrap().unwrap();
        }
        Self { network, ends }
    }

    /// Starts a node at an end of the switch, with a setup file.
    pub(crate) fn node(&self, end: usize, name: &str, setup: &str, more: &[&str]) -> Node {
        let mut command = self.command(end, name, setup, "eth0");
        command.args(more);
        Node::start(command)
    }

    /// Returns the command that starts a node at an end of the switch.
    pub(crate) fn command(&self, end: usize, name: &str, setup: &str, interface: &str) -> Command {
        let mut command = bench();
        command.args([name, "run", "--setup", setup, "--interface", interface]);
        command.env_remove("STATE_DIRECTORY").env("XDG_STATE_HOME", "/dev/null").stdout(Stdio::piped());
        self.ends[end].confine(&mut command).unwrap();
        command
    }
}

/// A running node.
pub(crate) struct Node {
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Node {
    /// Starts a node by a command whose output is piped.
    pub(crate) fn start(mut command: Command) -> Self {
        let mut child = command.spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        Self { child, lines }
    }

    /// Reads up to a line with this text and returns all lines so far.
    #[track_caller]
    pub(crate) fn read_to(&mut self, text: &str) -> Vec<String> {
        let mut read = Vec::new();
        for line in self.lines.by_ref().map_while(Result::ok) {
            read.push(line);
            if read.last().is_some_and(|line| line.contains(text)) {
                return read;
            }
        }
        panic!("there is no `{text}` in {read:#?}");
    }

    /// Ends the node and returns the lines that were not read.
    pub(crate) fn end(mut self) -> Vec<String> {
        let _ = kill_process(Pid::from_child(&self.child), Signal::TERM);
        let lines = self.lines.by_ref().map_while(Result::ok).collect();
        let _ = self.child.wait();
        lines
    }
}

/// Writes Setup A with another name of the robot.
fn setup(place: &tempfile::TempDir, file: &str, name: &str) -> String {
    let built_in =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../cell/setups/A.toml")).unwrap();
    let path = place.path().join(file);
    std::fs::write(&path, built_in.replace("\"skillbench-robot\"", &format!("\"{name}\""))).unwrap();
    path.to_str().unwrap().to_owned()
}

pub(crate) fn a_robot_that_kept_the_address_of_another_one_is_not_connected_to() {
    let place = tempfile::tempdir().unwrap();
    let (old, new) = (setup(&place, "old.toml", OLD), setup(&place, "new.toml", "arm-7"));
    for cyclic in ["udp", "rt1"] {
        let switch = TestSwitch::new();
        ip(&switch.ends[1], &format!("addr add {ROBOT} dev eth0"));
        let mut old_robot = switch.node(1, "__robot-node", &old, &[]);
        old_robot.read_to("IO-Device");
        let mut new_robot = switch.node(2, "__robot-node", &new, &[]);
        new_robot.read_to("IO-Device");
        let mut plc = switch.node(0, "__plc-node", &new, &["--cyclic", cyclic]);
        let line = plc.read_to("not connected").pop().unwrap();
        assert!(line.contains("another station has this IP address: 192.168.64.2"), "{line}");
        let mac =
            |end: usize| switch.ends[end].run(|| Interface::open("eth0").unwrap().mac().to_string()).unwrap();
        assert!(line.contains(&mac(1)) && line.contains(&mac(2)), "{line}");
        // The old one is switched off: the PLC goes on with the right one.
        let untouched = old_robot.end();
        ip(&switch.network, "link set s1 down");
        plc.read_to("connected");
        new_robot.read_to("connected");
        plc.end();
        new_robot.end();
        assert!(!untouched.iter().any(|line| line == "connected"), "{untouched:?}");
    }
}

pub(crate) fn a_stranger_that_takes_the_address_of_the_robot_is_named_by_both_nodes() {
    let place = tempfile::tempdir().unwrap();
    let new = setup(&place, "new.toml", "arm-7");
    let switch = TestSwitch::new();
    let mut robot = switch.node(1, "__robot-node", &new, &[]);
    robot.read_to("IO-Device");
    let mut plc = switch.node(0, "__plc-node", &new, &["--reps", "1000"]);
    plc.read_to("robot ready");
    ip(&switch.ends[3], "addr add 192.168.64.2/24 dev eth0");
    // Its first question to another station claims the address.
    let ask = || std::net::UdpSocket::bind("192.168.64.2:0")?.send_to(b"?", "192.168.64.77:9");
    switch.ends[3].run(ask).unwrap().unwrap();
    let mac = switch.ends[3].run(|| Interface::open("eth0").unwrap().mac().to_string()).unwrap();
    for node in [&mut plc, &mut robot] {
        let warning = node.read_to("warning: another station has the IP address 192.168.64.2").pop().unwrap();
        assert!(warning.contains(&mac), "{warning}");
    }
    plc.end();
    robot.end();
}
