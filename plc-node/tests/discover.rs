//! `plc-node discover` on a real cable, in network namespaces that the tests make and that vanish with them. How long a
//! search takes is not looked at.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::net::Ipv4Addr;
use std::ops::ControlFlow;
use std::process::{Command, ExitCode};

use ethercat_subdevice::DeviceConfig as SubDeviceConfig;
use ethernet_ip::{Adapter, AdapterConfig};
use machine::{Instant, Machine};
use networked_tests::End;
use profinet::{Device, DeviceConfig};
use protocol::buses::EthercatSubDevice;
use protocol::fieldbus::LinkEvent;
use protocol::stations::{ETHERCAT_ROBOT, ETHERNET_IP_ROBOT, PROFINET_ROBOT};
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{
    CyclicThread, Driver, Interface, NoticeSender, Notifier, OpenPort, Task, bridge, clock,
};
use serde_json::{Value, json};

const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
const PLC: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const ROBOT: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);

fn main() -> ExitCode {
    networked_tests::run(networked_tests::tests![
        a_robot_of_each_bus_on_one_cable_is_found,
        who_may_not_open_raw_sockets_still_finds_ethernet_ip_devices,
        a_cable_without_devices_is_no_failure,
        an_interface_that_cannot_be_used_is_named_with_what_to_do,
        a_search_beside_a_node_that_has_the_ports_of_the_bus_works,
        twins_on_one_switch_are_named_with_their_mac_addresses,
    ])
}

/// A cable with both of its ends.
struct Cable {
    plc: NetworkNamespace,
    robot: NetworkNamespace,
}

/// What the program printed and how it ended.
struct Finished {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Cable {
    fn lay() -> Self {
        let [plc, robot] = [(); 2].map(|()| NetworkNamespace::new().unwrap());
        networked_tests::cable([
            End { network: &plc, name: "plc0", address: Some(PLC) },
            End { network: &robot, name: "robot0", address: Some(ROBOT) },
        ]);
        Self { plc, robot }
    }

    /// Runs a device at the robot's end.
    fn attach<M: Machine<Event = LinkEvent> + Send + 'static>(
        &self,
        device: impl FnOnce(&Interface) -> M + Send,
    ) -> Attached<M> {
        attach(&self.robot, device)
    }

    fn discover(&self, arguments: &[&str]) -> Finished {
        discover_by(&self.plc, Command::new(env!("CARGO_BIN_EXE_plc-node")), arguments)
    }

    /// Runs `discover` as a user who may not open raw sockets.
    fn discover_without_privilege(&self, arguments: &[&str]) -> Finished {
        let mut command = Command::new("setpriv");
        command.args(["--bounding-set", "-net_raw", "--inh-caps", "-net_raw"]);
        command.arg(env!("CARGO_BIN_EXE_plc-node"));
        discover_by(&self.plc, command, arguments)
    }
}

/// A switch with the PLC and two robots of one IP address.
struct TwinSwitch {
    _network: NetworkNamespace,
    plc: NetworkNamespace,
    robots: [NetworkNamespace; 2],
}

impl TwinSwitch {
    fn new() -> Self {
        let network = NetworkNamespace::new().unwrap();
        let open = |name: &str| Interface::open(name).unwrap();
        network.run(|| bridge::new("br0")).unwrap().unwrap();
        network.run(|| open("br0").set_up()).unwrap().unwrap();
        let [plc, one, other] = [(); 3].map(|()| NetworkNamespace::new().unwrap());
        let ends =
            [(&plc, "s0", "plc0", PLC), (&one, "s1", "robot0", ROBOT), (&other, "s2", "robot0", ROBOT)];
        for (end, port, name, address) in ends {
            networked_tests::cable([
                End { network: &network, name: port, address: None },
                End { network: end, name, address: Some(address) },
            ]);
            network.run(|| bridge::add_port(&open("br0"), &open(port))).unwrap().unwrap();
        }
        Self { _network: network, plc, robots: [one, other] }
    }
}

fn attach<M: Machine<Event = LinkEvent> + Send + 'static>(
    network: &NetworkNamespace,
    device: impl FnOnce(&Interface) -> M + Send,
) -> Attached<M> {
    let start = || {
        let interface = Interface::open("robot0").unwrap();
        let machine = device(&interface);
        let (waker, reader) = (Notifier::new().unwrap(), Notifier::new().unwrap());
        let driver = Driver::new(machine, interface, waker.clone()).unwrap();
        CyclicThread::start(driver, Idle, waker, reader).unwrap()
    };
    Attached(Some(network.run(start).unwrap()))
}

