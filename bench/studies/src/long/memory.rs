//! Memory of this process, as the kernel counts it.

use std::fmt;

use anyhow::{Context, anyhow};

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
        let path = "/proc/self/status";
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {path}"))?;
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let number = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse().ok());
        number.map(Self).ok_or_else(|| anyhow!("{path} does not say `VmHWM: … kB`"))
    }
}

impl fmt::Display for PeakResident {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} MiB", self.0 as f64 / 1024.0)
    }
}
