//! `bench history`: the stored runs, oldest first, each compared with the last one before it that measured the same.
//!
//! ```text
//! entry       a run of the list
//! table       the list on screen
//! page        the list as a page
//! ├─ chart    its figures
//! └─ link     its links to the reports
//! ```

mod chart;
mod entry;
mod link;
mod page;
mod table;

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use clap::{Args, ValueEnum};

pub use entry::Entry;

use records::agreement::Altered;
use records::comparable::Conditions;
use records::exit::{Exit, Failure};
use records::mode::Mode;
use records::occupied::{SAMPLES, holds_run};
use records::origin::OriginKind;
use records::run_directory::{self, Durability, replace};
use report::outln;
use report::{errln, in_shell};
use studies::outputs::{self, Own};

/// Options of the list of runs.
#[derive(Args, Debug)]
pub struct HistoryOptions {
    /// The directory that holds the run directories.
    #[arg(value_name = "DIR", default_value = "runs")]
    pub directory: PathBuf,
    /// Only runs of the setup with this name.
    #[arg(long, value_name = "NAME")]
    pub setup: Option<String>,
    /// Only runs that were measured in this way.
    #[arg(long, value_enum)]
    pub mode: Option<ListedMode>,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Write a page with the figures over time, and links to the reports, to this file as well.
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
}

/// Mode of a run of the list: on a clock of the bench, or measured elsewhere.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum ListedMode {
    /// On the host's clock.
    Real,
    /// In virtual time.
    Virtual,
    /// From a capture.
    Captured,
    /// Read out of a PLC.
    Imported,
}

impl ListedMode {
    /// Returns the mode's name in results.
    const fn name(self) -> &'static str {
        match self {
            Self::Real => Mode::Real.name(),
            Self::Virtual => Mode::Virtual.name(),
            Self::Captured => OriginKind::Capture.mode(),
            Self::Imported => OriginKind::Import.mode(),
        }
    }
}

/// The runs of a directory.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct History {
    /// The runs, oldest first.
    pub entries: Vec<Entry>,
    /// Run directories that cannot be read, with the error.
    pub unreadable: Vec<String>,
    /// Whether one of them has a saved figure that was changed.
    pub has_altered: bool,
    /// Why there are no entries, and what to do; none if there are some.
    pub is_empty_because: Option<String>,
}

/// Prints the runs of a directory, and writes a page if requested.
///
/// # Errors
///
/// There is no such directory, it is a run itself, or the page cannot be written. If a run has a saved figure that was
/// changed, the others are listed and the exit code is that of a failed run.
pub fn run(options: &HistoryOptions) -> Result<Exit, Failure> {
    outputs::check(&[("--html", options.html.as_deref())], &[], Own::default())?;
    let mut history = History::load(&options.directory)?;
    history.keep(options);
    if options.json {
        let json = serde_json::to_string_pretty(&history.entries).context("cannot write the list as JSON")?;
        outln!("{json}");
    } else if let Some(reason) = &history.is_empty_because {
        outln!("{reason}");
    } else {
        outln!("{}", history.table());
    }
    for unreadable in &history.unreadable {
        errln!("warning: left out: {unreadable}");
    }
    if let Some(path) = &options.html {
        let page = page::page(&history, &options.directory, path)?;
        replace(path, &page, Durability::Written)?;
        if !options.json {
            outln!("\n{}", path.display());
        }
    }
    Ok(if history.has_altered { Exit::RunFailed } else { Exit::Pass })
}

