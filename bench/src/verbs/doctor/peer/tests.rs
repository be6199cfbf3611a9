//! Both looks against our own nodes as foreign ends, in virtual time: every step is seen, what is wrong is named, nothing moves.

use machine::ethernet::Mac;
use plc_node::bus::PlcBus;
use plc_node::{AnyProgram, PlcConfig, PlcEvent, PlcNode};
use protocol::fieldbus::ControllerBus as _;
use protocol::image::State;
use robot_node::bus::{Host, RobotBus};
use robot_node::{RobotConfig, RobotEvent, RobotNode};
use setup::{EthernetIpAdapter, EthernetIpFormat, ProfinetDevice, ProfinetModule, ProfinetSubmodule};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig, Side};

use super::*;
use crate::verbs::doctor::finding::Verdict::{Good, Missing, NotSeen};

const MACS: [Mac; 2] = [Mac([2, 0, 0, 0, 0, 1]), Mac([2, 0, 0, 0, 0, 2])];

/// Time in which every connection comes up and is watched to the end.
const END: Instant = Instant::from_millis(8_000);

fn config(setup: &Setup) -> PairConfig {
    let cable = Impairment { delay: Duration::from_micros(12), ..Impairment::default() };
    let plc = setup.bus.addresses().map(|addresses| addresses.plc);
    let addresses = [plc, robot_node::bus::address_from_project(&setup.bus.kind)];
    PairConfig { seed: 3, clocks: [Clock::default(); 2], links: [cable; 2], addresses }
}

fn robot_bus(setup: &Setup) -> RobotBus {
    let host =
        Host { mac: MACS[1], address: robot_node::bus::address_from_project(&setup.bus.kind), gateway: None };
    robot_node::bus::open_station(&setup.bus, host, None, 5, || Instant::from_micros(300))
}

fn plc_bus(setup: &Setup) -> PlcBus {
    plc_node::bus::open(&setup.bus, MACS[0], 7, Instant::from_micros(100)).unwrap()
}

/// Looks at the robot of one setup from the PLC of another.
fn check_robot(expected: &Setup, real: &Setup) -> Vec<Finding> {
    let bus = plc_bus(expected);
    let robot_cycle = Duration::from_micros(expected.robot.cycle_us.value.into());
    let watch = RobotWatch::new(&bus, StationId::FIRST, robot_cycle);
    let start = Instant::from_micros(100);
    let look = Look::new(bus, watch, Cycle::new(start, Duration::from_millis(1)), start);
    let start = Instant::from_micros(300);
    let robot = RobotNode::new(RobotConfig::from_setup(real).unwrap(), vec![], robot_bus(real), 1, start);
    let mut pair = Pair::new(look, robot, config(real));
    while let Some(event) = pair.next_event(END) {
        match event {
            Event::B(RobotEvent::Link(LinkEvent::SetAddress { address, .. })) => {
                pair.set_address(Side::B, Some(address));
                pair.command_b(|robot, now| {
                    protocol::fieldbus::Fieldbus::address_set(robot.bus_mut(), now, true)
                });
            }
            Event::B(RobotEvent::SkillStarted { .. }) => panic!("the look started a skill"),
            Event::A(_) | Event::B(_) => {}
        }
    }
    assert_eq!(pair.b().controller().feedback().state, State::Halted, "an idle PLC enables nothing");
    pair.a().findings()
}

/// Looks at the PLC of one setup from the robot of another.
fn check_plc(real: &Setup, expected: &Setup) -> Vec<Finding> {
    let application = planning::setup_and_application("A", None).unwrap().1;
    let plan = application.plan(real).unwrap();
    let start = Instant::from_micros(100);
    let plc: PlcNode<PlcBus, AnyProgram> =
        PlcNode::of_code(PlcConfig::of_plan(real, &plan), None, plc_bus(real), start).unwrap();
    let bus = robot_bus(expected);
    let own_name = match &expected.bus.kind {
        BusKind::Profinet(_, profinet) => Some(profinet.robot_station_name.clone()),
        _ => None,
    };
    let watch = PlcWatch::new(&bus, own_name, Duration::from_micros(expected.plc.scan_cycle_us.value.into()));
    let start = Instant::from_micros(300);
    let look = Look::new(bus, watch, Cycle::new(start, Duration::from_millis(4)), start);
    let mut pair = Pair::new(plc, look, config(expected));
    let mut links = Vec::new();
    while let Some(event) = pair.next_event(END) {
        match event {
            Event::B(LinkEvent::SetAddress { address, .. }) => {
                pair.set_address(Side::B, Some(address));
                pair.command_b(|look, now| look.address_set(now, true));
            }
            Event::A(report) => links.extend(match report.event {
                PlcEvent::Finished(_) => Some("finished"),
                _ => None,
            }),
            Event::B(_) => {}
        }
    }
    assert!(links.is_empty(), "no skill is executed");
    pair.b().findings()
}

fn finding<'a>(findings: &'a [Finding], what: &str) -> &'a Finding {
    findings
        .iter()
        .find(|finding| finding.what == what)
        .unwrap_or_else(|| panic!("no {what} in {findings:#?}"))
}

fn setup_of(name: &str) -> Setup {
    setup::setup(name).unwrap()
}

