//! Finding and reading setups and applications.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::check::{Problem, check_application, check_setup, check_together};
use crate::{Application, Error, Setup};

/// Setups compiled in: name and text.
pub const SETUPS: &[(&str, &str)] = &[
    ("A", include_str!("../../../bench/setups/A.toml")),
    ("B", include_str!("../../../bench/setups/B.toml")),
];

/// Applications compiled in: name and text.
pub const APPLICATIONS: &[(&str, &str)] =
    &[("pick-and-place", include_str!("../../../bench/applications/pick-and-place.toml"))];

/// Finds the setup that `name` names: a built-in one, or the path of a file. Its values are checked.
pub fn setup(name: &str) -> Result<Setup, Error> {
    Ok(read_setup(name)?.value)
}

/// Finds the application that `name` names: a built-in one, or the path of a file. Its values are checked.
pub fn application(name: &str) -> Result<Application, Error> {
    Ok(read_application(name, None)?.value)
}

/// Finds the setup that `name` names and the application that it runs, and checks that they fit each other.
///
/// An application that is not built in is looked for from the directory of the setup's file.
pub fn setup_with_application(name: &str) -> Result<(Setup, Application), Error> {
    let setup = read_setup(name)?;
    let directory = setup.path.as_deref().and_then(Path::parent);
    let application = read_application(&setup.value.application, directory)?;
    check_together(&setup.value, &application.value).map_err(|problem| application.refuse(problem))?;
    Ok((setup.value, application.value))
}

/// Checks a setup that was changed after it was read, say by an option on the command line.
pub fn check(setup: &Setup) -> Result<(), Error> {
    check_setup(setup).map_err(|problem| refuse(format!("setup {}", setup.name), problem))
}

/// A text that was found, and what it says.
struct Found<T> {
    origin: String,
    /// None for a built-in one.
    path: Option<PathBuf>,
    value: T,
}

impl<T> Found<T> {
    fn refuse(&self, problem: Problem) -> Error {
        refuse(self.origin.clone(), problem)
    }
}

fn refuse(origin: String, Problem { key, text }: Problem) -> Error {
    Error::Value { origin, key, problem: text }
}

fn read_setup(name: &str) -> Result<Found<Setup>, Error> {
    let found = find::<Setup>("setup", SETUPS, name, None)?;
    check_setup(&found.value).map_err(|problem| found.refuse(problem))?;
    Ok(found)
}

fn read_application(name: &str, directory: Option<&Path>) -> Result<Found<Application>, Error> {
    let found = find::<Application>("application", APPLICATIONS, name, directory)?;
    check_application(&found.value).map_err(|problem| found.refuse(problem))?;
    Ok(found)
}

fn find<T: DeserializeOwned>(
    what: &'static str,
    built_in: &[(&'static str, &'static str)],
    name: &str,
    directory: Option<&Path>,
) -> Result<Found<T>, Error> {
    if let Some((known, text)) = built_in.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)) {
        let origin = format!("built-in {what} {known}");
        let value = parse(&origin, text)?;
        return Ok(Found { origin, path: None, value });
    }
    let path = directory.map_or_else(|| PathBuf::from(name), |directory| directory.join(name));
    if !path.exists() && path.extension().is_none() {
        let known = built_in.iter().map(|(known, _)| *known).collect();
        return Err(Error::Unknown { what, name: name.to_owned(), known });
    }
    let text = std::fs::read_to_string(&path).map_err(|source| Error::Unreadable {
        what,
        path: path.clone(),
        source,
    })?;
    let origin = path.display().to_string();
    let value = parse(&origin, &text)?;
    Ok(Found { origin, path: Some(path), value })
}

pub(crate) fn parse<T: DeserializeOwned>(origin: &str, text: &str) -> Result<T, Error> {
    let broken = |key: String, source: &toml::de::Error| Error::format(origin, text, key, source);
    let document = toml::Deserializer::parse(text).map_err(|source| broken(String::new(), &source))?;
    serde_path_to_error::deserialize(document)
        .map_err(|error| broken(error.path().to_string(), error.inner()))
}
