//! The buses of a cell's PLC, and the interfaces that they need.

use std::net::Ipv4Addr;

use crate::{Addresses, Bus, Cell};

/// A bus of the PLC, with the stations on it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct CellBus {
    /// Its kind, by name.
    pub name: &'static str,
    /// Indexes of its stations in the cell, in the order in which the bus numbers them: on EtherCAT that of the line.
    pub stations: Vec<usize>,
    /// Number of the PLC's interface, from 0. Buses on which the PLC has the same address share one; an EtherCAT segment has one of
    /// its own.
    pub interface: usize,
}

impl CellBus {
    /// Returns the buses of a cell, in the order of their first stations.
    #[must_use]
    pub fn of_cell(cell: &Cell) -> Vec<Self> {
        Self::of_stations(cell.stations.iter().map(|station| (&station.bus, station.position)))
    }

    /// Returns the buses of stations in the same way, each with its place in the line if its setup gives one.
    pub fn of_stations<'a>(stations: impl IntoIterator<Item = (&'a Bus, Option<u16>)>) -> Vec<Self> {
        let mut buses: Vec<Self> = Vec::new();
        let mut interfaces: Vec<Option<Ipv4Addr>> = Vec::new();
        let mut places = Vec::new();
        for (index, (bus, position)) in stations.into_iter().enumerate() {
            let name = bus.kind.name();
            let known = buses.iter().position(|other| other.name == name);
            let number = known.unwrap_or_else(|| {
                let address = bus.addresses().map(|addresses| addresses.plc);
                let shared = interfaces.iter().position(|other| address.is_some() && *other == address);
                let interface = shared.unwrap_or_else(|| {
                    interfaces.push(address);
                    interfaces.len() - 1
                });
                buses.push(Self { name, stations: Vec::new(), interface });
                buses.len() - 1
            });
            let Some(bus) = buses.get_mut(number) else { continue };
            places.push(position.map_or(bus.stations.len(), usize::from));
            bus.stations.push(index);
        }
        for bus in &mut buses {
            bus.stations.sort_by_key(|index| places.get(*index));
        }
        buses
    }

    /// Returns how each of its stations describes the bus.
    pub fn descriptions<'a>(&self, cell: &'a Cell) -> impl Iterator<Item = &'a Bus> {
        self.stations.iter().filter_map(|index| Some(&cell.stations.get(*index)?.bus))
    }

    /// Returns the addresses of the bus; `None` for one without.
    #[must_use]
    pub fn addresses<'a>(&self, cell: &'a Cell) -> Option<&'a Addresses> {
        self.descriptions(cell).next()?.addresses()
    }

    /// Returns the station that comes before this one in the line; `None` at the PLC, and on a bus whose stations are not in line.
    #[must_use]
    pub fn upstream_of(&self, station: usize) -> Option<usize> {
        let place = self.stations.iter().position(|index| *index == station)?;
        place.checked_sub(1).filter(|_| self.is_line()).and_then(|before| self.stations.get(before).copied())
    }

    /// Returns whether another station comes after this one in the line.
    #[must_use]
    pub fn leads_on_from(&self, station: usize) -> bool {
        self.is_line() && self.stations.contains(&station) && self.stations.last() != Some(&station)
    }

    /// Returns whether its stations are in line, each passing frames on to the next one.
    #[must_use]
    pub fn is_line(&self) -> bool {
        self.name == crate::cell::ETHERCAT
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BusKind;

    fn cell(name: &str) -> Cell {
        crate::cell(name).unwrap().0
    }

    fn listed(cell: &Cell) -> Vec<(&'static str, Vec<usize>, usize)> {
        CellBus::of_cell(cell).into_iter().map(|bus| (bus.name, bus.stations, bus.interface)).collect()
    }

    #[test]
    fn a_cell_has_a_bus_for_each_kind_with_its_stations_in_the_order_of_the_bus() {
        assert_eq!(listed(&cell("E")), [("profinet", vec![0], 0), ("ethernet-ip", vec![1], 0)]);
        assert_eq!(listed(&cell("F")), [("profinet", vec![0], 0), ("ethercat", vec![1], 1)]);
        let mut in_line = cell("F");
        in_line.stations.insert(0, in_line.stations[1].clone());
        in_line.stations[0].name = "last".to_owned();
        (in_line.stations[0].position, in_line.stations[2].position) = (Some(1), Some(0));
        assert_eq!(listed(&in_line), [("ethercat", vec![2, 0], 0), ("profinet", vec![1], 1)]);
        let line = CellBus::of_cell(&in_line).swap_remove(0);
        assert_eq!([0, 1, 2].map(|station| line.upstream_of(station)), [Some(2), None, None]);
        assert_eq!([0, 1, 2].map(|station| line.leads_on_from(station)), [false, false, true]);
    }

    #[test]
    fn buses_with_other_addresses_of_the_plc_have_interfaces_of_their_own() {
        let mut cell = cell("E");
        if let BusKind::EthernetIp(addresses, _) = &mut cell.stations[1].bus.kind {
            addresses.plc = [192, 168, 64, 9].into();
        }
        assert_eq!(listed(&cell), [("profinet", vec![0], 0), ("ethernet-ip", vec![1], 1)]);
    }
}
