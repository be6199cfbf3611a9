//! What `--export-json` of the gate writes.

use serde::Serialize;

use super::verdict::GateRow;

/// Version of the format.
const SCHEMA_VERSION: u32 = 1;

/// The comparison with a baseline, for other programs.
#[derive(Serialize)]
#[serde(untagged)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) enum GateExport<'a> {
    /// A virtual run.
    Virtual {
        /// Version of this format; it counts changes that break a reader.
        schema_version: u32,
        /// Each figure with its baseline.
        figures: &'a [GateRow<'a>],
    },
    /// A real run: `--run`.
    Real {
        /// Version of this format; it counts changes that break a reader.
        schema_version: u32,
        /// Each ratio, and each skew and pose of a run of several stations, with its baseline.
        ratios: &'a [RatioRow<'a>],
    },
}

/// A ratio for other programs.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct RatioRow<'a> {
    /// The two types whose AETs are divided; or type and name of a skew or pose, of which the figures are medians.
    pub(super) ratio: &'a str,
    /// Unit; empty for a ratio.
    pub(super) unit: &'a str,
    /// Value in the baseline.
    pub(super) baseline: f64,
    /// Value of this run.
    pub(super) now: f64,
    /// Lower end of the 95 % interval of the value.
    pub(super) low: f64,
    /// Upper end of this interval.
    pub(super) high: f64,
    /// Value above which the gate fails.
    pub(super) at_most: f64,
    /// `within`, `beyond` or `inconclusive`.
    pub(super) verdict: &'static str,
}

impl<'a> GateExport<'a> {
    pub(super) const fn of_figures(figures: &'a [GateRow<'a>]) -> Self {
        Self::Virtual { schema_version: SCHEMA_VERSION, figures }
    }

    pub(super) const fn of_ratios(ratios: &'a [RatioRow<'a>]) -> Self {
        Self::Real { schema_version: SCHEMA_VERSION, ratios }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    fn the_committed_schema_matches_the_export_of_the_gate() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/schemas/gate.schema.json");
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(GateExport<'_>)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        assert!(
            std::fs::read_to_string(path).unwrap_or_default() == schema,
            "the export changed: count SCHEMA_VERSION up where a reader breaks, then INSTA_UPDATE=always cargo test -p bench"
        );
    }
}
