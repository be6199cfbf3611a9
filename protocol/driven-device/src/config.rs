//! Settings of a driven device, and reasons why it cannot be driven.

use std::net::Ipv4Addr;

use emulated_device::ScriptError;
use machine::Duration;
use machine::ethernet::Mac;

use crate::value::ValueError;

/// Settings of the controller on its bus.
#[derive(Clone, Debug)]
pub struct BusConfig {
    /// MAC address of the own interface.
    pub mac: Mac,
    /// Own IP address; EtherCAT needs none.
    pub address: Option<Ipv4Addr>,
    /// Subnet mask.
    pub mask: Ipv4Addr,
    /// Seed of connection numbers; choose another one at each start.
    pub seed: u64,
}

/// Settings for one device.
#[derive(Clone, Debug)]
pub struct DriveConfig {
    /// IP address of the device; on PROFINET the one that it gets.
    pub device_address: Option<Ipv4Addr>,
    /// Station name of the device on PROFINET.
    pub station_name: Option<String>,
    /// Position of the device on an EtherCAT cable, from 1; the other devices are left as they are. Without one, the device must
    /// be alone there.
    pub position: Option<u16>,
    /// Interval of the cyclic data; none for that of the file.
    pub interval: Option<Duration>,
    /// Requested packet interval of the outputs on EtherNet/IP (O→T), in place of `interval`.
    pub output_interval: Option<Duration>,
    /// Requested packet interval of the inputs on EtherNet/IP (T→O), in place of `interval`.
    pub input_interval: Option<Duration>,
    /// True if outputs count from the start on. Before, they are zeros that the device is to ignore.
    pub is_running: bool,
    /// Shortest time between two reports of changed inputs.
    pub report_every: Duration,
}

/// Reason why a device cannot be driven.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum DriveError {
    /// The interface has no address.
    #[error("the interface has no IPv4 address; give it one in the device's subnet")]
    NoAddress,
    /// The device's address is unknown.
    #[error("the device's address is unknown; give it, as in --at 192.168.0.2")]
    NoDeviceAddress,
    /// The file does not give sizes that the stack carries.
    #[error("{0}")]
    File(String),
    /// The bus does not allow the settings.
    #[error("{0}")]
    Bus(String),
    /// A name is not one of the device.
    #[error("{kind} `{name}` is not in the file; choose from {known}")]
    UnknownName {
        /// Kind of the name, such as `output`.
        kind: &'static str,
        /// Name found.
        name: String,
        /// Names that there are.
        known: String,
    },
    /// A value does not fit.
    #[error(transparent)]
    Value(#[from] ValueError),
    /// A name may not be written.
    #[error("{kind} `{name}`: {reason}")]
    NotWritable {
        /// Kind of the name, such as `output`.
        kind: &'static str,
        /// Name.
        name: String,
        /// Reason and remedy.
        reason: &'static str,
    },
    /// The script does not fit the device.
    #[error(transparent)]
    Script(#[from] ScriptError),
    /// Several devices have the name, or none of several.
    #[error("{kind} `{name}`: {fault}; put the name of a device in front: {examples}")]
    WhichDevice {
        /// Kind of the name, such as `output`.
        kind: &'static str,
        /// Name found.
        name: String,
        /// Fault of the name.
        fault: &'static str,
        /// Names with that of a device.
        examples: String,
    },
    /// One of several devices cannot be driven.
    #[error("device `{device}`: {error}")]
    Device {
        /// Name of the device.
        device: String,
        /// Reason.
        error: Box<DriveError>,
    },
    /// Two devices have one name, or are one.
    #[error("{0}")]
    Twice(String),
}

/// Names that a message lists.
const MOST_LISTED: usize = 12;

impl DriveError {
    /// Returns true if the own interface has no address, which no other file or setting of a device mends.
    #[must_use]
    pub fn is_without_address(&self) -> bool {
        match self {
            Self::NoAddress => true,
            Self::Device { error, .. } => error.is_without_address(),
            _ => false,
        }
    }

    /// Makes the error of a name that is not among these.
    pub(crate) fn unknown<'a>(
        kind: &'static str,
        name: &str,
        known: impl IntoIterator<Item = &'a str>,
    ) -> Self {
        let known: Vec<_> = known.into_iter().collect();
        let mut listed =
            known.iter().take(MOST_LISTED).map(|name| device_files::excerpt(name)).collect::<Vec<_>>();
        match known.len().saturating_sub(MOST_LISTED) {
            0 if listed.is_empty() => listed.push("none".to_owned()),
            0 => {}
            more => listed.push(format!("{more} more")),
        }
        Self::UnknownName { kind, name: device_files::excerpt(name), known: listed.join(", ") }
    }
}
