//! The fuzzer: `FUZZ_TARGET=device fuzz CORPUS` with libFuzzer's options, if built by `scripts/dev.sh fuzz`. Built otherwise it
//! runs the files that are named as arguments through the target, such as one that crashed.

#![cfg_attr(fuzzing, no_main)]

use fuzz::{TARGETS, Target};

/// Returns the target that the environment names.
///
/// # Panics
///
/// It names none.
fn chosen() -> Target {
    let name = std::env::var("FUZZ_TARGET").unwrap_or_default();
    let found = TARGETS.iter().find(|(target, _)| *target == name);
    let names: Vec<_> = TARGETS.iter().map(|(name, _)| *name).collect();
    found.unwrap_or_else(|| panic!("FUZZ_TARGET is `{name}`; choose one of {}", names.join(", "))).1
}

#[cfg(fuzzing)]
mod driven {
    use std::sync::LazyLock;

    static TARGET: LazyLock<fuzz::Target> = LazyLock::new(super::chosen);

    libfuzzer_sys::fuzz_target!(|data: &[u8]| {
        (*TARGET)(data);
    });
}

#[cfg(not(fuzzing))]
fn main() {
    let target = chosen();
    for path in std::env::args_os().skip(1) {
        let data =
            std::fs::read(&path).unwrap_or_else(|error| panic!("cannot read {}: {error}", path.display()));
        target(&data);
        println!("{}: passed", path.display());
    }
}
