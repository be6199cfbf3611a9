#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![warn(clippy::indexing_slicing)]

extern crate alloc;

pub mod alarm;
pub mod block;
pub mod connect;
pub mod control;
mod controller;
pub mod dcp;
pub mod description;
pub mod device;
pub mod lldp;
mod mau;
mod provided;
pub mod record;
mod record_reader;
mod requests;
pub mod rpc;
pub mod rt;
mod search;
mod station;
mod station_setter;
pub mod status;
pub mod tag;
mod tries;
mod uuid;

pub use controller::{
    Ar, ArConfig, ArId, ConfigError, Controller, ControllerConfig, Parameter, ReceivedAlarm, RecordError,
};
pub use device::{AlarmError, Device, DeviceConfig};
pub use mau::MauType;
pub use provided::DataError;
pub use record_reader::{RecordPlace, RecordReadError, RecordReader, RecordReaderConfig};
pub use search::{FoundStation, Search, SearchConfig};
pub use station::{Permanent, is_station_name};
pub use station_setter::{StationChange, StationSetError, StationSetter, StationSetterConfig};
pub use uuid::Uuid;

use machine::ethernet::Mac;
use machine::{PortRequest, arp};

/// EtherType of PROFINET (IEC 61158-6-10, 4.1).
pub const ETHER_TYPE: u16 = 0x8892;

/// Raw Ethernet as every station listens to it, with the groups of DCP Identify, DCP Hello, and the fast and slow alarm
/// groups (IEC 61158-6-10, multicast addresses).
pub const ETHERNET: PortRequest = PortRequest::Ethernet {
    ether_type: ETHER_TYPE,
    groups: &[
        dcp::IDENTIFY_MULTICAST,
        dcp::HELLO_MULTICAST,
        Mac([0x01, 0x0E, 0xCF, 0x00, 0x01, 0x01]),
        Mac([0x01, 0x0E, 0xCF, 0x00, 0x01, 0x02]),
    ],
};

/// The ports of both roles: raw Ethernet, connection management, cyclic data over UDP, the neighbours' announcements, and ARP.
pub const PORTS: &[PortRequest] =
    &[ETHERNET, PortRequest::Udp(RPC_PORT), PortRequest::Udp(rt::UDP_PORT), lldp::ETHERNET, arp::ETHERNET];

/// UDP port of connection management (IANA `profinet-cm`).
pub const RPC_PORT: u16 = 34964;

/// The code `LT` in connection management for cyclic data and alarms over UDP: IPv4's EtherType. On raw Ethernet it is
/// `ETHER_TYPE`.
pub const LT_UDP: u16 = 0x0800;

#[cfg(test)]
extern crate self as profinet;
#[cfg(test)]
mod captured;
#[cfg(test)]
#[path = "../tests/profinet/samples.rs"]
mod samples;
