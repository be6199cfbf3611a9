//! Jobs that a verb numbers, such as the lives of a soak: executed by the pool, and saved in the order of their numbers, a line each.
//! So the file depends on neither threads nor kills, and its length says where to go on.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, bail};
use records::exit::Failure;

use super::claim::StudyClaim;
use super::folder::{of_host, of_journal};
use super::lines::{Appended, CsvLines, fields, locked};
use crate::jobs::Pool;

/// The jobs 0 to `count` − 1 of a verb.
pub struct NumberedJobs<'a> {
    pool: Pool<'a>,
    count: u64,
    /// Number of the first job that is not saved.
    next: u64,
    journal: Option<Appended>,
}

impl<'a> NumberedJobs<'a> {
    /// Returns jobs that are not saved.
    #[must_use]
    pub const fn in_memory(pool: Pool<'a>, count: u64) -> Self {
        Self { pool, count, next: 0, journal: None }
    }

    /// Opens the file of the jobs, and calls `known` with the number and the fields of each job that it has; `None` for a broken line.
    /// `head` is its first line, without the end.
    ///
    /// # Errors
    ///
    /// The file cannot be read or written, has other columns, or is broken before its end.
    pub fn saved_in(
        self,
        claim: &StudyClaim,
        name: &str,
        head: &str,
        known: impl FnMut(u64, &[String]) -> Option<()>,
    ) -> Result<Self, Failure> {
        claim.make()?;
        let path = claim.directory().join(name);
        let opened = open(&path, &format!("{head}\n"), self.count, known);
        let (journal, next) = opened.map_err(of_journal)?;
        Ok(Self { journal: Some(journal), next, ..self })
    }

    /// Executes the jobs that are not saved until an interrupt, and calls `done` in the order of the numbers; it returns the line
    /// of a finished job without its number, and `None` for one that an interrupt cut. Returns how many jobs there are results of.
    ///
    /// # Errors
    ///
    /// A job failed, or the disk does not take one.
    pub fn each<R: Send>(
        self,
        work: impl Fn(u64) -> anyhow::Result<R> + Sync,
        mut done: impl FnMut(u64, R) -> anyhow::Result<Option<String>>,
    ) -> Result<u64, Failure> {
        let Self { pool, count, next: first, mut journal } = self;
        let (mut next, mut waiting, mut is_not_saved) = (first, BTreeMap::new(), false);
        // An error waits for the jobs before it, so that it is the same with any number of threads.
        let ran = pool.each_number(
            count - first,
            |index| Ok(work(first + index)),
            |index, result| {
                waiting.insert(first + index, result);
                while let Some(result) = waiting.remove(&next) {
                    let line = done(next, result?)?;
                    match (line, &mut journal) {
                        (Some(line), Some(saved)) => {
                            saved.add(&format!("{next},{line}\n")).inspect_err(|_| is_not_saved = true)?;
                        }
                        // The file has no gaps: nothing after a job that was cut is saved.
                        (None, _) => journal = None,
                        (Some(_), None) => {}
                    }
                    next += 1;
                }
                Ok(())
            },
        );
        match ran {
            Ok(()) => Ok(next),
            Err(error) if is_not_saved => Err(of_host(error.context("the jobs before are saved"))),
            Err(error) => Err(error.into()),
        }
    }
}

