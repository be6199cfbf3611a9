//! The applications of a study's setup: that of the only robot, or those of all stations.

use planning::FoundCell;
use setup::Cell;

/// Returns the setup with an application in place of its own: of the only robot, or one of all stations.
pub(super) fn with_application(mut cell: Cell, name: &str) -> Cell {
    let is_one = cell.is_one();
    match cell.stations.as_mut_slice() {
        [station] if is_one => name.clone_into(&mut station.application),
        _ => cell.application = Some(name.to_owned()),
    }
    cell
}

/// Returns the name of the application of the only robot, or of all stations; `None` where each station has its own.
pub(super) fn application_name(cell: &Cell) -> Option<&str> {
    match cell.stations.as_slice() {
        [station] if cell.is_one() => Some(&station.application),
        _ => cell.application.as_deref(),
    }
}

/// Returns the text of the applications.
pub(super) fn text_of(cell: &Cell, found: &FoundCell) -> String {
    match found.stations.as_slice() {
        [only] if cell.is_one() => only.text.clone(),
        _ => found.text(cell),
    }
}

/// Returns the setup without the paths of its applications, which say nothing: their texts do. An arm's name stays.
pub(super) fn nameless(base: &Cell) -> Cell {
    let mut cell = base.clone();
    match &mut cell.application {
        Some(application) => application.clear(),
        None => cell.stations.iter_mut().for_each(|station| station.application.clear()),
    }
    cell
}
