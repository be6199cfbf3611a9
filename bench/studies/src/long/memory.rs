//! Memory of this process, as the kernel counts it.

use std::fmt;

use records::own_memory::OwnMemory;

/// Largest resident memory since the process started, in KiB. The kernel counts in batches, so a later value may be
/// slightly smaller than an earlier one.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct PeakResident(pub u64);

impl PeakResident {
    /// Reads it from the kernel (`VmHWM` in `/proc/self/status`).
    ///
    /// # Errors
    ///
    /// The file does not exist or has no such line.
    pub fn now() -> anyhow::Result<Self> {
        OwnMemory::Peak.kib().map(Self)
    }
}

impl fmt::Display for PeakResident {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} MiB", self.0 as f64 / 1024.0)
    }
}
