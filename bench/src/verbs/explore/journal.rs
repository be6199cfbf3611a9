//! The outcomes of an exploration in a file, one line each, written at once: an interrupted exploration can be read, and
//! continued where it ended.

use std::fs::{self, File, OpenOptions};
use std::io::{BufRead as _, BufReader, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};

use super::classes::{Class, Outcome};

/// Longest time for which an outcome is only in memory.
const FLUSH_EVERY: Duration = Duration::from_secs(1);

const HEAD: &str = "run,type,faults,class,later_ns,reason\n";

/// The file that outcomes are added to.
pub(super) struct Journal {
    path: PathBuf,
    file: BufWriter<File>,
    flushed: Instant,
}

impl Journal {
    /// Opens `outcomes.csv` of a directory, and calls `known` with the number and the outcome of each run that it has
    /// already.
    ///
    /// # Errors
    ///
    /// It cannot be read or written, or is of another exploration.
    pub(super) fn open(
        directory: &Path,
        mut known: impl FnMut(usize, Outcome) -> anyhow::Result<()>,
    ) -> anyhow::Result<Self> {
        let path = directory.join("outcomes.csv");
        let about = || format!("cannot write {}", path.display());
        let whole = if path.exists() { read(&path, &mut known)? } else { 0 };
        let file = OpenOptions::new().create(true).append(true).open(&path).with_context(about)?;
        // A run whose line was cut off by an interruption is made again.
        file.set_len(whole).with_context(about)?;
        let mut file = BufWriter::new(file);
        if whole == 0 {
            file.write_all(HEAD.as_bytes()).with_context(about)?;
        }
        Ok(Self { path, file, flushed: Instant::now() })
    }

    /// Adds the outcome of a run.
    pub(super) fn add(
        &mut self,
        run: usize,
        execution_type: &str,
        faults: &str,
        outcome: &Outcome,
    ) -> anyhow::Result<()> {
        let Outcome { class, later_ns, reason } = outcome;
        let reason = reason.replace('"', "'").replace('\n', " ");
        let written =
            writeln!(self.file, "{run},{execution_type},{faults},{},{later_ns},\"{reason}\"", class.name());
        let flushed = written.and_then(|()| {
            if self.flushed.elapsed() >= FLUSH_EVERY {
                self.flushed = Instant::now();
                self.file.flush()?;
            }
            Ok(())
        });
        flushed.with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Writes what is still in memory.
    pub(super) fn end(mut self) -> anyhow::Result<()> {
        self.file.flush().with_context(|| format!("cannot write {}", self.path.display()))
    }
}

/// Reads the outcomes of a file; returns the length of its whole lines.
fn read(path: &Path, known: &mut impl FnMut(usize, Outcome) -> anyhow::Result<()>) -> anyhow::Result<u64> {
    let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut lines = BufReader::new(file);
    let (mut whole, mut line) = (0, String::new());
    loop {
        line.clear();
        let read = lines.read_line(&mut line).with_context(|| format!("cannot read {}", path.display()))?;
        if !line.ends_with('\n') {
            return Ok(whole);
        }
        if whole > 0 {
            let (run, outcome) =
                parse(&line).with_context(|| format!("{} is broken: {line}", path.display()))?;
            known(run, outcome)?;
        } else if line != HEAD {
            bail!("{} is no file of an exploration: name another directory by --out", path.display());
        }
        whole += read as u64;
    }
}

fn parse(line: &str) -> Option<(usize, Outcome)> {
    let mut fields = line.trim_end().splitn(6, ',');
    let run = fields.next()?.parse().ok()?;
    let class = Class::of_name(fields.nth(2)?)?;
    let later_ns = fields.next()?.parse().ok()?;
    let reason = fields.next()?.strip_prefix('"')?.strip_suffix('"')?.to_owned();
    Some((run, Outcome { class, later_ns, reason }))
}

/// Writes what determines the jobs of an exploration, or compares it with the file that the directory already has.
///
/// # Errors
///
/// They differ, or the file cannot be written.
pub(super) fn claim(directory: &Path, what: &str) -> anyhow::Result<()> {
    let path = directory.join("exploration.txt");
    match fs::read_to_string(&path) {
        Ok(known) if known == what => Ok(()),
        Ok(known) => bail!(
            "{} has an exploration with other options; name another directory by --out, or use these:\n{known}",
            directory.display()
        ),
        Err(_) => fs::write(&path, what).with_context(|| format!("cannot write {}", path.display())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcomes(directory: &Path) -> (Journal, Vec<(usize, Outcome)>) {
        let mut known = Vec::new();
        let journal = Journal::open(directory, |run, outcome| {
            known.push((run, outcome));
            Ok(())
        });
        (journal.unwrap(), known)
    }

    #[test]
    fn an_interrupted_journal_goes_on_behind_its_last_whole_line() {
        let place = tempfile::tempdir().unwrap();
        let same = Outcome::new(Class::Same, String::new());
        let refused = Outcome::new(Class::Refused, "the PLC, \"in short\", gave up".to_owned());
        let (mut journal, known) = outcomes(place.path());
        assert!(known.is_empty());
        journal.add(3, "CM", "to-plc:lose-frame=1", &same).unwrap();
        journal.add(0, "CM", "to-plc:lose-frame=2 to-plc:lose-frame=3", &refused).unwrap();
        journal.end().unwrap();
        let path = place.path().join("outcomes.csv");
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, format!("{text}7,CM,to-plc:lo")).unwrap();
        let (journal, known) = outcomes(place.path());
        let reason = "the PLC, 'in short', gave up".to_owned();
        assert_eq!(known, [(3, same), (0, Outcome { reason, ..refused })]);
        journal.end().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), text);
    }

    #[test]
    fn a_directory_of_another_exploration_is_refused() {
        let place = tempfile::tempdir().unwrap();
        claim(place.path(), "seed 1").unwrap();
        claim(place.path(), "seed 1").unwrap();
        assert!(claim(place.path(), "seed 2").unwrap_err().to_string().ends_with("seed 1"));
    }
}
