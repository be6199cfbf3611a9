//! The connections of a rig: the PLC's interfaces, and the station at the other end of each cable.

use records::faults::{self, Change, Fault};
use setup::{Bus, Cell};
use std::time::Duration;

use crate::capture::{PLC_FILE, ROBOT_FILE};

/// The connections of a rig.
#[derive(Clone, PartialEq, Debug)]
pub struct RigLayout {
    /// Names of the buses on each interface of the PLC; a setup of one robot does not name its bus.
    interfaces: Vec<Vec<&'static str>>,
    stations: Vec<StationPlace>,
}

/// Where a station is.
#[derive(Clone, PartialEq, Debug)]
struct StationPlace {
    /// Its name; `None` for the only robot.
    name: Option<String>,
    /// Index of the PLC's interface that it is connected to.
    on: usize,
}

impl RigLayout {
    /// Returns the connection of a PLC with one robot.
    #[must_use]
    pub fn of_one() -> Self {
        let station = StationPlace { name: None, on: 0 };
        Self { interfaces: vec![Vec::new()], stations: vec![station] }
    }

    /// Returns the connections of a cell: buses on which the PLC has the same address share an interface, and each EtherCAT
    /// segment has one of its own.
    #[must_use]
    pub fn of_cell(cell: &Cell) -> Self {
        let mut addresses = Vec::new();
        let mut interfaces: Vec<Vec<&'static str>> = Vec::new();
        let mut stations = Vec::with_capacity(cell.stations.len());
        for station in &cell.stations {
            let Bus { kind, .. } = &station.bus;
            let address = station.bus.addresses().map(|addresses| addresses.plc);
            let is_same = |(index, other): (usize, &Option<_>)| match address {
                Some(_) => *other == address,
                None => interfaces.get(index).is_some_and(|buses| buses.contains(&kind.name())),
            };
            let found = addresses.iter().enumerate().position(is_same);
            let on = found.unwrap_or_else(|| {
                addresses.push(address);
                interfaces.push(Vec::new());
                interfaces.len() - 1
            });
            if let Some(buses) = interfaces.get_mut(on).filter(|buses| !buses.contains(&kind.name())) {
                buses.push(kind.name());
            }
            stations.push(StationPlace { name: Some(station.name.clone()), on });
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

    /// Returns the indexes of the stations at an interface of the PLC.
    pub(super) fn stations_on(&self, interface: usize) -> impl Iterator<Item = usize> {
        let places = self.stations.iter().enumerate();
        places.filter(move |(_, place)| place.on == interface).map(|(index, _)| index)
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

    /// Returns the name of the capture at an interface of the PLC.
    pub(super) fn plc_capture(&self, interface: usize) -> String {
        match self.interfaces.get(interface) {
            Some(buses) if self.interfaces.len() > 1 => format!("plc-{}.pcapng", buses.join("-")),
            _ => PLC_FILE.to_owned(),
        }
    }

    /// Returns the name of the capture at a robot.
    pub(super) fn robot_capture(&self, station: usize) -> String {
        let name = self.stations.get(station).and_then(|station| station.name.as_deref());
        name.map_or_else(|| ROBOT_FILE.to_owned(), |name| format!("robot-{name}.pcapng"))
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
        let captures =
            [e.plc_capture(0), e.robot_capture(1), f.plc_capture(1), RigLayout::of_one().robot_capture(0)];
        assert_eq!(captures, ["plc.pcapng", "robot-right.pcapng", "plc-ethercat.pcapng", "robot.pcapng"]);
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
