//! Lateness of a cyclic task, as in results.json.

use ::node::report::LatenessReport;
use serde::{Deserialize, Serialize};

/// Lateness of a cyclic task.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CycleLateness {
    /// Median, in µs.
    pub p50_us: f64,
    /// 99th percentile, in µs.
    pub p99_us: f64,
    /// Largest lateness, in µs.
    pub max_us: f64,
    /// Cycles that passed without a run.
    pub missed: u64,
    /// Histogram: for each bucket with runs, its upper bound in µs and its number of runs.
    #[serde(default)]
    pub buckets: Vec<(f64, u32)>,
}

impl From<&LatenessReport> for CycleLateness {
    fn from(report: &LatenessReport) -> Self {
        let LatenessReport { p50_us, p99_us, max_us, missed, ref buckets, .. } = *report;
        Self { p50_us, p99_us, max_us, missed, buckets: buckets.clone() }
    }
}
