//! Refusals of an adapter as text, with what the adapter has instead.

use core::fmt;
use core::net::Ipv4Addr;

use super::advice::advice;
use crate::Reader;
use crate::cip::{AcceptableIntervals, ElectronicKey, Extended, General, Reply, Revision};
use crate::class1::SEQUENCE_LEN;
use crate::connection::{DirectionData, RealTimeFormat, Triad};
use crate::description::{Assembly, Description, Identity, Role};
use machine::{Down, DownCause};

/// A refused request: what was requested, and what the device has.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Refusal {
    /// General status of its reply; [`General::KeyFailure`] where this side found the device to be another one.
    pub general: General,
    /// Extended status of its reply.
    pub extended: Option<Extended>,
    /// The size that the device has instead, in bytes, if it reports it: a connection size, which counts sequence count, header
    /// and data, or the size of the configuration data alone, for [`Extended::InvalidConfigurationSize`].
    pub size: Option<u16>,
    /// The packet intervals that the device would serve, if it reports them.
    pub intervals: Option<AcceptableIntervals>,
    /// Requested connection.
    pub requested: RequestedConnection,
    /// The identity that the device reported.
    pub found: Option<Identity>,
    /// The scanner that owns the outputs, if the device says it.
    pub owner: Option<Owner>,
}

/// The scanner that owns the outputs of an adapter.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Owner {
    /// Its connection, with its vendor and its serial number.
    pub triad: Triad,
    /// Whether its last frame was run; false for one that is idle, or has sent none.
    pub is_run: bool,
    /// Its direction O→T, with interval and timeout, if the device says it.
    pub o_t: Option<DirectionData>,
}

impl Owner {
    /// Reads the adapter's answer; `None` if it names nobody.
    pub(super) fn parse(data: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(data);
        let connections = reader.u8().ok()?;
        reader.skip(2).ok()?;
        let action = reader.u8().ok()?;
        let triad = Triad::parse(&mut reader).ok()?;
        (connections > 0).then_some(Self { triad, is_run: action == 2, o_t: None })
    }
}

/// Parameters that a Forward_Open requested.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct RequestedConnection {
    /// The adapter.
    pub target: Ipv4Addr,
    /// What the EDS file of the required device says.
    pub described: Option<&'static Description>,
    /// The required device.
    pub key: Option<ElectronicKey>,
    /// O→T assembly.
    pub consumed: RequestedAssembly,
    /// T→O assembly.
    pub produced: RequestedAssembly,
    /// Configuration assembly.
    pub configuration: Option<u32>,
    /// Packet intervals O→T and T→O in µs.
    pub rpi_us: (u32, u32),
}

/// Assembly and connection size that a Forward_Open requested for one direction.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct RequestedAssembly {
    /// Instance of the assembly.
    pub instance: u32,
    /// Connection size in bytes: sequence count, header and data.
    pub connection_size: u16,
    /// Real-time format, which decides how much of the size is data.
    pub format: RealTimeFormat,
}

impl RequestedAssembly {
    /// Writes how many bytes of data a connection of this size has in the requested format: setups and EDS files count data.
    fn write_data(self, f: &mut fmt::Formatter<'_>, connection_size: u16) -> fmt::Result {
        let overhead = SEQUENCE_LEN + self.format.header_len();
        match connection_size.checked_sub(overhead) {
            Some(data) => write!(f, "{data} bytes of data"),
            None => f.write_str("no data"),
        }
    }
}

impl Refusal {
    pub(super) fn of_reply(
        reply: &Reply<'_>,
        requested: RequestedConnection,
        found: Option<Identity>,
    ) -> Self {
        let extended = reply.additional_status(0).map(Extended::from);
        let (mut size, mut intervals) = (None, None);
        match extended {
            Some(
                Extended::InvalidConnectionSize
                | Extended::InvalidOtSize
                | Extended::InvalidToSize
                | Extended::MismatchedToSize,
            ) => size = reply.additional_status(1),
            // The size of configuration data is in words (volume 1, table 3-5.29).
            Some(Extended::InvalidConfigurationSize) => {
                size = reply.additional_status(1).map(|words| words.saturating_mul(2));
            }
            Some(Extended::RpiNotAcceptable) => {
                let mut behind_status = Reader::new(reply.additional.get(2..).unwrap_or_default());
                intervals = AcceptableIntervals::parse(&mut behind_status).ok();
            }
            _ => {}
        }
        Self { general: reply.general, extended, size, intervals, requested, found, owner: None }
    }

