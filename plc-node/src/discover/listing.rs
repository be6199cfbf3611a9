//! Results of a search, as tables and as JSON.
//!
//! Names come from devices: whatever their bytes, they must not reach a terminal as control sequences.

use std::collections::BTreeMap;
use std::fmt;
use std::net::Ipv4Addr;

use ethernet_ip::FoundDevice;
use machine::ethernet::Mac;
use machine::search::{Answers, REQUESTS, SearchCounters};
use node::screen;
use profinet::FoundStation;
use protocol::search::Search;
use serde::Serialize;

use super::conflict::{Conflict, SharedProperty, conflicts};
use super::found_device::{Device, Station, state};
use super::sub_device::SubDevices;

/// The stations that answered ARP for each address.
pub(super) type Hosts = BTreeMap<Ipv4Addr, Vec<Mac>>;

/// A bus that can be searched.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) enum Bus {
    Profinet,
    EthernetIp,
    Ethercat,
}

impl fmt::Display for Bus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Profinet => "PROFINET",
            Self::EthernetIp => "EtherNet/IP",
            Self::Ethercat => "EtherCAT",
        })
    }
}

/// A requested bus that could not be searched.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Skipped {
    pub(super) bus: Bus,
    pub(super) reason: String,
}

/// The search's parameters and results.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Listing {
    interface: String,
    timeout_ms: u32,
    /// Null if PROFINET was not searched.
    profinet: Option<Vec<Station>>,
    /// Null if EtherNet/IP was not searched.
    ethernet_ip: Option<Vec<Device>>,
    /// Null if EtherCAT was not searched.
    ethercat: Option<SubDevices>,
    /// Names, addresses and serial numbers that several devices have.
    conflicts: Vec<Conflict>,
    skipped: Vec<Skipped>,
    /// Answers that were broken, foreign or too many.
    ignored_answers: u64,
}

impl Listing {
    /// Collects the results of the searches; a bus that was not requested or not available is left out. `hosts` are the stations
    /// that answered ARP for the devices' addresses; `None` if they could not be asked.
    pub(super) fn new(
        interface: String,
        timeout_ms: u32,
        search: Option<&Search>,
        hosts: Option<&Hosts>,
        ethercat: Option<SubDevices>,
        skipped: Vec<Skipped>,
    ) -> Self {
        let ignored = |counters: SearchCounters| counters.ignored + counters.surplus;
        let profinet = search.and_then(Search::profinet).map(|search| search.answers());
        let ethernet_ip = search.and_then(Search::ethernet_ip).map(|search| search.answers());
        let tallies =
            [profinet.map(|answers| answers.counters()), ethernet_ip.map(|answers| answers.counters())];
        let stations = |answers: &Answers<FoundStation>| {
            let mut stations: Vec<_> = answers.devices().iter().map(Station::from).collect();
            stations.sort_by(|one, other| (&one.name, &one.mac).cmp(&(&other.name, &other.mac)));
            stations
        };
        let hosts: Option<BTreeMap<Ipv4Addr, Vec<String>>> = hosts.map(|hosts| {
            hosts
                .iter()
                .map(|(address, macs)| (*address, macs.iter().map(Mac::to_string).collect()))
                .collect()
        });
        let devices = |answers: &Answers<FoundDevice>| {
            let mut devices: Vec<_> = answers.devices().iter().map(Device::from).collect();
            for device in &mut devices {
                let macs =
                    |hosts: &BTreeMap<_, Vec<_>>| hosts.get(&device.ip_address).cloned().unwrap_or_default();
                device.mac_addresses = hosts.as_ref().map(macs);
            }
            devices.sort_by_key(|device| (device.ip_address, device.serial_number));
            devices
        };
        let (profinet, ethernet_ip) = (profinet.map(stations), ethernet_ip.map(devices));
        let conflicts = conflicts(
            profinet.as_deref().unwrap_or_default(),
            ethernet_ip.as_deref().unwrap_or_default(),
            &hosts.unwrap_or_default(),
        );
        Self {
            interface,
            timeout_ms,
            profinet,
            ethernet_ip,
            ethercat,
            conflicts,
            skipped,
            ignored_answers: tallies.into_iter().flatten().map(ignored).sum(),
        }
    }

