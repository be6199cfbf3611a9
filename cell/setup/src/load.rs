//! Finds and reads setups, and finds other files that are named in the same way.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::cell::CELL_SCHEMA;
use crate::check::{self, check_setup};
use crate::device_file;
use crate::exact::Exact;
use crate::place::line_of;
use crate::plain_file::{MOST_FILE_BYTES, read_plain_file, text_of};
use crate::problem::{Check, Problem};
use crate::{Cell, Error, Setup};

/// Setups compiled in: name and text.
pub const SETUPS: &[(&str, &str)] = &[
    ("A", include_str!("../../setups/A.toml")),
    ("B", include_str!("../../setups/B.toml")),
    ("C", include_str!("../../setups/C.toml")),
    ("D", include_str!("../../setups/D.toml")),
];

/// Setups of several stations compiled in: name and text. Only [`cell()`] reads them.
pub const CELLS: &[(&str, &str)] = &[
    ("E", include_str!("../../setups/E.toml")),
    ("F", include_str!("../../setups/F.toml")),
    ("G", include_str!("../../setups/G.toml")),
];

/// Finds the setup `name`: a built-in one, or the path of a file. Checks its values.
pub fn setup(name: &str) -> Result<Setup, Error> {
    Ok(setup_with_directory(name)?.0)
}

/// Finds a setup like [`setup()`], and also returns the directory to which its application's path is relative: that
/// of its file, `None` for a built-in one.
pub fn setup_with_directory(name: &str) -> Result<(Setup, Option<PathBuf>), Error> {
    let text = find_setup(name)?;
    let directory = text.directory();
    Ok((setup_in(&text.origin, &text.text, directory.as_deref())?, directory))
}

/// Reads a setup from its text, which `origin` names in messages, and checks its values.
///
/// # Errors
/// Among others [`Error::Several`]: a setup of several stations is a [`Cell`].
pub fn setup_from_text(origin: &str, text: &str) -> Result<Setup, Error> {
    setup_in(origin, text, None)
}

/// Reads a setup from its text, with the device file that it names relative to a directory.
fn setup_in(origin: &str, text: &str, directory: Option<&Path>) -> Result<Setup, Error> {
    if has_stations(origin, text)? {
        let cell = cell_of_several(origin, text, directory)?;
        let stations = cell.names().map(str::to_owned).collect();
        return Err(Error::Several { origin: origin.to_owned(), stations });
    }
    let mut setup = read::<Setup>(origin, text)?.with_servo();
    let of_file = directory.map_or(Ok(()), |directory| device_file::read(&mut setup.bus, directory));
    of_file.and_then(|()| check_setup(&setup)).map_err(|problem| refuse_text(origin, text, problem))?;
    Ok(setup)
}

/// Reads a setup with any number of stations from a table of its keys, such as [`cell_to_table`](crate::cell_to_table) makes, and
/// checks its values like [`cell_from_text`].
pub fn cell_from_table(origin: &str, table: toml::Table) -> Result<Cell, Error> {
    let refused = |problem: Problem| refuse(origin.to_owned(), problem);
    if table_has_stations(&table).map_err(refused)? {
        let cell = from_table::<Cell>(table).map_err(refused)?.with_servos();
        check::check_cell(&cell).map_err(refused)?;
        return Ok(cell);
    }
    let setup = from_table::<Setup>(table).map_err(refused)?.with_servo();
    check_setup(&setup).map_err(refused)?;
    Ok(setup.into())
}

fn from_table<T: DeserializeOwned>(table: toml::Table) -> Result<T, Problem> {
    serde_path_to_error::deserialize(Exact::new(toml::Value::Table(table)))
        .map_err(|error| Problem { key: error.path().to_string(), text: error.inner().message().to_owned() })
}

/// Finds a setup with any number of stations, and the directory to which the paths in it are relative, like
/// [`setup_with_directory`]. A setup of one robot is a cell of one station.
pub fn cell(name: &str) -> Result<(Cell, Option<PathBuf>), Error> {
    let text = find_setup(name)?;
    let directory = text.directory();
    Ok((cell_in(&text.origin, &text.text, directory.as_deref())?, directory))
}

/// Reads a setup with any number of stations from its text, like [`setup_from_text`].
pub fn cell_from_text(origin: &str, text: &str) -> Result<Cell, Error> {
    cell_in(origin, text, None)
}

fn cell_in(origin: &str, text: &str, directory: Option<&Path>) -> Result<Cell, Error> {
    if has_stations(origin, text)? {
        cell_of_several(origin, text, directory)
    } else {
        setup_in(origin, text, directory).map(Cell::from)
    }
}

fn cell_of_several(origin: &str, text: &str, directory: Option<&Path>) -> Result<Cell, Error> {
    let mut cell = read::<Cell>(origin, text)?.with_servos();
    let of_files = directory.map_or(Ok(()), |directory| read_device_files(&mut cell, directory));
    of_files.and_then(|()| check::check_cell(&cell)).map_err(|problem| refuse_text(origin, text, problem))?;
    Ok(cell)
}

/// Reads the device file of each station.
fn read_device_files(cell: &mut Cell, directory: &Path) -> Check {
    for station in &mut cell.stations {
        device_file::read(&mut station.bus, directory).map_err(|Problem { key, text }| Problem {
            key: format!("station.{}.{key}", station.name),
            text,
        })?;
    }
    Ok(())
}

