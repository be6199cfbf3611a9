//! The report of a run: one file without scripts and without anything from elsewhere, to read, print and send.
//!
//! ```text
//! run        what a run directory holds
//! page       the report's words and tables, for page.html
//! ├─ speed, samples, path, queue, lateness    a figure each
//! └─ numbers                                  what the setup says, and from where
//! compare    several runs beside each other
//! ```

mod compare;
mod lateness;
mod numbers;
mod page;
mod path;
mod queue;
mod run;
mod samples;
mod speed;

use std::path::{Path, PathBuf};

pub use compare::Comparison;

use crate::output::exit::Failure;
use crate::records::run_directory::{Durability, replace};
use run::Run;

/// The report's name in the run directory.
pub const FILE: &str = "report.html";

/// Writes the report of a run into its directory and returns its path.
///
/// # Errors
///
/// The same as for [`render`], or the report cannot be written.
pub fn write(directory: &Path) -> Result<PathBuf, Failure> {
    let path = directory.join(FILE);
    replace(&path, render(directory)?, Durability::Synced)?;
    Ok(path)
}

/// Returns the report of a run as HTML.
///
/// # Errors
///
/// There is no run, or it has another version.
pub fn render(directory: &Path) -> Result<String, Failure> {
    Ok(page::render(&Run::load(directory)?)?)
}
