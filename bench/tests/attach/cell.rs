//! Setup E on a real network: a PLC with two robots, one over PROFINET and one over EtherNet/IP, on one switch.

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};

use protocol_linux::namespace::NetworkNamespace;
use rustix::process::{Pid, Signal, kill_process};

use crate::stations::{Node, TestSwitch};
use crate::{TOKEN, bench, cable, results, text};

const STATIONS: [&str; 2] = ["left", "right"];
/// Both buses of the PLC are on its one interface.
const BOTH_BUSES: &str = "profinet=eth0,ethernet-ip=eth0";

/// Starts both robots, each at an end of its own.
fn robots(switch: &TestSwitch) -> [Node; 2] {
    let start = |end, station| switch.node(end, "__robot-node", "E", &["--station", station]);
    [start(1, STATIONS[0]), start(2, STATIONS[1])]
}

pub(crate) fn two_robots_on_two_buses_and_one_switch_work_with_one_plc() {
    let switch = TestSwitch::new();
    let robots = robots(&switch);
    let mut plc = switch.command(0, "__plc-node", "E", BOTH_BUSES);
    plc.args(["--reps", "1", "--types", "cm"]).stdin(Stdio::null()).stderr(Stdio::piped());
    let output = plc.spawn().unwrap().wait_with_output().unwrap();
    let (said, error) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(0), "{said}{error}");
    for station in STATIONS {
        let connected = format!("{station}: connected");
        assert!(said.lines().any(|line| line == connected), "`{connected}` in {said}");
        let finished = format!("{station}: cm ");
        assert_eq!(said.lines().filter(|line| line.starts_with(&finished)).count(), 1, "{said}");
    }
    // What happens to the whole PLC names no station.
    for line in ["robot ready", "cm started"] {
        assert!(said.lines().any(|one| one == line), "`{line}` in {said}");
    }
    for robot in robots {
        let said = robot.end();
        assert!(said.iter().any(|line| line == "connected"), "{said:?}");
        assert!(said.iter().any(|line| line.starts_with("command ")), "{said:?}");
    }
}

