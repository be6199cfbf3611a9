//! The options of all studies, and the files in which they save their tables. A study is many virtual runs with one table.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clap::Args;
use setup::Setup;

use crate::engine::claim::{RowsOrigin, StudyClaim};
use crate::engine::listed::ListedStudy;
use crate::event_loop;
use crate::outputs::{self, FigureExports, Own};
use crate::setup_option::SetupOption;
use crate::study_files::CLAIMED_FILES;
use records::exit::{Exit, Failure};
use records::occupied::Files;
use records::run_directory::{self, Durability, replace};

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
    /// Files for other programs.
    #[command(flatten)]
    pub exports: FigureExports,
    /// Print the table only: no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

impl StudyOptions {
    /// Creates the directory for the results of the study `name`, and checks that all its files can be written: it may take an
    /// hour, and the files are written at its end.
    ///
    /// # Errors
    ///
    /// The directory contains a run or files that are not of this study, or a file could not be written.
    pub fn prepare(
        &self,
        name: &str,
        setup: &Setup,
        found: &planning::Found,
        started: SystemTime,
    ) -> Result<PathBuf, Failure> {
        let default = || run_directory::default_path(&setup.name, name, started);
        let directory = self.out.clone().unwrap_or_else(default);
        let [page, json, csv] = ["html", "json", "csv"].map(|extension| format!("{name}.{extension}"));
        let own = [&["setup.toml", &page, &json, &csv], CLAIMED_FILES.as_slice()].concat();
        self.check_exports(found, Own { directory: Some(&directory), files: &own })?;
        let files = Files {
            inputs: &[("setup.toml", &setup::setup_to_toml(setup)?)],
            results: &[&page, &json, &csv],
        };
        run_directory::make_for_study(&directory, files)?;
        self.exports.check_writable()?;
        Ok(directory)
    }

    /// Opens the rows of the study `name`, which its other options determine; a study that was killed goes on with them.
    ///
    /// # Errors
    ///
    /// The directory has rows of other options or of another program, or files of the study without a claim.
    pub fn with_rows<'a>(
        &self,
        study: ListedStudy<'a>,
        subject: (&Setup, &planning::Found),
        directory: &Path,
        options: &str,
        commit: &str,
    ) -> Result<ListedStudy<'a>, Failure> {
        let (setup, found) = subject;
        let name = study.name;
        let options = [name, &setup::setup_to_toml(setup)?, &found.text, options].join("\n");
        let [page, json, csv] = ["html", "json", "csv"].map(|extension| format!("{name}.{extension}"));
        let results = [page.as_str(), &json, &csv];
        let origin = RowsOrigin { directory, options: &options, command: "", results: &results, commit };
        study.saved_in(&StudyClaim::checked(origin)?)
    }

    /// Rejects requested files that replace what the study reads or writes anyway.
    fn check_exports(&self, found: &planning::Found, own: Own<'_>) -> Result<(), Failure> {
        let read = [("the setup", self.setup.file()), ("the application", found.path.as_deref())];
        outputs::check(&self.exports.files(), &read, own)
    }

    /// Saves the results of the study `name` into its directory, and to the other requested files.
    ///
    /// # Errors
    ///
    /// A file cannot be written.
    pub fn save(&self, directory: &Path, name: &str, setup: &Setup, found: Found<'_>) -> anyhow::Result<()> {
        write(&directory.join("setup.toml"), &setup::setup_to_toml(setup)?)?;
        let here = |extension: &str| directory.join(name).with_extension(extension);
        let Found { json, csv, page } = found;
        if let Some(page) = page {
            write(&here("html"), page)?;
        }
        write(&here("json"), json)?;
        write(&here("csv"), csv)?;
        self.exports.write(json, csv)
    }
}

/// Returns how a study ended that is saved, and reports how much was done if that is not all.
pub fn ended(done: usize, all: usize, things: &str) -> Exit {
    if done < all { event_loop::interrupted(done, all, things) } else { Exit::Pass }
}

/// Reports an interrupt before there was a figure, and removes the study's directory unless the user has something in it.
pub fn interrupted(directory: &Path, all: usize, things: &str) -> Exit {
    let _ = std::fs::remove_dir(directory);
    event_loop::interrupted(0, all, things)
}

/// Returns how much of a study an interrupt left, for what tells its conditions; nothing of a whole one.
pub fn part(done: usize, all: usize, things: &str) -> String {
    if done < all { format!(" \u{b7} interrupted, {done} of {all} {things}") } else { String::new() }
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
