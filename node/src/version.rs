//! The version of a node's program.

use std::sync::OnceLock;

/// Commit that the program was built from: known to release builds, and where `SKILLBENCH_COMMIT` contained it during the build,
/// as for packages and images.
const BUILT_FROM: &str = env!("SKILLBENCH_NODE_COMMIT");

/// Returns the version for `--version`, with the commit. A development build is not made again for each commit, so it names the
/// commit of its sources at present, and says so.
#[must_use]
pub fn version() -> &'static str {
    static VERSION: OnceLock<String> = OnceLock::new();
    VERSION.get_or_init(|| text(env!("CARGO_PKG_VERSION"), BUILT_FROM, sources_commit))
}

/// Returns the version with the commit that the program was built from, if that is known.
#[cfg(all(feature = "real", target_os = "linux"))]
pub(crate) fn version_as_built() -> String {
    text(env!("CARGO_PKG_VERSION"), BUILT_FROM, || None)
}

fn text(version: &str, built_from: &str, sources: impl FnOnce() -> Option<String>) -> String {
    if !built_from.is_empty() {
        return format!("{version} ({built_from})");
    }
    match sources() {
        Some(commit) => format!("{version} (development build, sources at {commit})"),
        None => version.to_owned(),
    }
}

/// Returns the commit of the repository from which a development build was made; `None` where there is none any more.
#[cfg(debug_assertions)]
fn sources_commit() -> Option<String> {
    let directory = env!("CARGO_MANIFEST_DIR");
    let git = ["-c", "safe.directory=*", "-C", directory, "rev-parse", "--short=12", "HEAD"];
    let output = std::process::Command::new("git").args(git).output().ok()?;
    let commit = String::from_utf8(output.stdout).ok().filter(|_| output.status.success())?;
    Some(commit.trim().to_owned()).filter(|commit| !commit.is_empty())
}

#[cfg(not(debug_assertions))]
const fn sources_commit() -> Option<String> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_commit_follows_the_version_where_the_build_knows_it_and_a_development_build_names_its_sources() {
        let sources = || Some("5e6f".to_owned());
        assert_eq!(text("0.1.0", "1a2b3c4d5e6f", sources), "0.1.0 (1a2b3c4d5e6f)");
        assert_eq!(text("0.1.0", "", sources), "0.1.0 (development build, sources at 5e6f)");
        assert_eq!(text("0.1.0", "", || None), "0.1.0");
        assert!(version().starts_with(env!("CARGO_PKG_VERSION")));
    }
}
