//! Two robots on real stacks: on one bus of each kind, and on two buses.

use std::net::Ipv4Addr;

use ethernet_ip::{Adapter, AdapterConfig};
use machine::ethernet::Mac;
use machine::{Allowed, DownCause, Duration, Instant, InterfaceId};
use plc_node::bus::{PlcBus, open_all};
use plc_node::{ExecutionType, FailureCause, PlacedStation, PlcEvent, PlcNode, PlcReport, Sequences};
use profinet::{Device, DeviceConfig};
use protocol::buses::{Endpoint, EthercatSubDevice};
use protocol::fieldbus::LinkEvent;
use protocol::image::Motion;
use protocol::stations::{ETHERNET_IP_ROBOT, PROFINET_ROBOT};
use setup::{Bus, BusKind, Peer};
use virtual_time::{
    Clock, Either, Event, Impairment, Network, NodeId, Plug, StationConfig, SwitchConfig, SwitchId,
};

use crate::cell::{LEFT, MS, RIGHT, motions, placed, scan, work};
use crate::line::Line;
use crate::robot::{Robot, RobotScript};

type RobotBus = Endpoint<Device, Adapter, EthercatSubDevice>;
type Plc = PlcNode<PlcBus>;
type Node = Either<Plc, Either<Robot<RobotBus>, Line>>;

const PLC_MAC: Mac = Mac([2, 0, 0, 0, 0, 1]);
const PLC_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const CABLE: Duration = Duration::from_micros(12);
const NAMES: [&str; 2] = ["left", "right"];

const fn mac(station: usize) -> Mac {
    Mac([2, 0, 0, 0, 0, 2 + station as u8])
}

const fn address(station: usize) -> Ipv4Addr {
    Ipv4Addr::new(192, 168, 64, 2 + station as u8)
}

/// Returns the bus of a station, as on this setup.
fn bus(of_setup: &str, station: usize) -> Bus {
    let mut bus = setup::setup(of_setup).unwrap().bus;
    bus.watchdog_cycles.value = 50;
    match &mut bus.kind {
        BusKind::Profinet(addresses, profinet) => {
            addresses.robot = address(station);
            profinet.robot_station_name = NAMES[station].into();
        }
        BusKind::EthernetIp(addresses, _) => addresses.robot = address(station),
        BusKind::Ethercat(_) => {}
    }
    bus
}

fn robot_on(bus: &Bus, station: usize) -> Robot<RobotBus> {
    let end = match &bus.kind {
        BusKind::Profinet(addresses, profinet) => Endpoint::Profinet(Device::new(
            DeviceConfig {
                mac: mac(station),
                station_name: profinet.robot_station_name.clone().into_bytes(),
                permanent: None,
                address: None,
                mask: addresses.mask,
                description: PROFINET_ROBOT,
                controllers: Allowed::default(),
            },
            Instant::ZERO,
        )),
        BusKind::EthernetIp(addresses, _) => Endpoint::EthernetIp(
            Adapter::new(AdapterConfig {
                description: &ETHERNET_IP_ROBOT,
                serial_number: 100 + station as u32,
                address: addresses.robot,
                mask: addresses.mask,
                gateway: Ipv4Addr::UNSPECIFIED,
                mac: mac(station).0,
                first_id: 1_000 * (1 + station as u32),
                originators: Allowed::default(),
            })
            .with_conflict_detection(Instant::ZERO),
        ),
        BusKind::Ethercat(_) => panic!("its robots are in line"),
    };
    Robot { script: RobotScript::new(Instant::from_micros(1_300 + 900 * station as u64)), bus: end }
}

struct Cell {
    network: Network<Node>,
    plc: NodeId,
    /// The node of each station, and its place in the line there.
    robots: Vec<(NodeId, usize)>,
}

fn opened(buses: &[&Bus]) -> PlcBus {
    open_all(buses[0], &buses[1..], PLC_MAC, 7, Instant::ZERO).unwrap()
}

