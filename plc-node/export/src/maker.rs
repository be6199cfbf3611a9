//! Makers whose PLCs are served.

/// Whose language the code is written in.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Maker {
    /// Nobody's: one neutral file of Structured Text (IEC 61131-3).
    St,
    /// Siemens: SCL for TIA Portal.
    Siemens,
    /// CODESYS: PLCopen XML.
    Codesys,
    /// B&R: a package for Automation Studio.
    Br,
}

/// Bytes of a motion in the data: eleven UDINT.
const MOTION_BYTES: usize = 44;

/// Memory in KiB for the instance of the code without motions, and for what else is in the PLC. Assumed.
const REST_KIB: usize = 256;

/// Most motions of any export: more take a compiler too long. Assumed.
const MOST: usize = 100_000;

impl Maker {
    /// Returns the data memory of a PLC in KiB unless a user says how much it is.
    ///
    /// Siemens: work memory for data of the CPU 1517-3 by its data sheet. The others are assumed: a PLC on a PC, as the APC910 is, has
    /// what its runtime is given.
    #[must_use]
    pub const fn memory_kib(self) -> usize {
        match self {
            Self::Siemens => 8 * 1024,
            Self::St | Self::Codesys | Self::Br => 16 * 1024,
        }
    }

    /// Returns how many motions fit a data memory of so many KiB.
    #[must_use]
    pub const fn most_motions(memory_kib: usize) -> usize {
        let fitting = memory_kib.saturating_sub(REST_KIB) * 1024 / MOTION_BYTES;
        if fitting < MOST { fitting } else { MOST }
    }
}
