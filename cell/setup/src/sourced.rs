//! A number and where it comes from.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Where a number comes from.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Provenance {
    /// The paper states it.
    Paper,
    /// A datasheet or a public robot description states it.
    Datasheet,
    /// Chosen so that a published figure comes out; never to be shown as a prediction.
    Calibrated,
    /// Nobody could find it.
    Assumed,
}

impl fmt::Display for Provenance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Paper => "paper",
            Self::Datasheet => "datasheet",
            Self::Calibrated => "calibrated",
            Self::Assumed => "assumed",
        })
    }
}

/// A value with its provenance: `{ value = 1000, from = "paper", note = "section 6.2" }`.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "a value with its provenance: { value = ..., from = \"paper\", \"datasheet\", \"calibrated\" or \"assumed\" }"
)]
pub struct Sourced<T> {
    /// The value, in the unit that its key names.
    pub value: T,
    /// Where it comes from.
    pub from: Provenance,
    /// Which page, or how it was found.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
}
