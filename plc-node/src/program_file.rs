//! The file with exported code, as a command line names it: by the directory of the export.

use std::path::{Path, PathBuf};

use plc_export::FILE;

use crate::{CodeError, ExportedCode};

/// Why exported code cannot be executed.
#[derive(Debug, thiserror::Error)]
pub enum ProgramFileError {
    /// The file cannot be read.
    #[error("{}: {error}; name the directory that `plc-node export --for st` wrote", .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Message of the system.
        error: std::io::Error,
    },
    /// The code has a mistake.
    #[error("{}: {error}", .directory.display())]
    Code {
        /// The directory with the file.
        directory: PathBuf,
        /// The mistake, with its file and place.
        error: CodeError,
    },
}

/// Reads and checks the exported code in a directory.
///
/// # Errors
///
/// It cannot be read, or has a mistake.
pub fn read_program(directory: &Path) -> Result<ExportedCode, ProgramFileError> {
    let path = directory.join(FILE);
    let text = setup::read_plain_text(&path).map_err(|error| ProgramFileError::Unreadable { path, error })?;
    ExportedCode::compile(&text)
        .map_err(|error| ProgramFileError::Code { directory: directory.into(), error })
}
