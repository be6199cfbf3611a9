//! Nodes without a bench: a controller that writes its instructions itself, and Ctrl-C at the node.

use std::io::{BufRead as _, BufReader, Lines, Read, Write as _};
use std::net::TcpStream;
use std::process::{Child, Stdio};

use protocol_linux::namespace::NetworkNamespace;
use rustix::process::{Pid, Signal, kill_process};

use crate::{Cell, TOKEN, cable, node};

/// Reads up to a line with this text and returns it.
#[track_caller]
fn read_to(lines: &mut Lines<BufReader<impl Read>>, text: &str) -> String {
    let mut before = Vec::new();
    for line in lines.map_while(Result::ok) {
        if line.contains(text) {
            return line;
        }
        before.push(line);
    }
    panic!("there is no `{text}` in {before:#?}");
}

pub(crate) fn a_wrong_value_in_an_instruction_is_refused_and_the_run_goes_on() {
    let cell = Cell::start();
    let connect = || loop {
        // The node may not listen yet.
        if let Ok(stream) = TcpStream::connect("10.77.0.1:7700") {
            return stream;
        }
    };
    let mut controller = cell.control.run(connect).unwrap();
    let mut lines = BufReader::new(controller.try_clone().unwrap()).lines();
    writeln!(controller, "{{\"token\":\"{TOKEN}\"}}").unwrap();
    read_to(&mut lines, "\"ready\"");
    writeln!(controller, r#"{{"node":{{"start":{{"execution_type":"cm"}}}}}}"#).unwrap();
    read_to(&mut lines, "\"started\"");
    for (wrong, reason) in [
        (
            r#"{"execution_type":"rc","override":"120"}"#,
            "override: `120`: an override of 120 % was asked for",
        ),
        (r#"{"execution_type":"rc","override":"0"}"#, "override: `0` leaves the arm standing for ever"),
        (r#"{"execution_type":"xm"}"#, "unknown variant `xm`, expected one of `rc`, `sm`, `cm`"),
    ] {
        writeln!(controller, r#"{{"node":{{"start":{wrong}}}}}"#).unwrap();
        let refused = read_to(&mut lines, "{\"node\":{");
        assert!(refused.contains("{\"refused\":{\"reason\":") && refused.contains(reason), "{refused}");
    }
    let ended = read_to(&mut lines, "{\"node\":{");
    assert!(ended.contains("\"finished\""), "{ended}");
    writeln!(controller, "GET / HTTP/1.1").unwrap();
    read_to(&mut lines, "{\"denied\":{\"reason\":\"it sent a line that is not an instruction: ");
    assert!(lines.next().is_none(), "the connection has ended");
}

/// Sends a node a signal and returns its exit code.
fn end(node: &mut Child, signal: Signal) -> Option<i32> {
    kill_process(Pid::from_child(node), signal).unwrap();
    node.wait().unwrap().code()
}

pub(crate) fn nodes_end_with_130_at_ctrl_c_and_sigterm_whatever_they_do() {
    for signal in [Signal::INT, Signal::TERM] {
        let [plc, robot] = [(); 2].map(|()| NetworkNamespace::new().unwrap());
        cable((&plc, "plc0", None), (&robot, "robot0", None));
        let start = |network, name, interface, more: &[&str]| {
            let mut command = node(network, name, interface);
            let mut node = command.args(more).stdout(Stdio::piped()).spawn().unwrap();
            let lines = BufReader::new(node.stdout.take().unwrap()).lines();
            (node, lines)
        };
        let (mut alone, mut lines) = start(&plc, "__plc-node", "plc0", &[]);
        read_to(&mut lines, "plc0");
        assert_eq!(end(&mut alone, signal), Some(130), "before it is connected");

        let (mut robot_node, _robot_lines) = start(&robot, "__robot-node", "robot0", &[]);
        let (mut running, mut lines) = start(&plc, "__plc-node", "plc0", &["--reps", "1000"]);
        read_to(&mut lines, "rc started");
        assert_eq!(end(&mut running, signal), Some(130), "in an execution");
        assert_eq!(end(&mut robot_node, signal), Some(130), "of the robot node");
    }
}
