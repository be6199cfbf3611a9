//! The command `run` on a setup of several stations: the PLC node serves all of them, a robot node is one of them.
//!
//! ```text
//! RunOptions::prepare_cell     the PLC's: all stations planned, the buses that they are on, an interface for each bus
//! RunOptions::prepare_station  a robot's: its station as a setup of its own
//! ```

use anyhow::Context as _;
use planning::{FoundCell, PlannedCell};
use protocol_linux::{FormerAddress, Interface, StopSignals};
use setup::{Cell, CellBus};

use crate::cell_run_error::CellRunError;
use crate::message::CellText;
use crate::planned_station::{choose_station, find_station, names};
use crate::role::NodeRole;
use crate::run::{NodeStart, Prepared, RunOptions, set_up, take_address};
use crate::supervise::OperatingMode;
use crate::{Node, Outcome};

/// What the PLC node of several stations needs to start on its buses.
#[derive(Debug)]
pub struct PreparedCell {
    /// The setup, checked.
    pub cell: Cell,
    /// The motions of all stations, and where they wait for each other.
    pub planned: PlannedCell,
    /// Its buses.
    pub buses: Vec<CellBus>,
    /// The interface of each bus, in their order; they are up.
    pub interfaces: Vec<Interface>,
    /// Texts of the applications.
    applications: String,
    signals: StopSignals,
    former_addresses: Vec<FormerAddress>,
}

impl RunOptions {
    /// Returns whether the setup has several stations. Where it cannot be read, [`prepare`](Self::prepare) says why.
    #[must_use]
    pub fn has_several_stations(&self) -> bool {
        setup::cell(&self.setup).is_ok_and(|(cell, _)| !cell.is_one())
    }

    /// Prepares the PLC node of a setup with several stations. Call it while the process has one thread.
    ///
    /// # Errors
    ///
    /// [`CellRunError`], and those of [`prepare`](Self::prepare).
    pub fn prepare_cell(&self) -> anyhow::Result<PreparedCell> {
        let signals = self.prepare_process()?;
        let (cell, found) = self.find_cell()?;
        let planned = found.plan(&cell)?;
        let buses = CellBus::of_cell(&cell);
        let names: Vec<_> = buses.iter().map(|bus| bus.name).collect();
        let interfaces = self.find_interfaces(&names)?;
        check_interfaces(&cell, &buses, &interfaces.iter().map(Interface::name).collect::<Vec<_>>())?;
        let former_addresses = set_up(&interfaces)?;
        let applications = found.text(&cell);
        Ok(PreparedCell { cell, planned, buses, interfaces, applications, signals, former_addresses })
    }

    /// Prepares a node of one robot: of the station named so, or of a setup with one robot only. Call it while the process has
    /// one thread.
    ///
    /// # Errors
    ///
    /// [`CellRunError`], and those of [`prepare`](Self::prepare).
    pub fn prepare_station(&self, name: Option<&str>) -> anyhow::Result<Prepared> {
        if !self.has_several_stations() {
            if let (Some(name), Ok((only, _))) = (name, setup::cell(&self.setup)) {
                find_station(&only, name)?;
            }
            return self.prepare_on(|bus| self.find_ports_of(bus));
        }
        let signals = self.prepare_process()?;
        let (cell, found) = self.find_cell()?;
        let index = choose_station(&cell, name)?;
        let mut planned = found.plan(&cell)?;
        let (planned, application) = (planned.stations.swap_remove(index), found.stations[index].clone());
        let interfaces = self.find_ports(&cell, index)?;
        let former_addresses = set_up(&interfaces)?;
        let (setup, plan) = (planned.setup, planned.plan);
        Ok(Prepared { setup, application, plan, interfaces, station_file: None, signals, former_addresses })
    }

    /// Finds the interfaces of a station: one, or on EtherCAT the two of a SubDevice between two others.
    fn find_ports(&self, cell: &Cell, station: usize) -> anyhow::Result<Vec<Interface>> {
        let buses = CellBus::of_cell(cell);
        let bus = buses.iter().find(|bus| bus.stations.contains(&station)).context("a station has a bus")?;
        let found = self.find_ports_of(bus.name)?;
        if found.len() < 2 && bus.leads_on_from(station) {
            let after = bus.stations.iter().skip_while(|index| **index != station).nth(1);
            let name = |index: usize| cell.names().nth(index).unwrap_or_default().to_owned();
            let next = after.map(|index| name(*index)).unwrap_or_default();
            return Err(CellRunError::NoWayOn { station: name(station), next }.into());
        }
        Ok(found)
    }

