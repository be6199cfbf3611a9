//! `bench history`: the stored runs, oldest first, each compared with the previous one of the same measurement.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use comfy_table::{CellAlignment, Table, presets};
use node::screen;
use plc_node::ExecutionType;
use serde::Serialize;

use crate::outln;
use crate::output::errln;
use crate::output::exit::{Exit, Failure};
use crate::output::progress::label;
use crate::records::mode::Mode;
use crate::records::results::{PerType, Results, Status};
use crate::records::run_directory;
use crate::records::statistics::AetMad;

/// Options of the list of runs.
#[derive(Args, Debug)]
pub struct HistoryOptions {
    /// The directory that holds the run directories.
    #[arg(value_name = "DIR", default_value = "runs")]
    pub directory: PathBuf,
    /// Only runs of the setup with this name.
    #[arg(long, value_name = "NAME")]
    pub setup: Option<String>,
    /// Only runs on this clock.
    #[arg(long, value_enum)]
    pub mode: Option<Mode>,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// A run of the list.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct Entry {
    /// Its directory's name.
    pub run: String,
    /// Its start, UTC, ISO 8601; null if `host.json` is missing.
    pub date: Option<String>,
    /// The commit that the program was built from; null if `host.json` is missing.
    pub commit: Option<String>,
    /// The setup's name.
    pub setup: String,
    /// The application's name.
    pub application: String,
    /// `real` or `virtual`.
    pub mode: String,
    /// Whether the nodes ran already.
    pub is_attached: bool,
    /// How it ended.
    pub status: Status,
    /// Its traces or captures lack something.
    pub is_incomplete: bool,
    /// AET and MAD so far.
    pub figures: PerType<AetMad>,
    /// Successful repetitions so far. The MAD of one is 0 and says nothing.
    pub repetitions: PerType<usize>,
    /// AETi, 0…1; null if SM or CM is missing.
    pub aet_improvement: Option<f64>,
    /// AET minus that of the previous run with the same setup, application and mode, in ms.
    pub trend_ms: PerType<f64>,
}

/// The runs of a directory.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct History {
    /// The runs, oldest first.
    pub entries: Vec<Entry>,
    /// Run directories that cannot be read, with the error.
    pub unreadable: Vec<String>,
}

/// Prints the runs of a directory.
///
/// # Errors
///
/// There is no such directory.
pub fn run(options: &HistoryOptions) -> Result<Exit, Failure> {
    let mut history = History::load(&options.directory)?;
    let mode = options.mode.map(Mode::name);
    history.entries.retain(|entry| {
        options.setup.as_ref().is_none_or(|setup| *setup == entry.setup)
            && mode.is_none_or(|mode| *mode == *entry.mode)
    });
    if options.json {
        let json = serde_json::to_string_pretty(&history.entries).context("cannot write the list as JSON")?;
        outln!("{json}");
    } else if history.entries.is_empty() {
        outln!("No such run in {}.", options.directory.display());
    } else {
        outln!("{}", history.table());
    }
    for unreadable in &history.unreadable {
        errln!("warning: left out: {unreadable}");
    }
    Ok(Exit::Pass)
}

impl History {
    /// Reads every run directory in `directory`. Other directories are ignored; run directories that cannot be read
    /// are listed.
    ///
    /// # Errors
    ///
    /// There is no such directory.
    pub fn load(directory: &Path) -> Result<Self, Failure> {
        let listed = std::fs::read_dir(directory).with_context(|| {
            format!(
                "cannot list the runs in {}; name the directory that holds them, or make a run: `bench --setup A --mode virtual`",
                directory.display()
            )
        });
        let mut history = Self::default();
        for found in listed.map_err(|error| Failure::new(Exit::Usage, error))? {
            let path = found.context("cannot list the runs")?.path();
            if !path.join("samples.csv").exists() {
                continue;
            }
            match run_directory::results(&path) {
                Ok(results) => history.entries.push(Entry::new(&path, results)),
                Err(error) => history.unreadable.push(format!("{error:#}")),
            }
        }
        history.entries.sort_by(Entry::by_age);
        history.unreadable.sort();
        history.find_trends();
        Ok(history)
    }

    fn find_trends(&mut self) {
        for index in 0..self.entries.len() {
            let (before, rest) = self.entries.split_at_mut(index);
            let Some(entry) = rest.first_mut() else { continue };
            let Some(last) = before.iter().rev().find(|last| last.measured_the_same(entry)) else { continue };
            for execution_type in ExecutionType::ALL {
                let both = entry.figures.get(execution_type).zip(last.figures.get(execution_type));
                *entry.trend_ms.entry(execution_type) = both.map(|(now, then)| now.aet_ms - then.aet_ms);
            }
        }
    }

