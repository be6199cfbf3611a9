//! Why a setup cannot be used: what was read, what was found, what would be correct.

use std::path::PathBuf;

/// Why a setup cannot be used, or an application's file cannot be found.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The name is neither a built-in one nor a file.
    #[error("there is no {what} `{name}`: built in are {}; or give the path of a .toml file", known.join(", "))]
    Unknown {
        /// "setup" or "application".
        what: &'static str,
        /// The given name.
        name: String,
        /// The built-in names.
        known: Vec<&'static str>,
    },
    /// The file cannot be read.
    #[error("cannot read the {what} file {}: {reason}", path.display())]
    Unreadable {
        /// "setup" or "application".
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's error.
        reason: std::io::Error,
    },
    /// The text does not have the expected format.
    #[error("{origin}:{line}: {}{expectation}\n{line:>5} | {text}", in_key(key))]
    Format {
        /// The file, or the name of a built-in one.
        origin: String,
        /// Line, counted from 1.
        line: usize,
        /// Path of the key; empty if the text is not TOML.
        key: String,
        /// What was found and what was expected.
        expectation: String,
        /// The line of the file.
        text: String,
    },
    /// The text is well formed, but a value makes no sense.
    #[error("{origin}: `{key}`: {problem}")]
    Value {
        /// The file, or the name of a built-in one.
        origin: String,
        /// Path of the key.
        key: String,
        /// What is wrong, and what would be correct.
        problem: String,
    },
    /// A setup cannot be written as TOML.
    #[error("cannot write the setup as TOML: {0}")]
    Write(toml::ser::Error),
}

// Not `#[from]`, which would also make it the source: then it would be printed twice.
impl From<toml::ser::Error> for Error {
    fn from(reason: toml::ser::Error) -> Self {
        Self::Write(reason)
    }
}

impl Error {
    pub(crate) fn format(origin: &str, text: &str, key: String, source: &toml::de::Error) -> Self {
        let offset = source.span().map_or(0, |span| span.start).min(text.len());
        let before = text.get(..offset).unwrap_or_default();
        let mut line = before.matches('\n').count() + 1;
        line += lines_to_unknown_field(text, line, source.message());
        Self::Format {
            origin: origin.to_owned(),
            line,
            key: if key == "." { String::new() } else { key },
            expectation: source.message().to_owned(),
            text: text.lines().nth(line - 1).unwrap_or_default().to_owned(),
        }
    }
}

fn in_key(key: &str) -> String {
    if key.is_empty() { String::new() } else { format!("in `{key}`: ") }
}

/// Returns how many lines below the reported one the unknown key is: if `kind` selects the table's format, the parser
/// reports the line of the table's header.
fn lines_to_unknown_field(text: &str, line: usize, message: &str) -> usize {
    let name = message.strip_prefix("unknown field `").and_then(|rest| rest.split('`').next());
    let Some(name) = name else { return 0 };
    let is_its_line = |text: &str| {
        text.trim_start().strip_prefix(name).is_some_and(|rest| rest.trim_start().starts_with('='))
    };
    text.lines().skip(line - 1).position(is_its_line).unwrap_or(0)
}
