//! Names of the files in which a study's jobs are saved.

/// Description of the directory: what its rows belong to.
pub(crate) const MANIFEST: &str = "study.json";
/// A row for each repetition.
pub(crate) const ROWS: &str = "rows.csv";
/// A line for each job.
pub(crate) const JOBS: &str = "jobs.csv";

/// Files of every directory in which jobs are saved by address.
pub(crate) const CLAIMED_FILES: [&str; 3] = [MANIFEST, ROWS, JOBS];
