//! The content of the directory of a run of a cell with several stations.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use planning::PlannedCell;
use setup::Cell;

use records::cell_results::CellResults;
use records::run_directory;
use records::schedule::repetitions;
use records::trace::{CellTrace, Trace, tables};

/// Content of the directory of such a run.
#[derive(Debug)]
pub(super) struct CellFiles {
    directory: PathBuf,
    pub(super) results: CellResults,
    planned: Option<(Cell, PlannedCell)>,
    pub(super) trace: CellTrace,
    /// Missing parts besides the results, each with the reason.
    missing: Vec<String>,
}

impl CellFiles {
    /// Reads a run directory; its results are read already.
    pub(super) fn load(directory: &Path, results: CellResults) -> Self {
        let mut missing = Vec::new();
        let setup = directory.join("setup.toml");
        let planned = planning::cell_with_applications(&setup.to_string_lossy())
            .and_then(|(cell, found)| found.plan(&cell).map(|planned| (cell, planned)))
            .map_err(|error| missing.push(error.to_string()))
            .ok();
        let read = |file: &str, station: &str| {
            let path = directory.join(tables::of_station(file, Some(station)));
            run_directory::read_text(&path)
        };
        let of_station = |station: &str| -> anyhow::Result<Trace> {
            Ok(Trace::from_csv(&read(tables::ROBOT_FILE, station)?, &read(tables::PLC_FILE, station)?)?)
        };
        let names = results.stations.iter().map(|station| station.name.as_str());
        let is_recorded =
            |name: &str| directory.join(tables::of_station(tables::ROBOT_FILE, Some(name))).exists();
        let stations: anyhow::Result<Vec<_>> = if names.clone().any(is_recorded) {
            names.map(of_station).collect()
        } else {
            // A run that ended before its first repetition did has none, and so has one of an older version.
            Ok(Vec::new())
        };
        let trace =
            stations.context("the curves over time are left out").map(|stations| CellTrace { stations });
        let trace = trace.map_err(|error| missing.push(format!("{error:#}"))).unwrap_or_default();
        Self { directory: directory.to_owned(), results, planned, trace, missing }
    }

    pub(super) fn planned(&self) -> Option<(&Cell, &PlannedCell)> {
        self.planned.as_ref().map(|(cell, planned)| (cell, planned))
    }

    /// Returns the directory's name, which identifies the run.
    pub(super) fn name(&self) -> String {
        let name = self.directory.file_name().or_else(|| self.directory.parent()?.file_name());
        name.map_or_else(|| self.directory.display().to_string(), |name| name.to_string_lossy().into_owned())
    }

    /// Returns its conditions in a line.
    pub(super) fn about(&self) -> String {
        let CellResults { setup, application, mode, reps, .. } = &self.results;
        format!(
            "Setup {setup} · {application} · {mode} mode · {} of each type · {}",
            repetitions(*reps),
            self.results.conditions(" · ")
        )
    }

    /// Returns what the traces lack, as sentences; none if they are complete.
    pub(super) fn incomplete(&self) -> Option<String> {
        let names = self.results.stations.iter().map(|station| &station.name);
        let lacking = names.zip(&self.trace.stations).filter_map(|(name, trace)| {
            let lacking = trace.incomplete()?;
            Some(format!("Station {name}: {lacking}"))
        });
        let lacking: Vec<_> = lacking.collect();
        (!lacking.is_empty()).then(|| lacking.join(" "))
    }

    pub(super) fn lacks(&self) -> Vec<String> {
        self.missing.iter().cloned().chain(self.incomplete()).collect()
    }
}