    /// Returns what a user can do about it.
    #[must_use]
    pub const fn advice(&self) -> &'static str {
        advice(self.general, self.extended)
    }

    /// Returns the meaning of the status in words.
    #[must_use]
    pub const fn text(&self) -> &'static str {
        match self.extended {
            Some(extended) => extended.text(),
            None => self.general.text(),
        }
    }

    /// Converts the refusal to the reason of a [`LinkEvent::Down`](machine::LinkEvent::Down). The upper half of its code is
    /// the general status.
    #[must_use]
    pub fn down(&self) -> Down {
        let extended = self.extended.map_or(0, u16::from);
        let code = u32::from(u8::from(self.general)) << 16 | u32::from(extended);
        Down { cause: DownCause::Refused, code, text: self.text() }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the adapter {} refused the connection: {}", self.requested.target, self.text())?;
        write!(f, " (general status 0x{:02X}", u8::from(self.general))?;
        if let Some(extended) = self.extended {
            write!(f, ", extended status 0x{:04X}", u16::from(extended))?;
        }
        f.write_str("); asked for ")?;
        self.write_asked(f)?;
        self.write_size(f)?;
        if let Some(AcceptableIntervals { o_t, t_o }) = self.intervals {
            write!(f, "; the device would take {o_t} O→T and {t_o} T→O")?;
        }
        if let Some(Owner { triad, is_run, o_t }) = self.owner {
            let (vendor, serial) = (triad.vendor, triad.originator_serial);
            let does = if is_run { "in run" } else { "idle or silent" };
            write!(f, "; the owner is vendor {vendor}, serial number 0x{serial:08X}, {does}")?;
            if let Some((o_t, timeout)) = o_t.and_then(|o_t| Some((o_t, o_t.timeout()?))) {
                let timeout = timeout.as_secs_f64();
                write!(f, ", with a packet every {} µs and a time-out of {timeout} s", o_t.rpi_us)?;
            }
        }
        if let (true, Some(found)) = (self.is_about_key(), self.found) {
            write!(f, "; the device is {found}")?;
        }
        self.write_described(f)?;
        write!(f, "; {}", self.advice())
    }
}

impl Refusal {
    const fn is_about_key(&self) -> bool {
        matches!(
            (self.general, self.extended),
            (General::KeyFailure, None)
                | (
                    _,
                    Some(
                        Extended::VendorOrProductMismatch
                            | Extended::DeviceTypeMismatch
                            | Extended::RevisionMismatch
                    )
                )
        )
    }

    /// Writes the size that the device has instead, as data and as it stands in its reply.
    fn write_size(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let RequestedConnection { consumed, produced, .. } = self.requested;
        let Some(size) = self.size else { return Ok(()) };
        match self.extended {
            Some(Extended::InvalidConfigurationSize) => {
                return write!(f, "; the device has {size} bytes of configuration data");
            }
            Some(Extended::InvalidOtSize) => {
                f.write_str("; the device has ")?;
                consumed.write_data(f, size)?;
            }
            Some(Extended::InvalidToSize | Extended::MismatchedToSize) => {
                f.write_str("; the device has ")?;
                produced.write_data(f, size)?;
            }
            // The status does not say which direction is meant (volume 1, table 3-5.29).
            _ => {
                f.write_str("; the device takes ")?;
                consumed.write_data(f, size)?;
                f.write_str(" O→T, or ")?;
                produced.write_data(f, size)?;
                f.write_str(" T→O")?;
            }
        }
        write!(f, " (connection size {size} with sequence count and header)")
    }

