//! Creates the nodes of a cell with several stations: the PLC with a bus of each kind, and the robots.

use std::net::Ipv4Addr;
use std::time::Duration;

use anyhow::bail;
use machine::InterfaceId;
use machine::ethernet::Mac;
use planning::PROGRAM;
use plc_node::bus::PlcBus;
use plc_node::{MotionList, PlacedStation, PlcConfig, PlcNode, Scan, Sequences};
use protocol::fieldbus::StationId;
use records::faults::{self, Fault};
use robot_node::bus::RobotBus;
use robot_node::{Program, RobotNode};
use setup::{Bus, CellBus};
use virtual_time::{Clock, Impairment};

use super::cell::{NewInterface, NewNode, NewStation, VirtualCell};
use super::cell_faults;
use super::cell_watch::CellClocks;
use super::new_nodes::{open_plc, open_robot};
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
    let mut buses = Vec::with_capacity(new_buses.len());
    for bus in &new_buses {
        buses.push(open_bus(bus, seed, plc_clock, &mut phases)?);
    }
    let scan_us = &first.setup.plc;
    let scan = Scan::new(
        phases.first(plc_clock, scan_us.scan_cycle_us.value),
        Duration::from_micros(scan_us.scan_cycle_us.value.into()),
        Duration::from_micros(scan_us.scan_cost_us.value.into()),
    );
    let (mut placed, mut work, mut robots) = (Vec::new(), Vec::new(), Vec::new());
    for (index, station) in stations.iter().enumerate() {
        let Some((number, id)) = place_of(&new_buses, index) else { bail!("a station has no bus") };
        let PlannedStation { name, setup, planned, waits, visits, zones, .. } = station;
        let PlannedCell { motions, stops, to_start, .. } = planned.clone();
        let config = PlcConfig {
            motions: Box::new(MotionList::from(motions)),
            to_start,
            stops,
            ..PlcConfig::from_setup(setup, Vec::new(), PROGRAM)
        };
        let (config, of_program) = config.into_station(name, waits);
        placed.push(PlacedStation { bus: number, id, config });
        work.push(of_program.in_zones(visits, zones.as_ref()));
        let faults = cell_faults::of_station(name, faults);
        let mut robot = new_robot(station, index, new_buses[number].interface, seed, &mut phases, &faults);
        let in_line = &new_buses[number].stations;
        robot.line_place = in_line.iter().position(|(on_bus, _)| *on_bus == index).unwrap_or_default();
        let is_last = in_line.last().is_some_and(|(last, _)| *last == index);
        if let (RobotBus::Ethercat(sub_device), false) = (robot.node.machine.bus_mut(), is_last) {
            sub_device.lead_on();
        }
        robots.push(robot);
    }
    let arms: Option<Vec<_>> = stations.iter().map(|station| station.in_step.clone()).collect();
    let plc = PlcNode::with_program(scan, buses, placed, Sequences::new(work).into())
        .in_step(arms.unwrap_or_default());
    let plc = NewNode { machine: plc, clock: plc_clock, address: None };
    let cell = VirtualCell::of_many(plc, interfaces, robots, seed);
    Ok(NewCell { cell, clocks: CellClocks { plc: plc_clock, robots: phases.robots } })
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

fn open_bus(bus: &NewBus<'_>, seed: u64, clock: Clock, phases: &mut Phases) -> anyhow::Result<PlcBus> {
    let mut described = bus.stations.iter().map(|(_, bus)| *bus);
    let Some(first) = described.next() else { bail!("a bus has no station") };
    let others: Vec<&Bus> = described.collect();
    let start = phases.first(clock, first.cycle_us.value);
    Ok(open_plc(first, &others, bus.mac, seed, start)?)
}

fn new_robot(
    station: &PlannedStation,
    index: usize,
    on: usize,
    seed: u64,
    phases: &mut Phases,
    faults: &[Fault],
) -> NewStation {
    let bus = &station.setup.bus;
    let clock = phases.robots.get(index).copied().unwrap_or_default();
    // Each robot draws numbers of its own.
    let seed = seed.wrapping_add(index as u64);
    let mac = robot_mac(index);
    let of_robot = open_robot(bus, mac, seed, || phases.first(clock, bus.cycle_us.value));
    let start = phases.first(clock, station.setup.robot.cycle_us.value);
    let store = Program::of_sections(&station.planned.motions, &station.sections);
    let machine = RobotNode::new(station.planned.robot.clone(), store, of_robot, seed, start);
    let address: Option<Ipv4Addr> = robot_node::bus::address_from_project(&bus.kind);
    let delay = Duration::from_micros(bus.cable_delay_us.value.into());
    NewStation {
        node: NewNode { machine, clock, address },
        name: format!("robot {}", station.name),
        line_place: 0,
        mac: bus.addresses().map(|_| mac),
        on,
        links: faults::links(faults, Impairment { delay, ..Impairment::default() }),
    }
}

/// Locally administered addresses of the PLC's interfaces and of the robots.
pub(super) fn plc_mac(interface: usize) -> Mac {
    Mac([0x02, 0, 0, 0, 1, u8::try_from(interface).unwrap_or(u8::MAX)])
}

pub(super) fn robot_mac(index: usize) -> Mac {
    let [.., high, low] = index.to_be_bytes();
    Mac([0x02, 0, 0, 1, high, low])
}
