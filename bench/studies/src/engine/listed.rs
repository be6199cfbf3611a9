//! Jobs that a verb lists itself, such as those of a sweep: executed on all cores by the pool, saved by the journal of all studies
//! as soon as they end, and read back when the verb is given again with the same `--out`.

use std::collections::HashMap;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};

use records::exit::Failure;
use sha2::{Digest as _, Sha256};

use super::claim::StudyClaim;
use super::file::RowFigure;
use super::folder::of_journal;
use super::job::{JobInputs, JobRow, JobRows, JobSubject, ListedJob, RowStatus};
use super::lines::fields;
use super::plan::JobAddress;
use super::rows::{Columns, RowsJournal, SavedJob};
use crate::jobs::Pool;
use crate::study_files::{JOBS, MANIFEST, ROWS};

/// The jobs of a verb that lists them, with those that are saved already.
pub struct ListedStudy<'a> {
    /// Beginning of the line of progress.
    pub name: &'a str,
    /// Without progress.
    pub quiet: bool,
    /// Set when no further job is to start.
    pub interrupted: &'a AtomicBool,
    saved: Option<SavedRows>,
}

struct SavedRows {
    directory: PathBuf,
    program: String,
    journal: Mutex<RowsJournal>,
    known: Mutex<HashMap<JobAddress, JobRows>>,
}

impl<'a> ListedStudy<'a> {
    /// Returns jobs that are not saved.
    #[must_use]
    pub const fn in_memory(name: &'a str, quiet: bool, interrupted: &'a AtomicBool) -> Self {
        Self { name, quiet, interrupted, saved: None }
    }

    /// Opens the rows of a directory, and reads the jobs that are saved.
    ///
    /// # Errors
    ///
    /// The rows are broken, or cannot be written.
    pub fn saved_in(self, claim: &StudyClaim) -> Result<Self, Failure> {
        claim.make()?;
        let directory = claim.directory();
        let mut known = HashMap::new();
        let journal = RowsJournal::open(directory, columns(), |job| {
            known.insert(job.address, read_back(job));
        });
        let saved = SavedRows {
            directory: directory.to_owned(),
            program: claim.program().to_owned(),
            journal: Mutex::new(journal.map_err(of_journal)?),
            known: Mutex::new(known),
        };
        Ok(Self { saved: Some(saved), ..self })
    }

    /// Executes jobs of which none may fail; `None` for a job that was not started before an interrupt.
    ///
    /// # Errors
    ///
    /// A repetition failed, or the disk does not take a job.
    pub fn measured(&self, jobs: &[ListedJob]) -> anyhow::Result<Vec<Option<JobRows>>> {
        self.each(jobs, ListedJob::measured)
    }

    /// Executes jobs of which some may fail: their rows have the reason.
    ///
    /// # Errors
    ///
    /// The disk does not take a job.
    pub fn executed(&self, jobs: &[ListedJob]) -> anyhow::Result<Vec<Option<JobRows>>> {
        self.each(jobs, |job| Ok(job.inputs().execute()))
    }

    fn each(
        &self,
        jobs: &[ListedJob],
        work: impl Fn(&ListedJob) -> anyhow::Result<JobRows> + Sync,
    ) -> anyhow::Result<Vec<Option<JobRows>>> {
        let mut results: Vec<Option<JobRows>> = jobs.iter().map(|_| None).collect();
        let pool = Pool { name: self.name, quiet: self.quiet, threads: None, interrupted: self.interrupted };
        let work = |job: &ListedJob| {
            let Some(saved) = &self.saved else { return Ok((None, work(job)?)) };
            let address = job.address(&saved.program)?;
            let known = saved.known.lock().unwrap_or_else(PoisonError::into_inner).get(&address).cloned();
            match known {
                Some(rows) => Ok((None, rows)),
                None => Ok((Some(address), work(job)?)),
            }
        };
        pool.each(jobs, work, |index, (address, rows)| {
            if let (Some(saved), Some(address), Some(job)) = (&self.saved, address, jobs.get(index)) {
                saved.add(address, job, &rows)?;
            }
            if let Some(slot) = results.get_mut(index) {
                *slot = Some(rows);
            }
            Ok(())
        })?;
        Ok(results)
    }

    /// Removes the files of a study that has no job, so that nothing is left of it.
    pub fn discard_if_empty(&self) {
        let Some(saved) = &self.saved else { return };
        if saved.known.lock().unwrap_or_else(PoisonError::into_inner).is_empty() {
            for name in [ROWS, JOBS, MANIFEST] {
                let _ = fs::remove_file(saved.directory.join(name));
            }
        }
    }
}

