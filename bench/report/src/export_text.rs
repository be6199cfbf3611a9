//! Parts of texts that the exports of one robot and of a cell share.

use crate::figures::CALIBRATED;
use records::results::Status;

/// Formats a field of a CSV file, in quotes if necessary (RFC 4180).
pub(super) fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

/// Formats a row of a Markdown table.
pub(super) fn markdown_row<T: AsRef<str>>(cells: &[T]) -> String {
    let cells: Vec<_> = cells.iter().map(|cell| escaped_marks(cell.as_ref().trim())).collect();
    format!("| {} |", cells.join(" | "))
}

/// Escapes the marks of calibrated figures, of which two would be emphasis.
pub(super) fn escaped_marks(text: &str) -> String {
    text.replace(CALIBRATED, "\\*")
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
