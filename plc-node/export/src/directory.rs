//! The directory of an export: written whole or not at all.

use std::path::{Path, PathBuf};
use std::{fs, io};

use crate::br::br;
use crate::codesys::codesys;
use crate::siemens::siemens;
use crate::{ExportedApplication, FILE, Maker, Refused, VECTORS, VectorsError, structured_text, vectors};

/// A file of an export.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ExportFile {
    /// Its path in the directory, with `/`.
    pub path: String,
    /// Its text.
    pub text: String,
}

/// Why nothing was exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The first thing that does not fit.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// The vectors could not be made.
    #[error(transparent)]
    Vectors(#[from] VectorsError),
    /// The directory contains something.
    #[error("{}: not empty; name a new or an empty directory", .0.display())]
    NotEmpty(PathBuf),
    /// The directory cannot be written.
    #[error("{}: cannot be written: {error}", .path.display())]
    Write {
        /// The directory.
        path: PathBuf,
        /// What the system says.
        error: io::Error,
    },
}

impl ExportError {
    /// Returns true for an error that another application, setup or directory corrects.
    #[must_use]
    pub const fn is_usage(&self) -> bool {
        matches!(self, Self::Refused(_) | Self::NotEmpty(_))
    }
}

/// Returns the files for a maker's PLC, with the vectors that its code has to answer.
///
/// # Errors
/// The first thing that does not fit.
pub fn files(application: &ExportedApplication, maker: Maker) -> Result<Vec<ExportFile>, ExportError> {
    let text = structured_text(application)?;
    let vectors = ExportFile { path: VECTORS.into(), text: vectors(&text, application)? };
    let mut files = match maker {
        Maker::St => {
            crate::names::checked_parts(&text, "Structured Text", &[])?;
            vec![ExportFile { path: FILE.into(), text }]
        }
        Maker::Siemens => siemens(application, &text)?,
        Maker::Codesys => codesys(application, &text)?,
        Maker::Br => br(application, &text)?,
    };
    files.push(vectors);
    Ok(files)
}

/// Writes the export into a directory that is new or empty. The files are written beside it first, and then renamed.
///
/// # Errors
/// The first thing that does not fit, or the directory cannot be written; then nothing is left.
pub fn export(application: &ExportedApplication, maker: Maker, directory: &Path) -> Result<(), ExportError> {
    let files = files(application, maker)?;
    let failed = |error| ExportError::Write { path: directory.into(), error };
    if fs::read_dir(directory).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(ExportError::NotEmpty(directory.into()));
    }
    let name = directory.file_name().ok_or_else(|| failed(io::ErrorKind::InvalidInput.into()))?;
    let partial =
        directory.with_file_name(format!(".{}.partial-{}", name.to_string_lossy(), std::process::id()));
    let written = fs::create_dir(&partial)
        .and_then(|()| files.iter().try_for_each(|file| write(&partial, file)))
        // An empty directory gives way; the system refuses one that is filled meanwhile.
        .and_then(|()| fs::rename(&partial, directory));
    written.map_err(|error| {
        let _ = fs::remove_dir_all(&partial);
        failed(error)
    })
}

fn write(directory: &Path, ExportFile { path, text }: &ExportFile) -> io::Result<()> {
    let path = directory.join(path);
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent)?;
    }
    fs::write(path, text)
}
