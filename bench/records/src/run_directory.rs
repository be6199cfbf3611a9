//! The directory of a measurement: what was to be run, on which computer, and every finished repetition.
//!
//! ```text
//! setup.toml        the setup; runs again as `--setup DIR/setup.toml`
//! application.toml  the text of the application
//! skillbench.st     the exported code that was executed, if there was some; `--plc-program DIR` executes it again
//! host.json         the computer
//! samples.csv       a line per repetition, written before the next one starts
//! results.json      the results so far, replaced as a whole
//! trace-*.csv       both nodes tick by tick in the first repetition of each type
//! report.html       the report
//! race.html         the arms side by side
//! ```

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context, anyhow};
use plc_node::ExecutionType;
use setup::Setup;

use crate::agreement::{self, Altered};
use crate::cell_results::{CELL_SCHEMA_VERSION, CellResults};
use crate::conditions::Measured;
use crate::counted::counted;
use crate::digest::Digests;
use crate::host::date;
use crate::occupied::{self, Files, MOST_RUN_BYTES, Occupied, PROGRAM, SAMPLES, holds_run};
use crate::origin::{MeasuredTime, MeasuredType};
use crate::replacement::check_writable;
pub use crate::replacement::{Durability, Replacement, check_replaceable, replace};
use crate::results::{PerType, Results, SCHEMA_VERSION};
use crate::schedule::Step;

/// First line of the samples.
const SAMPLES_HEAD: &str =
    "type,repetition,execution_ms,robot_execution_ms,blends_suppressed,plc_missed,robot_missed,error\n";

/// The directory of a measurement.
#[derive(Debug)]
pub struct RunDirectory {
    path: PathBuf,
    /// Whether the bench made the directory, and not its user.
    is_own: bool,
    samples: File,
    /// First line of the samples.
    head: &'static str,
    /// Length of the completely written samples, in bytes.
    samples_len: u64,
    durability: Durability,
    /// Those of the files that say what is run.
    digests: Digests,
}

impl RunDirectory {
    /// Creates the directory and writes what is to be run: the setup and the text of its application. A directory
    /// that already has one of a run's files is not changed. `code` is the exported code that the run executes.
    pub fn create(
        path: &Path,
        setup: &Setup,
        application: &str,
        code: Option<&str>,
        durability: Durability,
    ) -> anyhow::Result<Self> {
        let mut setup = setup.clone();
        setup.application = "application.toml".to_owned();
        let setup = setup::setup_to_toml(&setup)?;
        let mut inputs = vec![("setup.toml", setup.as_str()), ("application.toml", application)];
        inputs.extend(code.map(|code| (PROGRAM, code)));
        Self::begin(path, &inputs, SAMPLES_HEAD, durability)
    }

    /// Creates the directory with files that say what is run and with the first line of the samples.
    pub(crate) fn begin(
        path: &Path,
        inputs: &[(&str, &str)],
        head: &'static str,
        durability: Durability,
    ) -> anyhow::Result<Self> {
        Occupied::check(path, occupied::RUN)?;
        let is_own = !path.exists();
        fs::create_dir_all(path).with_context(|| {
            format!("cannot make the run directory {}; choose another by --out", path.display())
        })?;
        let samples_path = path.join(SAMPLES);
        let samples = OpenOptions::new().write(true).create_new(true).open(&samples_path);
        let samples = samples.with_context(|| format!("cannot write {}", samples_path.display()))?;
        let digests = Digests::of_files(inputs);
        let path = path.to_owned();
        let mut directory = Self { path, is_own, samples, head, samples_len: 0, durability, digests };
        directory.append(head)?;
        inputs.iter().try_for_each(|(name, text)| directory.write(name, text))?;
        Ok(directory)
    }