#[test]
fn every_step_of_our_robot_is_seen_on_every_bus_and_nothing_moves() {
    for name in ["A", "B", "C"] {
        let setup = setup_of(name);
        let findings = check_robot(&setup, &setup);
        let wrong: Vec<_> = findings.iter().filter(|finding| finding.verdict != Good).collect();
        assert!(wrong.is_empty(), "{name}: {wrong:#?}");
        assert!(finding(&findings, "state").found.starts_with("Halted"), "{findings:#?}");
    }
}

#[test]
fn every_step_of_our_plc_is_seen_on_every_bus_up_to_its_first_command() {
    for name in ["A", "B", "C"] {
        let setup = setup_of(name);
        let findings = check_plc(&setup, &setup);
        let wrong: Vec<_> = findings.iter().filter(|finding| finding.verdict != Good).collect();
        assert!(wrong.is_empty(), "{name}: {wrong:#?}");
        let command = &finding(&findings, "first command").found;
        assert!(command.contains("MovePtpCartesian") && command.contains("1 of 1 motions"), "{command}");
    }
}

#[test]
fn a_plc_that_asks_for_another_name_is_named_with_it() {
    let (real, mut expected) = (setup_of("A"), setup_of("A"));
    if let BusKind::Profinet(_, profinet) = &mut expected.bus.kind {
        profinet.robot_station_name = "arm-12".into();
    }
    let findings = check_plc(&real, &expected);
    let name = finding(&findings, "name");
    assert_eq!(name.verdict, Missing);
    assert!(
        name.found.contains("02:00:00:00:00:01 asks for `skillbench-robot`; nobody asks for `arm-12`"),
        "{name:?}"
    );
    assert_eq!(finding(&findings, "connection").verdict, NotSeen);
}

/// Returns Setup A whose PLC expects this module with so many bytes of inputs.
fn expecting(ident: u32, input_bytes: u16) -> Setup {
    let submodule = |subslot, ident, input_bytes, output_bytes| ProfinetSubmodule {
        subslot,
        ident,
        input_bytes,
        output_bytes,
    };
    let access = [(1, 1), (0x8000, 0x8000), (0x8001, 0x8001)];
    let access = access.map(|(subslot, ident)| submodule(subslot, ident, 0, 0)).to_vec();
    let data = vec![submodule(1, 0x101, input_bytes, 256)];
    let modules = vec![
        ProfinetModule { slot: 0, ident: 1, submodules: access },
        ProfinetModule { slot: 1, ident, submodules: data },
    ];
    let mut setup = setup_of("A");
    if let BusKind::Profinet(_, profinet) = &mut setup.bus.kind {
        profinet.device = Some(ProfinetDevice { vendor: 0xFFFF, device: 1, modules });
    }
    setup
}

#[test]
fn another_module_is_named_by_both_looks_with_what_is_there_and_what_is_expected() {
    let (wrong, right) = (expecting(0x222, 256), setup_of("A"));
    let findings = check_robot(&wrong, &right);
    let module = finding(&findings, "module");
    assert_eq!((module.verdict, &*module.found), (Missing, "slot 1 has another module, 0x00000100"));
    assert_eq!(finding(&findings, "connection").verdict, Missing);
    let findings = check_plc(&wrong, &right);
    let asked = &finding(&findings, "connection").found;
    assert!(asked.contains("slot 1 expects module 0x00000222, this device has 0x00000100"), "{asked}");
}

#[test]
fn a_plc_with_other_sizes_is_refused_with_what_it_asked_for() {
    let right = setup_of("A");
    let findings = check_plc(&expecting(0x100, 64), &right);
    let connection = finding(&findings, "connection");
    assert_eq!(connection.verdict, Missing);
    assert!(
        connection.found.contains("slot 1 subslot 1: 64 bytes of inputs, 256 of outputs"),
        "{connection:?}"
    );
    assert!(connection.found.contains("refused: "), "{connection:?}");

    let (right, mut wrong) = (setup_of("B"), setup_of("B"));
    if let BusKind::EthernetIp(_, ethernet_ip) = &mut wrong.bus.kind {
        ethernet_ip.adapter = Some(EthernetIpAdapter {
            consumed_assembly: 150,
            consumed_bytes: 128,
            produced_assembly: 100,
            produced_bytes: 256,
            consumed_format: EthernetIpFormat::RunIdleHeader,
            produced_format: EthernetIpFormat::Modeless,
            configuration_assembly: None,
            configuration_data: Vec::new(),
            route: Vec::new(),
            key: None,
        });
    }
    let findings = check_plc(&wrong, &right);
    let connection = finding(&findings, "connection");
    assert_eq!(connection.verdict, Missing);
    for text in ["O→T assembly 150, connection size 134", "refused: ", "this adapter has connection size 262"]
    {
        assert!(connection.found.contains(text), "{text}: {}", connection.found);
    }
    let findings = check_robot(&wrong, &right);
    let connection = finding(&findings, "connection");
    assert!(
        connection.verdict == Missing && connection.found.contains("256 bytes of data"),
        "{connection:?}"
    );
}

#[test]
fn a_silent_cable_leaves_every_step_unseen_with_a_remedy() {
    for name in ["A", "B", "C"] {
        let setup = setup_of(name);
        let bus = plc_bus(&setup);
        let watch = RobotWatch::new(&bus, StationId::FIRST, Duration::from_millis(4));
        let findings = PeerWatch::findings(&watch, &bus);
        assert!(
            findings.iter().all(|finding| finding.verdict == NotSeen && finding.fix.is_some()),
            "{findings:#?}"
        );
        assert_eq!(bus.stations(), 1);
    }
}