    /// Writes what the device has instead, if its reply has no field for it but its EDS file does.
    fn write_described(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_described =
            |device: &&Description| self.found.is_some_and(|found| device.key().check(&found.key).is_ok());
        let Some(device) = self.requested.described.filter(is_described) else {
            return match self.extended {
                Some(Extended::RpiNotSupported | Extended::RpiNotAcceptable) if self.intervals.is_none() => {
                    f.write_str("; the device's EDS file has its shortest and longest interval")
                }
                _ => Ok(()),
            };
        };
        match self.extended {
            Some(Extended::RpiNotSupported | Extended::RpiNotAcceptable) => {
                let Description { min_rpi_us, max_rpi_us, .. } = device;
                write!(f, "; by its EDS file the device serves {min_rpi_us} to {max_rpi_us} µs")
            }
            Some(Extended::OwnershipConflict) => {
                let owners = device.exclusive_owners;
                let plural = if owners == 1 { "" } else { "s" };
                write!(f, "; by its EDS file the device has outputs for {owners} owner{plural}")
            }
            Some(Extended::OutOfConnections | Extended::TargetOutOfConnections) => {
                let Description { exclusive_owners, input_only, listen_only, explicit, .. } = device;
                write!(f, "; by its EDS file the device has connections for {exclusive_owners} owner, ")?;
                write!(f, "{input_only} input-only, {listen_only} listen-only and {explicit} of class 3")
            }
            Some(
                Extended::InvalidApplicationPath
                | Extended::InvalidConfigurationPathCombination
                | Extended::InvalidConfigurationPath
                | Extended::InvalidConsumingPath
                | Extended::InvalidProducingPath
                | Extended::InconsistentPathCombination,
            ) => {
                f.write_str("; by its EDS file the device has the assemblies")?;
                for (index, assembly) in device.assemblies.iter().enumerate() {
                    let Assembly { instance, size, role, .. } = assembly;
                    let comma = if index == 0 { "" } else { "," };
                    write!(f, "{comma} {instance} {}", role.text())?;
                    if matches!(role, Role::Consumed | Role::Produced) {
                        write!(f, " ({size} bytes)")?;
                    }
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn write_asked(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let RequestedConnection { key, consumed, produced, configuration, rpi_us, .. } = self.requested;
        match self.extended {
            _ if self.is_about_key() => write_key(f, key),
            Some(Extended::InvalidOtSize) => write_o_t(f, consumed),
            Some(Extended::InvalidToSize | Extended::MismatchedToSize) => write_t_o(f, produced),
            Some(Extended::InvalidConnectionSize) => {
                write_o_t(f, consumed)?;
                f.write_str(" and ")?;
                write_t_o(f, produced)
            }
            Some(Extended::RpiNotSupported | Extended::RpiNotAcceptable) => {
                write!(f, "a packet every {} µs O→T and every {} µs T→O", rpi_us.0, rpi_us.1)
            }
            _ => {
                write!(f, "O→T assembly {} and T→O assembly {}", consumed.instance, produced.instance)?;
                match configuration {
                    Some(configuration) => write!(f, " with configuration assembly {configuration}"),
                    None => Ok(()),
                }
            }
        }
    }
}

fn write_o_t(f: &mut fmt::Formatter<'_>, consumed: RequestedAssembly) -> fmt::Result {
    consumed.write_data(f, consumed.connection_size)?;
    write!(f, " O→T to assembly {} (connection size {})", consumed.instance, consumed.connection_size)
}

fn write_t_o(f: &mut fmt::Formatter<'_>, produced: RequestedAssembly) -> fmt::Result {
    produced.write_data(f, produced.connection_size)?;
    write!(f, " T→O from assembly {} (connection size {})", produced.instance, produced.connection_size)
}

fn write_key(f: &mut fmt::Formatter<'_>, key: Option<ElectronicKey>) -> fmt::Result {
    let Some(key) = key else { return f.write_str("any device") };
    let ElectronicKey { vendor, device_type, product_code, revision: Revision { major, minor }, compatible } =
        key;
    write!(f, "vendor {vendor}, device type {device_type}, product code {product_code}, ")?;
    write!(f, "revision {major}.{minor}{}", if compatible { " or compatible" } else { "" })
}
