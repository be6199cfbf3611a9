//! Description of a device: the source of its objects' values, its connections and its EDS file.

use core::fmt;

use super::cip::{ElectronicKey, Revision};
use super::class1::{RUN_IDLE_LEN, SEQUENCE_LEN};

/// What an assembly is for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Role {
    /// Sent by the device, T→O.
    Produced,
    /// Received by the device from its owner, O→T, with a run/idle header before the data.
    Consumed,
    /// The same without a header: the owner always runs (volume 1, 3-6.1.2, modeless).
    ConsumedModeless,
    /// Sent by the device, T→O, with a run/idle header before the data.
    ProducedWithHeader,
    /// Configuration.
    Configuration,
    /// Heartbeat of an input-only connection: O→T without data.
    InputOnlyHeartbeat,
    /// Heartbeat of a listen-only connection: O→T without data.
    ListenOnlyHeartbeat,
}

impl Role {
    /// Returns whether the device sends it.
    #[must_use]
    pub const fn is_produced(self) -> bool {
        matches!(self, Self::Produced | Self::ProducedWithHeader)
    }

    /// Returns whether an owner sends it to the device.
    #[must_use]
    pub const fn is_consumed(self) -> bool {
        matches!(self, Self::Consumed | Self::ConsumedModeless)
    }

    /// Returns its purpose in words.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::Produced | Self::ProducedWithHeader => "for T→O",
            Self::Consumed | Self::ConsumedModeless => "for O→T",
            Self::Configuration => "for configuration",
            Self::InputOnlyHeartbeat => "for O→T of input-only connections",
            Self::ListenOnlyHeartbeat => "for O→T of listen-only connections",
        }
    }
}

/// An assembly: data that a connection can carry.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Assembly {
    /// Instance, which is the connection point too.
    pub instance: u32,
    /// Its use.
    pub role: Role,
    /// Bytes of data.
    pub size: u16,
    /// Its name.
    pub name: &'static str,
}

impl Assembly {
    /// Returns the size of a connection to it in bytes: with the sequence count, and the run/idle header if it has one.
    #[must_use]
    pub const fn connection_size(&self) -> u16 {
        match self.role {
            Role::Consumed | Role::ProducedWithHeader => self.size + SEQUENCE_LEN + RUN_IDLE_LEN,
            _ => self.size + SEQUENCE_LEN,
        }
    }
}

/// A device.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Description {
    /// ODVA vendor number.
    pub vendor: u16,
    /// The vendor's name.
    pub vendor_name: &'static str,
    /// Device type (profile).
    pub device_type: u16,
    /// The vendor's product code.
    pub product_code: u16,
    /// Revision.
    pub revision: Revision,
    /// Product name, at most 32 characters.
    pub product_name: &'static str,
    /// Its assemblies.
    pub assemblies: &'static [Assembly],
    /// Shortest packet interval that it serves, in µs.
    pub min_rpi_us: u32,
    /// Longest packet interval that it serves, in µs.
    pub max_rpi_us: u32,
    /// Connections that own outputs at a time. Each consumed assembly has one owner at most.
    pub exclusive_owners: u8,
    /// Input-only connections at a time.
    pub input_only: u8,
    /// Listen-only connections at a time.
    pub listen_only: u8,
    /// Class 3 connections at a time.
    pub explicit: u8,
    /// TCP connections at a time.
    pub sessions: u8,
}

impl Description {
    /// Returns the assembly with this instance number.
    #[must_use]
    pub fn assembly(&self, instance: u32) -> Option<&'static Assembly> {
        self.assemblies.iter().find(|assembly| assembly.instance == instance)
    }

    /// Returns the first assembly of this role.
    #[must_use]
    pub fn role(&self, role: Role) -> Option<&'static Assembly> {
        self.assemblies.iter().find(|assembly| assembly.role == role)
    }

    /// Returns the number of connections of every kind that the device serves at a time.
    pub(crate) fn connections(&self) -> usize {
        let Self { exclusive_owners, input_only, listen_only, explicit, .. } = *self;
        [exclusive_owners, input_only, listen_only, explicit].into_iter().map(usize::from).sum()
    }

    /// Returns the key that matches this device and no other.
    #[must_use]
    pub const fn key(&self) -> ElectronicKey {
        ElectronicKey {
            vendor: self.vendor,
            device_type: self.device_type,
            product_code: self.product_code,
            revision: self.revision,
            compatible: false,
        }
    }
}

/// Identity that a device reports.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Identity {
    /// Its vendor, type, product code and revision.
    pub key: ElectronicKey,
    /// Its serial number.
    pub serial_number: u32,
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ElectronicKey { vendor, device_type, product_code, revision: Revision { major, minor }, .. } =
            self.key;
        write!(f, "vendor {vendor}, device type {device_type}, product code {product_code}, ")?;
        write!(f, "revision {major}.{minor}, serial number 0x{:08X}", self.serial_number)
    }
}
