//! The directory of a run of a cell with several stations: its files have the names of those of one station.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use setup::Cell;

use crate::cell_results::{CellResults, CellSample};
use crate::digest::Digests;
use crate::occupied::{self, Occupied, SAMPLES};
use crate::replacement::{Durability, replace};
use crate::schedule::Step;

/// First line of the samples: a line for each repetition and station.
const SAMPLES_HEAD: &str = "type,repetition,station,execution_ms,robot_execution_ms,blends_suppressed,waiting_ms,start_skew_us,error\n";

/// The directory of a run of a cell.
#[derive(Debug)]
pub struct CellDirectory {
    path: PathBuf,
    names: Vec<String>,
    samples: String,
    digests: Digests,
}

impl CellDirectory {
    /// Creates the directory, and writes the setup and the text of its application, if it is one for all stations.
    ///
    /// # Errors
    ///
    /// It has a file of a run, or cannot be written.
    pub fn create(path: &Path, cell: &Cell, application: Option<&str>) -> anyhow::Result<Self> {
        Occupied::check(path, occupied::RUN)?;
        fs::create_dir_all(path).with_context(|| {
            format!("cannot make the run directory {}; choose another by --out", path.display())
        })?;
        let mut cell = cell.clone();
        if application.is_some() {
            cell.application = Some("application.toml".to_owned());
        }
        let setup = setup::cell_to_toml(&cell)?;
        let mut inputs = vec![("setup.toml", setup.as_str())];
        inputs.extend(application.map(|text| ("application.toml", text)));
        let digests = Digests::of_files(&inputs);
        for (name, text) in &inputs {
            replace(&path.join(name), text, Durability::Written)?;
        }
        let names = cell.names().map(str::to_owned).collect();
        Ok(Self { path: path.to_owned(), names, samples: SAMPLES_HEAD.to_owned(), digests })
    }

    /// Returns the digests of the files that say what is run, for the results.
    #[must_use]
    pub const fn digests(&self) -> &Digests {
        &self.digests
    }

    /// Writes a finished or failed repetition, and then the results so far.
    ///
    /// # Errors
    ///
    /// A file cannot be written.
    pub fn save(
        &mut self,
        step: &Step,
        outcome: &anyhow::Result<CellSample>,
        results: &CellResults,
    ) -> anyhow::Result<()> {
        let Step { execution_type, repetition, .. } = step;
        match outcome {
            Ok(sample) => {
                let millis = |time: std::time::Duration| time.as_nanos() as f64 / 1e6;
                let skew =
                    sample.start_skew.map_or_else(String::new, |it| (it.as_nanos() as f64 / 1e3).to_string());
                for (name, one) in self.names.iter().zip(&sample.stations) {
                    let _ = writeln!(
                        self.samples,
                        "{execution_type},{repetition},{name},{},{},{},{},{skew},",
                        millis(sample.execution),
                        millis(one.robot_execution),
                        one.blends_suppressed,
                        millis(one.waited),
                    );
                }
            }
            Err(error) => {
                let error = format!("{error:#}").replace('"', "\"\"");
                let _ = writeln!(self.samples, "{execution_type},{repetition},,,,,,,\"{error}\"");
            }
        }
        replace(&self.path.join(SAMPLES), &self.samples, Durability::Written)?;
        self.save_results(results)
    }

    /// Writes the results so far.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn save_results(&self, results: &CellResults) -> anyhow::Result<()> {
        replace(&self.path.join("results.json"), &results.to_json()?, Durability::Synced)
    }
}
