//! The directory of an export: written whole or not at all.

use std::path::{Path, PathBuf};
use std::{fs, io};

use crate::abb::abb;
use crate::application::{Maker, Refused, RobotApplication};
use crate::krl_check;
use crate::kuka::kuka;
use crate::layer::kit;
use crate::names::{NameFault, check_names};
use crate::printed::ExportFile;

/// Why nothing was exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The first motion that the language lacks.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// The text of a file is not what the checker of KRL takes.
    #[error("{file}: {fault}; please report this export")]
    Krl {
        /// The file.
        file: String,
        /// The first fault.
        fault: krl_check::KrlFault,
    },
    /// A name that the controller would not take, or would take for something else.
    #[error("{0}; please report this export")]
    Name(#[from] NameFault),
    /// The directory contains something.
    #[error("{}: not empty; name a new or an empty directory", .0.display())]
    NotEmpty(PathBuf),
    /// The directory cannot be written.
    #[error("{}: cannot be written: {error}", .path.display())]
    Write {
        /// The directory.
        path: PathBuf,
        /// Message of the system.
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

/// Returns the files for a maker's robot.
///
/// # Errors
/// The first motion that the language lacks, or the first name that it takes for something else.
pub fn files(application: &RobotApplication, maker: Maker) -> Result<Vec<ExportFile>, ExportError> {
    let kit = kit(&application.served(maker)?, None);
    let files = match maker {
        Maker::Abb => abb(application, &kit),
        Maker::Kuka => kuka(application, &kit),
    };
    check_names(&files, maker)?;
    if maker == Maker::Kuka {
        for file in &files {
            krl_check::check(&file.text)
                .map_err(|fault| ExportError::Krl { file: file.path.clone(), fault })?;
        }
    }
    Ok(files)
}

/// Writes the export into a directory that is new or empty. The files are written beside it first, and then renamed.
///
/// # Errors
/// The first motion that the language lacks, or the directory cannot be written; then nothing is left.
pub fn export(application: &RobotApplication, maker: Maker, directory: &Path) -> Result<(), ExportError> {
    let files = files(application, maker)?;
    let failed = |error| ExportError::Write { path: directory.into(), error };
    if fs::read_dir(directory).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(ExportError::NotEmpty(directory.into()));
    }
    let name = directory.file_name().ok_or_else(|| failed(io::ErrorKind::InvalidInput.into()))?;
    let partial =
        directory.with_file_name(format!(".{}.partial-{}", name.to_string_lossy(), std::process::id()));
    let written = fs::create_dir(&partial)
        .and_then(|()| files.iter().try_for_each(|file| fs::write(partial.join(&file.path), &file.text)))
        // An empty directory gives way; the system refuses one that is filled meanwhile.
        .and_then(|()| fs::rename(&partial, directory));
    written.map_err(|error| {
        let _ = fs::remove_dir_all(&partial);
        failed(error)
    })
}