pub(crate) fn a_plc_that_sends_json_names_the_station_of_each_message() {
    let switch = TestSwitch::new();
    let [left, right] = robots(&switch);
    let mut plc = switch.command(0, "__plc-node", "E", BOTH_BUSES);
    let mut plc = plc.arg("--json").stdin(Stdio::piped()).spawn().unwrap();
    let mut instructions = plc.stdin.take().unwrap();
    let mut lines = BufReader::new(plc.stdout.take().unwrap()).lines();
    // Reads up to a message of this kind and returns it.
    let mut read_to = |kind: &str| {
        for line in lines.by_ref().map_while(Result::ok) {
            let message: serde_json::Value = serde_json::from_str(&line).unwrap();
            if line.contains(kind) {
                return message;
            }
        }
        panic!("no message has `{kind}`");
    };
    let mut up = [(); 2].map(|()| read_to("link_up")["station"].as_str().unwrap().to_owned());
    up.sort();
    assert_eq!(up, STATIONS);
    assert_eq!(read_to("\"ready\""), serde_json::json!({ "node": "ready" }));
    writeln!(instructions, r#"{{"node":{{"start":{{"execution_type":"cm"}}}}}}"#).unwrap();
    assert!(read_to("started").get("station").is_none());
    for station in STATIONS {
        let finished = read_to("finished");
        assert_eq!(finished["station"], station, "{finished}");
        assert!(finished["node"]["finished"]["motions"].as_u64().unwrap() > 0, "{finished}");
    }
    read_to("\"ready\"");
    right.end();
    let down = read_to("link_down");
    assert_eq!(down["station"], "right", "{down}");
    writeln!(instructions, r#"{{"node":{{"start":{{"execution_type":"cm"}}}}}}"#).unwrap();
    let failed = read_to("failed");
    assert_eq!(failed["station"], "right", "the reason is the robot that is not connected: {failed}");
    writeln!(instructions, "\"report\"").unwrap();
    assert!(read_to("\"report\"").get("station").is_none());
    writeln!(instructions, "\"stop\"").unwrap();
    assert_eq!(plc.wait().unwrap().code(), Some(0));
    left.end();
}

/// Setup E's right station as a robot on PROFINET: its end of another bus than the PLC's.
const RIGHT_ON_PROFINET: &str = "kind = \"profinet\"";
const ITS_SECTION: &str = "[station.bus.profinet]
cyclic = \"udp\"
plc_station_name = \"skillbench-plc\"
robot_station_name = \"skillbench-right\"

[station.robot]
";
/// An IO-Device of another vendor, and an adapter of another electronic key.
const OTHER_DEVICE: &str = "robot_station_name = \"skillbench-left\"

[station.bus.profinet.device]
vendor = 0x2A
device = 0x314
modules = [
  { slot = 0, ident = 1, submodules = [{ subslot = 1, ident = 1 }] },
  { slot = 1, ident = 0x22, submodules = [{ subslot = 1, ident = 1, input_bytes = 64, output_bytes = 64 }] },
]
";
const OTHER_ADAPTER: &str = "[station.bus.ethernet_ip.adapter]
consumed_assembly = 100
consumed_bytes = 64
produced_assembly = 101
produced_bytes = 64
key = { vendor = 1, device_type = 43, product_code = 7, major_revision = 1, minor_revision = 1 }

[station.robot]
";

/// Writes Setup E with parts of its right station, or of its left one, replaced.
fn other_e(place: &Path, file: &str, is_right: bool, replaced: &[(&str, &str)]) -> String {
    let e = setup::CELLS.iter().find(|(name, _)| *name == "E").unwrap().1;
    let right = e.find("name = \"right\"").unwrap();
    let (mut left, mut right) = (e[..right].to_owned(), e[right..].to_owned());
    let station = if is_right { &mut right } else { &mut left };
    for (before, after) in replaced {
        assert!(station.contains(before), "{before}");
        *station = station.replacen(before, after, 1);
    }
    let path = place.join(file);
    fs::write(&path, left + &right).unwrap();
    path.to_str().unwrap().to_owned()
}

pub(crate) fn a_robot_that_is_missing_or_another_than_described_is_named_and_the_other_arm_does_not_move() {
    let place = tempfile::tempdir().unwrap();
    let on_profinet = [("kind = \"ethernet-ip\"", RIGHT_ON_PROFINET), ("[station.robot]\n", ITS_SECTION)];
    let other_bus = other_e(place.path(), "other-bus.toml", true, &on_profinet);
    let name = "robot_station_name = \"skillbench-left\"\n";
    let other_device = other_e(place.path(), "other-device.toml", false, &[(name, OTHER_DEVICE)]);
    let other_adapter =
        other_e(place.path(), "other-adapter.toml", true, &[("[station.robot]\n", OTHER_ADAPTER)]);
    let no_adapter = "TCP port 44818 of the adapter does not answer";
    // The PLC's setup, that of the right robot, the station that is not connected, and why.
    let cases = [
        ("E", None, "right", no_adapter),
        ("E", Some(other_bus.as_str()), "right", no_adapter),
        (&other_device, Some("E"), "left", "the station of this name is another device than described"),
        (&other_adapter, Some("E"), "right", "the electronic key does not fit the device"),
    ];
    for (setup, right, missing, why) in cases {
        let switch = TestSwitch::new();
        let robot = |end, setup, station| {
            let mut robot = switch.node(end, "__robot-node", setup, &["--station", station]);
            robot.read_to(" on eth0 ");
            robot
        };
        let robots = [Some(robot(1, "E", STATIONS[0])), right.map(|setup| robot(2, setup, STATIONS[1]))];
        let mut plc = Node::start(switch.command(0, "__plc-node", setup, BOTH_BUSES));
        let mut said = plc.read_to(&format!("{missing}: not connected: "));
        assert!(said.last().unwrap().contains(why), "{said:?}");
        let other = if missing == "left" { "right" } else { "left" };
        if !said.iter().any(|line| *line == format!("{other}: connected")) {
            said.extend(plc.read_to(&format!("{other}: connected")));
        }
        // The PLC goes on to connect: longer than the other robot needs to be ready.
        said.extend(plc.read_to(&format!("{missing}: waited 10 s so far for the connection: ")));
        said.extend(plc.end());
        assert!(!said.iter().any(|line| line.contains("moving the arm")), "{said:?}");
        for robot in robots.into_iter().flatten() {
            let said = robot.end();
            assert!(!said.iter().any(|line| line.starts_with("command ")), "{said:?}");
        }
    }
}

/// The nodes of Setup E on a switch, and the network of their controllers.
struct Attachable {
    control: NetworkNamespace,
    /// The PLC, the left robot and the right one.
    nodes: [Child; 3],
    place: tempfile::TempDir,
    _switch: TestSwitch,
}

const ALL: &str = "plc=10.77.0.1:7700,left=10.77.1.1:7700,right=10.77.2.1:7700";

impl Attachable {
    fn start() -> Self {
        let (switch, control) = (TestSwitch::new(), NetworkNamespace::new().unwrap());
        let start = |end: u8, name: &str, interface: &str, station: &[&str]| {
            let of_control = format!("c{end}");
            let far = (&switch.ends[usize::from(end)], "control", Some([10, 77, end, 1]));
            cable(far, (&control, &of_control, Some([10, 77, end, 2])));
            let mut command = switch.command(end.into(), name, "E", interface);
            command.args(["--control", &format!("10.77.{end}.1:7700")]).args(station);
            command.env("SKILLBENCH_CONTROL_TOKEN", TOKEN).stdin(Stdio::null()).stdout(Stdio::null());
            command.spawn().unwrap()
        };
        let nodes = [
            start(0, "__plc-node", BOTH_BUSES, &[]),
            start(1, "__robot-node", "eth0", &["--station", "left"]),
            start(2, "__robot-node", "eth0", &["--station", "right"]),
        ];
        Self { control, nodes, place: tempfile::tempdir().unwrap(), _switch: switch }
    }

    fn measure(&self, run: &str, setup: &Path, attach: &str) -> Output {
        let mut command = bench();
        command.env("SKILLBENCH_CONTROL_TOKEN", TOKEN).arg("--setup").arg(setup);
        command.args(["--types", "cm", "--reps", "1", "--attach", attach, "--out"]);
        command.arg(self.place.path().join(run)).stdin(Stdio::null());
        self.control.confine(&mut command).unwrap();
        command.output().unwrap()
    }

    /// Measures and returns the exit code and the error.
    fn refused(&self, setup: &Path, attach: &str) -> (Option<i32>, String) {
        let output = self.measure("refused", setup, attach);
        (output.status.code(), text(&output.stderr))
    }
}

impl Drop for Attachable {
    fn drop(&mut self) {
        for node in &mut self.nodes {
            let _ = kill_process(Pid::from_child(node), Signal::TERM);
            let _ = node.wait();
        }
    }
}

pub(crate) fn a_bench_measures_on_the_nodes_of_a_cell_that_run_already() {
    let cell = Attachable::start();
    for run in ["first", "second"] {
        let output = cell.measure(run, Path::new("E"), ALL);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let results = results(cell.place.path(), run);
        assert_eq!((&results["schema_version"], &results["mode"]), (&2.into(), &"real".into()));
        assert_eq!(results["attached"]["robots"][1]["address"], "10.77.2.1:7700");
        let identity = |station: usize| results["attached"]["identities"][station].as_str().unwrap();
        assert!(identity(0).contains("VendorID 0x"), "{}", results["attached"]);
        assert!(identity(1).contains("serial number 0x"), "{}", results["attached"]);
        let table = text(&output.stdout).replace("\n ", "");
        assert!(table.contains("on the bus right is vendor"), "{table}");
        assert_eq!(results["results"]["cm"]["samples_ms"].as_array().unwrap().len(), 1);
    }
}

pub(crate) fn attached_nodes_of_a_cell_that_are_others_or_missing_are_named_before_anything_moves() {
    let mut cell = Attachable::start();
    let e = Path::new("E");
    let (code, error) = cell.refused(Path::new("F"), ALL);
    assert_eq!(code, Some(2), "{error}");
    assert!(error.contains("a plc-node of setup E, but a plc-node of setup F is needed"), "{error}");
    let exchanged = "plc=10.77.0.1:7700,right=10.77.1.1:7700,left=10.77.2.1:7700";
    let (code, error) = cell.refused(e, exchanged);
    assert_eq!(code, Some(2), "{error}");
    let other = "a robot-node of setup E-right, but a robot-node of setup E-left is needed";
    assert!(error.contains(other), "{error}");
    let (code, error) = cell.refused(e, "plc=10.77.0.1:7700,left=10.77.1.1:7700");
    assert_eq!((code, error.trim()), (Some(2), "error: station right has no address: add right=HOST:PORT"));
    let (code, error) = cell.refused(&changed(cell.place.path()), ALL);
    assert_eq!(code, Some(2), "{error}");
    let key = "in its setup, `station.right.robot.skill_overhead_us` is 38800";
    assert!(
        error.contains("the plc-node at 10.77.0.1:7700 runs another cell") && error.contains(key),
        "{error}"
    );
    // One of two robots is missing at the start.
    kill_process(Pid::from_child(&cell.nodes[2]), Signal::KILL).unwrap();
    cell.nodes[2].wait().unwrap();
    let (code, error) = cell.refused(e, ALL);
    assert_eq!(code, Some(5), "{error}");
    assert!(error.contains("no robot-node of station right answers at 10.77.2.1:7700"), "{error}");
}

/// Writes Setup E with another value at its right station.
fn changed(place: &Path) -> PathBuf {
    let e = setup::CELLS.iter().find(|(name, _)| *name == "E").unwrap().1;
    let (before, right) = e.rsplit_once("skill_overhead_us = { value = ").unwrap();
    let (_, after) = right.split_once(',').unwrap();
    let path = place.join("changed.toml");
    fs::write(&path, format!("{before}skill_overhead_us = {{ value = 1234,{after}")).unwrap();
    path
}
