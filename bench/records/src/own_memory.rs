//! Memory of this process, as the kernel counts it.

use anyhow::{Context as _, anyhow};

/// Memory that the kernel counts, by its name in `/proc/self/status` (proc(5)).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum OwnMemory {
    /// Resident memory of now.
    Resident,
    /// Largest resident memory since the process started.
    Peak,
}

impl OwnMemory {
    /// Reads it from the kernel, in KiB.
    ///
    /// # Errors
    ///
    /// The file does not exist or has no such line.
    pub fn kib(self) -> anyhow::Result<u64> {
        let path = "/proc/self/status";
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {path}"))?;
        let name = match self {
            Self::Resident => "VmRSS:",
            Self::Peak => "VmHWM:",
        };
        let line = text.lines().find_map(|line| line.strip_prefix(name));
        let number = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse().ok());
        number.ok_or_else(|| anyhow!("{path} does not say `{name} … kB`"))
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn the_peak_is_at_least_a_mebibyte_and_about_what_is_resident_or_more() {
        let [resident, peak] = [OwnMemory::Resident, OwnMemory::Peak].map(|memory| memory.kib().unwrap());
        // The kernel counts in batches.
        assert!(peak > 1_024 && peak + 1_024 > resident, "{resident} {peak}");
    }
}
