//! Tells the program the commit that it is built from, as `SKILLBENCH_COMMIT`: `1a2b3c4d5e6f`, with `-modified` where a file of
//! the repository differs from it; empty without a repository. `SKILLBENCH_VERSION` is the version with that commit.
//!
//! It runs again when the commit or a source changes. Built from an archive, as a package or in an image, the variable of that
//! name in the environment is taken.

use std::process::Command;

const VARIABLE: &str = "SKILLBENCH_COMMIT";

/// Folders and files of the workspace whose changes make the program another one, or bring the build here anyway.
const SOURCES: [&str; 14] = [
    "src",
    "judge/src",
    "records/src",
    "report/src",
    "stands/src",
    "studies/src",
    "build.rs",
    "../cell",
    "../node/src",
    "../plc-node/src",
    "../robot-node/src",
    "../protocol/src",
    "../Cargo.lock",
    "../Cargo.toml",
];

fn main() {
    println!("cargo:rerun-if-env-changed={VARIABLE}");
    let given = std::env::var(VARIABLE).ok().filter(|commit| !commit.is_empty());
    if given.is_none() {
        watch();
    }
    let commit = given.or_else(commit).unwrap_or_default();
    println!("cargo:rustc-env={VARIABLE}={commit}");
    let version = std::env::var("CARGO_PKG_VERSION").unwrap_or_default();
    let version = if commit.is_empty() { version } else { format!("{version} ({commit})") };
    println!("cargo:rustc-env=SKILLBENCH_VERSION={version}");
}

/// Lets Cargo run this again after a commit, and after a change of a source.
fn watch() {
    // The log of HEAD grows with each commit and checkout; a worktree has its own.
    for file in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--path-format=absolute", "--git-path", file]) {
            println!("cargo:rerun-if-changed={path}");
        }
    }
    SOURCES.iter().for_each(|source| println!("cargo:rerun-if-changed={source}"));
}

fn commit() -> Option<String> {
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let is_modified = !git(&["status", "--porcelain", "--untracked-files=no"])?.is_empty();
    Some(if is_modified { format!("{commit}-modified") } else { commit })
}

/// Returns what Git prints; `None` if it fails or is not there.
fn git(arguments: &[&str]) -> Option<String> {
    // The owner of the sources need not be the user who builds them, as in a container.
    let output = Command::new("git").args(["-c", "safe.directory=*"]).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok().filter(|_| output.status.success())?;
    Some(text.trim().to_owned())
}
