//! What this process has in memory, by the kernel's account.

use std::fmt;

use anyhow::{Context, anyhow};

/// The most that was resident at once since the process began, in KiB. The kernel counts in batches, so that a later
/// figure may be a little lower than one before.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct PeakResident(pub u64);

impl PeakResident {
    /// Asks the kernel (`VmHWM` in `/proc/self/status`).
    ///
    /// # Errors
    ///
    /// There is no such file, or it does not say.
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
