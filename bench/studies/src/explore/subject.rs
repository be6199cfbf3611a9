//! The subject of an exploration, as its files in the directory and as the options of its commands.

use std::path::Path;

use planning::{Application, Found};
use setup::Setup;

use super::explored::{ExploredCell, FaultTarget, LoneRobot};
use super::fault::{FaultTexts, What};
use super::{ExploreOptions, OUTCOMES, PAGE};
use crate::engine::claim::{RowsOrigin, StudyClaim};
use records::cell_directory;
use records::exit::{Exit, Failure};
use records::occupied::Files;
use records::run_directory::{self, Durability, replace};
use report::in_shell;
use stands::planned_cell::PlannedCell;
use stands::planned_station::PlannedStation;

/// The application beside the setup of one robot.
const APPLICATION: &str = "application.toml";

/// A sequence that takes a second.
const SHORT: &str = include_str!("short.toml");

/// Subject of an exploration.
pub(super) struct Subject {
    /// Name of the setup.
    pub(super) name: String,
    /// Its title.
    pub(super) title: String,
    pub(super) explored: Box<dyn FaultTarget>,
    pub(super) texts: FaultTexts,
    pub(super) kinds: Vec<What>,
    /// The `--application` of commands that run again, after a blank; empty where the setup's own one is run.
    pub(super) application: String,
}

impl Subject {
    /// Reads and plans what is explored, and writes it into the directory, unless that has other files or another exploration.
    pub(super) fn prepare(
        options: &ExploreOptions,
        directory: &Path,
        commit: &str,
    ) -> Result<(Self, StudyClaim), Failure> {
        let (subject, files) = if options.setup.of_several().is_some() {
            Self::of_cell(options)?
        } else {
            Self::of_robot(options, directory)?
        };
        let claim = write(options, directory, &files, &subject.kinds, commit)?;
        Ok((subject, claim))
    }

    fn of_robot(options: &ExploreOptions, directory: &Path) -> Result<(Self, Named), Failure> {
        let (mut setup, found) = match &options.application {
            Some(name) => options.setup.load_with(Some(name))?,
            None => (setup::setup(options.setup.name())?, short(directory)?),
        };
        setup = options.drives.applied_to(setup)?;
        let kinds = options.kinds_for(&setup.name, has_drives(&setup))?;
        APPLICATION.clone_into(&mut setup.application);
        let files = vec![
            ("setup.toml".to_owned(), setup::setup_to_toml(&setup)?),
            (APPLICATION.to_owned(), found.text.clone()),
        ];
        let planned = PlannedCell::of_plan(&setup, &found.application, &found.plan(&setup)?)?;
        let own = || directory.join(APPLICATION).display().to_string();
        let application = options.application.clone().unwrap_or_else(own);
        let subject = Self {
            name: setup.name.clone(),
            title: setup.title.clone(),
            explored: Box::new(LoneRobot::new(setup, planned)?),
            texts: FaultTexts { lengths: options.lengths(), stations: Vec::new() },
            kinds,
            application: in_command(&application),
        };
        Ok((subject, files))
    }

    fn of_cell(options: &ExploreOptions) -> Result<(Self, Named), Failure> {
        let instead = options.application.as_deref();
        let (cell, found) = planning::cell_and_application(options.setup.name(), instead)?;
        let cell = options.drives.applied_to_cell(cell)?;
        let kinds = options.kinds_for(&cell.name, cell.setups().any(|setup| has_drives(&setup)))?;
        let texts: Vec<_> = found.stations.iter().map(|station| station.text.clone()).collect();
        let files = cell_directory::inputs(&cell, &texts)?;
        let stations = PlannedStation::all(&found.plan(&cell)?);
        let stations = stations.map_err(|error| Failure::new(Exit::Usage, error))?;
        let subject = Self {
            name: cell.name.clone(),
            title: cell.title.clone(),
            explored: Box::new(ExploredCell::new(stations)),
            texts: FaultTexts {
                lengths: options.lengths(),
                stations: cell.names().map(str::to_owned).collect(),
            },
            kinds,
            application: instead.map_or_else(String::new, in_command),
        };
        Ok((subject, files))
    }
}

fn has_drives(setup: &Setup) -> bool {
    setup.robot.drives.is_some()
}

fn in_command(application: &str) -> String {
    format!(" --application {}", in_shell(application))
}

/// Files by their names.
type Named = Vec<(String, String)>;

/// Writes what is explored, unless the directory has other files or another exploration.
fn write(
    options: &ExploreOptions,
    directory: &Path,
    files: &Named,
    kinds: &[What],
    commit: &str,
) -> Result<StudyClaim, Failure> {
    let inputs: Vec<_> = files.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    let command = options.command(kinds);
    let texts: Vec<_> = inputs.iter().map(|(name, text)| format!("{name}\n{text}")).collect();
    let jobs = format!("explore {command}\n{}", texts.join("\n"));
    let results = [OUTCOMES, PAGE];
    let origin = RowsOrigin { directory, options: &jobs, command: &command, results: &results, commit };
    let claim = StudyClaim::checked(origin)?;
    run_directory::make_for_study(directory, Files { inputs: &inputs, results: &results })?;
    for (name, text) in inputs {
        replace(&directory.join(name), text, Durability::Written)?;
    }
    Ok(claim)
}

/// Returns the short application as it is written into the directory.
fn short(directory: &Path) -> anyhow::Result<Found> {
    let path = directory.join(APPLICATION);
    let origin = path.display().to_string();
    let application = Application::parse(&origin, SHORT)?;
    Ok(Found { origin, path: Some(path), text: SHORT.to_owned(), application })
}
