//! Tells the program the commit that it is built from, as `SKILLBENCH_COMMIT`: `1a2b3c4d5e6f`, with `-modified` where a file of
//! the repository differs from it; empty without a repository. `SKILLBENCH_VERSION` is the version with that commit.
//!
//! It runs again when the commit or a source changes. Built from an archive, as a package or in an image, the variable of that
//! name in the environment is taken.

#[path = "../node/commit.rs"]
mod commit;

use commit::VARIABLE;

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
    println!("cargo:rerun-if-changed=../node/commit.rs");
    let commit = commit::commit(&SOURCES);
    println!("cargo:rustc-env={VARIABLE}={commit}");
    let version = std::env::var("CARGO_PKG_VERSION").unwrap_or_default();
    let version = if commit.is_empty() { version } else { format!("{version} ({commit})") };
    println!("cargo:rustc-env=SKILLBENCH_VERSION={version}");
}
