//! Claim of a directory by a verb: with these options and this program its jobs go on there, and with others they are refused.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use records::exit::{Exit, Failure};
use records::run_directory::{Durability, replace};
use sha2::{Digest as _, Sha256};

use super::folder::{self, Manifest, of_host};
use super::hex::hex;
use crate::outputs;
use crate::study_files::{JOBS, MANIFEST, ROWS};

/// Origin of the jobs of a verb.
#[derive(Clone, Copy, Debug)]
pub struct RowsOrigin<'a> {
    /// Directory for the jobs.
    pub directory: &'a Path,
    /// The verb with everything that determines its jobs besides the program.
    pub options: &'a str,
    /// The same as a user gives it, for the refusal of other options; may be empty.
    pub command: &'a str,
    /// Files of the verb besides the rows; a directory that has one of them without a claim is refused.
    pub results: &'a [&'a str],
    /// Commit that this program was built from.
    pub commit: &'a str,
}

/// A directory in which no other study and no other program has jobs.
#[derive(Clone, Debug)]
pub struct StudyClaim {
    directory: PathBuf,
    manifest: Manifest,
}

impl StudyClaim {
    /// Checks that the directory is free, or has jobs of the same options and program. Writes nothing.
    ///
    /// # Errors
    ///
    /// It has jobs of other options or of another program, or files of the verb without a claim.
    pub fn checked(origin: RowsOrigin<'_>) -> Result<Self, Failure> {
        let RowsOrigin { directory, options, command, results, commit } = origin;
        let usage = |error| Failure::new(Exit::Usage, error);
        let study = hex(&Sha256::digest(options));
        let manifest = Manifest::of_listed(study, command.to_owned(), folder::program(commit)?);
        match Manifest::read(directory).map_err(usage)? {
            Some(known) => manifest.check_same(&known, directory).map_err(usage)?,
            None => {
                let mut results = results.iter().chain(&[ROWS, JOBS]);
                if let Some(name) = results.find(|name| directory.join(name).exists()) {
                    return Err(usage(anyhow!(
                        "{}: has {name} without {MANIFEST}, so its options are not known; use another --out",
                        directory.display()
                    )));
                }
            }
        }
        Ok(Self { directory: directory.to_owned(), manifest })
    }

    /// Makes the directory, and writes the claim into it.
    ///
    /// # Errors
    ///
    /// It is a file, or the disk does not take it.
    pub(super) fn make(&self) -> Result<(), Failure> {
        crate::directory::make(&self.directory)?;
        let text = outputs::json(&self.manifest)?;
        replace(&self.directory.join(MANIFEST), text, Durability::Written).map_err(of_host)
    }

    /// Returns the directory.
    #[must_use]
    pub(super) fn directory(&self) -> &Path {
        &self.directory
    }

    /// Returns the program of the jobs.
    #[must_use]
    pub(super) fn program(&self) -> &str {
        &self.manifest.program
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn refused(place: &Path, options: &str, command: &str, commit: &str) -> Option<String> {
        let origin = RowsOrigin { directory: place, options, command, results: &["lives.csv"], commit };
        let claim = StudyClaim::checked(origin).map(|claim| claim.make().unwrap());
        claim.err().map(|refused| refused.error.to_string().replace(&place.display().to_string(), "DIR"))
    }

    #[test]
    fn a_directory_of_other_options_names_them_and_that_of_another_program_names_both() {
        let place = tempfile::tempdir().unwrap();
        let place = place.path();
        assert_eq!(refused(place, "a", "--hours 1", "c0ffee"), None);
        assert_eq!(refused(place, "a", "--hours 1", "c0ffee"), None);
        insta::assert_snapshot!(refused(place, "b", "--hours 2", "c0ffee").unwrap(), @"DIR: has jobs of other options; use another --out, or these: --hours 1");
        insta::assert_snapshot!(refused(place, "b", "--hours 1", "c0ffee").unwrap(), @"DIR: has rows of another study; use another --out");
        insta::assert_snapshot!(refused(place, "a", "--hours 1", "decaf").unwrap(), @"DIR: has rows of program c0ffee, and this is decaf; use that program, or another --out");
    }

    #[test]
    fn a_directory_with_files_of_the_verb_and_no_claim_is_refused_and_left_as_it_is() {
        for name in ["lives.csv", ROWS, JOBS] {
            let old = tempfile::tempdir().unwrap();
            fs::write(old.path().join(name), "old").unwrap();
            let expected = format!(
                "DIR: has {name} without study.json, so its options are not known; use another --out"
            );
            assert_eq!(refused(old.path(), "a", "", "c0ffee").unwrap(), expected);
            assert_eq!(fs::read_dir(old.path()).unwrap().count(), 1);
        }
    }
}
