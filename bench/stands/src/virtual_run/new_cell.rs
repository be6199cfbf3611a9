//! Creates the nodes of a cell with several stations: the PLC with a bus of each kind, and the robots.

use std::net::Ipv4Addr;
use std::time::Duration;

use anyhow::bail;
use machine::ethernet::Mac;
use machine::{Instant, InterfaceId};
use planning::PROGRAM;
use plc_node::bus::PlcBus;
use plc_node::{PlacedStation, PlcConfig, PlcNode, Scan, Sequences, motion_source};
use protocol::fieldbus::StationId;
use records::faults::{self, Fault};
use robot_node::arm::Joints;
use robot_node::bus::RobotBus;
use robot_node::{Program, RobotNode};
use setup::{Bus, CellBus};
use virtual_time::Impairment;

use super::cell::{NewInterface, NewNode, NewStation, Plc, VirtualCell};
use super::cell_faults;
use super::cell_watch::CellClocks;
use super::new_nodes::{UNTIL_FIRST_CYCLE, open_plc, open_robot};
use super::phases::Phases;
use crate::planned_cell::PlannedCell;
use crate::planned_station::PlannedStation;

/// A bus of the PLC.
struct NewBus<'a> {
    /// Each station's index and how it describes the bus.
    stations: Vec<(usize, &'a Bus)>,
    interface: usize,
    mac: Mac,
}

/// A cell that was just switched on, and the clocks of its nodes.
pub(super) struct NewCell {
    pub(super) cell: VirtualCell,
    pub(super) clocks: CellClocks,
}

/// Switches on all nodes of a cell. They do not know each other yet.
///
/// # Errors
///
/// A setup gives no bus endpoint, or the virtual network cannot carry the stations.
pub(super) fn switch_on(stations: &[PlannedStation], seed: u64, faults: &[Fault]) -> anyhow::Result<NewCell> {
    let Some(first) = stations.first() else { bail!("the cell has no station; add one to its setup") };
    let mut phases = Phases::new(stations.iter().map(|station| &station.setup), seed);
    let (new_buses, interfaces) = buses_of(stations);
    let plc_clock = phases.plc;
    let plc = {
        let mut start = |cycle_us| phases.first(plc_clock, cycle_us);
        let buses = new_buses.iter().map(|bus| bus.open(seed, &mut start)).collect::<Result<_, _>>()?;
        new_plc(stations, &new_buses, buses, start(first.setup.plc.scan_cycle_us.value))?
    };
    let mut robots = Vec::new();
    for (index, station) in stations.iter().enumerate() {
        let of_station = cell_faults::of_station(&station.name, faults);
        let clock = phases.robots.get(index).copied().unwrap_or_default();
        let start = |cycle_us| phases.first(clock, cycle_us);
        let machine = new_robot(station, (index, ends_line(&new_buses, index)), seed, None, start);
        let bus = &station.setup.bus;
        let delay = Duration::from_micros(bus.cable_delay_us.value.into());
        let Some((number, StationId(line_place))) = place_of(&new_buses, index) else {
            bail!("a station has no bus")
        };
        robots.push(NewStation {
            node: NewNode { machine, clock, address: address_of(station) },
            name: format!("robot {}", station.name),
            mac: bus.addresses().map(|_| robot_mac(index)),
            on: new_buses[number].interface,
            line_place: line_place.into(),
            links: faults::links(&of_station, Impairment { delay, ..Impairment::default() }),
        });
    }
    let plc = NewNode { machine: plc, clock: plc_clock, address: None };
    let cell = VirtualCell::of_many(plc, interfaces, robots, seed);
    Ok(NewCell { cell, clocks: CellClocks { plc: plc_clock, robots: phases.robots } })
}

/// Creates the PLC of these stations once more, as a computer that is switched off and on.
///
/// # Errors
///
/// A setup gives no bus endpoint.
pub(super) fn restarted_plc(stations: &[PlannedStation], seed: u64, now: Instant) -> anyhow::Result<Plc> {
    let (new_buses, _) = buses_of(stations);
    // Its numbers of connections are others than those of the first one.
    let seed = seed ^ now.as_nanos();
    let mut start = |_| now + UNTIL_FIRST_CYCLE;
    let buses = new_buses.iter().map(|bus| bus.open(seed, &mut start)).collect::<Result<_, _>>()?;
    new_plc(stations, &new_buses, buses, now + UNTIL_FIRST_CYCLE)
}

/// Creates a robot once more, likewise; its arm stands in these joints.
pub(super) fn restarted_robot(
    stations: &[PlannedStation],
    index: usize,
    seed: u64,
    now: Instant,
    joints: Joints,
) -> Option<RobotNode<RobotBus>> {
    let (new_buses, _) = buses_of(stations);
    let place = (index, ends_line(&new_buses, index));
    let start = |_| now + UNTIL_FIRST_CYCLE;
    Some(new_robot(stations.get(index)?, place, seed ^ now.as_nanos(), Some(joints), start))
}

