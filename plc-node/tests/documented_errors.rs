//! `docs/plcopen.md` has every ErrorID that a block can show.

#![expect(clippy::panic, reason = "a table that cannot be read fails the test")]

const PAGE: &str = include_str!("../../docs/plcopen.md");
const CODE: &str = include_str!("../src/function_blocks/error.rs");

/// Returns the number that a text begins with, as `0x8001`.
fn id(text: &str) -> u16 {
    let digits = text.get(2..6).unwrap_or_else(|| panic!("`{text}` is no ErrorID"));
    u16::from_str_radix(digits, 16).unwrap_or_else(|_| panic!("`{text}` is no ErrorID"))
}

#[test]
fn the_page_has_every_error_id_of_the_blocks_once_and_no_other() {
    let in_code: Vec<u16> = CODE.split("=> ").skip(1).filter(|it| it.starts_with("0x80")).map(id).collect();
    let documented: Vec<u16> = PAGE
        .lines()
        .filter_map(|line| line.strip_prefix("| "))
        .filter(|it| it.starts_with("0x"))
        .map(id)
        .collect();
    let mut sorted = in_code;
    sorted.sort_unstable();
    assert!(sorted.len() > 20, "the numbers are found in the code: {sorted:x?}");
    assert_eq!(documented, sorted);
}