impl SavedRows {
    fn add(&self, address: JobAddress, job: &ListedJob, rows: &JobRows) -> anyhow::Result<()> {
        let seed = job.schedule.seed;
        self.journal.lock().unwrap_or_else(PoisonError::into_inner).add(address, seed, &[], rows)?;
        self.known.lock().unwrap_or_else(PoisonError::into_inner).insert(address, rows.clone());
        Ok(())
    }
}

impl ListedJob {
    fn inputs(&self) -> JobInputs<'_> {
        let Self { setup, planned, schedule } = self;
        let subject = JobSubject::Robot { setup, planned };
        JobInputs { subject, schedule, faults: &[], figures: &RowFigure::USUAL }
    }

    /// Returns the digest of everything that its rows depend on.
    fn address(&self, program: &str) -> anyhow::Result<JobAddress> {
        let Self { setup, planned, schedule } = self;
        let mut digest = Sha256::new();
        digest.update("skillbench listed job 1\n");
        let setup = setup::setup_to_toml(setup)?;
        for part in [setup, format!("{planned:?}"), format!("{schedule:?}"), program.to_owned()] {
            digest.update(format!("{}:", part.len()));
            digest.update(part);
        }
        let first = digest.finalize().iter().take(8).fold(0, |sum, byte| (sum << 8) | u64::from(*byte));
        Ok(JobAddress(first))
    }
}

/// Columns of the rows: a job has as many as it executes.
fn columns() -> Columns {
    Columns { figures: RowFigure::USUAL.to_vec(), keys: Vec::new(), rows_per_job: Columns::ANY }
}

/// Returns the rows of a saved job.
fn read_back(job: &SavedJob<'_>) -> JobRows {
    let row = |line: &String| {
        let fields: Vec<&str> = line.trim_end().split(',').collect();
        let status = RowStatus::of_name(fields.get(7)?)?;
        let figures = fields.get(4..7)?.iter().filter_map(|field| field.parse().ok());
        Some(JobRow {
            execution_type: fields.get(2)?.parse().ok()?,
            repetition: fields.get(3)?.parse().ok()?,
            status,
            figures: figures.collect(),
        })
    };
    let reason = fields(job.line).pop().unwrap_or_default();
    JobRows { rows: job.rows.iter().filter_map(row).collect(), reason }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::claim::RowsOrigin;
    use plc_node::ExecutionType;
    use records::schedule::Schedule;
    use stands::planned_cell::PlannedCell;
    use std::path::Path;

    fn jobs() -> Vec<ListedJob> {
        let (setup, found) = planning::setup_with_application("A").unwrap();
        let planned = PlannedCell::of(&setup, &found.application).unwrap();
        let job = |(execution_type, reps)| ListedJob {
            setup: setup.clone(),
            planned: planned.clone(),
            schedule: Schedule::new(&[execution_type], reps, 3),
        };
        [(ExecutionType::Rc, 1), (ExecutionType::Cm, 2)].map(job).into()
    }

    fn opened<'a>(
        place: &'a Path,
        options: &str,
        interrupted: &'a AtomicBool,
    ) -> Result<ListedStudy<'a>, String> {
        let (command, results, commit) = ("", &["sweep.json"], "c0ffee");
        let claim = StudyClaim::checked(RowsOrigin { directory: place, options, command, results, commit });
        let study =
            claim.and_then(|claim| ListedStudy::in_memory("jobs", true, interrupted).saved_in(&claim));
        study.map_err(|failure| failure.error.to_string().replace(&place.display().to_string(), "DIR"))
    }

    #[test]
    fn a_killed_study_reads_its_finished_jobs_back_and_executes_only_the_others() {
        let (place, go_on) = (tempfile::tempdir().unwrap(), AtomicBool::new(false));
        let jobs = jobs();
        let wanted = ListedStudy::in_memory("jobs", true, &go_on).measured(&jobs).unwrap();
        let first = opened(place.path(), "options", &go_on).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(first.measured(&jobs[1..]).unwrap(), wanted[1..]);
        drop(first);
        // Killed while it wrote: a part of the next job's rows.
        let path = place.path().join(ROWS);
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, format!("{text}0123456789abcdef,3,rc,1,37")).unwrap();
        let second = opened(place.path(), "options", &go_on).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(second.saved.as_ref().unwrap().known.lock().unwrap().len(), 1);
        assert_eq!(second.measured(&jobs).unwrap(), wanted);
        drop(second);
        let rows = fs::read_to_string(&path).unwrap();
        assert!(rows.starts_with(&text) && rows.lines().count() == 4, "{rows}");
    }

    #[test]
    fn rows_of_other_options_are_refused() {
        let (place, go_on) = (tempfile::tempdir().unwrap(), AtomicBool::new(false));
        drop(opened(place.path(), "options", &go_on).unwrap_or_else(|error| panic!("{error}")));
        let refused = opened(place.path(), "other options", &go_on).err().unwrap();
        insta::assert_snapshot!(refused, @"DIR: has rows of another study; use another --out");
    }
}
