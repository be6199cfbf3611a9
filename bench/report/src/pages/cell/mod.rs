//! The pages of a run of a cell with several stations: its figures, when which arm moves and waits, and the race.

mod arms;
mod page;

use std::path::Path;

use super::cell_run::CellFiles;
use super::{FILE, Pages, WantedPages, race};
use records::cell_results::CellResults;
use records::exit::Failure;
use records::run_directory::{Durability, replace};

/// Writes the pages of a run of a cell into its directory.
pub(super) fn write(directory: &Path, results: CellResults, wanted: WantedPages) -> Result<Pages, Failure> {
    let files = CellFiles::load(directory, results);
    let (report, race) = (directory.join(FILE), directory.join(race::FILE));
    if wanted.report {
        replace(&report, &page::render(&files, wanted.race)?, Durability::Synced)?;
    }
    if wanted.race {
        replace(&race, &race::of_cell::render(&files)?, Durability::Synced)?;
    }
    let is_recorded = wanted.race && !files.trace.stations.is_empty();
    Ok(Pages { report, race: is_recorded.then_some(race), lacks: files.lacks() })
}

/// Returns the report of a run of a cell, for another place than its directory, and what of the run it lacks.
pub(super) fn render(directory: &Path, results: CellResults) -> Result<(String, Vec<String>), Failure> {
    let files = CellFiles::load(directory, results);
    Ok((page::render(&files, false)?, files.lacks()))
}