fn plc(buses: Vec<PlcBus>, stations: Vec<PlacedStation>) -> Plc {
    let works = (0..stations.len()).map(|station| work(motions(station, 4 + station as u16), vec![], vec![]));
    PlcNode::with_program(scan(), buses, stations, Sequences::new(works.collect()))
}

/// Returns a PLC with stations on a switch, on one bus or on a bus each, and at option one more on an EtherCAT cable.
fn on_switch(setups: [&str; 2], change: impl Fn(usize, &mut Bus), with_ethercat: bool) -> Cell {
    let expected = [LEFT, RIGHT].map(|station| bus(setups[station], station));
    let buses = [LEFT, RIGHT].map(|station| {
        let mut bus = expected[station].clone();
        change(station, &mut bus);
        bus
    });
    let is_one = setups[LEFT] == setups[RIGHT];
    let mut opens = match is_one {
        true => vec![opened(&[&buses[LEFT], &buses[RIGHT]])],
        false => vec![opened(&[&buses[LEFT]]), opened(&[&buses[RIGHT]])],
    };
    let right = if is_one { placed(0, 1, "right") } else { placed(1, 0, "right") };
    let mut stations = vec![placed(0, 0, "left"), right];
    let on_switch: Vec<_> = (0..opens.len() as u8).map(InterfaceId).collect();
    if with_ethercat {
        stations.push(placed(opens.len(), 0, "third"));
        opens.push(opened(&[&bus("C", 0)]));
    }
    let ethercat = InterfaceId(on_switch.len() as u8);
    let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
    let plc = network.add_node("plc", Either::A(plc(opens, stations)), Clock::default());
    let nic = network.add_nic(plc, &on_switch, Some(PLC_MAC), Some(PLC_ADDRESS));
    let link = Impairment { delay: CABLE, ..Impairment::default() };
    network.connect([Plug::Nic(nic), Plug::Switch(SwitchId::FIRST)], [link; 2]);
    let mut robots = Vec::new();
    for station in [LEFT, RIGHT] {
        let robot = Either::B(Either::A(robot_on(&expected[station], station)));
        let has_address = matches!(expected[station].kind, BusKind::EthernetIp(..));
        let host = StationConfig::new(mac(station), has_address.then(|| address(station)), CABLE);
        robots.push((network.add_station(SwitchId::FIRST, NAMES[station], robot, host), 0));
    }
    if with_ethercat {
        let line = Line::new(vec![RobotScript::new(Instant::from_micros(2_100))]);
        let line = network.add_node("line", Either::B(Either::B(line)), Clock::default());
        let ours = network.add_nic(plc, &[ethercat], None, None);
        let its = network.add_nic(line, &[InterfaceId::FIRST], None, None);
        network.connect([Plug::Nic(ours), Plug::Nic(its)], [link; 2]);
        robots.push((line, 0));
    }
    Cell { network, plc, robots }
}

/// Returns a PLC with two robots in line on one EtherCAT cable.
fn in_line() -> Cell {
    let buses = [bus("C", LEFT), bus("C", RIGHT)];
    let opens = vec![opened(&[&buses[LEFT], &buses[RIGHT]])];
    let mut network = Network::new(1);
    let plc = plc(opens, vec![placed(0, 0, "left"), placed(0, 1, "right")]);
    let plc = network.add_node("plc", Either::A(plc), Clock::default());
    let scripts = [1_300, 2_200].map(|first| RobotScript::new(Instant::from_micros(first)));
    let line = network.add_node("line", Either::B(Either::B(Line::new(scripts.into()))), Clock::default());
    let ours = network.add_nic(plc, &[InterfaceId::FIRST], None, None);
    let its = network.add_nic(line, &[InterfaceId::FIRST], None, None);
    let link = Impairment { delay: CABLE, ..Impairment::default() };
    network.connect([Plug::Nic(ours), Plug::Nic(its)], [link; 2]);
    Cell { network, plc, robots: vec![(line, 0), (line, 1)] }
}

