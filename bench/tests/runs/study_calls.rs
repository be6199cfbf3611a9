//! `bench study` as tests call it.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::program::{Finished, bench};

/// Calls `bench study` with these arguments.
pub(crate) fn study(directory: &Path, arguments: &str) -> Finished {
    bench(directory, [&["study"], arguments.split(' ').collect::<Vec<_>>().as_slice()].concat())
}

/// Makes a directory with this study.
pub(crate) fn place(text: &str) -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("study.toml"), text).unwrap();
    place
}

/// Reads a file of a directory.
pub(crate) fn read(directory: &Path, name: &str) -> String {
    fs::read_to_string(directory.join(name)).unwrap()
}

/// Returns the digest that a merge of these directories prints.
pub(crate) fn merged(directory: &Path, parts: &str, out: &str) -> String {
    let finished = study(directory, &format!("merge {parts} --out {out}"));
    let digest =
        finished.stdout.lines().find_map(|line| line.strip_prefix("digest sha256:").map(str::to_owned));
    let digest = digest.unwrap_or_else(|| panic!("{}{}", finished.stdout, finished.stderr));
    let summed = Command::new("sha256sum").arg(directory.join(out).join("rows.csv")).output().unwrap();
    assert_eq!(String::from_utf8(summed.stdout).unwrap().split(' ').next(), Some(digest.as_str()));
    digest
}
