//! Files that the user asks for, checked before the verb begins: they replace none of what it reads and nothing of a run or study.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::Args;
use serde::Serialize;

use records::exit::{Exit, Failure};
use records::occupied::{self, holds_run};
use records::run_directory::{Durability, check_replaceable, replace};

use crate::study_files::{CLAIMED_FILES, MANIFEST};

/// Options of a verb that writes its figures for other programs, too.
#[derive(Args, Clone, Debug, Default)]
pub struct FigureExports {
    /// Write the figures to this file as well, as JSON.
    #[arg(long = "export-json", value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write the figures to this file as well, as CSV.
    #[arg(long = "export-csv", value_name = "FILE")]
    pub csv: Option<PathBuf>,
}

impl FigureExports {
    /// Returns the options that ask for files, each with its file if it is given.
    #[must_use]
    pub fn files(&self) -> [Named<'_>; 2] {
        [("--export-json", self.json.as_deref()), ("--export-csv", self.csv.as_deref())]
    }

    /// Rejects requested files that cannot be written, before a verb that may take an hour.
    ///
    /// # Errors
    ///
    /// A file is a directory, or its directory does not exist or does not take files.
    pub fn check_writable(&self) -> anyhow::Result<()> {
        self.files().into_iter().filter_map(|(_, file)| file).try_for_each(check_replaceable)
    }

    /// Writes each requested file.
    ///
    /// # Errors
    ///
    /// A file cannot be written; its old content is kept.
    pub fn write(&self, json: &str, csv: &str) -> anyhow::Result<()> {
        let write =
            |file: Option<&Path>, text| file.map_or(Ok(()), |file| replace(file, text, Durability::Written));
        write(self.json.as_deref(), json)?;
        write(self.csv.as_deref(), csv)
    }
}

/// Formats figures as JSON, with a line break at the end.
///
/// # Errors
///
/// Never: figures are numbers and texts.
pub fn json(figures: &impl Serialize) -> anyhow::Result<String> {
    Ok(serde_json::to_string_pretty(figures).context("cannot write the figures as JSON")? + "\n")
}

/// Formats a number for CSV, to the given digits after the point; nothing where there is none.
#[must_use]
pub fn csv_number(value: Option<f64>, digits: usize) -> String {
    let shown = value.filter(|value| value.is_finite()).map(|value| format!("{value:.digits$}"));
    // A zero has no sign, whether it was one or is rounded to one.
    let unsigned = |text: String| match text.strip_prefix('-') {
        Some(digits) if digits.trim_matches(['0', '.']).is_empty() => digits.to_owned(),
        _ => text,
    };
    shown.map_or_else(String::new, unsigned)
}

/// A file, if there is one, with what it is in messages: the option that asks for it, or what the verb reads from it.
pub type Named<'a> = (&'static str, Option<&'a Path>);

/// What a verb with its own directory writes there besides.
#[derive(Clone, Copy, Debug, Default)]
pub struct Own<'a> {
    /// Its directory.
    pub directory: Option<&'a Path>,
    /// The names of its files there.
    pub files: &'a [&'a str],
}

/// Rejects requested files that are the same, that replace what the verb reads or writes itself, or that replace a file of
/// a run or of a study.
///
/// # Errors
///
/// [`Exit::Usage`] with the option and the file.
pub fn check(asked: &[Named<'_>], read: &[Named<'_>], own: Own<'_>) -> Result<(), Failure> {
    let usage = |error| Err(Failure::new(Exit::Usage, error));
    let there = |(what, file): &Named<'_>| Some((*what, location((*file)?)));
    let read: Vec<_> = read.iter().filter_map(there).collect();
    let mut before = Vec::new();
    for (option, file) in asked {
        let Some(file) = file else { continue };
        let (shown, file) = (file.display(), location(file));
        let refuse = |what: &str| usage(anyhow!("{option} would replace {shown}, {what}; name another file"));
        if before.contains(&file) {
            return usage(anyhow!("two exports go to {shown}; give each a file of its own"));
        }
        if let Some((what, _)) = read.iter().find(|(_, read)| *read == file) {
            return refuse(what);
        }
        let is_in = |directory: &Path, names: &[&str]| {
            let directory = location(directory);
            names.iter().any(|name| directory.join(name) == file)
        };
        if own.directory.is_some_and(|directory| is_in(directory, own.files)) {
            return refuse("which is written there anyway");
        }
        if file.parent().is_some_and(|parent| holds_run(parent) && is_in(parent, occupied::RUN.results)) {
            return refuse("a file of the run there");
        }
        let is_of_study = |parent: &Path| parent.join(MANIFEST).exists() && is_in(parent, &CLAIMED_FILES);
        if file.parent().is_some_and(is_of_study) {
            return refuse("a file of the study there");
        }
        before.push(file);
    }
    Ok(())
}

