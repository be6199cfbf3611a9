//! What a drive reports in object 0x603F (IEC 61800-7-201, error codes).

use core::fmt;

/// An error code of a drive; 0 for none.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct ErrorCode(pub u16);

impl ErrorCode {
    /// No error.
    pub const NONE: Self = Self(0x0000);
    /// The motor takes too much current.
    pub const OVER_CURRENT: Self = Self(0x2310);
    /// The voltage of the DC link is too high.
    pub const DC_LINK_OVER_VOLTAGE: Self = Self(0x3210);
    /// The drive is too hot.
    pub const OVER_TEMPERATURE: Self = Self(0x4310);
    /// The encoder cannot be read.
    pub const ENCODER: Self = Self(0x7305);
    /// No process data came in time, or the device left OP.
    pub const COMMUNICATION: Self = Self(0x7500);
    /// The motor is further from its target than the window allows, for longer than it allows.
    pub const FOLLOWING_ERROR: Self = Self(0x8611);

    /// Returns the error register, object 0x1001, that goes with the code (ETG.1000.6, error register): bit 0 for every
    /// error, and one for its kind. 0 without an error.
    #[must_use]
    pub const fn register(self) -> u8 {
        const GENERIC: u8 = 0x01;
        match self.0 {
            0 => 0,
            0x2000..=0x2FFF => GENERIC | 0x02,                   // current
            0x3000..=0x3FFF => GENERIC | 0x04,                   // voltage
            0x4000..=0x4FFF => GENERIC | 0x08,                   // temperature
            0x7500..=0x75FF | 0x8100..=0x82FF => GENERIC | 0x10, // communication
            0x8300..=0x8FFF => GENERIC | 0x20,                   // defined by the device profile
            0xFF00..=0xFFFF => GENERIC | 0x80,                   // defined by the maker
            _ => GENERIC,
        }
    }

    /// Returns what the code means.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::NONE => "no error",
            Self::OVER_CURRENT => "continuous over current",
            Self::DC_LINK_OVER_VOLTAGE => "DC link over voltage",
            Self::OVER_TEMPERATURE => "excess temperature of the drive",
            Self::ENCODER => "encoder error",
            Self::COMMUNICATION => "communication",
            Self::FOLLOWING_ERROR => "following error",
            _ => "an error of this drive",
        }
    }
}

impl fmt::Display for ErrorCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}: {}", self.0, self.text())
    }
}
