//! Creates the nodes of a cell, once more where a fault has ended them, as a computer that is switched off and on.

use std::net::Ipv4Addr;
use std::time::Duration;

use machine::Instant;
use machine::ethernet::Mac;
use planning::{PROGRAM, Stop, ToStart};
use plc_node::bus::{BusError, PlcBus};
use plc_node::{ExportedCode, MotionSource, PlcConfig, PlcNode};
use protocol::image::Motion;
use robot_node::arm::Joints;
use robot_node::bus::RobotBus;
use robot_node::{Program, RobotConfig, RobotNode};
use setup::{Bus, Setup};
use virtual_time::Side;

use super::cell::Plc;
use super::phases::Phases;
use super::{PLC_MAC, ROBOT_MAC, Work};
use crate::planned_cell::PlannedCell;

/// Time from the start of a node to its first cycle.
pub(super) const UNTIL_FIRST_CYCLE: Duration = Duration::from_micros(100);

/// Creates both ends of a bus, each with a phase of its own.
///
/// # Errors
///
/// The setup gives no bus endpoint for the PLC.
pub(super) fn new_buses(bus: &Bus, seed: u64, phases: &mut Phases) -> Result<(PlcBus, RobotBus), BusError> {
    let start = phases.first_at(Side::A, bus.cycle_us.value);
    let plc = open_plc(bus, &[], PLC_MAC, seed, start)?;
    let start = || phases.first_at(Side::B, bus.cycle_us.value);
    Ok((plc, open_robot(bus, ROBOT_MAC, seed, start)))
}

/// Opens the PLC's end of a bus with one station, or with several, as each describes it. The addresses of a virtual network were
/// checked, so EtherNet/IP does not ask for another station with its own: 60 ms of questions would only shift the phases of
/// all cycles.
///
/// # Errors
///
/// The setup gives no bus endpoint for the PLC.
pub(super) fn open_plc(
    first: &Bus,
    others: &[&Bus],
    mac: Mac,
    seed: u64,
    start: Instant,
) -> Result<PlcBus, BusError> {
    let mut plc = plc_node::bus::open_all(first, others, mac, seed, start)?;
    if let PlcBus::EthernetIp(scanner) = &mut plc {
        scanner.stop_conflict_detection();
    }
    Ok(plc)
}

/// Opens a robot's end of a bus, likewise.
pub(super) fn open_robot(bus: &Bus, mac: Mac, seed: u64, start: impl FnOnce() -> Instant) -> RobotBus {
    let mut robot = robot_node::bus::open(bus, mac, None, seed, start);
    if let RobotBus::EthernetIp(adapter) = &mut robot {
        adapter.stop_conflict_detection();
    }
    robot
}

/// Returns the IP addresses that the PLC and the robot have at the start.
pub(super) fn addresses(bus: &Bus) -> [Option<Ipv4Addr>; 2] {
    let plc = bus.addresses().map(|addresses| addresses.plc);
    [plc, robot_node::bus::address_from_project(&bus.kind)]
}

/// Creates the PLC of a cell; `plan` is what it sends, where its continuous motions end, and how the arm gets to their
/// start. Exported code takes the place of its function blocks, if there is some.
pub(super) fn new_plc(
    setup: &Setup,
    plan: (Box<dyn MotionSource>, Vec<Stop>, ToStart<Motion>),
    code: Option<ExportedCode>,
    bus: PlcBus,
    start: Instant,
) -> anyhow::Result<Plc> {
    let (motions, stops, to_start) = plan;
    let config = PlcConfig { motions, to_start, stops, ..PlcConfig::from_setup(setup, Vec::new(), PROGRAM) };
    Ok(PlcNode::of_code(config, code, bus, start)?)
}

/// Creates the robot of a cell, with a program of these motions and stops in its store.
pub(super) fn new_robot(
    config: RobotConfig,
    (program, stops): (Vec<Motion>, &[Stop]),
    bus: RobotBus,
    seed: u64,
    start: Instant,
) -> RobotNode<RobotBus> {
    RobotNode::new(config, vec![(PROGRAM, Program::new(program, stops))], bus, seed, start)
}

/// Makes a PLC that starts at an instant of its own clock.
type MakePlc = Box<dyn Fn(Instant) -> anyhow::Result<Plc>>;

/// Makes a robot likewise, whose arm stands in these joints.
type MakeRobot = Box<dyn Fn(Instant, Joints) -> RobotNode<RobotBus>>;

/// Makes each node of a cell once more.
pub(super) struct Restart {
    pub(super) plc: MakePlc,
    pub(super) robot: MakeRobot,
}

impl Restart {
    /// Prepares the nodes of a cell on the bus that its setup names. Their numbers of connections are others than those
    /// of the first nodes.
    pub(super) fn of(setup: &Setup, planned: PlannedCell, code: Option<ExportedCode>, seed: u64) -> Self {
        let (setup_of_plc, planned_of_plc) = (setup.clone(), planned.clone());
        let plc: MakePlc = Box::new(move |now| {
            let start = now + UNTIL_FIRST_CYCLE;
            let bus = open_plc(&setup_of_plc.bus, &[], PLC_MAC, seed ^ now.as_nanos(), start)?;
            let Work { source, stops, to_start, .. } = Work::of(planned_of_plc.clone());
            new_plc(&setup_of_plc, (source, stops, to_start), code.clone(), bus, start)
        });
        let setup = setup.clone();
        let robot: MakeRobot = Box::new(move |now, joints| {
            let (start, seed) = (now + UNTIL_FIRST_CYCLE, seed ^ now.as_nanos());
            let bus = open_robot(&setup.bus, ROBOT_MAC, seed, || start);
            let Work { robot, program, stops, .. } = Work::of(planned.clone());
            new_robot(RobotConfig { home: joints, ..robot }, (program, &stops), bus, seed, start)
        });
        Self { plc, robot }
    }
}

#[cfg(test)]
mod tests {
    use crate::virtual_run::VirtualRun;

    #[test]
    fn the_plc_hears_from_the_robot_on_each_bus_what_device_it_is() {
        let said = ["A", "B", "C"].map(|name| {
            let (setup, found) = planning::setup_with_application(name).unwrap();
            let run = VirtualRun::start(&setup, &found.application, 1).unwrap();
            let mut words = String::new();
            run.nodes.cell.plc().write_identity(0, &mut words).unwrap();
            words
        });
        let [profinet, ethernet_ip, ethercat] = &said;
        assert!(profinet.starts_with("`skillbench-robot` (02:"), "{said:?}");
        assert!(profinet.ends_with("VendorID 0xFFFF, DeviceID 0x0001"), "{said:?}");
        assert!(ethernet_ip.starts_with("vendor 65535, device type 43, product code 1"), "{said:?}");
        assert!(ethercat.contains("vendor 0x") && ethercat.contains("revision 0x"), "{said:?}");
    }
}