    /// Formats the list as a table.
    #[must_use]
    pub fn table(&self) -> String {
        let mut table = Table::new();
        table.load_preset(presets::NOTHING);
        table.set_header([
            "run",
            "date",
            "commit",
            "setup",
            "mode",
            "application",
            "RC, ms\nAET ± MAD",
            "SM, ms\nAET ± MAD",
            "CM, ms\nAET ± MAD",
            "AETi",
            "trend of AET",
            "ended",
        ]);
        for entry in &self.entries {
            let or_none = |text: &Option<String>| text.clone().unwrap_or_else(|| "–".to_owned());
            let figure = |execution_type| {
                let deviates = entry.repetitions.get(execution_type).is_some_and(|number| *number > 1);
                let text = |figure: &AetMad| match deviates {
                    true => format!("{:.1} ± {:.1}", figure.aet_ms, figure.mad_ms),
                    false => format!("{:.1} ±   –", figure.aet_ms),
                };
                entry.figures.get(execution_type).map_or_else(|| "–".to_owned(), text)
            };
            let improvement = entry.aet_improvement.map(|share| format!("{:.1} %", share * 100.0));
            table.add_row([
                entry.run.clone(),
                or_none(&entry.date),
                or_none(&entry.commit),
                entry.setup.clone(),
                if entry.is_attached { format!("{}, attached", entry.mode) } else { entry.mode.clone() },
                entry.application.clone(),
                figure(ExecutionType::Rc),
                figure(ExecutionType::Sm),
                figure(ExecutionType::Cm),
                or_none(&improvement),
                entry.trend(),
                entry.ended(),
            ]);
        }
        for column in table.column_iter_mut().skip(6).take(4) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        screen::drawn(&table)
    }
}

impl Entry {
    fn new(path: &Path, results: Results) -> Self {
        let host = run_directory::host(path);
        let host = |key: &str| Some(host.as_ref()?.get(key)?.as_str()?.to_owned());
        let mut figures = PerType::default();
        let mut repetitions = PerType::default();
        for execution_type in ExecutionType::ALL {
            *figures.entry(execution_type) = results.figure(execution_type);
            let samples = results.results.get(execution_type).map(|result| result.samples_ms.len());
            *repetitions.entry(execution_type) = samples;
        }
        Self {
            run: path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            date: host("date"),
            commit: host("commit"),
            setup: results.setup,
            application: results.application,
            mode: results.mode,
            is_attached: results.attached.is_some(),
            status: results.status,
            is_incomplete: !results.incomplete.is_empty(),
            figures,
            repetitions,
            aet_improvement: results.aet_improvement,
            trend_ms: PerType::default(),
        }
    }

    /// Formats how the run ended, and whether its traces and captures lack something.
    fn ended(&self) -> String {
        let ended = match self.status {
            Status::Complete => "complete",
            Status::Running => "not finished",
            Status::Failed => "failed",
            Status::Interrupted => "interrupted",
        };
        if self.is_incomplete { format!("{ended}, records incomplete") } else { ended.to_owned() }
    }

    fn by_age(&self, other: &Self) -> Ordering {
        (&self.date, &self.run).cmp(&(&other.date, &other.run))
    }

    fn measured_the_same(&self, other: &Self) -> bool {
        (&self.setup, &self.application, &self.mode, self.is_attached)
            == (&other.setup, &other.application, &other.mode, other.is_attached)
    }

    /// Formats the trend, for example `RC +0.0  SM −3.1  CM +0.2 ms`; empty for the first run of its kind.
    fn trend(&self) -> String {
        let trend = |execution_type| {
            self.trend_ms.get(execution_type).map(|ms| format!("{} {}", label(execution_type), signed(*ms)))
        };
        let trends: Vec<_> = ExecutionType::ALL.into_iter().filter_map(trend).collect();
        if trends.is_empty() { String::new() } else { trends.join("  ") + " ms" }
    }
}