impl Cell {
    fn plc<R>(&mut self, call: impl FnOnce(&mut Plc, Instant) -> R) -> R {
        let call = |node: &mut Node, now| match node {
            Either::A(plc) => call(plc, now),
            Either::B(_) => panic!("a robot"),
        };
        self.network.command(self.plc, call).unwrap()
    }

    fn script<R>(&mut self, station: usize, call: impl FnOnce(&mut RobotScript) -> R) -> R {
        let (node, place) = self.robots[station];
        let call = |node: &mut Node, _| match node {
            Either::A(_) => panic!("the PLC"),
            Either::B(Either::A(robot)) => call(&mut robot.script),
            Either::B(Either::B(line)) => call(&mut line.scripts[place]),
        };
        self.network.command(node, call).unwrap()
    }

    /// Runs until the PLC reports what is wanted, or to the end. A device gets the address that it is to have.
    fn until<T>(&mut self, within: Duration, mut wanted: impl FnMut(&PlcReport) -> Option<T>) -> Option<T> {
        let until = self.network.now() + within;
        while let Some((node, event)) = self.network.next_event(until) {
            match event {
                Event::A(report) => {
                    let found = wanted(&report);
                    if found.is_some() {
                        return found;
                    }
                }
                Event::B(Event::A(LinkEvent::SetAddress { address, .. })) => {
                    self.network.set_address(node, InterfaceId::FIRST, Some(address));
                    let set = |node: &mut Node, now| match node {
                        Either::B(Either::A(Robot { bus: Endpoint::Profinet(device), .. })) => {
                            device.address_set(now, true);
                        }
                        _ => panic!("no device"),
                    };
                    self.network.command(node, set);
                }
                Event::B(_) => {}
            }
        }
        None
    }

    fn until_ready(&mut self) {
        let mut seen = Vec::new();
        let ready = self.until(MS * 20_000, |report| {
            seen.push(*report);
            (report.event == PlcEvent::Ready).then_some(())
        });
        assert!(ready.is_some(), "{seen:?}");
    }

    /// Runs once; checks what each robot got.
    fn run(&mut self, execution_type: ExecutionType) {
        let count = self.robots.len();
        for station in 0..count {
            self.script(station, |script| {
                script.clear();
                script.programs = vec![4 + station as u32];
            });
        }
        self.plc(|plc, now| plc.start(now, execution_type)).unwrap();
        let mut finished = vec![None; count];
        self.until(MS * 20_000, |report| {
            match (report.station, report.event) {
                (Some(station), PlcEvent::Finished(execution)) => finished[station] = Some(execution.motions),
                (_, PlcEvent::Failed(failure)) => panic!("{failure}"),
                _ => {}
            }
            finished.iter().all(Option::is_some).then_some(())
        });
        for (station, finished) in finished.into_iter().enumerate() {
            let motions: Vec<Motion> = motions(station, 4 + station as u16);
            assert_eq!(finished, Some(motions.len() as u32), "{execution_type}, station {station}");
            if execution_type != ExecutionType::Rc {
                assert_eq!(self.script(station, |script| script.taken.clone()), motions);
            }
        }
        let begun: Vec<_> =
            (0..count).map(|station| self.script(station, |script| script.begun[0])).collect();
        let (first, last) = (begun.iter().min().unwrap(), begun.iter().max().unwrap());
        assert!(last.since(*first) <= MS * 12, "at once: {begun:?}");
        let joints: Vec<_> =
            (0..count).map(|station| self.script(station, |script| script.feedback.joints)).collect();
        let seen = self.plc(|plc, _| {
            plc.stations()
                .iter()
                .map(|station| station.group().feedback().unwrap().joints)
                .collect::<Vec<_>>()
        });
        assert_eq!(seen, joints, "each station has the image of its robot");
    }
}

fn all_cells() -> Vec<(&'static str, Cell)> {
    vec![
        ("one IO-Controller", on_switch(["A", "A"], |_, _| (), false)),
        ("one scanner", on_switch(["B", "B"], |_, _| (), false)),
        ("one MainDevice", in_line()),
        (
            "PROFINET and EtherNet/IP on one switch, EtherCAT on a cable",
            on_switch(["A", "B"], |_, _| (), true),
        ),
    ]
}

