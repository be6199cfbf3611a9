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

/// The file with the outcomes.
pub(super) const OUTCOMES: &str = "outcomes.csv";

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
        let path = directory.join(OUTCOMES);
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

/// The file with what determines the jobs of an exploration: a line with the options, and the application.
pub(super) const CLAIM: &str = "exploration.txt";

/// The directory has an exploration of other jobs.
#[derive(Debug, thiserror::Error)]
pub(super) enum OtherExploration {
    #[error(
        "{} has an exploration with other options; name another directory by --out, or use these: {known}",
        directory.display()
    )]
    Options { directory: PathBuf, known: String },
    #[error(
        "{} has an exploration of an application with another text; name another directory by --out",
        directory.display()
    )]
    Application { directory: PathBuf },
}

/// Compares what determines the jobs of an exploration with that of the exploration that the directory has, if it has one.
///
/// # Errors
///
/// They differ.
pub(super) fn check_claim(directory: &Path, claim: &str) -> Result<(), OtherExploration> {
    let Ok(known) = fs::read_to_string(directory.join(CLAIM)) else { return Ok(()) };
    if known == claim {
        return Ok(());
    }
    let directory = directory.to_owned();
    let options = |claim: &str| claim.lines().next().unwrap_or_default().to_owned();
    let known = options(&known);
    Err(if known == options(claim) {
        OtherExploration::Application { directory }
    } else {
        OtherExploration::Options { directory, known }
    })
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
    fn a_directory_of_another_exploration_is_refused_with_its_options_in_one_line() {
        let place = tempfile::tempdir().unwrap();
        let refused = |claim: &str| {
            let refused = check_claim(place.path(), claim).err().map(|refused| refused.to_string());
            refused.map(|refused| refused.replace(&place.path().display().to_string(), "DIR"))
        };
        let claim = "--setup 'my cell.toml' --seed 1\n\nname = \"short\"\n";
        assert_eq!(refused(claim), None);
        fs::write(place.path().join(CLAIM), claim).unwrap();
        assert_eq!(refused(claim), None);
        insta::assert_snapshot!(refused(&claim.replace("seed 1", "seed 2")).unwrap(), @"DIR has an exploration with other options; name another directory by --out, or use these: --setup 'my cell.toml' --seed 1");
        insta::assert_snapshot!(refused(&claim.replace("short", "long")).unwrap(), @"DIR has an exploration of an application with another text; name another directory by --out");
    }
}
