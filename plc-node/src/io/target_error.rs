//! Why the device is not found.

use std::net::Ipv4Addr;

/// Reason why the device is not found.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub(super) enum TargetError {
    /// The option does not name a device of the bus.
    #[error("--at `{0}`: must be {1}")]
    At(String, &'static str),
    /// No device has the identity.
    #[error(
        "no {0} device of the file's identity answers on this network; check cable and power, or give --at"
    )]
    None(&'static str),
    /// Several devices have it.
    #[error("{0} devices of the file's identity answer: {1}; choose one with --at")]
    Several(usize, String),
    /// No station has the name.
    #[error("no station is called `{0}`; stations that answer: {1}")]
    NoStation(String, String),
    /// Several stations have the name.
    #[error("{0} stations are called `{1}`: {2}; rename one of them")]
    Twins(usize, String, String),
    /// Several devices have the address.
    #[error("{0} devices have the address {1}: {2}; give each an address of its own")]
    SharedAddress(usize, Ipv4Addr, String),
    /// The station has no address.
    #[error("station `{0}` has no IP address; give it one with --address")]
    NoStationAddress(String),
    /// The device does not report its modules.
    #[error("the device does not report its modules: {0}; give them with --module")]
    NoModules(String),
    /// The choice of several devices is to be printed.
    #[error("--print-config: several --device; print the choice of one device at a time")]
    SeveralConfigs,
}

impl TargetError {
    /// Returns true for an error of the command line.
    pub(super) const fn is_usage(&self) -> bool {
        matches!(self, Self::At(..) | Self::NoStationAddress(_) | Self::Several(..) | Self::SeveralConfigs)
    }
}
