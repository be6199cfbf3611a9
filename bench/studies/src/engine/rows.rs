//! `rows.csv`, a line for each repetition, and `jobs.csv`, a line for each job: appended job by job and never rewritten.
//!
//! A job is saved when its line is in `jobs.csv`; its rows are written before. After a kill or on a full disk at most the job that
//! was being written is a part, which is removed when the study goes on.

mod reading;

use std::fmt::Write as _;
use std::path::Path;

use super::file::{RowFigure, Scalar};
use super::job::{JobRow, JobRows};
use super::lines::{Appended, field, locked};
use super::plan::{JobAddress, StudyPlan};
use crate::study_files::{JOBS, ROWS};
pub(super) use reading::{SavedJob, Tail, read};

/// Names and order of the columns.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Columns {
    /// Figures of each row, the usual ones first.
    pub figures: Vec<RowFigure>,
    /// The varied keys.
    pub keys: Vec<String>,
    /// Rows of each job, or [`Columns::ANY`].
    pub rows_per_job: u64,
}

impl Columns {
    /// Each job has as many rows as it executes.
    pub(super) const ANY: u64 = 0;

    /// Returns whether this number of rows is a whole job.
    const fn is_whole(&self, rows: u64) -> bool {
        rows == self.rows_per_job || (self.rows_per_job == Self::ANY && rows > 0)
    }

    /// Returns the columns of a study.
    #[must_use]
    pub(super) fn of(plan: &StudyPlan) -> Self {
        Self {
            figures: plan.figures.clone(),
            keys: plan.axes.iter().map(|axis| axis.path.clone()).collect(),
            rows_per_job: plan.rows_per_job(),
        }
    }

    /// Returns the first line of the rows. Figures that not every study has come last.
    #[must_use]
    pub(super) fn rows_head(&self) -> String {
        let (usual, more) = self.figures.split_at(RowFigure::USUAL.len().min(self.figures.len()));
        let columns = ["job", "seed", "type", "repetition"].into_iter();
        let columns = columns.chain(usual.iter().map(|figure| figure.column())).chain(["status"]);
        columns.chain(more.iter().map(|figure| figure.column())).collect::<Vec<_>>().join(",") + "\n"
    }

    /// Returns the first line of the jobs.
    #[must_use]
    pub(super) fn jobs_head(&self) -> String {
        let keys = self.keys.iter().map(|key| field(key));
        ["job".to_owned()].into_iter().chain(keys).chain(["reason".to_owned()]).collect::<Vec<_>>().join(",")
            + "\n"
    }

    /// Appends the line of a repetition.
    fn write_row(&self, text: &mut String, address: JobAddress, seed: u64, row: &JobRow) {
        let usual = RowFigure::USUAL.len();
        let JobRow { execution_type, repetition, status, figures } = row;
        // Writing to a string never fails.
        let _ = write!(text, "{address},{seed},{execution_type},{repetition}");
        for (index, figure) in self.figures.iter().enumerate() {
            if index == usual {
                let _ = write!(text, ",{}", status.name());
            }
            text.push(',');
            match figures.get(index) {
                Some(value) if value.is_nan() => {}
                Some(value) if figure.is_whole() => drop(write!(text, "{value:.0}")),
                // A millionth of a mm or of a rating: more digits would only be longer.
                Some(value) => drop(write!(text, "{value:.6}")),
                None => {}
            }
        }
        if self.figures.len() <= usual {
            let _ = write!(text, ",{}", status.name());
        }
        text.push('\n');
    }
}

/// The rows of a study's directory, which one process at a time appends to.
pub(super) struct RowsJournal {
    columns: Columns,
    rows: Appended,
    jobs: Appended,
}

