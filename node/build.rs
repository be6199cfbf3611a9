//! Tells release builds of both nodes the commit that they are built from, as `SKILLBENCH_NODE_COMMIT`.
//!
//! Everything above this crate would be built again after each commit. So a development build does not watch the repository; its
//! `--version` names the commit at which the sources are when it runs.

mod commit;

/// Folders of the workspace that decide what a node does, seen from this crate.
const SOURCES: [&str; 7] =
    ["src", "../cell", "../plc-node", "../robot-node", "../protocol", "../Cargo.lock", "../Cargo.toml"];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=commit.rs");
    println!("cargo:rerun-if-env-changed={}", commit::VARIABLE);
    let is_release = std::env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let given = std::env::var(commit::VARIABLE).ok().filter(|commit| !commit.is_empty());
    let commit = match given {
        Some(given) => given,
        None if is_release => commit::commit(&SOURCES),
        None => String::new(),
    };
    println!("cargo:rustc-env=SKILLBENCH_NODE_COMMIT={commit}");
}
