//! Memory and descriptors of this process from life to life.

use std::fmt;

use anyhow::Context as _;
use records::own_memory::OwnMemory;

/// Growth of resident memory in MiB that is reported as growth. The allocator keeps freed memory, so less means nothing.
const GROWTH_MIB: f64 = 8.0;

/// Memory and descriptors of this process.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Held {
    /// Resident memory in MiB.
    memory_mib: f64,
    /// Open descriptors.
    descriptors: usize,
}

impl Held {
    /// Reads it from the kernel.
    pub(super) fn now() -> anyhow::Result<Self> {
        let memory_mib = OwnMemory::Resident.kib()? as f64 / 1_024.0;
        let open = std::fs::read_dir("/proc/self/fd").context("cannot read /proc/self/fd")?;
        Ok(Self { memory_mib, descriptors: open.count() })
    }
}

/// Growth of this process from the end of the first tenth of the lives to the last third, of which the least counts: a file that is open
/// just then has not leaked.
#[derive(Clone, Copy, Debug)]
pub(super) struct Growth {
    from: Held,
    to: Held,
}

impl Growth {
    pub(super) fn of(held: &[Held]) -> Self {
        let nothing = Held { memory_mib: 0.0, descriptors: 0 };
        // By then every thread has run a cell.
        let from = held.get(held.len() / 10).copied().unwrap_or(nothing);
        let last = &held[held.len() - held.len().div_ceil(3)..];
        let least = |one: Held, other: &Held| Held {
            memory_mib: one.memory_mib.min(other.memory_mib),
            descriptors: one.descriptors.min(other.descriptors),
        };
        let to = last.iter().copied().reduce(|one, other| least(one, &other)).unwrap_or(nothing);
        Self { from, to }
    }

    pub(super) fn is_none(&self) -> bool {
        let Self { from, to } = self;
        to.memory_mib <= from.memory_mib + GROWTH_MIB && to.descriptors <= from.descriptors
    }
}

impl fmt::Display for Growth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { from, to } = self;
        if to.descriptors == 0 {
            return f.write_str("Memory was not measured: no life ran now.");
        }
        write!(
            f,
            "Memory {:.1} MiB at first and {:.1} MiB at last, descriptors {} and {}.",
            from.memory_mib, to.memory_mib, from.descriptors, to.descriptors
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_or_descriptors_that_grow_from_life_to_life_are_found() {
        let held = |memory_mib, descriptors| Held { memory_mib, descriptors };
        let flat = [held(20.0, 9), held(21.0, 9), held(24.0, 9)];
        assert!(Growth::of(&flat).is_none());
        assert!(!Growth::of(&[held(20.0, 9), held(29.0, 9)]).is_none());
        assert!(!Growth::of(&[held(20.0, 9), held(20.0, 10)]).is_none());
        let grows = [20.0, 22.0, 24.0, 26.0, 28.5, 31.0].map(|memory_mib| held(memory_mib, 9));
        assert!(!Growth::of(&grows).is_none());
        // A file is open at the end of one life.
        let spike = [9, 9, 9, 9, 9, 10].map(|descriptors| held(20.0, descriptors));
        assert!(Growth::of(&spike).is_none());
    }
}