impl History {
    /// Reads every run directory in `directory`. Other directories are ignored; run directories that cannot be read
    /// are listed.
    ///
    /// # Errors
    ///
    /// There is no such directory, or it is a run itself.
    pub fn load(directory: &Path) -> Result<Self, Failure> {
        let shown = directory.display();
        if holds_run(directory) {
            let error = anyhow!(
                "{shown} is a run; name the directory that holds it, or `bench report {}` draws it",
                in_shell(&shown)
            );
            return Err(Failure::new(Exit::Usage, error));
        }
        let listed = std::fs::read_dir(directory).with_context(|| {
            format!(
                "cannot list the runs in {shown}; name the directory that holds them, or make a run: `bench --setup A --mode virtual`"
            )
        });
        let mut history = Self::default();
        let mut runs = Vec::new();
        for found in listed.map_err(|error| Failure::new(Exit::Usage, error))? {
            let path = found.context("cannot list the runs")?.path();
            match holds_part_of_run(&path) {
                Ok(true) => {}
                // What is in no directory is no run either.
                Err(error) if error.kind() != ErrorKind::NotADirectory => {
                    history.unreadable.push(format!("cannot look into {}: {error}", path.display()));
                    continue;
                }
                Ok(false) | Err(_) => continue,
            }
            match run_directory::results(&path) {
                Ok(results) => runs.push((Conditions::of(&path, &results), Entry::new(&path, results))),
                Err(error) => {
                    history.has_altered |= error.is::<Altered>();
                    history.unreadable.push(format!("{error:#}"));
                }
            }
        }
        runs.sort_by(|(_, one), (_, other)| one.by_age(other));
        history.entries = compared(runs);
        history.unreadable.sort();
        history.is_empty_because = history.entries.is_empty().then(|| match history.unreadable.is_empty() {
            true => format!("There is no run in {shown}; make one: `bench --setup A --mode virtual`."),
            false => format!("No run in {shown} can be read."),
        });
        Ok(history)
    }

    /// Leaves out what the options do not ask for.
    fn keep(&mut self, options: &HistoryOptions) {
        let (setup, mode) = (options.setup.as_deref(), options.mode.map(ListedMode::name));
        let mut others = Vec::new();
        self.entries.retain(|entry| {
            let is_kept =
                setup.is_none_or(|name| name == entry.setup) && mode.is_none_or(|mode| mode == entry.mode);
            if !is_kept {
                others.push(format!("{} ({})", entry.setup, entry.mode));
            }
            is_kept
        });
        others.sort();
        others.dedup();
        if self.entries.is_empty() && !others.is_empty() {
            let wanted = setup
                .map(|name| format!(" of setup {name}"))
                .into_iter()
                .chain(mode.map(|mode| format!(" in {mode} mode")));
            let wanted: String = wanted.collect();
            self.is_empty_because = Some(format!(
                "No run in {}{wanted}; there are: {}.",
                options.directory.display(),
                others.join(", ")
            ));
        }
    }
}

/// Returns whether a directory has the samples or the results of a run.
fn holds_part_of_run(path: &Path) -> std::io::Result<bool> {
    Ok(path.join(SAMPLES).try_exists()? || path.join("results.json").try_exists()?)
}

/// What the earlier of two runs is called.
const BEFORE: &str = "before";

