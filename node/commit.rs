//! The commit that a program is built from, for build scripts.

use std::process::Command;

/// Variable with the commit, where the sources are an archive, as in a package or an image.
pub(crate) const VARIABLE: &str = "SKILLBENCH_COMMIT";

/// Returns the commit: `1a2b3c4d5e6f`, with `-modified` where one of these files differs from it; empty without a repository.
/// Cargo runs the script again after a commit, and after a change of these files.
pub(crate) fn commit(sources: &[&str]) -> String {
    println!("cargo:rerun-if-env-changed={VARIABLE}");
    if let Some(given) = std::env::var(VARIABLE).ok().filter(|commit| !commit.is_empty()) {
        return given;
    }
    // The log of HEAD grows with each commit and checkout; a worktree has its own.
    for file in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--path-format=absolute", "--git-path", file]) {
            println!("cargo:rerun-if-changed={path}");
        }
    }
    sources.iter().for_each(|source| println!("cargo:rerun-if-changed={source}"));
    of_repository(sources).unwrap_or_default()
}

fn of_repository(sources: &[&str]) -> Option<String> {
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let status = [&["status", "--porcelain", "--untracked-files=no", "--"], sources].concat();
    let is_modified = !git(&status)?.is_empty();
    Some(if is_modified { format!("{commit}-modified") } else { commit })
}

/// Returns what Git prints; `None` if it fails or is not there.
fn git(arguments: &[&str]) -> Option<String> {
    // The owner of the sources need not be the user who builds them, as in a container.
    let output = Command::new("git").args(["-c", "safe.directory=*"]).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok().filter(|_| output.status.success())?;
    Some(text.trim().to_owned())
}
