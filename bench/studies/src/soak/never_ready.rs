//! The end of a life: a cell that stays down.

use records::faults::{self, Fault};

/// A cell does not come up again after a repetition failed.
#[derive(Debug, thiserror::Error)]
#[error("seed {seed}: {reason}; after that {then}; the faults of every life are {faults}")]
pub(super) struct NeverReady {
    seed: u64,
    reason: String,
    then: String,
    faults: String,
}

impl NeverReady {
    pub(super) fn new(seed: u64, error: &anyhow::Error, then: &anyhow::Error, faults: &[Fault]) -> Self {
        Self { seed, reason: format!("{error:#}"), then: format!("{then:#}"), faults: faults::listed(faults) }
    }
}