/// Creates the PLC of these stations on its open buses, whose first scan is at `start`.
fn new_plc(
    stations: &[PlannedStation],
    new_buses: &[NewBus<'_>],
    buses: Vec<PlcBus>,
    start: Instant,
) -> anyhow::Result<Plc> {
    let Some(first) = stations.first() else { bail!("the cell has no station; add one to its setup") };
    let scan_us = &first.setup.plc;
    let scan = Scan::new(
        start,
        Duration::from_micros(scan_us.scan_cycle_us.value.into()),
        Duration::from_micros(scan_us.scan_cost_us.value.into()),
    );
    let (mut placed, mut work) = (Vec::new(), Vec::new());
    for (index, station) in stations.iter().enumerate() {
        let Some((number, id)) = place_of(new_buses, index) else { bail!("a station has no bus") };
        let PlannedStation { name, setup, planned, waits, visits, zones, .. } = station;
        let PlannedCell { motions, points, stops, to_start, .. } = planned.clone();
        let config = PlcConfig {
            motions: motion_source(motions, points),
            to_start,
            stops,
            ..PlcConfig::from_setup(setup, Vec::new(), PROGRAM)
        };
        let (config, of_program) = config.into_station(name, waits);
        placed.push(PlacedStation { bus: number, id, config });
        work.push(of_program.in_zones(visits, zones.as_ref()));
    }
    let arms: Option<Vec<_>> = stations.iter().map(|station| station.in_step.clone()).collect();
    let plc = PlcNode::with_program(scan, buses, placed, Sequences::new(work).into());
    Ok(plc.in_step(arms.unwrap_or_default()))
}

/// Finds the buses of the stations, and the interfaces that they need, as [`CellBus`] has them.
fn buses_of(stations: &[PlannedStation]) -> (Vec<NewBus<'_>>, Vec<NewInterface>) {
    let mut interfaces: Vec<NewInterface> = Vec::new();
    let described = stations.iter().map(|station| (&station.setup.bus, station.position));
    let new_bus = |(number, bus): (u8, CellBus)| {
        let of_bus: Vec<_> = bus
            .stations
            .iter()
            .filter_map(|index| Some((*index, &stations.get(*index)?.setup.bus)))
            .collect();
        let address = of_bus.first().and_then(|(_, bus)| bus.addresses()).map(|addresses| addresses.plc);
        let (on, mac) = (InterfaceId(number), plc_mac(bus.interface));
        match interfaces.get_mut(bus.interface) {
            Some(shared) => shared.serves.push(on),
            None => interfaces.push(NewInterface { serves: vec![on], mac: address.map(|_| mac), address }),
        }
        NewBus { stations: of_bus, interface: bus.interface, mac }
    };
    let buses = (0..=u8::MAX).zip(CellBus::of_stations(described)).map(new_bus).collect();
    (buses, interfaces)
}

fn place_of(buses: &[NewBus<'_>], station: usize) -> Option<(usize, StationId)> {
    buses.iter().enumerate().find_map(|(number, bus)| {
        let at = bus.stations.iter().position(|(index, _)| *index == station)?;
        Some((number, StationId(u16::try_from(at).ok()?)))
    })
}

/// Returns whether no other robot follows a robot on its bus.
fn ends_line(buses: &[NewBus<'_>], station: usize) -> bool {
    let is_last = |bus: &NewBus<'_>| bus.stations.last().is_some_and(|(last, _)| *last == station);
    buses.iter().any(is_last)
}

impl NewBus<'_> {
    /// Opens the PLC's end; `start` gives the first cycle of a task with such a cycle in µs.
    fn open(&self, seed: u64, start: &mut impl FnMut(u32) -> Instant) -> anyhow::Result<PlcBus> {
        let mut described = self.stations.iter().map(|(_, bus)| *bus);
        let Some(first) = described.next() else { bail!("a bus has no station") };
        let others: Vec<&Bus> = described.collect();
        Ok(open_plc(first, &others, self.mac, seed, start(first.cycle_us.value))?)
    }
}

/// Creates the robot of a station, by its index and whether it is the last one on its bus. `joints` are where its arm
/// stands; by default where its setup says. `start` gives the first cycle of a task with such a cycle in µs.
fn new_robot(
    station: &PlannedStation,
    (index, ends_line): (usize, bool),
    seed: u64,
    joints: Option<Joints>,
    mut start: impl FnMut(u32) -> Instant,
) -> RobotNode<RobotBus> {
    let bus = &station.setup.bus;
    // Each robot draws numbers of its own.
    let seed = seed.wrapping_add(index as u64);
    let mut of_robot = open_robot(bus, robot_mac(index), seed, || start(bus.cycle_us.value));
    if let (RobotBus::Ethercat(sub_device), false) = (&mut of_robot, ends_line) {
        sub_device.lead_on();
    }
    let mut config = station.planned.robot.clone();
    config.home = joints.unwrap_or(config.home);
    let store = Program::of_sections(&station.planned.motions, &station.programs);
    RobotNode::new(config, store, of_robot, seed, start(station.setup.robot.cycle_us.value))
}

/// Returns the IP address that a station's robot has when it is switched on.
pub(super) fn address_of(station: &PlannedStation) -> Option<Ipv4Addr> {
    robot_node::bus::address_from_project(&station.setup.bus.kind)
}

/// Locally administered addresses of the PLC's interfaces and of the robots.
pub(super) fn plc_mac(interface: usize) -> Mac {
    Mac([0x02, 0, 0, 0, 1, u8::try_from(interface).unwrap_or(u8::MAX)])
}

pub(super) fn robot_mac(index: usize) -> Mac {
    let [.., high, low] = index.to_be_bytes();
    Mac([0x02, 0, 0, 1, high, low])
}