/// Compares each run with the last one before it under the same conditions. The runs are sorted by age.
fn compared(runs: Vec<(Conditions, Entry)>) -> Vec<Entry> {
    // Few runs differ in their conditions, and to compare setups takes time: each run is compared with each condition.
    let mut found: Vec<Conditions> = Vec::new();
    let mut entries: Vec<(usize, Entry)> = Vec::new();
    for (conditions, mut entry) in runs {
        let same = found.iter().position(|known| conditions.difference((known, BEFORE)).is_none());
        let under_the_same = entries.iter().rev().filter(|(index, _)| Some(*index) == same);
        entry.compare(under_the_same.map(|(_, earlier)| earlier));
        let last = entries.iter().rev().find(|(_, earlier)| entry.has_kind_of(earlier));
        let differences =
            last.and_then(|(index, _)| Some(conditions.differences((found.get(*index)?, BEFORE))));
        entry.differs = differences.filter(|all| !all.is_empty()).map(|all| all.join("; "));
        entries.push((same.unwrap_or(found.len()), entry));
        if same.is_none() {
            found.push(conditions);
        }
    }
    entries.into_iter().map(|(_, entry)| entry).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plc_node::ExecutionType;
    use records::conditions::Measured;
    use records::results::{Results, Status};
    use records::run_directory::{Durability, RunDirectory};
    use records::schedule::Schedule;
    use setup::Setup;
    use std::time::Duration;

    /// Stores a run of Setup A, of all types, that took `micros`, as `name`.
    fn keep(place: &Path, name: &str, mode: Mode, date: &str, micros: u64) {
        let (setup, _) = planning::setup_with_application("A").unwrap();
        // One repetition has no deviation: run `a` has one of each type, the others have two.
        let samples = vec![micros; if name == "a" { 1 } else { 2 }];
        keep_setup(place, name, &setup, mode, date, &samples);
    }

    /// Stores a run of a setup with these execution times in µs.
    fn keep_setup(place: &Path, name: &str, setup: &Setup, mode: Mode, date: &str, samples: &[u64]) {
        let (_, found) = planning::setup_with_application("A").unwrap();
        let mut directory =
            RunDirectory::create(&place.join(name), setup, &found.text, None, Durability::Written).unwrap();
        directory.write_host(&format!("{{\"date\": \"{date}\", \"commit\": \"4f32136\"}}")).unwrap();
        let schedule = Schedule::new(&ExecutionType::ALL, samples.len() as u32, 1);
        let mut results = Results::new(setup, &found.application.name, mode, &schedule);
        results.digests = Some(directory.digests().clone());
        for (step, micros) in schedule.steps().zip(samples.iter().flat_map(|it| [it; 3])) {
            let more = if step.execution_type == ExecutionType::Sm { 2_750_000 } else { 0 };
            let measured = Measured::lasting(Duration::from_micros(micros + more));
            results.record(step.execution_type, &measured).unwrap();
            directory.save(&step, &Ok(measured), &results).unwrap();
        }
        let is_slow = samples.iter().any(|micros| *micros > 4_000_000);
        results.status = if is_slow { Status::Interrupted } else { Status::Complete };
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
        assert_eq!(history.unreadable.len(), 1);
        let said = history.unreadable.join("\n").replace(&place.path().display().to_string(), "RUNS");
        insta::assert_snapshot!(said, @"RUNS/old/results.json has schema version 0, and this program reads 1; use the version of skillbench that wrote it, or run again");
    }

    #[test]
    fn a_directory_that_cannot_be_looked_into_is_reported_and_a_file_beside_the_runs_is_not() {
        let place = tempfile::tempdir().unwrap();
        std::fs::write(place.path().join("notes.txt"), "no run").unwrap();
        // A link to itself cannot be followed, by root neither.
        std::os::unix::fs::symlink("loop", place.path().join("loop")).unwrap();
        let history = History::load(place.path()).unwrap();
        let [unreadable] = history.unreadable.as_slice() else { panic!("{:?}", history.unreadable) };
        let expected = format!("cannot look into {}: ", place.path().join("loop").display());
        assert!(unreadable.starts_with(&expected), "{unreadable}");
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
    fn a_change_is_claimed_where_its_interval_leaves_out_zero_and_a_short_run_between_does_not_hide_it() {
        let place = tempfile::tempdir().unwrap();
        let (setup, _) = planning::setup_with_application("A").unwrap();
        let around = |middle: u64| [0, 1_000, 2_000, 3_000, 4_000].map(|more| middle + more - 2_000);
        let days = ["a", "b", "c", "d", "e"]
            .into_iter()
            .zip([3_720_000, 3_721_000, 3_731_000, 3_731_000, 3_741_000]);
        for (index, (name, middle)) in days.enumerate() {
            let samples = around(middle);
            let all = if name == "d" { &samples[..4] } else { &samples[..] };
            keep_setup(
                place.path(),
                name,
                &setup,
                Mode::Virtual,
                &format!("2026-11-0{index}T08:00:00Z"),
                all,
            );
        }
        let history = History::load(place.path()).unwrap();
        let changes =
            |index: usize| ExecutionType::ALL.map(|one| history.entries[index].change(one).is_some());
        assert_eq!(
            [0, 1, 2, 3, 4].map(changes),
            [false, false, true, false, true].map(|is_seen| [is_seen; 3])
        );
        let (ms, (low, high)) = history.entries[2].change(ExecutionType::Sm).unwrap();
        // Each standard error is √0.5 ms; 2.31 times √1 is the margin at eight degrees of freedom.
        assert!(
            (ms - 10.0).abs() < 1e-9 && (low - 7.69).abs() < 0.02 && (high - 12.31).abs() < 0.02,
            "{low} {high}"
        );
        let compared_with = |index: usize| history.entries[index].compared_with.sm.as_deref();
        assert_eq!([0, 1, 2, 3, 4].map(compared_with), [None, Some("a"), Some("b"), Some("c"), Some("c")]);
        assert!(
            history.entries[3].trend_ms.sm.is_some() && history.entries[3].trend_interval_ms.sm.is_none()
        );
    }

    #[test]
    fn a_run_of_another_content_is_compared_with_the_last_one_of_the_same_and_says_why() {
        let place = tempfile::tempdir().unwrap();
        let (setup, _) = planning::setup_with_application("A").unwrap();
        let mut faster = setup.clone();
        faster.motions.velocity_percent.value *= 2.0;
        let mut renamed = setup.clone();
        renamed.title = "The same cell".to_owned();
        let setups = [&setup, &faster, &renamed, &faster, &faster, &setup];
        for (name, setup) in ["1", "2", "3", "4", "5", "6"].into_iter().zip(setups) {
            let date = format!("2026-11-0{name}T08:00:00Z");
            keep_setup(place.path(), name, setup, Mode::Virtual, &date, &[3_720_000]);
        }
        let change = |run: &str, from: &str, to: &str| {
            let path = place.path().join(run).join("application.toml");
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.contains(from));
            std::fs::write(path, text.replace(from, to)).unwrap();
            // Its digest is that of the text before.
            let path = place.path().join(run).join("results.json");
            let results: Results = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
            std::fs::write(path, Results { digests: None, ..results }.to_json().unwrap()).unwrap();
        };
        change("4", "\ntitle = \"", "\ntitle = \"another ");
        change("5", "clearance_mm = 8.0", "clearance_mm = 9.0");
        let history = History::load(place.path()).unwrap();
        let told = history.entries.iter().map(|entry| {
            let text = |text: &Option<String>| text.clone().unwrap_or_else(|| "–".to_owned());
            format!("{} with {}: {}", entry.run, text(&entry.compared_with.cm), text(&entry.differs))
        });
        insta::assert_snapshot!(told.collect::<Vec<_>>().join("\n"), @"
        1 with –: –
        2 with –: motions.velocity_percent is 46.6, before 23.3
        3 with 1: motions.velocity_percent is 23.3, before 46.6
        4 with 2: motions.velocity_percent is 46.6, before 23.3
        5 with –: in the application, ways.clearance_mm is 9.0, before 8.0
        6 with 3: motions.velocity_percent is 23.3, before 46.6; in the application, ways.clearance_mm is 8.0, before 9.0
        ");
    }

    #[test]
    fn what_is_no_directory_of_runs_is_refused_or_answered_in_words() {
        let place = tempfile::tempdir().unwrap();
        let said = |history: Result<History, Failure>| {
            let text = match history {
                Ok(history) => history.is_empty_because.unwrap(),
                Err(failure) => format!("exit {}: {:#}", failure.exit as u8, failure.error),
            };
            text.replace(&place.path().display().to_string(), "RUNS")
        };
        let mut all =
            vec![said(History::load(place.path())), said(History::load(&place.path().join("none")))];
        keep(place.path(), "a", Mode::Virtual, "2026-11-01T08:00:00Z", 3_722_460);
        all.push(said(History::load(&place.path().join("a"))));
        all.push(said(History::load(&place.path().join("a/samples.csv"))));
        let mut history = History::load(place.path()).unwrap();
        history.keep(&HistoryOptions {
            directory: place.path().to_owned(),
            setup: Some("B".to_owned()),
            mode: Some(ListedMode::Captured),
            json: false,
            html: None,
        });
        all.push(said(Ok(history)));
        std::fs::write(place.path().join("a/results.json"), "no JSON").unwrap();
        all.push(said(History::load(place.path())));
        insta::assert_snapshot!(all.join("\n"), @"
        There is no run in RUNS; make one: `bench --setup A --mode virtual`.
        exit 2: cannot list the runs in RUNS/none; name the directory that holds them, or make a run: `bench --setup A --mode virtual`: No such file or directory (os error 2)
        exit 2: RUNS/a is a run; name the directory that holds it, or `bench report RUNS/a` draws it
        exit 2: cannot list the runs in RUNS/a/samples.csv; name the directory that holds them, or make a run: `bench --setup A --mode virtual`: Not a directory (os error 20)
        No run in RUNS of setup B in captured mode; there are: A (virtual).
        No run in RUNS can be read.
        ");
    }
}
