//! Settings of an emulated device, and reasons why it cannot be emulated.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use profinet::Permanent;

use crate::script::ScriptError;

/// Settings of one device.
#[derive(Clone, Debug)]
pub struct EmulationConfig {
    /// MAC address.
    pub mac: Mac,
    /// IP address; PROFINET may get it later.
    pub address: Option<Ipv4Addr>,
    /// Subnet mask.
    pub mask: Ipv4Addr,
    /// Gateway, [`Ipv4Addr::UNSPECIFIED`] without one.
    pub gateway: Ipv4Addr,
    /// Station name of PROFINET; none for that of the file.
    pub station_name: Option<Vec<u8>>,
    /// Name and address that DCP set permanently before the start, if the owner stored it.
    pub permanent: Option<Permanent>,
    /// Serial number.
    pub serial_number: u32,
    /// First connection number of EtherNet/IP; choose another one at each start.
    pub first_id: u32,
}

/// Reason why a device cannot be emulated.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum EmulationError {
    /// An adapter needs an address before it starts.
    #[error("EtherNet/IP needs an IPv4 address; give the interface one, and each of several devices its own")]
    NoAddress,
    /// A submodule belongs to a profile.
    #[error(
        "subslot {slot}.{subslot} is in API 0x{api:04X} of a profile; only API 0 is emulated, choose another module"
    )]
    OtherApi {
        /// Slot.
        slot: u16,
        /// Subslot.
        subslot: u16,
        /// API.
        api: u32,
    },
    /// A status has more than one byte.
    #[error(
        "subslot {slot}.{subslot} has a status of several bytes; only one byte is emulated, choose another module"
    )]
    StatusLength {
        /// Slot.
        slot: u16,
        /// Subslot.
        subslot: u16,
    },
    /// An entry of process data is longer than its mapping can say.
    #[error(
        "entry 0x{index:04X}:{subindex:02X} has {bits} bits: a mapping has at most 255, choose other PDOs"
    )]
    LongEntry {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// Bits.
        bits: u16,
    },
    /// The mailbox is of a form that the stack does not have.
    #[error("mailbox: {0}; choose another device")]
    Mailbox(String),
    /// The sync managers are of a form that the stack does not have.
    #[error("{0}; choose other process data or another device")]
    SyncManagers(String),
    /// Another number of devices than one process has.
    #[error("{0} devices: one process has 1 to {most}", most = crate::MOST_DEVICES)]
    Count(usize),
    /// Devices of different buses.
    #[error("devices of {0} and of {1}: one process has one bus; start another process for the other")]
    SeveralBuses(&'static str, &'static str),
    /// The script does not fit the device.
    #[error(transparent)]
    Script(#[from] ScriptError),
}
