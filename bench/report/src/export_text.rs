//! Parts of texts that the exports of one robot and of a cell share.

use crate::figures::CALIBRATED;
use records::results::Status;

/// Formats a field of a CSV file, in quotes if necessary (RFC 4180).
#[must_use]
pub fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

/// Formats a row of a Markdown table.
pub(super) fn markdown_row<T: AsRef<str>>(cells: &[T]) -> String {
    let cells: Vec<_> = cells.iter().map(|cell| markdown_text(cell.as_ref().trim())).collect();
    format!("| {} |", cells.join(" | "))
}

/// Escapes the marks of calibrated figures, of which two would be emphasis.
pub(super) fn escaped_marks(text: &str) -> String {
    text.replace(CALIBRATED, "\\*")
}

/// Escapes a text of a user for Markdown: it is shown as it is, in one line.
pub(super) fn markdown_text(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for char in text.chars() {
        match char {
            '\\' | '`' | '*' | '_' | '[' | ']' | '<' | '>' | '|' | '~' | '&' | '#' => {
                escaped.extend(['\\', char])
            }
            char if char.is_control() => escaped.push(' '),
            char => escaped.push(char),
        }
    }
    escaped
}

/// Returns the remark on a run that did not complete.
pub(super) const fn unfinished(status: Status) -> &'static str {
    match status {
        Status::Complete => "",
        Status::Running => " (not finished)",
        Status::Failed => " (a repetition failed)",
        Status::Interrupted => " (interrupted)",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_title_is_text_in_markdown_whatever_it_contains() {
        assert_eq!(markdown_text("a *b* | [c](d) <e>\n# f_g"), r"a \*b\* \| \[c\](d) \<e\> \# f\_g");
        assert_eq!(markdown_row(&["3.5*", "a|b"]), r"| 3.5\* | a\|b |");
    }
}
