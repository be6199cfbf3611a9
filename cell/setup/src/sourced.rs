//! A number and its provenance.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Provenance of a number.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Provenance {
    /// Given in the paper.
    Paper,
    /// Given in a datasheet or a public robot description.
    Datasheet,
    /// Chosen to reproduce a published figure; never to be shown as a prediction.
    Calibrated,
    /// Assumed, since no source was found.
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
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(
    deny_unknown_fields,
    expecting = "a value with its source: { value = ..., from = \"paper\", \"datasheet\", \"calibrated\" or \"assumed\" }"
)]
pub struct Sourced<T> {
    /// The value, in the unit given by its key.
    pub value: T,
    /// Its provenance.
    pub from: Provenance,
    /// The page of the source, or how the value was found.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
}
