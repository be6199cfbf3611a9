//! Shared zones: volumes in the cell that only one arm may be in at a time.

use serde::{Deserialize, Serialize};

use crate::Sourced;

/// A box in the cell that only one arm may be in: with its links, its tool and what is between them.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SharedZone {
    /// Its name in messages.
    pub name: String,
    /// Its corner with the lowest coordinates in the cell: x, y, z in mm.
    pub corner_mm: Sourced<[f64; 3]>,
    /// Its lengths along x, y and z, in mm.
    pub size_mm: Sourced<[f64; 3]>,
}