#[test]
fn the_robots_of_a_bus_and_of_several_buses_run_at_once_in_each_execution_type() {
    for (name, mut cell) in all_cells() {
        cell.until_ready();
        for execution_type in ExecutionType::ALL {
            cell.run(execution_type);
        }
        let frames: Vec<_> =
            cell.plc(|plc, _| (0..plc.stations().len()).map(|it| plc.counters_of(it)).collect());
        assert!(frames.iter().all(|it| it.received > 100 && it.lost == 0), "{name}: {frames:?}");
    }
}

/// Takes a robot from its bus, or puts it back.
fn set_lost(cell: &mut Cell, station: usize, lost: bool) {
    let (node, place) = cell.robots[station];
    if let Some(cable) = cell.network.cable(node, InterfaceId::FIRST)
        && matches!(cell.network.machine(node), Some(Either::B(Either::A(_))))
    {
        cell.network.set_cut(cable, lost);
        return;
    }
    let set = |node: &mut Node, now| match node {
        Either::B(Either::B(line)) => line.segment.set_power(now, ethercat_subdevice::DeviceId(place), !lost),
        _ => panic!("no line"),
    };
    cell.network.command(node, set);
}

#[test]
fn a_robot_lost_on_a_bus_leaves_the_others_of_the_bus_in_their_run_and_comes_back() {
    for (name, mut cell) in all_cells() {
        let lost = cell.robots.len() - 1;
        cell.until_ready();
        for station in 0..cell.robots.len() {
            cell.script(station, |script| script.motion_cycles = if station == lost { 200 } else { 100 });
            cell.script(station, RobotScript::clear);
        }
        cell.plc(|plc, now| plc.start(now, ExecutionType::Cm)).unwrap();
        cell.until(MS * 300, |_| None::<()>);
        set_lost(&mut cell, lost, true);
        let mut links = Vec::new();
        let failed = cell.until(MS * 20_000, |report| {
            if let PlcEvent::Link(_) = report.event {
                links.push(report.station);
            }
            match report.event {
                PlcEvent::Failed(failure) => Some((report.station, failure)),
                _ => None,
            }
        });
        let (station, failure) = failed.unwrap();
        assert_eq!(station, Some(lost), "{name}: {failure}");
        assert!(matches!(failure.cause, FailureCause::ConnectionLost(_)), "{name}: {failure}");
        assert!(!links.is_empty() && links.iter().all(|it| *it == Some(lost)), "{name}: {links:?}");
        for other in 0..lost {
            let done = cell.script(other, |script| (script.executed.len(), script.halts));
            assert_eq!(done, (4 + other, 0), "{name}");
        }
        set_lost(&mut cell, lost, false);
        (0..=lost).for_each(|station| cell.script(station, |script| script.motion_cycles = 5));
        cell.until_ready();
        cell.run(ExecutionType::Cm);
    }
}

#[test]
fn robots_that_have_changed_places_are_refused_by_name() {
    let swap_peers = |station: usize, bus: &mut Bus| {
        let other = 1 - station;
        bus.robot = Some(Peer {
            address: None,
            mac: matches!(bus.kind, BusKind::Profinet(..)).then_some(mac(other)),
            serial_number: matches!(bus.kind, BusKind::EthernetIp(..)).then_some(100 + other as u32),
        });
    };
    for setups in [["A", "A"], ["B", "B"]] {
        let mut cell = on_switch(setups, swap_peers, false);
        let mut refused = [false; 2];
        cell.until(MS * 15_000, |report| {
            match (report.station, report.event) {
                (Some(station), PlcEvent::Link(LinkEvent::Down(down))) => {
                    assert_ne!(down.cause, DownCause::Watchdog, "{down}");
                    refused[station] = true;
                }
                (_, PlcEvent::Link(LinkEvent::Up) | PlcEvent::Ready) => panic!("{setups:?}: {report:?}"),
                _ => {}
            }
            None::<()>
        });
        assert_eq!(refused, [true; 2], "{setups:?}");
    }
}
