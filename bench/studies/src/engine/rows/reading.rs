//! Reads rows and jobs back, job by job, also where a kill left a part of the last one.

use std::path::Path;

use anyhow::bail;

use super::Columns;
use crate::engine::lines::CsvLines;
use crate::engine::plan::JobAddress;
use crate::study_files::{JOBS, ROWS};

/// A job as it was saved.
#[derive(Clone, Copy, Debug)]
pub(in crate::engine) struct SavedJob<'a> {
    /// Its address.
    pub address: JobAddress,
    /// Its rows, each with its line's end.
    pub rows: &'a [String],
    /// Its line in the file of jobs.
    pub line: &'a str,
}

impl SavedJob<'_> {
    /// Returns whether it failed or was refused: it has a reason.
    #[must_use]
    pub(in crate::engine) fn is_failed(&self) -> bool {
        !self.line.trim_end().ends_with(',')
    }
}

/// State of the files' end.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(in crate::engine) enum Tail {
    /// A process was killed while it wrote the last job.
    MayBeCut,
    /// Nothing: the study is complete.
    IsWhole,
}

/// Reads both files job by job; returns the lengths of the parts that belong to whole jobs, 0 for a file without its first line.
///
/// # Errors
///
/// A file cannot be read, has other columns, or is broken before its last job.
pub(in crate::engine) fn read(
    directory: &Path,
    columns: &Columns,
    tail: Tail,
    mut known: impl FnMut(&SavedJob<'_>),
) -> anyhow::Result<[u64; 2]> {
    let mut rows = CsvLines::open(&directory.join(ROWS), &columns.rows_head())?;
    let mut jobs = CsvLines::open(&directory.join(JOBS), &columns.jobs_head())?;
    let mut block = Vec::new();
    let broken = loop {
        let whole = [rows.read(), jobs.read()];
        let Some(line) = jobs.next()? else { break whole };
        block.clear();
        let address =
            line.get(..JobAddress::DIGITS).and_then(JobAddress::parse).filter(|_| line.ends_with('\n'));
        let is_of_job = |row: &str| {
            row.ends_with('\n') && row.get(..JobAddress::DIGITS) == line.get(..JobAddress::DIGITS)
        };
        while columns.rows_per_job == Columns::ANY || (block.len() as u64) < columns.rows_per_job {
            match rows.next_if(is_of_job)? {
                Some(row) => block.push(row),
                None => break,
            }
        }
        match address {
            Some(address) if columns.is_whole(block.len() as u64) => {
                known(&SavedJob { address, rows: &block, line: &line });
            }
            _ => break whole,
        }
    };
    let left = |lines: &CsvLines, whole: u64| lines.len().saturating_sub(whole);
    let [rows_left, jobs_left] = [left(&rows, broken[0]), left(&jobs, broken[1])];
    // Line by line a job was being written: no more than its rows can be a part.
    let most = match columns.rows_per_job {
        Columns::ANY => MOST_ROWS,
        rows => rows,
    };
    let most = most.saturating_mul(LONGEST_ROW);
    let is_one_job = rows_left <= most && jobs_left <= LONGEST_JOB;
    if (tail == Tail::IsWhole && rows_left + jobs_left > 0) || !is_one_job {
        let remedy = match is_one_job {
            true => "run the study with this --out again, which goes on from there",
            false => "use a copy of these files that is whole, or another --out",
        };
        bail!(
            "{}: broken after {} in {ROWS} and {} in {JOBS}; {remedy}",
            directory.display(),
            bytes(broken[0]),
            bytes(broken[1])
        );
    }
    Ok(broken)
}

fn bytes(count: u64) -> String {
    format!("{count} bytes")
}

/// Longest line of a repetition in bytes, with all figures, for what a kill can leave of a job.
const LONGEST_ROW: u64 = 256;

/// Most rows of a job that a kill can leave, where jobs differ.
const MOST_ROWS: u64 = 30_000;

/// Longest line of a job in bytes.
const LONGEST_JOB: u64 = 64 << 10;
