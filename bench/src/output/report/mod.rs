//! The pages of a run: the report, which can be read, printed and sent, and the race, which is animated. Each page is one
//! file that loads nothing else; the report has no scripts.
//!
//! ```text
//! run        what a run directory holds
//! page       the report's words and tables, for page.html
//! ├─ first_look    the picture at the top; result has the sentences above it
//! ├─ speed, samples, path, queue, lateness    a figure each
//! └─ numbers                                  what the setup says, and from where
//! race       race.html, and the picture of it in the report
//! compare    several runs beside each other
//! ```

mod compare;
mod first_look;
mod lateness;
mod numbers;
mod page;
mod path;
mod queue;
pub(in crate::output) mod race;
mod result;
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

/// The pages of a run directory.
#[derive(Debug)]
pub struct Pages {
    /// The report.
    pub report: PathBuf,
    /// The race.
    pub race: PathBuf,
}

/// Writes the pages of a run into its directory and returns their paths.
///
/// # Errors
///
/// There is no run, it has another version, or a page cannot be written; what was there is then kept.
pub fn write(directory: &Path) -> Result<Pages, Failure> {
    let run = Run::load(directory)?;
    let pages = Pages { report: directory.join(FILE), race: directory.join(race::FILE) };
    replace(&pages.report, &page::render(&run, RaceIs::Beside)?, Durability::Synced)?;
    replace(&pages.race, &race::render(&run)?, Durability::Synced)?;
    Ok(pages)
}

/// Returns the report of a run as HTML, for another place than its directory.
///
/// # Errors
///
/// There is no run, or it has another version.
pub fn render(directory: &Path) -> Result<String, Failure> {
    Ok(page::render(&Run::load(directory)?, RaceIs::Elsewhere)?)
}

/// Where the race is, as seen from the report.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum RaceIs {
    /// In the same directory, so that the report links to it.
    Beside,
    /// In the run's directory, and the report in another.
    Elsewhere,
}
