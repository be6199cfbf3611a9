//! Reads rows and jobs back, job by job, also where a kill left a part of the last one.

use std::fs::File;
use std::io::{self, BufRead as _, BufReader};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

use super::{Columns, JOBS, ROWS};
use crate::engine::plan::JobAddress;

/// Returns the fields of a line of CSV.
pub(in crate::engine) fn fields(line: &str) -> Vec<String> {
    let (mut fields, mut field, mut is_quoted) = (Vec::new(), String::new(), false);
    let mut letters = line.trim_end_matches(['\n', '\r']).chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if is_quoted && letters.peek() == Some(&'"') => field.extend(letters.next()),
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => fields.push(std::mem::take(&mut field)),
            other => field.push(other),
        }
    }
    fields.push(field);
    fields
}

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
        let whole = [rows.read, jobs.read];
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
    let left = |lines: &CsvLines, whole: u64| lines.len.saturating_sub(whole);
    let [rows_left, jobs_left] = [left(&rows, broken[0]), left(&jobs, broken[1])];
    // Line by line a job was being written: no more than its rows can be a part.
    let most = match columns.rows_per_job {
        Columns::ANY => MOST_ROWS,
        rows => rows,
    };
    let most = most.saturating_mul(LONGEST_ROW);
    if (tail == Tail::IsWhole && rows_left + jobs_left > 0) || rows_left > most || jobs_left > LONGEST_JOB {
        bail!(
            "{}: broken after {} in {ROWS} and {} in {JOBS}; use a copy of these files that is whole, or another --out",
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

/// The lines of a file after its first one.
struct CsvLines {
    path: PathBuf,
    reader: Option<BufReader<File>>,
    len: u64,
    /// Bytes read so far.
    read: u64,
    /// A line that was looked at and belongs to what comes next.
    waiting: Option<String>,
}

impl CsvLines {
    fn open(path: &Path, head: &str) -> anyhow::Result<Self> {
        let about = || format!("cannot read {}", path.display());
        let none = Self { path: path.to_owned(), reader: None, len: 0, read: 0, waiting: None };
        let file = match File::open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(none),
            opened => opened.with_context(about)?,
        };
        let len = file.metadata().with_context(about)?.len();
        let mut reader = BufReader::with_capacity(1 << 16, file);
        let mut first = String::new();
        reader.read_line(&mut first).with_context(about)?;
        if first == head {
            return Ok(Self { reader: Some(reader), len, read: first.len() as u64, ..none });
        }
        // A kill may leave a part of the first line, and nothing else.
        if head.starts_with(&first) {
            return Ok(none);
        }
        bail!(
            "{}: has other columns, so it is from another study or version; use another --out",
            path.display()
        )
    }

    /// Returns the next line if it is wanted; otherwise it stays.
    fn next_if(&mut self, is_wanted: impl Fn(&str) -> bool) -> anyhow::Result<Option<String>> {
        let Some(line) = self.next()? else { return Ok(None) };
        if is_wanted(&line) {
            return Ok(Some(line));
        }
        self.read -= line.len() as u64;
        self.waiting = Some(line);
        Ok(None)
    }

    fn next(&mut self) -> anyhow::Result<Option<String>> {
        if let Some(line) = self.waiting.take() {
            self.read += line.len() as u64;
            return Ok(Some(line));
        }
        let Some(reader) = &mut self.reader else { return Ok(None) };
        let mut line = String::new();
        let read =
            reader.read_line(&mut line).with_context(|| format!("cannot read {}", self.path.display()))?;
        self.read += read as u64;
        Ok((read > 0).then_some(line))
    }
}