impl RowsJournal {
    /// Opens the rows of a directory, and calls `known` with each job that they have already.
    ///
    /// # Errors
    ///
    /// Another process writes there, a file cannot be read or written, or its lines are broken before the end.
    pub(super) fn open(
        directory: &Path,
        columns: Columns,
        known: impl FnMut(&SavedJob<'_>),
    ) -> anyhow::Result<Self> {
        let (rows_path, jobs_path) = (directory.join(ROWS), directory.join(JOBS));
        let lock = locked(&rows_path)?;
        let [rows_len, jobs_len] = read(directory, &columns, Tail::MayBeCut, known)?;
        let jobs = Appended::open(jobs_path, &columns.jobs_head(), jobs_len)?;
        let mut rows = Appended::open(rows_path, &columns.rows_head(), rows_len)?;
        rows.hold(lock);
        Ok(Self { columns, rows, jobs })
    }

    /// Appends a finished job: its rows, then its line.
    ///
    /// # Errors
    ///
    /// The disk does not take it. What was saved before is whole.
    pub(super) fn add(
        &mut self,
        address: JobAddress,
        seed: u64,
        values: &[Scalar],
        job: &JobRows,
    ) -> anyhow::Result<()> {
        let mut lines = String::new();
        job.rows.iter().for_each(|row| self.columns.write_row(&mut lines, address, seed, row));
        let mut line = address.to_string();
        for value in values {
            line.push(',');
            line.push_str(&field(&value.to_string()));
        }
        let _ = writeln!(line, ",{}", field(&job.reason));
        let before = self.rows.len();
        self.rows.add(&lines)?;
        self.jobs.add(&line).inspect_err(|_| self.rows.shorten(before))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::job::RowStatus;
    use plc_node::ExecutionType;
    use std::fs;

    fn columns() -> Columns {
        Columns { figures: RowFigure::USUAL.to_vec(), keys: vec!["bus.kind".to_owned()], rows_per_job: 2 }
    }

    fn job(time: f64) -> JobRows {
        let row = |repetition| JobRow {
            execution_type: ExecutionType::Cm,
            repetition,
            status: RowStatus::Passed,
            figures: vec![time, time - 1.0, 0.0],
        };
        JobRows { rows: vec![row(1), row(2)], reason: String::new() }
    }

    fn known(directory: &Path) -> anyhow::Result<(RowsJournal, Vec<u64>)> {
        let mut known = Vec::new();
        let journal = RowsJournal::open(directory, columns(), |job| known.push(job.address.0))?;
        Ok((journal, known))
    }

    fn saved() -> (tempfile::TempDir, String, String) {
        let place = tempfile::tempdir().unwrap();
        let (mut journal, none) = known(place.path()).unwrap();
        assert!(none.is_empty());
        let value = [Scalar::Text("profinet".to_owned())];
        for address in 1..=3 {
            journal.add(JobAddress(address), 7, &value, &job(3_727_000_000.0)).unwrap();
        }
        drop(journal);
        let text = |name| fs::read_to_string(place.path().join(name)).unwrap();
        let (rows, jobs) = (text(ROWS), text(JOBS));
        (place, rows, jobs)
    }

    #[test]
    fn the_files_have_a_line_for_each_repetition_and_job() {
        let (_place, rows, jobs) = saved();
        insta::assert_snapshot!(rows.lines().take(3).collect::<Vec<_>>().join("\n"), @"
job,seed,type,repetition,execution_ns,robot_execution_ns,blends_suppressed,status
0000000000000001,7,cm,1,3727000000,3726999999,0,passed
0000000000000001,7,cm,2,3727000000,3726999999,0,passed
");
        insta::assert_snapshot!(jobs.lines().take(2).collect::<Vec<_>>().join("\n"), @"
job,bus.kind,reason
0000000000000001,profinet,
");
        assert!(rows.lines().all(|line| line.len() < 100));
    }

    #[test]
    fn killed_at_any_byte_the_journal_goes_on_after_its_last_whole_job() {
        let (place, rows, jobs) = saved();
        let write = |rows: &str, jobs: &str| {
            fs::write(place.path().join(ROWS), rows).unwrap();
            fs::write(place.path().join(JOBS), jobs).unwrap();
        };
        let job_starts: Vec<usize> = jobs.match_indices('\n').map(|(at, _)| at + 1).collect();
        let row_starts: Vec<usize> = rows.match_indices('\n').map(|(at, _)| at + 1).collect();
        // While the third job is written: any part of its rows, then all rows and any part of its line.
        let cuts = (row_starts[4]..=rows.len()).map(|end| (end, job_starts[2]));
        let cuts = cuts.chain((job_starts[2]..jobs.len()).map(|end| (rows.len(), end)));
        for (rows_end, jobs_end) in cuts {
            write(&rows[..rows_end], &jobs[..jobs_end]);
            let (mut journal, found) = known(place.path()).unwrap();
            assert_eq!(found, [1, 2], "{rows_end} {jobs_end}");
            journal
                .add(JobAddress(3), 7, &[Scalar::Text("profinet".to_owned())], &job(3_727_000_000.0))
                .unwrap();
            drop(journal);
            assert_eq!(fs::read_to_string(place.path().join(ROWS)).unwrap(), rows);
            assert_eq!(fs::read_to_string(place.path().join(JOBS)).unwrap(), jobs);
        }
        // While the first lines are written.
        for end in 0..row_starts[0] {
            write(&rows[..end], "");
            assert!(known(place.path()).unwrap().1.is_empty());
        }
    }

    #[test]
    fn a_file_that_is_broken_in_its_midst_is_refused_and_kept() {
        let (place, rows, jobs) = saved();
        let many = rows.replace("0000000000000001", "0000000000000009") + &rows.repeat(40);
        fs::write(place.path().join(ROWS), &many).unwrap();
        let refused = known(place.path()).err().unwrap().to_string();
        assert!(refused.contains("broken after"), "{refused}");
        assert_eq!(fs::read_to_string(place.path().join(ROWS)).unwrap(), many);
        fs::write(place.path().join(ROWS), "other,columns\n1,2\n").unwrap();
        let refused = known(place.path()).err().unwrap().to_string();
        assert!(refused.contains("other columns"), "{refused}");
        assert_eq!(fs::read_to_string(place.path().join(JOBS)).unwrap(), jobs);
    }

    #[test]
    fn two_processes_do_not_write_into_one_directory() {
        let place = tempfile::tempdir().unwrap();
        let (_first, _) = known(place.path()).unwrap();
        let refused = known(place.path()).err().unwrap().to_string();
        assert!(refused.contains("another process writes here"), "{refused}");
    }
}
