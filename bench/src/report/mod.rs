//! The report of a run: one file without scripts and without anything from elsewhere, to read, print and send.
//!
//! ```text
//! run        what a run directory holds
//! document   what all pages share; document.html and style.css are how it looks
//! page       the report's words and tables, for page.html
//! ├─ speed, samples, path, queue, lateness    a figure each
//! │  └─ chart                                 widths, colours, axes of all figures
//! └─ numbers                                  what the setup says, and from where
//! compare    several runs beside each other
//! sweep      the page of a starvation sweep
//! ```

mod chart;
mod compare;
mod document;
mod lateness;
mod numbers;
mod page;
mod path;
mod queue;
mod run;
mod samples;
mod speed;
mod sweep;

use std::path::{Path, PathBuf};

use clap::Args;

pub use compare::{CompareOptions, compare};
pub use sweep::page as sweep_page;

use crate::exit::{Exit, Failure};
use crate::outln;
use crate::run_directory::{Durability, replace};
use run::Run;

/// The report's name in the run directory.
pub const FILE: &str = "report.html";

/// Options of a report that is drawn again.
#[derive(Args, Debug)]
pub struct ReportOptions {
    /// The run directory.
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Write the report to this file [default: RUN/report.html].
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Draws a run's report again and prints where it is.
///
/// # Errors
///
/// There is no run, it is of another version, or the report cannot be written; the report before it then stays.
pub fn run(options: &ReportOptions) -> Result<Exit, Failure> {
    let path = options.out.clone().unwrap_or_else(|| options.run.join(FILE));
    let html = render(&options.run)?;
    replace(&path, &html, Durability::Synced)
        .map_err(|error| error.context("the run is as it was; name a file that can be written by --out"))?;
    outln!("{}", path.display());
    Ok(Exit::Pass)
}

/// Draws the report of a run into its directory and says where it is.
///
/// # Errors
///
/// As [`run`].
pub fn write(directory: &Path) -> Result<PathBuf, Failure> {
    let path = directory.join(FILE);
    replace(&path, render(directory)?, Durability::Synced)?;
    Ok(path)
}

/// The report of a run as HTML.
///
/// # Errors
///
/// There is no run, or it is of another version.
pub fn render(directory: &Path) -> Result<String, Failure> {
    Ok(page::render(&Run::load(directory)?)?)
}
