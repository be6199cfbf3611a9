//! Finding and reading setups and applications.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::{Application, Setup};

/// Setups compiled in: name and text.
pub const SETUPS: &[(&str, &str)] = &[("A", include_str!("../../../bench/setups/A.toml"))];

/// Applications compiled in: name and text.
pub const APPLICATIONS: &[(&str, &str)] =
    &[("pick-and-place", include_str!("../../../bench/applications/pick-and-place.toml"))];

/// Why a setup or an application cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The name is neither built in nor a file.
    #[error("there is no {what} `{name}`: built in are {}; or give the path of a .toml file", known.join(", "))]
    Unknown {
        /// "setup" or "application".
        what: &'static str,
        /// What was asked for.
        name: String,
        /// Those that are built in.
        known: Vec<&'static str>,
    },
    /// The file is there but cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not what the format wants: file, line, key and what was expected.
    #[error("{origin}: {source}")]
    Format {
        /// The file, or the built-in's name.
        origin: String,
        /// Line, key and expectation.
        source: Box<toml::de::Error>,
    },
    /// The text is well formed, but a value makes no sense.
    #[error("{origin}: {key}: {problem}")]
    Value {
        /// The file, or the built-in's name.
        origin: String,
        /// The key.
        key: String,
        /// What is wrong and what would be right.
        problem: String,
    },
}

/// Finds the setup that `name` names: a built-in one, or the path of a file.
pub fn setup(name: &str) -> Result<Setup, Error> {
    let (_origin, setup) = find::<Setup>("setup", SETUPS, name, None)?;
    Ok(setup)
}

/// Finds the application that `name` names: a built-in one, or the path of a file.
pub fn application(name: &str) -> Result<Application, Error> {
    let (_origin, application) = find::<Application>("application", APPLICATIONS, name, None)?;
    Ok(application)
}

fn find<T: DeserializeOwned>(
    what: &'static str,
    built_in: &[(&'static str, &'static str)],
    name: &str,
    beside: Option<&Path>,
) -> Result<(String, T), Error> {
    let (origin, text) = match built_in.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)) {
        Some((known, text)) => (format!("built-in {what} {known}"), (*text).to_owned()),
        None => {
            let path = beside.map_or_else(|| PathBuf::from(name), |directory| directory.join(name));
            if !path.exists() && path.extension().is_none() {
                let known = built_in.iter().map(|(known, _)| *known).collect();
                return Err(Error::Unknown { what, name: name.to_owned(), known });
            }
            let text = std::fs::read_to_string(&path)
                .map_err(|source| Error::Unreadable { path: path.clone(), source })?;
            (path.display().to_string(), text)
        }
    };
    let value = toml::from_str(&text)
        .map_err(|source| Error::Format { origin: origin.clone(), source: Box::new(source) })?;
    Ok((origin, value))
}
