//! The content of a run's directory.

use std::path::{Path, PathBuf};

use anyhow::Context;
use planning::Application;
use setup::Setup;

use records::exit::Failure;
use records::results::Results;
use records::run_directory;
use records::schedule::repetitions;
use records::trace::{Trace, tables};

/// Everything of a run that its report shows.
#[derive(Debug)]
pub(super) struct Run {
    pub(super) directory: PathBuf,
    pub(super) results: Results,
    pub(super) setup: Option<Setup>,
    pub(super) application: Option<Application>,
    /// Number of the application's continuous motions, each of which is a skill of CM; `None` if it cannot be planned.
    pub(super) continuous: Option<usize>,
    /// `host.json`, key by key.
    pub(super) host: Option<serde_json::Map<String, serde_json::Value>>,
    pub(super) trace: Option<Trace>,
    /// What is missing besides the results, with the reason.
    pub(super) missing: Vec<String>,
}

impl Run {
    /// Reads a run directory. Only the results are required; the report names other missing parts.
    pub(super) fn load(directory: &Path) -> Result<Self, Failure> {
        let results = run_directory::results(directory).map_err(Failure::of_saved_run)?;
        let mut missing = Vec::new();
        let mut or_missing = |error: anyhow::Error| missing.push(format!("{error:#}"));
        let read = |name: &str| {
            let path = directory.join(name);
            run_directory::read_text(&path)
        };
        let (setup, application) =
            match planning::setup_with_application(&directory.join("setup.toml").to_string_lossy()) {
                Ok((setup, found)) => (Some(setup), Some(found.application)),
                Err(error) => {
                    or_missing(error.into());
                    (None, None)
                }
            };
        let cell = application.as_ref().zip(setup.as_ref());
        let plan = cell.and_then(|(application, setup)| planning::plan(application, setup).ok());
        let continuous = plan.map(|plan| plan.stops().len());
        let host = read("host.json")
            .and_then(|text| serde_json::from_str(&text).context("host.json is not what this version writes"))
            .map_err(&mut or_missing)
            .ok();
        let trace = match directory.join(tables::ROBOT_FILE).exists() {
            // A run whose nodes were killed may have none; the report says so instead.
            false => None,
            true => read(tables::ROBOT_FILE)
                .and_then(|robot| Ok((robot, read(tables::PLC_FILE)?)))
                .and_then(|(robot, plc)| Ok(Trace::from_csv(&robot, &plc)?))
                .context("the curves over time are left out")
                .map_err(&mut or_missing)
                .ok(),
        };
        Ok(Self {
            directory: directory.to_owned(),
            results,
            setup,
            application,
            continuous,
            host,
            trace,
            missing,
        })
    }

    /// Returns the directory's name, which identifies the run.
    pub(super) fn name(&self) -> String {
        let name = self.directory.file_name().or_else(|| self.directory.parent()?.file_name());
        name.map_or_else(|| self.directory.display().to_string(), |name| name.to_string_lossy().into_owned())
    }

    /// Returns its conditions in a line.
    pub(super) fn about(&self) -> String {
        let results = &self.results;
        format!(
            "Setup {} · {} · {} · {} of each type · {}{}",
            results.setup,
            results.application,
            results.mode_in_words(),
            repetitions(results.reps),
            results.conditions(" · "),
            if results.is_of_older_version() { " · written by an older version" } else { "" }
        )
    }

    /// Returns why there is no recording, and what would make one.
    pub(super) fn no_trace(&self) -> String {
        let setup = self.directory.join("setup.toml");
        let setup = setup.display();
        if self.results.attached.is_some() {
            format!(
                "Not recorded: nodes that ran already leave no trace. bench --mode virtual --setup {setup} records \
                 the same cell in virtual time, and bench --setup {setup} on nodes that it starts."
            )
        } else if self.results.origin.is_some() {
            format!(
                "Not recorded: only execution times were measured. bench --mode virtual --setup {setup} draws the same cell in \
                 virtual time."
            )
        } else if self.results.mode == "real" {
            format!(
                "Not recorded: the nodes left no trace. bench --mode virtual --setup {setup} draws it in virtual time."
            )
        } else {
            format!(
                "Not recorded: this run has no trace. bench --mode virtual --setup {setup} records it again."
            )
        }
    }

    /// Returns what the run's traces and captures lack, as sentences; none if they are complete.
    pub(super) fn incomplete(&self) -> Option<String> {
        let mut sentences = self.results.incomplete.clone();
        sentences.extend(self.trace.as_ref().and_then(Trace::incomplete));
        sentences.dedup();
        (!sentences.is_empty()).then(|| sentences.join(" "))
    }

    /// Returns everything that the report lacks, as sentences.
    pub(super) fn lacks(&self) -> Vec<String> {
        self.missing.iter().cloned().chain(self.incomplete()).collect()
    }

    /// Returns a value of `host.json` as text.
    pub(super) fn host(&self, key: &str) -> Option<&str> {
        self.host.as_ref()?.get(key)?.as_str()
    }
}
