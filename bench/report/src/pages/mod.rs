//! The pages of a run: the report, which can be read, printed and sent, and the race, which is animated. Each page is one
//! file that loads nothing else; the report has no scripts.
//!
//! ```text
//! run        what a run directory holds
//! page       the report's words and tables, for page.html
//! ├─ first_look    the picture at the top; result has the sentences above it
//! ├─ end           how a recorded repetition ends
//! ├─ speed, samples, path, queue, lateness    a figure each
//! └─ numbers                                  what the setup says, and from where
//! race       race.html, and the picture of it in the report
//! cell_run   what the directory of a run of several stations holds; cell: its pages
//! compare    several runs beside each other
//! ```

mod cell;
mod cell_run;
mod compare;
mod compared;
mod end;
mod first_look;
mod lateness;
mod numbers;
mod page;
mod path;
mod queue;
pub(crate) mod race;
mod result;
mod run;
mod samples;
mod speed;

use std::path::{Path, PathBuf};

pub use compare::Comparison;
pub use compared::CSV_HEADER as COMPARED_CSV_HEADER;

use records::exit::Failure;
use records::run_directory::{self, Durability, SavedResults, replace};
use run::Run;

/// The report's name in the run directory.
pub const FILE: &str = "report.html";

/// The pages of a run directory.
#[derive(Debug)]
pub struct Pages {
    /// The report.
    pub report: PathBuf,
    /// The race; `None` where nothing was recorded, and its page only says why.
    pub race: Option<PathBuf>,
    /// What of the run they lack, as sentences.
    pub lacks: Vec<String>,
}

/// Pages that are written.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct WantedPages {
    /// The report.
    pub report: bool,
    /// The race.
    pub race: bool,
}

impl WantedPages {
    /// Both pages.
    pub const BOTH: Self = Self { report: true, race: true };
}

/// Writes pages of a run into its directory and returns the paths of all.
///
/// # Errors
///
/// There is no run, it has another version, or a page cannot be written; what was there is then kept.
pub fn write(directory: &Path, wanted: WantedPages) -> Result<Pages, Failure> {
    if let SavedResults::Cell(results) = run_directory::saved(directory).map_err(Failure::of_saved_run)? {
        return cell::write(directory, *results, wanted);
    }
    let run = Run::load(directory)?;
    let (report, race) = (directory.join(FILE), directory.join(race::FILE));
    if wanted.report {
        let race = if wanted.race { RaceIs::Beside } else { RaceIs::Elsewhere };
        replace(&report, &page::render(&run, race)?, Durability::Synced)?;
    }
    if wanted.race {
        replace(&race, &race::render(&run)?, Durability::Synced)?;
    }
    Ok(Pages { report, race: (wanted.race && run.trace.is_some()).then_some(race), lacks: run.lacks() })
}

/// Returns the report of a run as HTML, for another place than its directory, and what of the run it lacks.
///
/// # Errors
///
/// There is no run, or it has another version.
pub fn render(directory: &Path) -> Result<(String, Vec<String>), Failure> {
    if let SavedResults::Cell(results) = run_directory::saved(directory).map_err(Failure::of_saved_run)? {
        return cell::render(directory, *results);
    }
    let run = Run::load(directory)?;
    Ok((page::render(&run, RaceIs::Elsewhere)?, run.lacks()))
}

/// Where the race is, as seen from the report.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum RaceIs {
    /// In the same directory, so that the report links to it.
    Beside,
    /// In the run's directory, and the report in another.
    Elsewhere,
}
