//! AL status codes (ETG.1000.6, table of AL status codes; ETG.1020).

use super::AlState;

/// Why a device refused a state, or left it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct AlStatusCode(pub u16);

impl AlStatusCode {
    /// No error.
    pub const NO_ERROR: Self = Self(0x0000);
    /// An error without a code of its own.
    pub const UNSPECIFIED_ERROR: Self = Self(0x0001);
    /// There is no way from the present state to the requested one.
    pub const INVALID_STATE_CHANGE: Self = Self(0x0011);
    /// The requested state does not exist.
    pub const UNKNOWN_STATE: Self = Self(0x0012);
    /// The device has no state BOOT.
    pub const BOOT_NOT_SUPPORTED: Self = Self(0x0013);
    /// The sync managers of the mailbox do not fit BOOT.
    pub const INVALID_BOOT_MAILBOX: Self = Self(0x0015);
    /// The sync managers of the mailbox do not fit PRE-OP.
    pub const INVALID_MAILBOX: Self = Self(0x0016);
    /// No outputs came in time.
    pub const WATCHDOG: Self = Self(0x001B);
    /// The sync manager of the outputs is not as the device needs it.
    pub const INVALID_OUTPUTS: Self = Self(0x001D);
    /// The sync manager of the inputs is not as the device needs it.
    pub const INVALID_INPUTS: Self = Self(0x001E);
    /// The SYNC signals stay away in OP.
    pub const FATAL_SYNC_ERROR: Self = Self(0x002C);
    /// There are no SYNC signals on the way to OP.
    pub const NO_SYNC_ERROR: Self = Self(0x002D);
    /// The SYNC signals are not as the device needs them.
    pub const INVALID_SYNC: Self = Self(0x0030);
    /// The device's EEPROM is damaged.
    pub const EEPROM_ERROR: Self = Self(0x0051);
    /// The controller's list of modules in object 0xF030 is not that of the detected ones in 0xF050 (ETG.5001.1).
    pub const OTHER_MODULES: Self = Self(0x0070);

    /// Returns the highest state in which a device can be that indicates this error (ETG.1020, AL status codes). None is in
    /// OP, not even after a request that it only refused: Beckhoff's SSC, SOES and KickCAT go to SAFE-OP, too.
    pub(crate) const fn highest_state(self) -> AlState {
        match self {
            Self::INVALID_MAILBOX | Self::INVALID_BOOT_MAILBOX => AlState::Init,
            Self::INVALID_OUTPUTS | Self::INVALID_INPUTS | Self::OTHER_MODULES => AlState::PreOp,
            _ => AlState::SafeOp,
        }
    }

    /// Returns what the code says.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::NO_ERROR => "no error",
            Self::UNSPECIFIED_ERROR => "unspecified error",
            Self::INVALID_STATE_CHANGE => "invalid requested state change",
            Self::UNKNOWN_STATE => "unknown requested state",
            Self::BOOT_NOT_SUPPORTED => "bootstrap not supported",
            Self(0x0014) => "no valid firmware",
            Self::INVALID_BOOT_MAILBOX => "invalid mailbox configuration in BOOT",
            Self::INVALID_MAILBOX => "invalid mailbox configuration in PRE-OP",
            Self(0x0017) => "invalid sync manager configuration",
            Self(0x0018) => "no valid inputs available",
            Self(0x0019) => "no valid outputs",
            Self(0x001A) => "synchronisation error",
            Self::WATCHDOG => "sync manager watchdog",
            Self::INVALID_OUTPUTS => "invalid output configuration",
            Self::INVALID_INPUTS => "invalid input configuration",
            Self(0x001F) => "invalid watchdog configuration",
            Self::FATAL_SYNC_ERROR => "fatal sync error",
            Self::NO_SYNC_ERROR => "no sync signal",
            Self::INVALID_SYNC => "invalid DC SYNC configuration",
            Self::EEPROM_ERROR => "EEPROM error",
            Self::OTHER_MODULES => "detected and configured lists of modules do not match",
            _ => "a code that is not in the standard's table",
        }
    }
}

impl core::fmt::Display for AlStatusCode {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "0x{:04X}: {}", self.0, self.text())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;

    /// The codes that a device of this crate may have, and some of others, with the words of ETG.1020, "AL Status Codes".
    #[test]
    fn each_status_code_is_told_with_its_number_and_the_standards_words() {
        let table = [
            "0x0000: no error",
            "0x0001: unspecified error",
            "0x0011: invalid requested state change",
            "0x0012: unknown requested state",
            "0x0013: bootstrap not supported",
            "0x0014: no valid firmware",
            "0x0015: invalid mailbox configuration in BOOT",
            "0x0016: invalid mailbox configuration in PRE-OP",
            "0x0017: invalid sync manager configuration",
            "0x0018: no valid inputs available",
            "0x0019: no valid outputs",
            "0x001A: synchronisation error",
            "0x001B: sync manager watchdog",
            "0x001D: invalid output configuration",
            "0x001E: invalid input configuration",
            "0x001F: invalid watchdog configuration",
            "0x002C: fatal sync error",
            "0x002D: no sync signal",
            "0x0030: invalid DC SYNC configuration",
            "0x0051: EEPROM error",
        ];
        for expected in table {
            let code = u16::from_str_radix(&expected[2..6], 16).unwrap();
            assert_eq!(AlStatusCode(code).to_string(), expected);
        }
        assert_eq!(AlStatusCode(0x0042).to_string(), "0x0042: a code that is not in the standard's table");
    }
}
