//! Faults of a file: where they are, what was found and what to do.

use std::fmt::Display;

use serde::Serialize;

/// Fault at a place of a file.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, thiserror::Error)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[error("{line}: {element}: {fault}")]
pub struct FileFault {
    /// Line, from 1; 0 for the file as a whole.
    pub line: usize,
    /// Element of an XML file, or section and entry of an EDS.
    pub element: String,
    /// Value found and remedy.
    pub fault: String,
}

impl FileFault {
    pub(crate) fn new(line: usize, element: impl Into<String>, fault: impl Display) -> Self {
        Self { line, element: element.into(), fault: fault.to_string() }
    }

    /// Returns a fault of the file as a whole.
    pub(crate) fn of_file(fault: impl Display) -> Self {
        Self::new(0, "file", fault)
    }
}

/// Reason why a file is refused.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{file}:{finding}")]
pub struct ReadError {
    /// Name of the file, as the caller gave it.
    pub file: String,
    /// Fault.
    pub finding: FileFault,
}

/// Shortens a value of a file for a message, and replaces what a terminal would not print.
#[must_use]
pub fn excerpt(value: &str) -> String {
    shortened(value, 48)
}

/// Replaces what a terminal would not print in a text of any length.
#[must_use]
pub fn without_controls(text: &str) -> String {
    text.chars().map(shown).collect()
}

/// Returns whether a terminal shows the character and does nothing else: neither a control character (C0, DEL, C1) nor one that changes
/// the writing direction or is invisible.
#[must_use]
pub fn is_printable(letter: char) -> bool {
    let is_hidden = matches!(
        letter,
        '\u{200B}'..='\u{200F}' | '\u{2028}'..='\u{202E}' | '\u{2060}'..='\u{2069}' | '\u{FEFF}'
    );
    !(letter.is_control() || is_hidden)
}

fn shown(letter: char) -> char {
    if is_printable(letter) { letter } else { char::REPLACEMENT_CHARACTER }
}

/// Shortens a value that the user is to type to so many characters, and replaces what a terminal would not print.
pub(crate) fn shortened(value: &str, most: usize) -> String {
    let mut short: String = value.chars().take(most).map(shown).collect();
    if value.chars().nth(most).is_some() {
        short.push('…');
    }
    short
}
