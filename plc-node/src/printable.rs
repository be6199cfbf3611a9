//! Names as a terminal may show them.

use std::fmt;

use node::output;

/// Converts a device's bytes to text: invalid UTF-8 and every control character become `�`.
pub(crate) fn printable(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    // DCP's padding and fixed-length fields of some devices add zeros.
    let text = text.trim_end_matches('\0').trim();
    let is_plain = |char: char| !char.is_control() && output::is_harmless(char);
    text.chars().map(|char| if is_plain(char) { char } else { char::REPLACEMENT_CHARACTER }).collect()
}

/// Text of a file, as a terminal may show it: in one line and without control characters.
pub(crate) struct FileText<'a>(pub(crate) &'a str);

impl fmt::Display for FileText<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = self.0.split_whitespace().collect::<Vec<_>>().join(" ");
        formatter.pad(&printable(line.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_in_a_name_do_not_reach_the_terminal() {
        assert_eq!(printable(b"\x1b[2Jrobot\x07 \xFF\0\0"), "\u{FFFD}[2Jrobot\u{FFFD} \u{FFFD}");
        assert_eq!(printable("ab\u{202E}c".as_bytes()), "ab\u{FFFD}c");
        assert_eq!(printable("Förderband".as_bytes()), "Förderband");
    }
}