    /// Finds the setup with its applications, with the options in it.
    fn find_cell(&self) -> anyhow::Result<(Cell, FoundCell)> {
        let (mut cell, found) = planning::cell_with_applications(&self.setup)?;
        if self.application.is_some() {
            return Err(CellRunError::Application(cell.name).into());
        }
        if self.direct {
            return Err(CellRunError::Direct(cell.name).into());
        }
        if let Some(cyclic) = self.cyclic {
            for station in &mut cell.stations {
                station.bus.set_cyclic(cyclic);
            }
            setup::check_cell(&cell)?;
        }
        Ok((cell, found))
    }
}

/// Checks that each of these interfaces, by their names, can carry the buses on it.
fn check_interfaces(cell: &Cell, buses: &[CellBus], interfaces: &[&str]) -> Result<(), CellRunError> {
    for (index, (bus, interface)) in buses.iter().zip(interfaces).enumerate() {
        let before = buses.iter().zip(interfaces).take(index).filter(|(_, other)| *other == interface);
        for (other, _) in before {
            let interface = (*interface).to_owned();
            match (other.addresses(cell), bus.addresses(cell)) {
                (None, _) => return Err(CellRunError::SharedSegment { interface, other: bus.name }),
                (_, None) => return Err(CellRunError::SharedSegment { interface, other: other.name }),
                (Some(one), Some(two)) if one.plc != two.plc => {
                    let (buses, addresses) = ([other.name, bus.name], [one.plc, two.plc]);
                    return Err(CellRunError::TwoAddresses { interface, buses, addresses });
                }
                _ => {}
            }
        }
    }
    Ok(())
}

impl PreparedCell {
    /// Gives each interface the IP address that the PLC has there; buses with the same address on one interface share it.
    ///
    /// # Errors
    ///
    /// Another station on the cable has that address; the interface has another one, which may be the user's own connection;
    /// or it gets none.
    pub fn take_addresses(&self) -> anyhow::Result<()> {
        let mut taken: Vec<&str> = Vec::new();
        for (bus, interface) in self.buses.iter().zip(&self.interfaces) {
            let Some(addresses) = bus.addresses(&self.cell) else { continue };
            if !taken.contains(&interface.name()) {
                take_address(interface, "station.bus.plc_address", addresses.plc, addresses.mask)?;
                taken.push(interface.name());
            }
        }
        Ok(())
    }

    /// Runs the PLC until it is asked to end or `mode` ends it. `endpoint` is what it is on its buses, for its first message.
    ///
    /// # Errors
    ///
    /// The control port cannot be opened, or the cyclic thread does not start.
    pub fn supervise<N: Node, C: OperatingMode<N>>(
        self,
        options: &RunOptions,
        endpoint: &str,
        node: N,
        mode: &mut C,
    ) -> anyhow::Result<Outcome> {
        let Self { cell, interfaces, applications, signals, former_addresses, .. } = self;
        let text = CellText { setup: setup::cell_to_toml(&cell)?, application: applications };
        let several = Some(names(&cell)).filter(|stations| stations.len() > 1);
        let (stations, setup) = (several.unwrap_or_default(), cell.name);
        let station_file = None;
        let start =
            NodeStart { setup, cell: text, stations, interfaces, station_file, signals, former_addresses };
        start.supervise(options, NodeRole::Plc, endpoint, node, mode)
    }
}

#[cfg(test)]
mod tests {
    use setup::BusKind;

    use super::*;

    fn cell(name: &str) -> Cell {
        setup::cell(name).unwrap().0
    }

    #[test]
    fn buses_share_an_interface_unless_one_is_ethercat_or_their_addresses_differ() {
        let check = |cell: &Cell, interfaces: [&str; 2]| {
            let checked = check_interfaces(cell, &CellBus::of_cell(cell), &interfaces);
            checked.map_err(|error| error.to_string())
        };
        let (mut e, f) = (cell("E"), cell("F"));
        assert_eq!(check(&e, ["eth0", "eth0"]), Ok(()));
        assert_eq!(check(&f, ["eth0", "eth1"]), Ok(()));
        let shared = "bus ethercat shares interface eth0 with bus profinet: give it an interface of its own, ethercat=IF";
        assert_eq!(check(&f, ["eth0", "eth0"]), Err(shared.to_owned()));
        if let BusKind::EthernetIp(addresses, _) = &mut e.stations[1].bus.kind {
            addresses.plc = [192, 168, 64, 9].into();
        }
        assert_eq!(
            check(&e, ["eth0", "eth0"]).unwrap_err(),
            "the PLC is 192.168.64.1 on bus profinet and 192.168.64.9 on bus ethernet-ip, both on interface eth0: give each \
             bus an interface"
        );
        assert_eq!(check(&e, ["eth0", "eth1"]), Ok(()));
    }
}
