//! Station names, IP addresses and serial numbers that several devices on a cable have, though each must have its own.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::net::Ipv4Addr;

use serde::Serialize;

use super::found_device::{Device, Station};

/// Most devices that a line lists. JSON has all.
const MOST_LISTED: usize = 12;

/// Property that several devices have in common.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(super) enum SharedProperty {
    /// Name of PROFINET stations.
    StationName,
    /// IP address, on any bus.
    IpAddress,
    /// Serial number of EtherNet/IP devices of one vendor.
    SerialNumber,
}

/// A name, address or serial number that several devices have.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Conflict {
    shared: SharedProperty,
    /// The name, address or serial number, as the tables show it.
    value: String,
    devices: Vec<SharingDevice>,
    /// Remedy.
    remedy: &'static str,
}

/// One of the devices that share something, as far as it is known.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Default, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct SharingDevice {
    /// Null if ARP did not show it.
    mac: Option<String>,
    /// Name of a PROFINET station.
    station_name: Option<String>,
    ip_address: Option<Ipv4Addr>,
    /// Serial number of an EtherNet/IP device.
    serial_number: Option<u32>,
}

impl SharedProperty {
    const fn name(self) -> &'static str {
        match self {
            Self::StationName => "station name",
            Self::IpAddress => "IP address",
            Self::SerialNumber => "serial number",
        }
    }

    const fn remedy(self) -> &'static str {
        match self {
            Self::StationName => "rename all but one",
            Self::IpAddress => "give all but one another address",
            Self::SerialNumber => "an originator takes them for one device; ask the maker for another number",
        }
    }
}

impl Conflict {
    fn new(shared: SharedProperty, value: String, devices: Vec<SharingDevice>) -> Self {
        Self { shared, value, devices, remedy: shared.remedy() }
    }

    /// Returns whether several devices have this name, address or number.
    pub(super) fn is_of(&self, shared: SharedProperty, value: &str) -> bool {
        self.shared == shared && self.value == value
    }
}

impl fmt::Display for Conflict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { shared, value, devices, remedy } = self;
        write!(f, "{} devices have the {} {value}: ", devices.len(), shared.name())?;
        for (index, device) in devices.iter().take(MOST_LISTED).enumerate() {
            write!(f, "{}{}", if index == 0 { "" } else { ", " }, device.in_words(*shared))?;
        }
        match devices.len().saturating_sub(MOST_LISTED) {
            0 => {}
            more => write!(f, " and {more} more")?,
        }
        write!(f, "; {remedy}")
    }
}

impl SharingDevice {
    /// Returns the MAC address, and in parentheses what distinguishes the device besides what it shares.
    fn in_words(&self, shared: SharedProperty) -> String {
        let address = self.ip_address.filter(|_| shared != SharedProperty::IpAddress);
        let serial = self.serial_number.filter(|_| shared != SharedProperty::SerialNumber);
        let name = self.station_name.clone().filter(|_| shared != SharedProperty::StationName);
        let serial = serial.map(|number| format!("serial number 0x{number:08X}"));
        let others: Vec<_> =
            [name, address.map(|address| address.to_string()), serial].into_iter().flatten().collect();
        let others = others.join(", ");
        match &self.mac {
            None => format!("unknown MAC address ({others})"),
            Some(mac) if others.is_empty() => mac.clone(),
            Some(mac) => format!("{mac} ({others})"),
        }
    }
}

/// Finds the conflicts among the devices of a cable. `hosts` are the stations that answered ARP for an address.
pub(super) fn conflicts(
    stations: &[Station],
    devices: &[Device],
    hosts: &BTreeMap<Ipv4Addr, Vec<String>>,
) -> Vec<Conflict> {
    let mut conflicts = shared_names(stations);
    conflicts.extend(shared_addresses(stations, devices, hosts));
    conflicts.extend(shared_serial_numbers(devices));
    conflicts
}

