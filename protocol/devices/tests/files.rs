//! The files in this crate's folder are the generated ones.

use std::path::Path;

/// Returns the device files and the dissector.
fn all_files() -> impl Iterator<Item = (String, String)> {
    let dissector = (devices::wireshark::FILE_NAME.to_owned(), devices::wireshark::write());
    devices::files().into_iter().chain([dissector])
}

#[test]
fn the_files_are_those_generated_from_the_descriptions() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let rewrite = std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always");
    for (name, text) in all_files() {
        let path = folder.join(&name);
        if rewrite {
            std::fs::write(&path, &text).unwrap();
        }
        let there = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            there == text,
            "{name} is not what the description gives: run this test with INSTA_UPDATE=always, and set CHANGED to today"
        );
    }
}

#[test]
fn no_file_of_an_earlier_date_is_left_behind() {
    let names: Vec<_> = all_files().map(|(name, _)| name).collect();
    let folder = std::fs::read_dir(env!("CARGO_MANIFEST_DIR")).unwrap();
    for entry in folder {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let is_description = name.ends_with(".eds") || name.ends_with(".xml") || name.ends_with(".lua");
        assert!(!is_description || names.contains(&name), "{name} is made by nothing");
    }
}
