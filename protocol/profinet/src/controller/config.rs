//! Configuration of a controller: its own identity, and the devices that it connects to.

use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;
use core::net::Ipv4Addr;

use crate::description::{Description, INTERFACE_SUBSLOT};
use crate::is_station_name;
use crate::rt::{Transport, UnsupportedCycle};
use machine::Duration;
use machine::ethernet::Mac;

/// Configuration of a [`Controller`](super::Controller) itself.
#[derive(Clone, Debug)]
pub struct ControllerConfig {
    /// MAC address of its interface.
    pub mac: Mac,
    /// Its own station name.
    pub station_name: String,
    /// Its own IP address.
    pub address: Ipv4Addr,
    /// Subnet mask, which each device gets with its address.
    pub mask: Ipv4Addr,
    /// Its identity and names, for DCP and for the devices. It needs no modules.
    pub description: Description,
    /// Seed of the UUIDs and transaction numbers, mixed with the start time of each AR.
    pub seed: u64,
}

/// Configuration of one application relation (AR) with a device.
#[derive(Clone, Debug)]
pub struct ArConfig {
    /// Station name of the device, by which it is found.
    pub station_name: String,
    /// IP address that the device is to have.
    pub address: Ipv4Addr,
    /// MAC address of the device; `None` accepts any station of that name and identity. With an address, DCP answers of
    /// other stations are ignored.
    pub mac: Option<Mac>,
    /// The device: identity, modules, submodules.
    pub description: Description,
    /// Parameter records that are written before data are exchanged.
    pub parameters: Vec<Parameter>,
    /// Transport of the cyclic frames.
    pub transport: Transport,
    /// Time from one cyclic frame to the next, both ways.
    pub cycle: Duration,
    /// Cycles without a frame after which either side ends the connection.
    pub watchdog_cycles: u16,
}

/// A parameter record that the controller writes during startup.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Parameter {
    /// Slot number.
    pub slot: u16,
    /// Subslot number.
    pub subslot: u16,
    /// Index of the record.
    pub index: u16,
    /// The record's bytes.
    pub data: Vec<u8>,
}

impl Parameter {
    /// Returns PDInterfaceAdjust, which Siemens controllers write to every device: the names of its ports must be unique
    /// within the station only (MultipleInterfaceMode.NameOfDevice).
    #[must_use]
    pub fn interface_adjust() -> Self {
        // BlockType 0x0250, BlockLength 8, version 1.0, padding, MultipleInterfaceMode 1.
        let data = vec![0x02, 0x50, 0, 8, 1, 0, 0, 0, 0, 0, 0, 1];
        Self { slot: 0, subslot: INTERFACE_SUBSLOT, index: 0x8071, data }
    }
}

/// Why a configuration cannot lead to a connection.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum ConfigError {
    /// The cycle cannot be expressed.
    #[error(transparent)]
    Cycle(#[from] UnsupportedCycle),
    /// The device does not serve so short a cycle.
    #[error(
        "a cycle of {} µs is shorter than the {} µs that the device serves (MinDeviceInterval): choose a longer one",
        cycle.as_micros(), shortest.as_micros()
    )]
    ShortCycle {
        /// The cycle asked for.
        cycle: Duration,
        /// The shortest one of the device.
        shortest: Duration,
    },
    /// The watchdog is zero or longer than the standard allows.
    #[error(
        "a watchdog of {cycles} cycles is {} ms; choose 1 to {most} cycles, which are at most {} ms",
        time.as_millis(), longest.as_millis()
    )]
    Watchdog {
        /// The cycles asked for.
        cycles: u16,
        /// The time that they take.
        time: Duration,
        /// The most cycles that the standard allows.
        most: u16,
        /// The time that these take.
        longest: Duration,
    },
    /// A station name is empty or contains something that DCP does not allow.
    #[error(
        "{0:?} is not a station name: allowed are lower-case letters, digits and hyphens, in parts of up to 63 characters \
         separated by dots, 240 in all, and neither an IP address nor port-001"
    )]
    StationName(String),
    /// The two stations cannot reach each other.
    #[error(
        "{address} and {device} are not in one subnet (mask {mask}): without a router they cannot reach each other"
    )]
    Subnet {
        /// Address of the controller.
        address: Ipv4Addr,
        /// Address of the device.
        device: Ipv4Addr,
        /// Subnet mask of both.
        mask: Ipv4Addr,
    },
    /// The modules have more data than a frame holds.
    #[error(
        "the modules make {0} bytes of cyclic data in one direction, but a frame holds 1440: leave modules out"
    )]
    TooMuchData(usize),
    /// A parameter record is longer than one Write carries.
    #[error(
        "parameter record {index} of slot {slot} has {len} bytes, more than the 65,452 that fit: shorten it"
    )]
    Parameter {
        /// Slot number.
        slot: u16,
        /// Index of the record.
        index: u16,
        /// Its length in bytes.
        len: usize,
    },
    /// Another AR has the station name.
    #[error("two devices have the station name {0:?}: give one of them another name")]
    SameName(String),
    /// Another AR has the address.
    #[error(
        "the devices {other:?} and {name:?} have the address {address}: give one of them another address"
    )]
    SameAddress {
        /// The address.
        address: Ipv4Addr,
        /// Name of the device that was to be added.
        name: String,
        /// Name of the device that has the address.
        other: String,
    },
    /// The device has the address of the controller.
    #[error("the device {name:?} has the controller's address {address}: give one of them another address")]
    OwnAddress {
        /// The address.
        address: Ipv4Addr,
        /// Name of the device.
        name: String,
    },
    /// The controller has no number left for another AR.
    #[error("a controller has {0} ARs at most: remove one first")]
    TooManyArs(usize),
}

/// Checks that a station name is not empty and that DCP allows it.
pub(super) fn check_name(name: &str) -> Result<(), ConfigError> {
    let is_good = !name.is_empty() && is_station_name(name.as_bytes());
    if is_good { Ok(()) } else { Err(ConfigError::StationName(name.into())) }
}
