//! Setup E on a real network: a PLC with two robots, one over PROFINET and one over EtherNet/IP, on one switch.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::Stdio;

use crate::stations::{Node, Switch};
use crate::{HOST, PoisonError, text};

const STATIONS: [&str; 2] = ["left", "right"];
/// Both buses of the PLC are on its one interface.
const BOTH_BUSES: &str = "profinet=eth0,ethernet-ip=eth0";

/// Starts both robots, each at an end of its own.
fn robots(switch: &Switch) -> [Node; 2] {
    let start = |end, station| switch.node(end, "__robot-node", "E", &["--station", station]);
    [start(1, STATIONS[0]), start(2, STATIONS[1])]
}

pub(crate) fn two_robots_on_two_buses_and_one_switch_work_with_one_plc() {
    let _host = HOST.lock().unwrap_or_else(PoisonError::into_inner);
    let switch = Switch::new();
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
    let _host = HOST.lock().unwrap_or_else(PoisonError::into_inner);
    let switch = Switch::new();
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
