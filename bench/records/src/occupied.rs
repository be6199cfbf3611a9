//! Directories that a verb does not write into, because it would replace files that it did not write.

use std::fs;
use std::path::{Path, PathBuf};

/// Largest file of a run in bytes that is read as a whole; the traces of the longest runs have some hundred MB.
pub(crate) const MOST_RUN_BYTES: u64 = 1 << 30;

/// The files of a run, see [`run_directory`](super::run_directory).
pub const RUN: Files<'static> = Files {
    inputs: &[],
    results: &[
        SAMPLES,
        "setup.toml",
        "application.toml",
        PROGRAM,
        "host.json",
        "results.json",
        "report.html",
        "race.html",
        "trace-plc.csv",
        "trace-robot.csv",
        "trace-plc.rows",
        "trace-robot.rows",
        "plc.pcapng",
        "robot.pcapng",
        "trace.json",
        "motion.mcap",
    ],
};

/// The samples of a run. This file tells its directory from others.
pub const SAMPLES: &str = "samples.csv";

/// The exported code that a run executed in the place of the PLC's function blocks: the name that the export gives it, so that
/// the run's directory can be executed as it is.
pub const PROGRAM: &str = "skillbench.st";

/// Files that a cell has for each station: `trace-robot-left.csv`.
const OF_STATIONS: [(&str, &str); 7] = [
    ("application-", ".toml"),
    ("trace-robot-", ".csv"),
    ("trace-plc-", ".csv"),
    ("trace-robot-", ".rows"),
    ("trace-plc-", ".rows"),
    ("robot-", ".pcapng"),
    ("plc-", ".pcapng"),
];

/// Returns whether a file has the name of one of a run's.
pub(crate) fn is_of_run(name: &str) -> bool {
    let is_of_station = |(begin, end): &(&str, &str)| name.starts_with(begin) && name.ends_with(end);
    RUN.results.contains(&name) || OF_STATIONS.iter().any(is_of_station)
}

/// The files that a verb writes into its directory.
#[derive(Clone, Copy, Debug)]
pub struct Files<'a> {
    /// What the verb works on, each with its content. A directory that holds all of them is the verb's own: it was written
    /// by an earlier call with the same options.
    pub inputs: &'a [(&'a str, &'a str)],
    /// What it finds out. It is replaced or continued in a directory of its own only.
    pub results: &'a [&'a str],
}

/// The path of the directory is in use.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{} {found}; choose another directory by --out", path.display())]
pub struct Occupied {
    path: PathBuf,
    found: String,
}

impl Occupied {
    /// Checks that the path is free, or a directory in which these files replace none of anyone else's.
    ///
    /// # Errors
    ///
    /// It is a file, it holds a run, or it holds one of these files with other content.
    pub fn check(path: &Path, files: Files<'_>) -> Result<(), Self> {
        let occupied = |found| Err(Self { path: path.to_owned(), found });
        if path.exists() && !path.is_dir() {
            return occupied("is a file".to_owned());
        }
        if holds_run(path) {
            return occupied("holds a run already".to_owned());
        }
        let Files { inputs, results } = files;
        let is_there = |name: &str| path.join(name).symlink_metadata().is_ok();
        let is_same = |(name, content): &(&str, &str)| {
            fs::read(path.join(name)).is_ok_and(|found| found == content.as_bytes())
        };
        let is_own = !inputs.is_empty() && inputs.iter().all(is_same);
        let other_inputs = inputs.iter().filter(|input| !is_same(input)).map(|(name, _)| *name);
        let kept_results = results.iter().copied().filter(|_| !is_own);
        match other_inputs.chain(kept_results).find(|name| is_there(name)) {
            Some(name) => occupied(format!("holds another {name}, which would be replaced")),
            None => Ok(()),
        }
    }
}

/// Returns whether a directory holds a run.
#[must_use]
pub fn holds_run(directory: &Path) -> bool {
    directory.join(SAMPLES).exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STUDY: Files<'_> = Files { inputs: &[("setup.toml", "name = \"A\"\n")], results: &["study.csv"] };

    /// Returns whether a directory with these files is refused, and for which.
    fn refused(files: Files<'_>, found: &[(&str, &str)]) -> Option<String> {
        let directory = tempfile::tempdir().unwrap();
        for (name, content) in found {
            fs::write(directory.path().join(name), content).unwrap();
        }
        Occupied::check(directory.path(), files).err().map(|occupied| occupied.found)
    }

    #[test]
    fn a_cell_of_the_users_own_is_not_replaced_by_a_run_or_a_study() {
        let cell = [("setup.toml", "# My cell.\nname = \"A\"\n"), ("application.toml", "# My task.\n")];
        let setup = Some("holds another setup.toml, which would be replaced".to_owned());
        assert_eq!(refused(RUN, &cell), setup);
        assert_eq!(refused(STUDY, &cell), setup);
        let task = "holds another application.toml, which would be replaced";
        assert_eq!(refused(RUN, &cell[1..]).as_deref(), Some(task));
        assert_eq!(refused(STUDY, &cell[1..]), None, "a study writes no application");
    }

    #[test]
    fn a_study_goes_on_in_a_directory_with_the_same_inputs_and_only_there() {
        let [setup] = STUDY.inputs else { panic!("one input") };
        let figures = ("study.csv", "1,2\n");
        assert_eq!(refused(STUDY, &[]), None);
        assert_eq!(refused(STUDY, &[*setup]), None);
        assert_eq!(refused(STUDY, &[*setup, figures]), None);
        let kept = Some("holds another study.csv, which would be replaced".to_owned());
        assert_eq!(refused(STUDY, &[figures]), kept);
        let other = ("setup.toml", "name = \"B\"\n");
        assert!(refused(STUDY, &[other, figures]).unwrap().contains("another setup.toml"));
    }

    #[test]
    fn a_run_takes_no_directory_that_has_its_files_and_any_other_one() {
        for name in RUN.results.iter().filter(|name| **name != SAMPLES) {
            assert!(refused(RUN, &[(name, "")]).unwrap().contains(name));
        }
        assert_eq!(refused(RUN, &[("notes.md", "")]), None);
        for files in [RUN, STUDY] {
            assert_eq!(refused(files, &[(SAMPLES, "")]).as_deref(), Some("holds a run already"));
        }
    }
}