    /// Returns the whole listing as JSON, with a newline at the end.
    pub(super) fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }

    /// Formats the table of one bus, or says that nothing answered.
    fn section<D>(
        &self,
        f: &mut fmt::Formatter<'_>,
        found: &[D],
        [title, noun, question]: [&str; 3],
        header: &[&str],
        row: impl Fn(&D) -> Vec<String>,
    ) -> fmt::Result {
        if found.is_empty() {
            let Self { interface, timeout_ms, .. } = self;
            return writeln!(
                f,
                "{title}: no {noun} answered {question} on {interface}, asked {REQUESTS} times in {timeout_ms} ms."
            );
        }
        writeln!(f, "{title}: {} {noun}{}", found.len(), if found.len() == 1 { "" } else { "s" })?;
        let mut table = screen::ruled();
        table.set_header(header.to_vec());
        table.add_rows(found.iter().map(row));
        writeln!(f, "{}", screen::drawn(&table))
    }
}

impl fmt::Display for Listing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(stations) = &self.profinet {
            self.section(
                f,
                stations,
                ["PROFINET", "station", "DCP Identify"],
                &[
                    "Station name",
                    "MAC address",
                    "IP address",
                    "Type of station",
                    "VendorID",
                    "DeviceID",
                    "Roles",
                ],
                |station| station.row(&self.conflicts),
            )?;
        }
        if let Some(devices) = &self.ethernet_ip {
            if self.profinet.is_some() {
                writeln!(f)?;
            }
            self.section(
                f,
                devices,
                ["EtherNet/IP", "device", "ListIdentity"],
                &[
                    "IP address",
                    "MAC address",
                    "Product",
                    "Vendor",
                    "Type",
                    "Code",
                    "Revision",
                    "Serial number",
                    "Status",
                    "State",
                ],
                |device| device.row(&self.conflicts),
            )?;
        }
        if let Some(sub_devices) = &self.ethercat {
            if self.profinet.is_some() || self.ethernet_ip.is_some() {
                writeln!(f)?;
            }
            sub_devices.write(f, &self.interface)?;
        }
        if !self.conflicts.is_empty() {
            writeln!(f)?;
        }
        for conflict in &self.conflicts {
            writeln!(f, "! {conflict}")?;
        }
        if self.ignored_answers > 0 {
            writeln!(f, "\n{} broken or foreign answers were ignored.", self.ignored_answers)?;
        }
        Ok(())
    }
}

/// Returns a value for a table, with a mark if several devices have it.
fn marked(conflicts: &[Conflict], shared: SharedProperty, value: String) -> String {
    // The value of a conflict of names is in lower case.
    let compared = if shared == SharedProperty::StationName { value.to_lowercase() } else { value.clone() };
    if conflicts.iter().any(|conflict| conflict.is_of(shared, &compared)) { value + " !" } else { value }
}

impl Station {
    fn row(&self, conflicts: &[Conflict]) -> Vec<String> {
        let number = |id: Option<u16>| id.map_or_else(|| "–".to_owned(), |id| format!("0x{id:04X}"));
        let address = |address: Ipv4Addr| marked(conflicts, SharedProperty::IpAddress, address.to_string());
        let none = || "(none)".to_owned();
        let name = marked(conflicts, SharedProperty::StationName, self.name.clone());
        vec![
            if self.name.is_empty() { none() } else { name },
            self.mac.clone(),
            self.ip_address.map_or_else(none, address),
            self.type_of_station.clone(),
            number(self.vendor_id),
            number(self.device_id),
            self.roles.join(", "),
        ]
    }
}

impl Device {
    fn row(&self, conflicts: &[Conflict]) -> Vec<String> {
        let macs = self.mac_addresses.as_ref().filter(|macs| !macs.is_empty());
        let serial_number = format!("0x{:08X}", self.serial_number);
        vec![
            marked(conflicts, SharedProperty::IpAddress, self.ip_address.to_string()),
            macs.map_or_else(|| "–".to_owned(), |macs| macs.join(", ")),
            self.product_name.clone(),
            self.vendor_id.to_string(),
            self.device_type.to_string(),
            self.product_code.to_string(),
            self.revision.clone(),
            marked(conflicts, SharedProperty::SerialNumber, serial_number),
            format!("0x{:04X}", self.status),
            state(self.state),
        ]
    }
}

#[cfg(test)]
mod tests;
