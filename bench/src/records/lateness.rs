//! How late a cyclic task ran, as results.json has it.

use ::node::report::LatenessReport;
use serde::{Deserialize, Serialize};

/// How late a cyclic task ran.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CycleLateness {
    /// Median, in µs.
    pub p50_us: f64,
    /// 99th percentile, in µs.
    pub p99_us: f64,
    /// Latest, in µs.
    pub max_us: f64,
    /// Cycles that passed without a run.
    pub missed: u64,
    /// Each bucket that holds runs: its upper end in µs, and how many runs are in it.
    #[serde(default)]
    pub buckets: Vec<(f64, u32)>,
}

impl From<&LatenessReport> for CycleLateness {
    fn from(report: &LatenessReport) -> Self {
        let LatenessReport { p50_us, p99_us, max_us, missed, ref buckets, .. } = *report;
        Self { p50_us, p99_us, max_us, missed, buckets: buckets.clone() }
    }
}
