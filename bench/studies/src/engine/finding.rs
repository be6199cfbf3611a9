//! Rows that a study looks for, found while rows are written, read again or merged.

use std::path::Path;

use report::in_shell;

use super::file::StudyFinding;
use super::plan::JobAddress;
use super::rows::{Columns, SavedJob};

/// Jobs that are listed by name.
const LISTED: usize = 5;

/// Jobs that failed, and jobs with rows that a study looks for.
pub(super) struct Findings {
    looked_for: Vec<(usize, StudyFinding)>,
    /// Jobs so far.
    pub jobs: u64,
    /// Jobs that failed or were refused.
    pub failed: u64,
    found: u64,
    listed: Vec<(JobAddress, &'static str)>,
}

impl Findings {
    /// Begins without jobs.
    #[must_use]
    pub(super) fn of(findings: &[StudyFinding], columns: &Columns) -> Self {
        let head = columns.rows_head();
        let index = |finding: &StudyFinding| {
            head.trim_end().split(',').position(|name| name == finding.figure.column())
        };
        let looked_for = findings.iter().filter_map(|finding| Some((index(finding)?, finding.clone())));
        Self { looked_for: looked_for.collect(), jobs: 0, failed: 0, found: 0, listed: Vec::new() }
    }

    /// Adds a job.
    pub(super) fn add(&mut self, job: &SavedJob<'_>) {
        self.jobs += 1;
        if job.is_failed() {
            self.failed += 1;
            self.list(job.address, "did not pass");
        }
        let is_found = |row: &String| {
            self.looked_for.iter().any(|(column, finding)| {
                let value =
                    row.trim_end().split(',').nth(*column).and_then(|field| field.parse::<f64>().ok());
                let Some(value) = value else { return false };
                finding.above.is_some_and(|above| value > above)
                    || finding.below.is_some_and(|below| value < below)
            })
        };
        if job.rows.iter().any(is_found) {
            self.found += 1;
            self.list(job.address, "is a finding");
        }
    }

    fn list(&mut self, address: JobAddress, why: &'static str) {
        // The smallest addresses, so that the list depends neither on shards nor on threads.
        self.listed.push((address, why));
        self.listed.sort_unstable();
        self.listed.truncate(LISTED);
    }

    /// Returns what was found in sentences, with the commands that execute the first jobs again.
    #[must_use]
    pub(super) fn lines(&self, directory: &Path) -> Vec<String> {
        let mut lines = vec![format!("{} jobs, {} did not pass", self.jobs, self.failed)];
        if !self.looked_for.is_empty() {
            lines[0] += &format!(", {} with a finding", self.found);
        }
        lines[0] += ".";
        for (address, why) in &self.listed {
            lines.push(format!(
                "  {address} {why}: bench study rerun {} {address}",
                in_shell(directory.display())
            ));
        }
        lines
    }
}