    /// Removes a run that ended before its first repetition began, unless a node recorded something: then it stays. So does what
    /// else the user has in the directory.
    pub fn discard(self) {
        let Ok(entries) = fs::read_dir(&self.path).and_then(Iterator::collect::<io::Result<Vec<_>>>) else {
            return;
        };
        let is = |entry: &fs::DirEntry, names: &[&str]| names.iter().any(|name| entry.file_name() == *name);
        let is_empty = |entry: &fs::DirEntry| entry.metadata().is_ok_and(|found| found.len() == 0);
        let described = [SAMPLES, "setup.toml", "application.toml", PROGRAM, "host.json", "results.json"];
        let (of_run, others): (Vec<_>, Vec<_>) =
            entries.iter().partition(|entry| occupied::is_of_run(&entry.file_name().to_string_lossy()));
        // A node that recorded nothing leaves an empty file.
        let is_application =
            |entry: &fs::DirEntry| entry.file_name().to_string_lossy().starts_with("application-");
        let is_recorded =
            |entry: &&fs::DirEntry| !is(entry, &described) && !is_application(entry) && !is_empty(entry);
        if self.samples_len > self.head.len() as u64 || of_run.iter().any(is_recorded) {
            return;
        }
        for entry in of_run {
            let _ = fs::remove_file(entry.path());
        }
        if self.is_own && others.is_empty() {
            let _ = fs::remove_dir(&self.path);
        }
    }

    /// Writes a file that is never replaced.
    fn write(&self, name: &str, text: &str) -> anyhow::Result<()> {
        replace(&self.path.join(name), text, Durability::Written)
    }

    /// Appends the lines of a repetition to the samples, completely or not at all.
    pub(crate) fn append(&mut self, lines: &str) -> anyhow::Result<()> {
        let saved = self.samples.write_all(lines.as_bytes()).and_then(|()| match self.durability {
            Durability::Synced => self.samples.sync_data(),
            Durability::Written => Ok(()),
        });
        if saved.is_err() {
            // Remove what was partly written. If even that fails, readers see that the line is broken.
            let _ = self.samples.set_len(self.samples_len);
        } else {
            self.samples_len += lines.len() as u64;
        }
        saved.with_context(|| format!("cannot write {}", self.path.join(SAMPLES).display()))
    }

    /// Returns the digests of the setup and of the application, for the results.
    #[must_use]
    pub const fn digests(&self) -> &Digests {
        &self.digests
    }

    /// Returns its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the description of the computer.
    pub fn write_host(&self, json: &str) -> anyhow::Result<()> {
        self.write("host.json", json)
    }

    /// Writes a finished or failed repetition and the results so far, in this order: a run that is killed between the two has
    /// one line more than results, and is read as far as its results go.
    pub fn save(
        &mut self,
        step: &Step,
        outcome: &anyhow::Result<Measured>,
        results: &Results,
    ) -> anyhow::Result<()> {
        self.append(&sample_line(step, outcome))?;
        self.save_results(results)
    }

    /// Writes all samples of a run that was measured elsewhere, and its results.
    pub fn save_measured(&mut self, types: &PerType<MeasuredType>, results: &Results) -> anyhow::Result<()> {
        let mut lines = String::new();
        for execution_type in ExecutionType::ALL {
            let repetitions = types.get(execution_type).map_or(&[][..], |measured| &measured.repetitions);
            for (number, repetition) in (1_u32..).zip(repetitions) {
                lines += &measured_line(execution_type, number, repetition);
            }
        }
        self.append(&lines)?;
        self.save_results(results)
    }

    /// Writes the results so far.
    pub fn save_results(&self, results: &Results) -> anyhow::Result<()> {
        self.replace_results(&results.to_json()?)
    }

    /// Replaces the results.
    pub(crate) fn replace_results(&self, json: &str) -> anyhow::Result<()> {
        replace(&self.path.join("results.json"), json, self.durability)
    }
}

/// The results of a run.
#[derive(Clone, PartialEq, Debug)]
pub enum SavedResults {
    /// One station.
    One(Box<Results>),
    /// A cell with several stations.
    Cell(Box<CellResults>),
}

/// Reads the results of a run directory as [`saved`] does; those of a cell are reduced to what all runs have.
///
/// # Errors
///
/// The same as for [`saved`].
pub fn results(directory: &Path) -> anyhow::Result<Results> {
    Ok(match saved(directory)? {
        SavedResults::One(results) => *results,
        SavedResults::Cell(results) => results.of_station(0),
    })
}