/// Formats a number to a tenth, with its sign; never a negative zero.
fn signed(ms: f64) -> String {
    let tenths = (ms * 10.0).round() / 10.0 + 0.0;
    format!("{tenths:+.1}").replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::records::conditions::Measured;
    use crate::records::run_directory::{Durability, RunDirectory};
    use crate::records::schedule::Schedule;
    use std::time::Duration;

    /// Stores a run of all types that took `micros`, as `name`.
    fn keep(place: &Path, name: &str, mode: Mode, date: &str, micros: u64) {
        let (setup, found) = planning::setup_with_application("A").unwrap();
        let directory =
            RunDirectory::create(&place.join(name), &setup, &found.text, Durability::Written).unwrap();
        directory.write_host(&format!("{{\"date\": \"{date}\", \"commit\": \"4f32136\"}}")).unwrap();
        let schedule = Schedule::new(&ExecutionType::ALL, 1, 1);
        let mut results = Results::new(&setup, &found.application.name, mode, &schedule);
        let of_types = ExecutionType::ALL.into_iter().zip([0, 2_750_000, 0]);
        // One repetition has no deviation: run `a` has one of each type, the others have two.
        let repetitions = if name == "a" { 1 } else { 2 };
        for (execution_type, more) in of_types.cycle().take(3 * repetitions) {
            let execution = Duration::from_micros(micros + more);
            results.record(execution_type, &Measured::lasting(execution)).unwrap();
        }
        results.status = if micros > 4_000_000 { Status::Interrupted } else { Status::Complete };
        directory.save_results(&results).unwrap();
    }

    #[test]
    fn runs_are_listed_by_age_and_compared_with_the_previous_one_of_the_same_measurement() {
        let place = tempfile::tempdir().unwrap();
        keep(place.path(), "c", Mode::Virtual, "2026-11-03T08:00:00Z", 3_723_500);
        keep(place.path(), "b", Mode::Real, "2026-11-02T08:00:00Z", 4_723_500);
        keep(place.path(), "a", Mode::Virtual, "2026-11-01T08:00:00Z", 3_722_460);
        std::fs::create_dir(place.path().join("no run")).unwrap();
        let history = History::load(place.path()).unwrap();
        assert!(history.unreadable.is_empty());
        insta::assert_snapshot!(history.table(), @"
        run  date                  commit   setup  mode     application           RC, ms        SM, ms        CM, ms    AETi  trend of AET                  ended
                                                                               AET ± MAD     AET ± MAD     AET ± MAD
        a    2026-11-01T08:00:00Z  4f32136  A      virtual  pick-and-place  3722.5 ±   –  6472.5 ±   –  3722.5 ±   –  42.5 %                                complete
        b    2026-11-02T08:00:00Z  4f32136  A      real     pick-and-place  4723.5 ± 0.0  7473.5 ± 0.0  4723.5 ± 0.0  36.8 %                                interrupted
        c    2026-11-03T08:00:00Z  4f32136  A      virtual  pick-and-place  3723.5 ± 0.0  6473.5 ± 0.0  3723.5 ± 0.0  42.5 %  RC +1.0  SM +1.0  CM +1.0 ms  complete
        ");
    }

    #[test]
    fn a_run_that_cannot_be_read_is_reported_and_the_others_are_listed() {
        let place = tempfile::tempdir().unwrap();
        keep(place.path(), "good", Mode::Virtual, "2026-11-01T08:00:00Z", 3_722_460);
        keep(place.path(), "old", Mode::Virtual, "2026-10-01T08:00:00Z", 3_722_460);
        std::fs::write(place.path().join("old/results.json"), "{\"schema_version\": 0}").unwrap();
        let history = History::load(place.path()).unwrap();
        assert_eq!(history.entries.len(), 1);
        let said = history.unreadable.join("\n").replace(&place.path().display().to_string(), "RUNS");
        insta::assert_snapshot!(said, @"RUNS/old/results.json has schema version 0, and this program reads 1; use the version of skillbench that wrote it, or run again");
    }

    #[test]
    fn a_run_whose_records_are_incomplete_says_so_beside_how_it_ended() {
        let place = tempfile::tempdir().unwrap();
        for (name, micros) in [("a", 3_722_460), ("b", 4_723_500)] {
            keep(place.path(), name, Mode::Virtual, "2026-11-01T08:00:00Z", micros);
            let path = place.path().join(name);
            let mut results = run_directory::results(&path).unwrap();
            results.incomplete.push("The captures are incomplete: no space left.".to_owned());
            let text = results.to_json().unwrap();
            std::fs::write(path.join("results.json"), text).unwrap();
        }
        let history = History::load(place.path()).unwrap();
        let table = history.table();
        let ended: Vec<_> =
            table.lines().skip(2).filter_map(|line| Some(line.rsplit_once("  ")?.1.trim())).collect();
        assert_eq!(ended, ["complete, records incomplete", "interrupted, records incomplete"]);
    }

    #[test]
    fn a_trend_of_zero_has_a_positive_sign() {
        assert_eq!(
            (signed(-0.04), signed(-3.06), signed(0.1)),
            ("+0.0".into(), "−3.1".into(), "+0.1".into())
        );
    }
}
