//! The options of all studies, and the files in which they save their tables. A study is many virtual runs with one table.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clap::Args;
use setup::Setup;

use crate::records::run_directory::{self, Durability, replace};
use crate::verbs::setup_option::SetupOption;

/// Options of every study.
#[derive(Args, Debug)]
pub struct StudyOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// Seed of the clocks, phases and pauses.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Directory for the figures as CSV and JSON, and for the page if there is one [default: runs/TIME-SETUP-STUDY].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Write the figures to this file as well, as JSON.
    #[arg(long, value_name = "FILE")]
    pub export_json: Option<PathBuf>,
    /// Write the figures to this file as well, as CSV.
    #[arg(long, value_name = "FILE")]
    pub export_csv: Option<PathBuf>,
    /// Print the table only: no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

impl StudyOptions {
    /// Saves the results of the study `name` into a directory, and to the other requested files. Returns the
    /// directory.
    ///
    /// # Errors
    ///
    /// The directory contains a run, or a file cannot be written.
    pub fn save(
        &self,
        name: &str,
        setup: &Setup,
        started: SystemTime,
        found: Found<'_>,
    ) -> anyhow::Result<PathBuf> {
        let default = || run_directory::default_path(&setup.name, name, started);
        let directory = self.out.clone().unwrap_or_else(default);
        run_directory::create_for_study(&directory, setup)?;
        let here = |extension: &str| directory.join(name).with_extension(extension);
        let Found { json, csv, page } = found;
        if let Some(page) = page {
            write(&here("html"), page)?;
        }
        write(&here("json"), json)?;
        write(&here("csv"), csv)?;
        self.export_json.as_deref().map_or(Ok(()), |path| write(path, json))?;
        self.export_csv.as_deref().map_or(Ok(()), |path| write(path, csv))?;
        Ok(directory)
    }
}

/// Results of a study, in the formats of its files.
#[derive(Clone, Copy, Debug)]
pub struct Found<'a> {
    /// The figures.
    pub json: &'a str,
    /// The figures.
    pub csv: &'a str,
    /// The figures as a page to read.
    pub page: Option<&'a str>,
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    replace(path, text, Durability::Written)
}
