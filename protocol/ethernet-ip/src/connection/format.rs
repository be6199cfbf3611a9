//! Real-time formats: what a class 1 frame carries besides its data (volume 1, 3-6.1).

use crate::class1::RUN_IDLE_LEN;

/// The real-time format of one direction: how a consumer sees whether its producer is in run or idle.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum RealTimeFormat {
    /// Data alone. Its consumer cannot see whether the producer is idle.
    Modeless,
    /// Data in run, nothing in idle.
    ZeroLength,
    /// Never data: frames show only that the producer is there.
    Heartbeat,
    /// A header of 32 bits before the data; its bit 0 is run.
    RunIdleHeader,
}

impl RealTimeFormat {
    /// Returns the length of the header before the data, in bytes.
    #[must_use]
    pub const fn header_len(self) -> u16 {
        match self {
            Self::RunIdleHeader => RUN_IDLE_LEN,
            Self::Modeless | Self::ZeroLength | Self::Heartbeat => 0,
        }
    }

    /// Returns how many of these bytes of an assembly's data a frame in run carries.
    #[must_use]
    pub const fn data_len(self, assembly_len: u16) -> u16 {
        match self {
            Self::Heartbeat => 0,
            Self::Modeless | Self::ZeroLength | Self::RunIdleHeader => assembly_len,
        }
    }
}
