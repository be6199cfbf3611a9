//! Two PLCs and one EtherCAT robot on a switch of the kernel, in network namespaces that the tests make and that vanish with
//! them.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

use std::io::{BufRead as _, BufReader, Read as _};
use std::ops::ControlFlow;
use std::process::{Child, ChildStdout, Command, ExitCode, Stdio};

use ethercat_subdevice::DeviceConfig;
use machine::Instant;
use networked_tests::End;
use protocol::buses::EthercatSubDevice;
use protocol::fieldbus::LinkEvent;
use protocol::stations::ETHERCAT_ROBOT;
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{CyclicThread, Driver, Interface, NoticeSender, Notifier, Task};
use rustix::process::{Pid, Signal, kill_process};

fn main() -> ExitCode {
    networked_tests::run(networked_tests::tests![
        the_second_plc_names_the_first_one_and_takes_over_when_that_one_has_ended,
        a_plc_that_was_killed_starts_again_and_connects,
    ])
}

/// Runs until the test ends it.
struct Robot;

impl Task<EthercatSubDevice> for Robot {
    type Command = ();
    type Notice = ();

    fn event(
        &mut self,
        _: Instant,
        _: &mut EthercatSubDevice,
        _: LinkEvent,
        _: &mut NoticeSender<()>,
    ) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// A switch with a robot and places for two PLCs.
struct Cell {
    plcs: [NetworkNamespace; 2],
    _switch: NetworkNamespace,
    robot: Option<CyclicThread<EthercatSubDevice, Robot>>,
}

impl Cell {
    fn new() -> Self {
        let [first, second, robot, switch] = [(); 4].map(|()| NetworkNamespace::new().unwrap());
        for (network, name, port) in
            [(&first, "plc0", "port1"), (&second, "plc0", "port2"), (&robot, "robot0", "port3")]
        {
            networked_tests::cable([
                End { network, name, address: None },
                End { network: &switch, name: port, address: None },
            ]);
        }
        switch
            .run(|| {
                ip("link add switch type bridge");
                for port in ["port1", "port2", "port3"] {
                    ip(&format!("link set {port} master switch"));
                }
                ip("link set switch up");
            })
            .unwrap();
        let robot = robot
            .run(|| {
                let device = EthercatSubDevice::new(&DeviceConfig::new(&ETHERCAT_ROBOT));
                let (waker, reader) = (Notifier::new().unwrap(), Notifier::new().unwrap());
                let interface = Interface::open("robot0").unwrap();
                let driver = Driver::new(device, interface, waker.clone()).unwrap();
                CyclicThread::start(driver, Robot, waker, reader).unwrap()
            })
            .unwrap();
        Self { plcs: [first, second], _switch: switch, robot: Some(robot) }
    }

    fn start(&self, number: usize) -> RivalPlc {
        let mut command = Command::new(env!("CARGO_BIN_EXE_plc-node"));
        command.args(["run", "--setup", "C", "--interface", "plc0"]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
        self.plcs[number].confine(&mut command).unwrap();
        let mut process = command.spawn().unwrap();
        let lines = BufReader::new(process.stdout.take().unwrap());
        RivalPlc { process, lines, said: Vec::new() }
    }

    fn mac(&self, number: usize) -> [u8; 6] {
        self.plcs[number].run(|| Interface::open("plc0").unwrap().mac().0).unwrap()
    }
}

impl Drop for Cell {
    fn drop(&mut self) {
        let mut thread = self.robot.take().unwrap();
        thread.send(()).unwrap();
        thread.join().unwrap().result.unwrap();
    }
}

fn ip(arguments: &str) {
    assert!(Command::new("ip").args(arguments.split(' ')).status().unwrap().success(), "ip {arguments}");
}

struct RivalPlc {
    process: Child,
    lines: BufReader<ChildStdout>,
    said: Vec<String>,
}

impl RivalPlc {
    /// Reads lines until one of them contains these words.
    fn says(&mut self, words: &str) -> String {
        loop {
            let mut line = String::new();
            assert!(self.lines.read_line(&mut line).unwrap() > 0, "`{words}` after {:?}", self.said);
            self.said.push(line.clone());
            if line.contains(words) {
                return line;
            }
        }
    }

    /// Ends the process and returns what it had printed and nobody had read.
    fn end(mut self, signal: Signal) -> String {
        kill_process(Pid::from_child(&self.process), signal).unwrap();
        let mut rest = String::new();
        self.lines.read_to_string(&mut rest).unwrap();
        self.process.wait().unwrap();
        rest
    }
}

fn the_second_plc_names_the_first_one_and_takes_over_when_that_one_has_ended() {
    let cell = Cell::new();
    let mut first = cell.start(0);
    first.says("connected");
    let mut second = cell.start(1);
    let line = second.says("another EtherCAT MainDevice");
    // The first byte differs for a virtual interface.
    let [_, rest @ ..] = cell.mac(0);
    let mac: String = rest.iter().map(|byte| format!(":{byte:02x}")).collect();
    assert!(line.contains(&mac), "{line} without {mac}");
    let more = first.end(Signal::TERM);
    assert!(!more.contains("MainDevice") && !more.contains("left OP"), "{more}");
    second.says("connected");
    let all = second.said.concat() + &second.end(Signal::TERM);
    assert_eq!(all.matches("another EtherCAT MainDevice sends").count(), 1, "{all}");
}

fn a_plc_that_was_killed_starts_again_and_connects() {
    let cell = Cell::new();
    let mut plc = cell.start(0);
    plc.says("connected");
    plc.end(Signal::KILL);
    let mut again = cell.start(0);
    again.says("connected");
    assert!(!again.said.concat().contains("MainDevice ("), "{:?}", again.said);
    again.end(Signal::TERM);
}
