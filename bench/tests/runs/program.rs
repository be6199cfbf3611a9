//! The bench as a program: what a call prints, and how it ends.

use std::ffi::OsStr;
use std::path::Path;

use assert_cmd::Command;

/// Output and exit code of a call.
pub(crate) struct Finished {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

/// Runs the bench in a directory.
pub(crate) fn bench(directory: &Path, arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Finished {
    let output =
        Command::cargo_bin("bench").unwrap().current_dir(directory).args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Finished { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}
