//! The connections of a rig: the PLC's interfaces, and the station at the other end of each cable.

use records::faults::{self, Change, Fault};
use setup::{Cell, CellBus};
use std::time::Duration;

use super::cable::{ONWARD, ROBOT};
use crate::capture::{PLC_FILE, ROBOT_FILE};

/// The connections of a rig.
#[derive(Clone, PartialEq, Debug)]
pub struct RigLayout {
    /// Names of the buses on each interface of the PLC; a setup of one robot does not name its bus.
    interfaces: Vec<Vec<&'static str>>,
    stations: Vec<StationPlace>,
}

/// Where a station is.
#[derive(Clone, PartialEq, Default, Debug)]
struct StationPlace {
    /// Its name; `None` for the only robot.
    name: Option<String>,
    /// Index of the PLC's interface that it is connected to.
    on: usize,
    /// Set for an EtherCAT SubDevice, whose chip passes frames on.
    has_chip: bool,
    /// The station before it in an EtherCAT line; `None` for one at the PLC's interface.
    upstream: Option<usize>,
    /// Position before another station in the line: it has two interfaces.
    leads_on: bool,
}

impl RigLayout {
    /// Returns the connection of a PLC with one robot.
    #[must_use]
    pub fn of_one() -> Self {
        Self { interfaces: vec![Vec::new()], stations: vec![StationPlace::default()] }
    }

    /// Returns the connections of a cell: its buses on the PLC's interfaces, and on EtherCAT the stations in line.
    #[must_use]
    pub fn of_cell(cell: &Cell) -> Self {
        let mut interfaces: Vec<Vec<&'static str>> = Vec::new();
        let place = |name: &str| StationPlace { name: Some(name.to_owned()), ..StationPlace::default() };
        let mut stations: Vec<StationPlace> = cell.names().map(place).collect();
        for bus in CellBus::of_cell(cell) {
            interfaces.resize_with(interfaces.len().max(bus.interface + 1), Vec::new);
            interfaces.get_mut(bus.interface).into_iter().for_each(|buses| buses.push(bus.name));
            for index in &bus.stations {
                let Some(station) = stations.get_mut(*index) else { continue };
                station.on = bus.interface;
                station.has_chip = bus.is_line();
                (station.upstream, station.leads_on) = (bus.upstream_of(*index), bus.leads_on_from(*index));
            }
        }
        Self { interfaces, stations }
    }

    /// Returns the number of the PLC's interfaces.
    pub(super) const fn interfaces(&self) -> usize {
        self.interfaces.len()
    }

    /// Returns the number of stations.
    pub(super) const fn robots(&self) -> usize {
        self.stations.len()
    }

    /// Returns the names of the stations, in their order; `None` for the only robot.
    pub(super) fn names(&self) -> impl Iterator<Item = Option<&str>> {
        self.stations.iter().map(|station| station.name.as_deref())
    }

    /// Returns the indexes of the stations with a cable to an interface of the PLC, or to a switch there.
    pub(super) fn stations_on(&self, interface: usize) -> impl Iterator<Item = usize> {
        let places = self.stations.iter().enumerate();
        places
            .filter(move |(_, place)| place.on == interface && place.upstream.is_none())
            .map(|(index, _)| index)
    }

    /// Returns the station whose cable comes to this one in a line.
    pub(super) fn after(&self, station: usize) -> Option<usize> {
        self.stations.iter().position(|place| place.upstream == Some(station))
    }

    /// Returns the option `--interface` of a robot: its only one, or the ones towards the PLC and to the next robot of a line.
    pub(super) fn robot_interfaces(&self, station: usize) -> String {
        let leads_on = self.stations.get(station).is_some_and(|place| place.leads_on);
        if leads_on { format!("{ROBOT},{ONWARD}") } else { ROBOT.to_owned() }
    }

    /// Returns whether a station passes frames on, and so heeds the carriers of its cables.
    pub(super) fn has_chip(&self, station: usize) -> bool {
        self.stations.get(station).is_some_and(|place| place.has_chip)
    }

