//! A directory that a verb writes into.

use std::path::Path;

use anyhow::{Context as _, anyhow};

use records::exit::{Exit, Failure};

/// Makes a directory, with those above it, unless it is there.
///
/// # Errors
///
/// It is a file, or the disk does not take it.
pub fn make(directory: &Path) -> Result<(), Failure> {
    if directory.exists() && !directory.is_dir() {
        let error = anyhow!("{} is a file; name another directory", directory.display());
        return Err(Failure::new(Exit::Usage, error));
    }
    let made = std::fs::create_dir_all(directory);
    Ok(made.with_context(|| format!("cannot make the directory {}", directory.display()))?)
}