/// Returns where a file is or will be: without links as far as its path exists.
pub fn location(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut ancestors = absolute.ancestors();
    let found = ancestors.find_map(|ancestor| Some((ancestor, ancestor.canonicalize().ok()?)));
    let Some((ancestor, real)) = found else { return absolute };
    match absolute.strip_prefix(ancestor) {
        Ok(rest) if !rest.as_os_str().is_empty() => real.join(rest),
        _ => real,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// Returns the refusal of two exports beside a setup and a run, without the name of the directory.
    fn refused(place: &Path, json: &str, csv: &str) -> Option<String> {
        let [json, csv, setup, study] = [json, csv, "cell/setup.toml", "study"].map(|name| place.join(name));
        let own = Own { directory: Some(&study), files: &["study.csv"] };
        let asked = [("--export-json", Some(json.as_path())), ("--export-csv", Some(&csv))];
        let read = [("the setup", Some(setup.as_path())), ("the application", None)];
        let failure = check(&asked, &read, own).err()?;
        assert_eq!(failure.exit, Exit::Usage);
        Some(failure.error.to_string().replace(&format!("{}/", place.display()), ""))
    }

    #[test]
    fn a_number_for_csv_has_a_minus_only_if_a_digit_of_it_is_above_zero() {
        let shown =
            [-0.0, -0.000_4, -0.000_6, 0.000_4, -10.0, f64::NAN].map(|value| csv_number(Some(value), 3));
        assert_eq!(shown, ["0.000", "0.000", "-0.001", "0.000", "-10.000", ""]);
        assert_eq!([Some(-0.4), None].map(|value| csv_number(value, 0)), ["0", ""]);
    }

    #[test]
    fn an_export_replaces_neither_what_is_read_nor_a_file_of_a_run() {
        let place = tempfile::tempdir().unwrap();
        let place = place.path();
        for directory in ["cell", "run", "empty", "rows"] {
            fs::create_dir(place.join(directory)).unwrap();
        }
        for file in
            ["cell/setup.toml", "run/samples.csv", "run/results.json", "rows/study.json", "empty/rows.csv"]
        {
            fs::write(place.join(file), "").unwrap();
        }
        std::os::unix::fs::symlink("cell", place.join("link")).unwrap();
        insta::assert_snapshot!(refused(place, "cell/setup.toml", "b").unwrap(), @"--export-json would replace cell/setup.toml, the setup; name another file");
        insta::assert_snapshot!(refused(place, "a", "link/../cell/./setup.toml").unwrap(), @"--export-csv would replace link/../cell/./setup.toml, the setup; name another file");
        insta::assert_snapshot!(refused(place, "run/results.json", "b").unwrap(), @"--export-json would replace run/results.json, a file of the run there; name another file");
        insta::assert_snapshot!(refused(place, "a", "run/samples.csv").unwrap(), @"--export-csv would replace run/samples.csv, a file of the run there; name another file");
        insta::assert_snapshot!(refused(place, "a", "rows/jobs.csv").unwrap(), @"--export-csv would replace rows/jobs.csv, a file of the study there; name another file");
        insta::assert_snapshot!(refused(place, "a", "study/study.csv").unwrap(), @"--export-csv would replace study/study.csv, which is written there anyway; name another file");
        insta::assert_snapshot!(refused(place, "a", "empty/../a").unwrap(), @"two exports go to empty/../a; give each a file of its own");
        for (json, csv) in [
            ("a", "b"),
            ("run/table.json", "empty/samples.csv"),
            ("study/a", "cell/b"),
            ("empty/rows.csv", "rows/a"),
        ] {
            assert_eq!(refused(place, json, csv), None);
        }
    }

    #[test]
    fn a_relative_path_is_the_same_file_as_the_absolute_one_also_before_it_exists() {
        let here = std::env::current_dir().unwrap().canonicalize().unwrap();
        assert_eq!(location(Path::new("not/there.json")), here.join("not/there.json"));
        assert_eq!(location(Path::new("src")), here.join("src"));
    }
}