/// Finds stations with one name. Names are in lower case unless a station breaks the rules.
fn shared_names(stations: &[Station]) -> Vec<Conflict> {
    let mut by_name = BTreeMap::<String, Vec<&Station>>::new();
    for station in stations.iter().filter(|station| !station.name.is_empty()) {
        by_name.entry(station.name.to_lowercase()).or_default().push(station);
    }
    let sharing = |station: &&Station| SharingDevice {
        mac: Some(station.mac.clone()),
        ip_address: station.ip_address,
        station_name: Some(station.name.clone()),
        ..SharingDevice::default()
    };
    let twins = by_name.into_iter().filter(|(_, twins)| twins.len() > 1);
    twins
        .map(|(name, twins)| {
            Conflict::new(SharedProperty::StationName, name, twins.iter().map(sharing).collect())
        })
        .collect()
}

/// Finds addresses that several interfaces have. One device may be found on both buses.
fn shared_addresses(
    stations: &[Station],
    devices: &[Device],
    hosts: &BTreeMap<Ipv4Addr, Vec<String>>,
) -> Vec<Conflict> {
    let mut by_address = BTreeMap::<Ipv4Addr, BTreeSet<SharingDevice>>::new();
    for station in stations {
        let Some(address) = station.ip_address else { continue };
        by_address.entry(address).or_default().insert(SharingDevice {
            mac: Some(station.mac.clone()),
            station_name: Some(station.name.clone()).filter(|name| !name.is_empty()),
            ip_address: Some(address),
            serial_number: None,
        });
    }
    for (address, macs) in hosts {
        let sharing = by_address.entry(*address).or_default();
        for mac in macs {
            if !sharing.iter().any(|known| known.mac.as_ref() == Some(mac)) {
                let mac = Some(mac.clone());
                sharing.insert(SharingDevice { mac, ip_address: Some(*address), ..SharingDevice::default() });
            }
        }
    }
    for (address, identities) in identities_by_address(devices) {
        let sharing = by_address.entry(address).or_default();
        // ARP names each, but not which of them has which identity.
        if sharing.len() >= identities.len() {
            continue;
        }
        let mac = sharing.iter().find_map(|known| known.mac.clone());
        *sharing = identities
            .iter()
            .map(|device| SharingDevice {
                mac: mac.clone(),
                station_name: None,
                ip_address: Some(address),
                serial_number: Some(device.serial_number),
            })
            .collect();
    }
    let shared = by_address.into_iter().filter(|(_, sharing)| sharing.len() > 1);
    shared
        .map(|(address, sharing)| {
            Conflict::new(SharedProperty::IpAddress, address.to_string(), sharing.into_iter().collect())
        })
        .collect()
}

fn identities_by_address(devices: &[Device]) -> BTreeMap<Ipv4Addr, Vec<&Device>> {
    let mut by_address = BTreeMap::<Ipv4Addr, Vec<&Device>>::new();
    for device in devices {
        by_address.entry(device.ip_address).or_default().push(device);
    }
    by_address
}

/// Finds devices of one vendor with one serial number (volume 1, 5-2.2.1: both together identify a device).
fn shared_serial_numbers(devices: &[Device]) -> Vec<Conflict> {
    let mut by_number = BTreeMap::<(u16, u32), Vec<&Device>>::new();
    for device in devices {
        by_number.entry((device.vendor_id, device.serial_number)).or_default().push(device);
    }
    let mut conflicts = Vec::new();
    for ((_, number), twins) in by_number {
        let macs: Option<BTreeSet<_>> = twins.iter().map(|device| device.mac_addresses.as_deref()).collect();
        // A device with two addresses answers twice.
        let is_one_device =
            macs.is_some_and(|macs| macs.len() == 1 && macs.iter().all(|macs| macs.len() == 1));
        if twins.len() < 2 || is_one_device {
            continue;
        }
        let sharing = |device: &&Device| SharingDevice {
            mac: device.mac_addresses.as_ref().filter(|macs| !macs.is_empty()).map(|macs| macs.join(" or ")),
            station_name: None,
            ip_address: Some(device.ip_address),
            serial_number: Some(number),
        };
        let value = format!("0x{number:08X}");
        conflicts.push(Conflict::new(
            SharedProperty::SerialNumber,
            value,
            twins.iter().map(sharing).collect(),
        ));
    }
    conflicts
}
