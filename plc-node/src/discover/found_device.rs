//! Stations and devices that answered a search, as the listing has them.

use std::net::Ipv4Addr;

use ethernet_ip::FoundDevice;
use profinet::FoundStation;
use profinet::dcp::IpSuite;
use serde::Serialize;

use crate::printable::printable;

/// A PROFINET station.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Station {
    pub(super) name: String,
    pub(super) mac: String,
    pub(super) ip_address: Option<Ipv4Addr>,
    pub(super) subnet_mask: Option<Ipv4Addr>,
    pub(super) gateway: Option<Ipv4Addr>,
    pub(super) type_of_station: String,
    pub(super) vendor_id: Option<u16>,
    pub(super) device_id: Option<u16>,
    pub(super) roles: Vec<&'static str>,
}

/// An EtherNet/IP device.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Device {
    pub(super) ip_address: Ipv4Addr,
    /// Stations that answer ARP for the address; null if ARP could not be asked.
    pub(super) mac_addresses: Option<Vec<String>>,
    /// The address that the device reports.
    pub(super) listens_at: String,
    pub(super) product_name: String,
    pub(super) vendor_id: u16,
    pub(super) device_type: u16,
    pub(super) product_code: u16,
    pub(super) revision: String,
    pub(super) serial_number: u32,
    pub(super) status: u16,
    pub(super) state: u8,
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
pub(super) fn roles(bits: u8) -> Vec<&'static str> {
    let names = ["IO-Device", "IO-Controller", "IO-Multidevice", "IO-Supervisor"];
    names.into_iter().enumerate().filter(|(bit, _)| bits >> bit & 1 == 1).map(|(_, name)| name).collect()
}

/// Names the state of the Identity object (volume 1, 5-2.2.1).
pub(super) fn state(code: u8) -> String {
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