/// Opens a file of jobs to append; returns it with the number of jobs in it.
fn open(
    path: &Path,
    head: &str,
    count: u64,
    mut known: impl FnMut(u64, &[String]) -> Option<()>,
) -> anyhow::Result<(Appended, u64)> {
    let lock = locked(path)?;
    let mut lines = CsvLines::open(path, head)?;
    let (mut whole, mut next) = (lines.read(), 0);
    while let Some(line) = lines.next()? {
        if !line.ends_with('\n') {
            break;
        }
        let fields = fields(&line);
        let number = fields.first().and_then(|number| number.parse().ok());
        let is_next = number == Some(next) && next < count;
        if !is_next || known(next, fields.get(1..).unwrap_or_default()).is_none() {
            bail!(
                "{}: line {} is broken; use a copy that is whole, or another --out",
                path.display(),
                next + 2
            );
        }
        (whole, next) = (lines.read(), next + 1);
    }
    let mut journal = Appended::open(path.to_owned(), head, whole)
        .with_context(|| format!("cannot go on with {}", path.display()))?;
    journal.hold(lock);
    Ok((journal, next))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::claim::RowsOrigin;
    use std::fs;
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

    const FILE: &str = "squares.csv";

    /// Squares numbers in a directory; returns how many were squared anew, and all squares.
    fn squares(place: &Path, threads: u16, stop_at: u64) -> anyhow::Result<(u64, Vec<u64>)> {
        let (interrupted, made) = (AtomicBool::new(false), AtomicU64::new(0));
        let origin = RowsOrigin {
            directory: place,
            options: "squares",
            command: "",
            results: &[FILE],
            commit: "c0ffee",
        };
        let claim = StudyClaim::checked(origin).map_err(|failure| failure.error)?;
        let pool = Pool { name: "squares", quiet: true, threads: Some(threads), interrupted: &interrupted };
        let mut squares = Vec::new();
        let jobs = NumberedJobs::in_memory(pool, 40).saved_in(&claim, FILE, "number,square", |_, fields| {
            squares.push(fields.first()?.parse().ok()?);
            Some(())
        });
        let work = |number| {
            made.fetch_add(1, Ordering::Relaxed);
            interrupted.store(number >= stop_at, Ordering::Relaxed);
            anyhow::ensure!(number != 99, "never");
            Ok(number * number)
        };
        let ended = jobs.map_err(|failure| failure.error)?.each(work, |number, square| {
            squares.push(square);
            Ok((number < stop_at).then(|| square.to_string()))
        });
        ended.map_err(|failure| failure.error)?;
        Ok((made.into_inner(), squares))
    }

    #[test]
    fn the_file_is_the_same_with_any_threads_and_after_a_kill_at_any_byte() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join(FILE);
        let (made, wanted) = squares(place.path(), 1, 99).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!((made, text.lines().count()), (40, 41));
        for end in 0..=text.len() {
            fs::write(&path, &text[..end]).unwrap();
            let (made, found) = squares(place.path(), 3, 99).unwrap();
            assert_eq!(found, wanted, "{end}");
            let saved = text[..end].matches('\n').count().saturating_sub(1);
            assert_eq!(made, 40 - saved as u64, "{end}");
            assert_eq!(fs::read_to_string(&path).unwrap(), text, "{end}");
        }
    }

    #[test]
    fn a_job_that_an_interrupt_cut_is_not_saved_and_runs_again() {
        let place = tempfile::tempdir().unwrap();
        squares(place.path(), 1, 7).unwrap();
        assert_eq!(fs::read_to_string(place.path().join(FILE)).unwrap().lines().count(), 1 + 7);
        assert_eq!(squares(place.path(), 2, 99).unwrap().0, 33);
    }

    #[test]
    fn a_file_with_a_broken_line_is_refused_and_kept() {
        let place = tempfile::tempdir().unwrap();
        squares(place.path(), 1, 99).unwrap();
        let path = place.path().join(FILE);
        let text = fs::read_to_string(&path).unwrap();
        for (from, to) in [("\n5,25\n", "\n5,x\n"), ("\n5,25\n", "\n"), ("39,1521\n", "39,1521\n40,1600\n")] {
            let broken = text.replace(from, to);
            assert_ne!(broken, text);
            fs::write(&path, &broken).unwrap();
            let refused = squares(place.path(), 1, 99).unwrap_err().to_string();
            assert!(refused.contains(" is broken; use a copy"), "{refused}");
            assert_eq!(fs::read_to_string(&path).unwrap(), broken);
        }
    }
}
