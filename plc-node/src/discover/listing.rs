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
use profinet::dcp::IpSuite;
use protocol::search::Search;
use serde::Serialize;

use super::conflict::{Conflict, SharedProperty, conflicts};
use super::sub_device::SubDevices;
use crate::printable::printable;

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

#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Station {
    pub(super) name: String,
    pub(super) mac: String,
    pub(super) ip_address: Option<Ipv4Addr>,
    subnet_mask: Option<Ipv4Addr>,
    gateway: Option<Ipv4Addr>,
    type_of_station: String,
    vendor_id: Option<u16>,
    device_id: Option<u16>,
    roles: Vec<&'static str>,
}

#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Device {
    pub(super) ip_address: Ipv4Addr,
    /// Stations that answer ARP for the address; null if ARP could not be asked.
    pub(super) mac_addresses: Option<Vec<String>>,
    /// The address that the device reports.
    listens_at: String,
    product_name: String,
    pub(super) vendor_id: u16,
    device_type: u16,
    product_code: u16,
    revision: String,
    pub(super) serial_number: u32,
    status: u16,
    state: u8,
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

impl From<&FoundStation> for Station {
    fn from(station: &FoundStation) -> Self {
        let set = |address: Ipv4Addr| (!address.is_unspecified()).then_some(address);
        let part = |part: fn(&IpSuite) -> Ipv4Addr| station.ip.as_ref().map(part).and_then(set);
        Self {
            name: printable(&station.name),
            mac: station.mac.to_string(),
            ip_address: part(|ip| ip.address),
            subnet_mask: part(|ip| ip.mask),
            gateway: part(|ip| ip.gateway),
            type_of_station: printable(&station.type_of_station),
            vendor_id: station.identity.map(|(vendor, _)| vendor),
            device_id: station.identity.map(|(_, device)| device),
            roles: roles(station.roles),
        }
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

impl From<&FoundDevice> for Device {
    fn from(device: &FoundDevice) -> Self {
        let key = device.identity.key;
        Self {
            ip_address: device.address,
            mac_addresses: None,
            listens_at: device.listens_at.to_string(),
            product_name: printable(&device.product_name),
            vendor_id: key.vendor,
            device_type: key.device_type,
            product_code: key.product_code,
            revision: format!("{}.{:03}", key.revision.major, key.revision.minor),
            serial_number: device.identity.serial_number,
            status: device.status,
            state: device.state,
        }
    }
}

/// Names the bits of DCP's DeviceRole (IEC 61158-6-10, 4.3.1.4).
fn roles(bits: u8) -> Vec<&'static str> {
    let names = ["IO-Device", "IO-Controller", "IO-Multidevice", "IO-Supervisor"];
    names.into_iter().enumerate().filter(|(bit, _)| bits >> bit & 1 == 1).map(|(_, name)| name).collect()
}

/// Names the state of the Identity object (volume 1, 5-2.2.1).
fn state(code: u8) -> String {
    match code {
        0 => "nonexistent".to_owned(),
        1 => "self testing".to_owned(),
        2 => "standby".to_owned(),
        3 => "operational".to_owned(),
        4 => "recoverable fault".to_owned(),
        5 => "unrecoverable fault".to_owned(),
        0xFF => "default".to_owned(),
        other => format!("{other}"),
    }
}

#[cfg(test)]
mod tests;