fn discover_by(network: &NetworkNamespace, mut command: Command, arguments: &[&str]) -> Finished {
    command.arg("discover").args(arguments);
    network.confine(&mut command).unwrap();
    let output = command.output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Finished { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// A device on its thread, until it is dropped.
struct Attached<M: Machine<Event = LinkEvent> + Send + 'static>(Option<CyclicThread<M, Idle>>);

impl<M: Machine<Event = LinkEvent> + Send + 'static> Drop for Attached<M> {
    fn drop(&mut self) {
        let mut thread = self.0.take().unwrap();
        thread.send(()).unwrap();
        thread.join().unwrap().result.unwrap();
    }
}

/// Ends when the test ends it.
struct Idle;

impl<M: Machine<Event = LinkEvent>> Task<M> for Idle {
    type Command = ();
    type Notice = ();

    fn event(&mut self, _: Instant, _: &mut M, _: LinkEvent, _: &mut NoticeSender<()>) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

fn profinet_robot(interface: &Interface) -> Device {
    let config = DeviceConfig {
        mac: interface.mac(),
        station_name: b"skillbench-robot".to_vec(),
        permanent: None,
        address: interface.address(),
        mask: MASK,
        description: PROFINET_ROBOT,
        controllers: machine::Allowed::default(),
    };
    Device::new(config, clock::now())
}

fn ethernet_ip_robot(interface: &Interface) -> Adapter {
    let config = AdapterConfig {
        description: &ETHERNET_IP_ROBOT,
        serial_number: 0x1234_5678,
        address: ROBOT,
        mask: MASK,
        gateway: Ipv4Addr::UNSPECIFIED,
        mac: interface.mac().0,
        first_id: 1,
        originators: machine::Allowed::default(),
    };
    Adapter::new(config)
}

fn ethercat_robot(_: &Interface) -> EthercatSubDevice {
    EthercatSubDevice::new(&SubDeviceConfig { serial_number: 77, ..SubDeviceConfig::new(&ETHERCAT_ROBOT) })
}

fn a_robot_of_each_bus_on_one_cable_is_found() {
    let cable = Cable::lay();
    let (_profinet, _ethernet_ip) = (cable.attach(profinet_robot), cable.attach(ethernet_ip_robot));
    let _ethercat = cable.attach(ethercat_robot);
    let finished = cable.discover(&["--interface", "plc0", "--json"]);
    assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""));
    let found: Value = serde_json::from_str(&finished.stdout).unwrap();
    let station = &found["profinet"][0];
    let identity = PROFINET_ROBOT.identity;
    assert_eq!(station["name"], "skillbench-robot");
    assert_eq!(station["ip_address"], "192.168.64.2");
    assert_eq!(
        (&station["vendor_id"], &station["device_id"]),
        (&json!(identity.vendor), &json!(identity.device))
    );
    assert_eq!(station["roles"], json!(["IO-Device"]));
    let device = &found["ethernet_ip"][0];
    assert_eq!(device["ip_address"], "192.168.64.2");
    assert_eq!(device["product_name"], ETHERNET_IP_ROBOT.product_name);
    assert_eq!((&device["serial_number"], &device["state"]), (&json!(0x1234_5678), &json!(3)));
    let count = |bus: &str| found[bus].as_array().unwrap().len();
    assert_eq!((count("profinet"), count("ethernet_ip")), (1, 1));
    let sub_devices = found["ethercat"]["devices"].as_array().unwrap();
    assert_eq!(sub_devices.len(), 1, "{sub_devices:?}");
    let sub_device = &sub_devices[0];
    assert_eq!(sub_device["order_code"], ETHERCAT_ROBOT.order_code);
    assert_eq!(sub_device["product_code"], ETHERCAT_ROBOT.product_code);
    assert_eq!((&sub_device["serial_number"], &sub_device["position"]), (&json!(77), &json!(1)));
    assert_eq!((&sub_device["station_address"], &sub_device["state"]), (&json!(0), &json!("INIT")));
    assert_eq!((&found["ignored_answers"], &found["conflicts"]), (&json!(0), &json!([])));
    assert_eq!(device["mac_addresses"], json!([station["mac"]]));

    let finished = cable.discover(&["--interface", "plc0", "--bus", "profinet"]);
    assert!(finished.stdout.starts_with("PROFINET: 1 station\n"), "{}", finished.stdout);
    assert!(!finished.stdout.contains("EtherNet/IP"), "{}", finished.stdout);
}