    /// Returns the option `--interface` of the PLC; `named` gives each of its interfaces a name.
    pub(super) fn interface_option(&self, named: impl Fn(usize) -> String) -> String {
        let of_interface = |(index, buses): (usize, &Vec<&str>)| {
            let name = named(index);
            match buses.as_slice() {
                [] => name,
                buses => buses.iter().map(|bus| format!("{bus}={name}")).collect::<Vec<_>>().join(","),
            }
        };
        self.interfaces.iter().enumerate().map(of_interface).collect::<Vec<_>>().join(",")
    }

    /// Returns the names of the captures at both ends of a station's cable: at the one towards the PLC, and at the robot.
    pub(super) fn captures(&self, station: usize) -> [String; 2] {
        let name = self.stations.get(station).and_then(|station| station.name.as_deref());
        match name {
            Some(name) => ["plc", "robot"].map(|end| format!("{end}-{name}.pcapng")),
            None => [PLC_FILE, ROBOT_FILE].map(str::to_owned),
        }
    }

    /// Returns the faults of a station's cable, robot and drives, and with one robot those of the PLC.
    pub(super) fn faults_of(&self, station: usize, faults: &[Fault]) -> Vec<Fault> {
        let name = self.stations.get(station).and_then(|station| station.name.as_deref());
        faults.iter().filter(|fault| fault.station() == name).cloned().collect()
    }

    /// Returns the changes of nodes and drives that faults make, each with its time and the index of its station; those of the
    /// PLC have the first.
    pub(super) fn changes(&self, faults: &[Fault]) -> Vec<(Duration, usize, Change)> {
        let of_fault = |fault: &Fault| {
            let station = self.names().position(|name| name == fault.station()).unwrap_or(0);
            let changes = faults::changes_of_nodes(std::slice::from_ref(fault)).into_iter();
            changes.map(move |(at, change)| (at, station, change)).collect::<Vec<_>>()
        };
        let mut changes: Vec<_> = faults.iter().flat_map(of_fault).collect();
        changes.sort_by_key(|(at, ..)| *at);
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(setup: &str) -> RigLayout {
        RigLayout::of_cell(&setup::cell(setup).unwrap().0)
    }

    #[test]
    fn profinet_and_ethernet_ip_share_an_interface_and_ethercat_has_its_own() {
        let named = |index| format!("plc{index}");
        let (e, f) = (layout("E"), layout("F"));
        assert_eq!(e.interface_option(named), "profinet=plc0,ethernet-ip=plc0");
        assert_eq!(f.interface_option(named), "profinet=plc0,ethercat=plc1");
        assert_eq!(RigLayout::of_one().interface_option(named), "plc0");
        assert_eq!(e.stations_on(0).collect::<Vec<_>>(), [0, 1]);
        assert_eq!(f.stations_on(1).collect::<Vec<_>>(), [1]);
        let captures = [e.captures(1), RigLayout::of_one().captures(0)];
        assert_eq!(captures, [["plc-right.pcapng", "robot-right.pcapng"], ["plc.pcapng", "robot.pcapng"]]);
    }

    #[test]
    fn stations_on_ethercat_are_in_line_by_their_positions() {
        let (mut cell, _) = setup::cell("F").unwrap();
        cell.stations[0].bus = cell.stations[1].bus.clone();
        (cell.stations[0].position, cell.stations[1].position) = (Some(1), Some(0));
        let line = RigLayout::of_cell(&cell);
        assert_eq!((line.interfaces(), line.stations_on(0).collect::<Vec<_>>()), (1, vec![1]));
        assert_eq!([1, 0].map(|station| line.after(station)), [Some(0), None]);
        assert_eq!([1, 0].map(|station| line.robot_interfaces(station)), ["robot0,onward0", "robot0"]);
    }

    #[test]
    fn a_fault_is_of_the_cable_and_the_robot_of_its_station() {
        let faults = ["left/loss=0.5", "right/kill-robot-at=2s", "kill-plc-at=1s"];
        let faults = faults.map(|fault| fault.parse::<Fault>().unwrap());
        let e = layout("E");
        let listed = |station| faults::listed(&e.faults_of(station, &faults));
        assert_eq!((listed(0), listed(1)), ("left/loss=0.5".to_owned(), "right/kill-robot-at=2s".to_owned()));
        let changes = e.changes(&faults);
        let of: Vec<_> = changes.iter().map(|(at, station, _)| (at.as_secs(), *station)).collect();
        assert_eq!(of, [(1, 0), (2, 1)]);
    }
}
