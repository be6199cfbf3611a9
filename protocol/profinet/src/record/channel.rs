//! Items of alarms and diagnosis: faults by channel (IEC 61158-6-10, ChannelDiagnosisData, ExtChannelDiagnosisData,
//! QualifiedChannelDiagnosisData).
//!
//! ```text
//! UserStructureIdentifier u16 · then, once or more:
//!   8000 ChannelNumber u16 · ChannelProperties u16 · ChannelErrorType u16
//!   8002 the same · ExtChannelErrorType u16 · ExtChannelAddValue u32
//!   8003 the same · QualifiedChannelQualifier u32
//! any other: data of the maker
//! ```

use core::fmt;

use machine::wire::{BigEndian, Reader};

/// UserStructureIdentifiers of diagnosis by channel, and of the same with more values.
const CHANNEL: u16 = 0x8000;
const EXTENDED_CHANNEL: u16 = 0x8002;
const QUALIFIED_CHANNEL: u16 = 0x8003;

/// ChannelNumber of the submodule as a whole.
pub const WHOLE_SUBMODULE: u16 = 0x8000;

/// Fault of a channel.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ChannelFault {
    /// ChannelNumber; [`WHOLE_SUBMODULE`] for the submodule.
    pub channel: u16,
    /// ChannelProperties.
    pub properties: u16,
    /// ChannelErrorType.
    pub error: u16,
    /// ExtChannelErrorType.
    pub extended: Option<u16>,
}

impl ChannelFault {
    /// Returns whether the fault has disappeared.
    #[must_use]
    pub const fn disappears(&self) -> bool {
        // Bits 11 and 12 of ChannelProperties: 1 appears, 2 disappears, 3 disappears while others remain.
        matches!(self.properties >> 11 & 3, 2 | 3)
    }
}

impl fmt::Display for ChannelFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.channel {
            WHOLE_SUBMODULE => {}
            channel => write!(f, "channel {channel}: ")?,
        }
        f.write_str(channel_error_name(self.error).unwrap_or("error"))?;
        match self.extended {
            Some(extended) => write!(f, " (0x{:04X}/0x{extended:04X})", self.error),
            None => write!(f, " (0x{:04X})", self.error),
        }
    }
}

/// Item of an alarm.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum DiagnosisItem {
    /// Fault of a channel.
    Channel(ChannelFault),
    /// Data of the maker, of this UserStructureIdentifier.
    Maker(u16),
}

impl fmt::Display for DiagnosisItem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Channel(fault) => fault.fmt(f),
            Self::Maker(identifier) => write!(f, "data 0x{identifier:04X} of its maker"),
        }
    }
}

impl DiagnosisItem {
    /// Returns whether both are about the same fault, whatever their maintenance and state.
    #[must_use]
    pub fn is_same_fault(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Channel(one), Self::Channel(other)) => {
                (one.channel, one.error, one.extended) == (other.channel, other.error, other.extended)
            }
            _ => self == other,
        }
    }

    /// Returns whether the fault has disappeared.
    #[must_use]
    pub const fn disappears(&self) -> bool {
        matches!(self, Self::Channel(fault) if fault.disappears())
    }
}

/// Returns the items of data with this UserStructureIdentifier; items that are cut are left out.
pub fn diagnosis_items(identifier: u16, data: &[u8]) -> impl Iterator<Item = DiagnosisItem> {
    let mut reader = Reader::<BigEndian>::new(data);
    let mut is_first = true;
    core::iter::from_fn(move || {
        let more = match identifier {
            CHANNEL => 0,
            EXTENDED_CHANNEL => 4,
            QUALIFIED_CHANNEL => 8,
            maker => return core::mem::take(&mut is_first).then_some(DiagnosisItem::Maker(maker)),
        };
        let (channel, properties, error) = (reader.u16().ok()?, reader.u16().ok()?, reader.u16().ok()?);
        let extended = if identifier == CHANNEL { None } else { Some(reader.u16().ok()?) };
        reader.skip(more).ok()?;
        Some(DiagnosisItem::Channel(ChannelFault { channel, properties, error, extended }))
    })
}

/// Returns the standard's name of a ChannelErrorType (IEC 61158-6-10, ChannelErrorType).
#[must_use]
pub const fn channel_error_name(error: u16) -> Option<&'static str> {
    Some(match error {
        1 => "short circuit",
        2 => "undervoltage",
        3 => "overvoltage",
        4 => "overload",
        5 => "overtemperature",
        6 => "line break",
        7 => "upper limit exceeded",
        8 => "lower limit exceeded",
        9 => "error",
        16 => "parameter error",
        17 => "power supply error",
        18 => "fuse blown",
        20 => "ground fault",
        21 => "reference point lost",
        22 => "process event lost",
        23 => "threshold error",
        24 => "output disabled",
        26 => "external error",
        28 => "temporary fault",
        _ => return None,
    })
}