fn who_may_not_open_raw_sockets_still_finds_ethernet_ip_devices() {
    let cable = Cable::lay();
    let (_profinet, _ethernet_ip) = (cable.attach(profinet_robot), cable.attach(ethernet_ip_robot));
    let finished = cable.discover_without_privilege(&["--interface", "plc0"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(
        finished.stderr.starts_with("warning: PROFINET was not searched: opening raw Ethernet"),
        "{}",
        finished.stderr
    );
    assert!(finished.stderr.contains("setcap"), "{}", finished.stderr);
    assert!(finished.stdout.starts_with("EtherNet/IP: 1 device\n"), "{}", finished.stdout);
    let finished = cable.discover_without_privilege(&["--interface", "plc0", "--json"]);
    let found: Value = serde_json::from_str(&finished.stdout).unwrap();
    assert_eq!(found["ethernet_ip"][0]["mac_addresses"], Value::Null);

    let finished = cable.discover_without_privilege(&["--interface", "plc0", "--bus", "profinet"]);
    assert_eq!((finished.code, finished.stdout.as_str()), (Some(5), ""));
    assert!(
        finished.stderr.starts_with("error: nothing can be asked on `plc0`: opening raw"),
        "{}",
        finished.stderr
    );
}

fn a_cable_without_devices_is_no_failure() {
    let cable = Cable::lay();
    let finished = cable.discover(&["--interface", "plc0", "--timeout", "200"]);
    assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""));
    let nothing = "PROFINET: no station answered DCP Identify on plc0, asked 3 times in 200 ms.\n\n\
         EtherNet/IP: no device answered ListIdentity on plc0, asked 3 times in 200 ms.\n\n\
         EtherCAT: no frame came back on plc0, so there is no SubDevice.\n";
    assert_eq!(finished.stdout, nothing);
}

fn an_interface_that_cannot_be_used_is_named_with_what_to_do() {
    let cable = Cable::lay();
    let finished = cable.discover(&["--interface", "nosuch0"]);
    assert_eq!(finished.code, Some(5));
    assert!(finished.stderr.contains("no network interface `nosuch0`; there are: "), "{}", finished.stderr);
    let finished = cable.discover(&["--interface", "lo"]);
    assert_eq!(finished.code, Some(5));
    assert!(
        finished.stderr.contains("`lo` is switched off") && finished.stderr.contains("ip link set lo up"),
        "{}",
        finished.stderr
    );

    let without_address =
        || Interface::open("plc0").unwrap().set_address(Ipv4Addr::UNSPECIFIED, MASK).unwrap();
    cable.plc.run(without_address).unwrap();
    let finished = cable.discover(&["--interface", "plc0", "--timeout", "100"]);
    assert_eq!(finished.code, Some(0));
    assert!(
        finished.stderr.contains("EtherNet/IP was not searched: interface `plc0` has no IPv4"),
        "{}",
        finished.stderr
    );
}

fn a_search_beside_a_node_that_has_the_ports_of_the_bus_works() {
    let cable = Cable::lay();
    let _ethernet_ip = cable.attach(ethernet_ip_robot);
    let taken = || {
        let interface = Interface::open("plc0").unwrap();
        OpenPort::open_all(&interface, ethernet_ip::PORTS).unwrap()
    };
    let _taken = cable.plc.run(taken).unwrap();
    let finished = cable.discover(&["--interface", "plc0", "--bus", "ethernet-ip"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(finished.stdout.starts_with("EtherNet/IP: 1 device\n"), "{}", finished.stdout);
}

fn twins_on_one_switch_are_named_with_their_mac_addresses() {
    let switch = TwinSwitch::new();
    let _stations = switch.robots.each_ref().map(|robot| attach(robot, profinet_robot));
    let _adapters = switch.robots.each_ref().map(|robot| attach(robot, ethernet_ip_robot));
    let discover = |arguments: &[&str]| {
        discover_by(&switch.plc, Command::new(env!("CARGO_BIN_EXE_plc-node")), arguments)
    };
    let finished = discover(&["--interface", "plc0", "--json"]);
    assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""));
    let found: Value = serde_json::from_str(&finished.stdout).unwrap();
    let macs: Vec<_> = found["profinet"].as_array().unwrap().iter().map(|it| it["mac"].clone()).collect();
    assert_eq!(macs.len(), 2, "{found}");
    let conflicts = found["conflicts"].as_array().unwrap();
    let shared: Vec<_> = conflicts.iter().map(|it| (&it["shared"], &it["value"])).collect();
    assert_eq!(
        shared,
        [
            (&json!("station-name"), &json!("skillbench-robot")),
            (&json!("ip-address"), &json!("192.168.64.2"))
        ]
    );
    for conflict in conflicts {
        let named: Vec<_> =
            conflict["devices"].as_array().unwrap().iter().map(|it| it["mac"].clone()).collect();
        assert_eq!(named, macs, "{conflict}");
    }

    // ListIdentity shows one device, since both have the same address and serial number; ARP shows two.
    let finished = discover(&["--interface", "plc0", "--bus", "ethernet-ip"]);
    assert!(finished.stdout.starts_with("EtherNet/IP: 1 device\n"), "{}", finished.stdout);
    let line = "! 2 devices have the IP address 192.168.64.2: ";
    assert!(finished.stdout.contains(line), "{}", finished.stdout);
    assert!(macs.iter().all(|mac| finished.stdout.contains(mac.as_str().unwrap())), "{}", finished.stdout);
}
