//! The applications of a study's setup: that of the only robot, or those of all stations; and a study that varies some of them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use planning::{APPLICATIONS, ARMS_APPLICATIONS, FoundCell};
use records::digest::digest_of;
use setup::Cell;

use super::axis::Axis;
use super::key::{APPLICATION, application_of};

/// Returns the setup with an application in place of its own: of the only robot, or one of all stations.
pub(super) fn with_application(mut cell: Cell, name: &str) -> Cell {
    let is_one = cell.is_one();
    match cell.stations.as_mut_slice() {
        [station] if is_one => name.clone_into(&mut station.application),
        _ => cell.application = Some(name.to_owned()),
    }
    cell
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

/// The applications of a study of which some are varied.
pub(super) struct VariedApplications {
    /// The setup as given, for messages.
    setup: String,
    /// The keys that are varied.
    keys: Vec<String>,
    /// Directory of the study's file, to which varied names are relative.
    of_study: Option<PathBuf>,
    /// Directory to which the other names are relative.
    of_setup: Option<PathBuf>,
    found: Mutex<BTreeMap<String, Arc<Result<FoundCell, String>>>>,
}

/// Returns the names of the files of a setup's applications, each with its key. The names of arms are not among them.
fn names(cell: &mut Cell) -> Vec<(String, &mut String)> {
    let is_one = cell.is_one();
    match &mut cell.application {
        Some(application) => vec![(APPLICATION.to_owned(), application)],
        None => {
            let key = |name: &str| if is_one { APPLICATION.to_owned() } else { application_of(name) };
            cell.stations.iter_mut().map(|station| (key(&station.name), &mut station.application)).collect()
        }
    }
}

/// Returns the built-in applications that a setup can name.
const fn built_in(cell: &Cell) -> &'static [(&'static str, &'static str)] {
    if cell.application.is_some() { ARMS_APPLICATIONS } else { APPLICATIONS }
}

/// Returns the name of a varied application's file beside the rows.
fn copy_of(name: &str) -> String {
    format!("application-{}.toml", digest_of(name))
}

fn within(directory: Option<&Path>, name: &str) -> PathBuf {
    directory.map_or_else(|| PathBuf::from(name), |directory| directory.join(name))
}

impl VariedApplications {
    /// Returns the applications of a study; `None` if it varies none.
    pub(super) fn of(
        setup: &str,
        axes: &[Axis],
        base: &Cell,
        [of_study, of_setup]: [Option<&Path>; 2],
    ) -> Option<Self> {
        let known: Vec<String> = base.names().map(application_of).chain([APPLICATION.to_owned()]).collect();
        let keys: Vec<String> =
            axes.iter().map(|axis| axis.path.clone()).filter(|path| known.contains(path)).collect();
        (!keys.is_empty()).then(|| Self {
            setup: setup.to_owned(),
            keys,
            of_study: of_study.map(Path::to_owned),
            of_setup: of_setup.map(Path::to_owned),
            found: Mutex::new(BTreeMap::new()),
        })
    }

    /// Finds the applications of a setup with varied names; the error names the key.
    pub(super) fn find(&self, cell: &Cell) -> Arc<Result<FoundCell, String>> {
        let arms = cell.stations.iter().map(|station| &station.application);
        let given: Vec<&String> = cell.application.iter().chain(arms).collect();
        let given = format!("{given:?}");
        // What a thread holds is whole, also if it panicked.
        let mut known = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(known.entry(given).or_insert_with(|| Arc::new(self.read(cell))))
    }

    fn read(&self, cell: &Cell) -> Result<FoundCell, String> {
        let known = built_in(cell);
        let mut located = cell.clone();
        for (key, name) in names(&mut located) {
            if setup::built_in(known, name).is_some() {
                continue;
            }
            let path = self.path(&key, name);
            if !path.exists() {
                let (name, known) = (name.clone(), known.iter().map(|(name, _)| *name).collect());
                let unknown = setup::Error::Unknown { what: "application", name, known };
                return Err(format!("{key}: {unknown}"));
            }
            *name = path.display().to_string();
        }
        planning::applications_of(&self.setup, &located, None).map_err(|error| error.to_string())
    }

    /// Returns where an application is. Beside rows, varied ones have names of their own.
    fn path(&self, key: &str, name: &str) -> PathBuf {
        if !self.keys.iter().any(|varied| varied == key) {
            return within(self.of_setup.as_deref(), name);
        }
        let of_study = self.of_study.as_deref();
        let copy = within(of_study, &copy_of(name));
        if of_study.is_some() && copy.is_file() { copy } else { within(of_study, name) }
    }

    /// Returns the setup as it stands beside the rows, and the texts of its applications that are files: of those that are varied, and of
    /// the others, which the setup names. A file that cannot be read is left out: its jobs are refused.
    pub(super) fn saved(&self, base: &Cell, axes: &[Axis]) -> (Cell, Vec<(String, String)>) {
        let text_of = |key: &str, name: &str, known: &[(&'static str, &'static str)]| {
            let is_file = setup::built_in(known, name).is_none();
            is_file.then(|| setup::read_plain_text(&self.path(key, name)).ok()).flatten()
        };
        let is_varied = |key: &str| self.keys.iter().any(|varied| varied == key);
        let for_all = is_varied(APPLICATION);
        let mut files = Vec::new();
        // In an application for all stations, those name their arms.
        let names_files = |axis: &&Axis| {
            is_varied(&axis.path) && (axis.path == APPLICATION || !for_all && base.application.is_none())
        };
        for axis in axes.iter().filter(names_files) {
            let known =
                if axis.path == APPLICATION && !base.is_one() { ARMS_APPLICATIONS } else { APPLICATIONS };
            let given = (0..axis.len()).map(|number| axis.value(number, 0).to_string());
            files.extend(given.filter_map(|name| Some((copy_of(&name), text_of(&axis.path, &name, known)?))));
        }
        let mut cell = base.clone();
        let known = built_in(&cell);
        for (key, name) in names(&mut cell).into_iter().filter(|(key, _)| !for_all && !is_varied(key)) {
            if let Some(text) = text_of(&key, name, known) {
                let copy = match key.split('.').nth(1) {
                    Some(station) => format!("application-{station}.toml"),
                    None => records::cell_directory::APPLICATION.to_owned(),
                };
                files.push((copy.clone(), text));
                *name = copy;
            }
        }
        (cell, files)
    }
}