/// Returns whether a text is a setup with sections `[[station]]`, and refuses one whose `schema` says otherwise. What cannot
/// be read at all has none: its reader says why.
fn has_stations(origin: &str, text: &str) -> Result<bool, Error> {
    let Ok(table) = text.parse::<toml::Table>() else { return Ok(false) };
    table_has_stations(&table).map_err(|problem| refuse_text(origin, text, problem))
}

fn table_has_stations(table: &toml::Table) -> Result<bool, Problem> {
    let schema = table.get("schema").and_then(toml::Value::as_integer);
    let mismatch = match (schema == Some(CELL_SCHEMA.into()), table.contains_key("station")) {
        (true, true) => return Ok(true),
        (false, false) => return Ok(false),
        (true, false) => format!(
            "{CELL_SCHEMA} needs a section [[station]] for each robot, found none: add them, or write 1"
        ),
        (false, true) => {
            let found = schema.map_or_else(|| "no version".to_owned(), |found| found.to_string());
            format!("{found}: a setup with [[station]] has schema = {CELL_SCHEMA}")
        }
    };
    Err(Problem { key: "schema".to_owned(), text: mismatch })
}

fn find_setup(name: &str) -> Result<Text, Error> {
    find("setup", &[SETUPS, CELLS].concat(), name, None)
}

/// Finds a built-in setup, of one robot or of several, as [`built_in`] does.
#[must_use]
pub fn built_in_setup(name: &str) -> Option<(&'static str, &'static str)> {
    [SETUPS, CELLS].iter().find_map(|all| built_in(all, name))
}

/// Checks a cell that was changed after it was read.
pub fn check_cell(cell: &Cell) -> Result<(), Error> {
    check::check_cell(cell).map_err(|problem| refuse(format!("setup {}", cell.name), problem))
}

/// Checks a setup that was changed after it was read, for example by an option on the command line.
pub fn check(setup: &Setup) -> Result<(), Error> {
    check_setup(setup).map_err(|problem| refuse(format!("setup {}", setup.name), problem))
}

fn refuse(origin: String, Problem { key, text }: Problem) -> Error {
    Error::Value { origin, key, problem: text }
}

/// Refuses a value of a text, with its line.
fn refuse_text(origin: &str, text: &str, problem: Problem) -> Error {
    let line = line_of(text, &problem.key);
    refuse(line.map_or_else(|| origin.to_owned(), |line| format!("{origin}:{line}")), problem)
}

/// A text that was found.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Text {
    /// Its name in messages: the file's path, or the built-in name.
    pub origin: String,
    /// The file; `None` for a built-in one.
    pub path: Option<PathBuf>,
    /// The text itself.
    pub text: String,
}

impl Text {
    /// Returns the directory of the file; `None` for a built-in one.
    #[must_use]
    pub fn directory(&self) -> Option<PathBuf> {
        self.path.as_deref().and_then(Path::parent).map(Path::to_owned)
    }
}

/// Finds a built-in text by its name, in upper or lower case; returns its name as listed and the text.
#[must_use]
pub fn built_in<'a>(all: &[(&'a str, &'a str)], name: &str) -> Option<(&'a str, &'a str)> {
    all.iter().copied().find(|(known, _)| known.eq_ignore_ascii_case(name))
}

/// Finds the text `name`: one of `all` that are built in, in upper or lower case, or a file, with its path relative to `directory`.
/// `what` is the kind of text in messages.
pub fn find(
    what: &'static str,
    all: &[(&'static str, &'static str)],
    name: &str,
    directory: Option<&Path>,
) -> Result<Text, Error> {
    if let Some((known, text)) = built_in(all, name) {
        let origin = format!("built-in {what} {known}");
        return Ok(Text { origin, path: None, text: text.to_owned() });
    }
    let path = directory.map_or_else(|| PathBuf::from(name), |directory| directory.join(name));
    if !path.exists() && path.extension().is_none() {
        let known = all.iter().map(|(known, _)| *known).collect();
        return Err(Error::Unknown { what, name: name.to_owned(), known });
    }
    let text = read_text(what, &path)?;
    Ok(Text { origin: path.display().to_string(), path: Some(path), text })
}

/// Reads a text file.
fn read_text(what: &'static str, path: &Path) -> Result<String, Error> {
    let unreadable = |reason| Error::Unreadable { what, path: path.to_owned(), reason };
    let not_text = |problem: String| Error::NotText { path: path.to_owned(), problem };
    text_of(read_plain_file(path, MOST_FILE_BYTES).map_err(unreadable)?).map_err(not_text)
}

/// Reads a file of a format of ours from its text, which `origin` names in messages. A list of fixed length must have
/// exactly that length.
///
/// # Errors
/// [`Error::Format`]
pub fn read<T: DeserializeOwned>(origin: &str, text: &str) -> Result<T, Error> {
    let broken = |key: String, source: &toml::de::Error| Error::format(origin, text, key, source);
    let document = toml::Deserializer::parse(text).map_err(|source| broken(String::new(), &source))?;
    serde_path_to_error::deserialize(Exact::new(document))
        .map_err(|error| broken(error.path().to_string(), error.inner()))
}