/// Reads the results of a run directory, and checks that they agree with everything that is saved of the run.
///
/// # Errors
///
/// There are none, they have another version, or a saved figure was changed: [`Altered`].
pub fn saved(directory: &Path) -> anyhow::Result<SavedResults> {
    let path = directory.join("results.json");
    let text = match setup::read_plain_text_within(&path, MOST_RUN_BYTES) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let shown = directory.display();
            let repetitions = repetitions(directory);
            return Err(if repetitions > 0 {
                let found = format!("is missing beside {} in {SAMPLES}", counted(repetitions, "repetition"));
                Altered::new(path, found).into()
            } else if holds_run(directory) {
                anyhow!(
                    "the run in {shown} ended before its first repetition did, so there is nothing to report"
                )
            } else if directory.is_dir() {
                anyhow!(
                    "{shown} holds no run: results.json is missing; name a run directory, such as one below runs/"
                )
            } else {
                anyhow!("there is no run directory {shown}; name one, such as one below runs/")
            });
        }
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => {
            return Err(anyhow!(
                "{} is a file; name a run directory, such as one below runs/",
                directory.display()
            ));
        }
        Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.display())),
    };
    let value: serde_json::Value =
        serde_json::from_str(&text).with_context(|| format!("{} is not a results file", path.display()))?;
    match value.get("schema_version").and_then(serde_json::Value::as_u64) {
        Some(version) if version == u64::from(SCHEMA_VERSION) => {}
        Some(version) if version == u64::from(CELL_SCHEMA_VERSION) => {
            let results = parse(&path, &text)?;
            agreement::check_cell(directory, &value, &results)?;
            return Ok(SavedResults::Cell(Box::new(results)));
        }
        Some(version) => anyhow::bail!(
            "{} has schema version {version}, and this program reads {SCHEMA_VERSION}; use the version of skillbench that wrote it, or run again",
            path.display()
        ),
        None => anyhow::bail!("{} has no schema version, so it is not a results file", path.display()),
    }
    let results = parse(&path, &text)?;
    agreement::check(directory, &value, &results)?;
    Ok(SavedResults::One(Box::new(results)))
}

fn parse<T: serde::de::DeserializeOwned>(path: &Path, text: &str) -> anyhow::Result<T> {
    serde_json::from_str(text).with_context(|| format!("{} is broken; run again", path.display()))
}

/// Returns how many repetitions the samples of a run directory have.
fn repetitions(directory: &Path) -> usize {
    // The first line names the columns.
    read_text(&directory.join(SAMPLES)).map_or(0, |text| text.lines().skip(1).count())
}

/// Reads a text file of a run directory.
///
/// # Errors
///
/// The system's error, or the file is not a plain one, too large or not UTF-8.
pub fn read_text(path: &Path) -> anyhow::Result<String> {
    setup::read_plain_text_within(path, MOST_RUN_BYTES)
        .with_context(|| format!("cannot read {}", path.display()))
}

/// Reads a run directory's description of the computer, key by key; `None` if there is none.
#[must_use]
pub fn host(directory: &Path) -> Option<serde_json::Map<String, serde_json::Value>> {
    let text = read_text(&directory.join("host.json")).ok()?;
    serde_json::from_str(&text).ok()
}

/// Returns the directory of a run without `--out`: below `runs`, named by its start, its setup and its kind; the
/// first such name that is free.
#[must_use]
pub fn default_path(setup: &str, what: &str, started: SystemTime) -> PathBuf {
    let time = date(started).replace([':', '-'], "");
    let setup: String = setup.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
    let name = format!("runs/{time}-{setup}-{what}");
    let numbered = (2..).map(|number| PathBuf::from(format!("{name}-{number}")));
    std::iter::once(PathBuf::from(&name)).chain(numbered).find(|path| !path.exists()).unwrap_or_default()
}

/// Creates the directory of a study, which contains these files of many virtual runs but no run.
///
/// # Errors
///
/// It contains a run or the same files with other content, or nothing can be written to it.
pub fn make_for_study(path: &Path, files: Files<'_>) -> anyhow::Result<()> {
    Occupied::check(path, files)?;
    fs::create_dir_all(path)
        .with_context(|| format!("cannot make the directory {}; choose another by --out", path.display()))?;
    check_writable(path)
}

