//! The version of a node's program.

use std::sync::OnceLock;

/// Returns the version for `--version`, with the commit that the program was built from if the variable `SKILLBENCH_COMMIT`
/// contained it during the build, as for releases and images.
#[must_use]
pub fn version() -> &'static str {
    static VERSION: OnceLock<String> = OnceLock::new();
    VERSION.get_or_init(|| with_commit(env!("CARGO_PKG_VERSION"), option_env!("SKILLBENCH_COMMIT")))
}

fn with_commit(version: &str, commit: Option<&str>) -> String {
    match commit.filter(|commit| !commit.is_empty()) {
        Some(commit) => format!("{version} ({commit})"),
        None => version.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_commit_follows_the_version_where_the_build_knows_it() {
        assert_eq!(with_commit("0.1.0", Some("1a2b3c4d5e6f")), "0.1.0 (1a2b3c4d5e6f)");
        assert_eq!(with_commit("0.1.0", Some("")), "0.1.0");
        assert_eq!(with_commit("0.1.0", None), "0.1.0");
        assert!(version().starts_with(env!("CARGO_PKG_VERSION")));
    }
}
