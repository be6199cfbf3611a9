//! Names as a terminal may show them.

use std::fmt;

use device_files::without_controls;

/// Converts a device's bytes to text without controls: invalid UTF-8 becomes `�`, too.
pub(crate) fn printable(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    // DCP's padding and fixed-length fields of some devices add zeros.
    without_controls(text.trim_end_matches('\0').trim())
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