fn sample_line(step: &Step, outcome: &anyhow::Result<Measured>) -> String {
    let Step { execution_type, repetition, .. } = step;
    match outcome {
        Ok(measured) => {
            let millis = |nanos: u64| nanos as f64 / 1e6;
            format!(
                "{execution_type},{repetition},{},{},{},{},{},\n",
                millis(measured.execution.execution_time_ns),
                millis(measured.execution.robot_execution_ns),
                measured.execution.blends_suppressed,
                measured.interference.missed[0],
                measured.interference.missed[1]
            )
        }
        Err(error) => {
            format!("{execution_type},{repetition},,,,,,{}\n", quoted(error))
        }
    }
}

fn measured_line(
    execution_type: ExecutionType,
    number: u32,
    repetition: &Result<MeasuredTime, String>,
) -> String {
    let text = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    match repetition {
        Ok(MeasuredTime { execution_ms, robot_execution_ms, blends_suppressed }) => {
            let (robot, blends) = (text(*robot_execution_ms), text(blends_suppressed.map(f64::from)));
            format!("{execution_type},{number},{execution_ms},{robot},{blends},,,\n")
        }
        Err(error) => format!("{execution_type},{number},,,,,,{}\n", quoted(&anyhow!(error.clone()))),
    }
}

/// Returns an error as a field of the samples, on one line.
pub(crate) fn quoted(error: &anyhow::Error) -> String {
    format!("\"{}\"", format!("{error:#}").replace('"', "\"\"").replace('\n', " "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn step(repetition: u32) -> Step {
        Step { execution_type: ExecutionType::Sm, repetition, pause: Duration::ZERO, overrides: None }
    }

    #[test]
    fn every_repetition_is_a_line_whether_it_succeeded_or_failed() {
        let mut measured = Measured::lasting(Duration::from_nanos(6_477_123_456));
        measured.execution.robot_execution_ns = 6_470_000_000;
        let failed = Err(anyhow::anyhow!("the robot said \"no\"\nand stopped").context("sm failed"));
        let lines = [sample_line(&step(1), &Ok(measured)), sample_line(&step(2), &failed)];
        insta::assert_snapshot!(lines.concat(), @r#"
        sm,1,6477.123456,6470,0,0,0,
        sm,2,,,,,,"sm failed: the robot said ""no"" and stopped"
        "#);
    }

    #[test]
    fn a_directory_that_contains_a_run_is_not_changed() {
        let directory = tempfile::tempdir().unwrap();
        let (setup, found) = planning::setup_with_application("A").unwrap();
        let create =
            || RunDirectory::create(directory.path(), &setup, &found.text, None, Durability::Written);
        create().unwrap();
        let said = create().unwrap_err().to_string().replace(&directory.path().display().to_string(), "DIR");
        insta::assert_snapshot!(said, @"DIR holds a run already; choose another directory by --out");
    }

    #[test]
    fn the_directory_of_a_run_that_never_began_is_removed_unless_a_node_recorded_something() {
        let place = tempfile::tempdir().unwrap();
        let (setup, found) = planning::setup_with_application("A").unwrap();
        let path = place.path().join("run");
        let run = || RunDirectory::create(&path, &setup, &found.text, None, Durability::Written).unwrap();
        let begun = run();
        fs::write(path.join("trace-plc.rows"), "").unwrap();
        begun.discard();
        assert!(!path.exists());
        fs::create_dir(&path).unwrap();
        fs::write(path.join("notes"), "").unwrap();
        run().discard();
        let left: Vec<_> = fs::read_dir(&path).unwrap().map(|file| file.unwrap().file_name()).collect();
        assert_eq!(left, ["notes"], "the user's directory is as it was");
        let begun = run();
        fs::write(path.join("trace-plc.rows"), "a row").unwrap();
        begun.discard();
        assert!(path.join("trace-plc.rows").exists() && path.join("setup.toml").exists());
    }

    #[test]
    fn the_setup_in_the_directory_gives_the_same_run_again() {
        let directory = tempfile::tempdir().unwrap();
        let (setup, found) = planning::setup_with_application("A").unwrap();
        RunDirectory::create(directory.path(), &setup, &found.text, None, Durability::Synced).unwrap();
        let written = directory.path().join("setup.toml");
        let (again, same) = planning::setup_with_application(written.to_str().unwrap()).unwrap();
        assert_eq!((again.motions, again.robot), (setup.motions, setup.robot));
        assert_eq!((same.text, same.application), (found.text, found.application));
    }
}
