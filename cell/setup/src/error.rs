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
        /// The line of the file, and below it one that points to the key if the key is one of several in the line.
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
        let span = source.span().unwrap_or_default();
        let before = text.get(..span.start).unwrap_or_default();
        let mut line = before.matches('\n').count() + 1;
        line += lines_to_unknown_field(text, line, source.message());
        let broken = text.lines().nth(line - 1).unwrap_or_default();
        let start_of_line = before.rfind('\n').map_or(0, |at| at + 1);
        Self::Format {
            origin: origin.to_owned(),
            line,
            text: broken.to_owned()
                + &mark_in_inline_table(broken, span.end.saturating_sub(start_of_line), &key),
            key: if key == "." { String::new() } else { key },
            expectation: source.message().to_owned(),
        }
    }
}

fn in_key(key: &str) -> String {
    if key.is_empty() { String::new() } else { format!("in `{key}`: ") }
}

/// Returns a line that points to the last part of the path `key` in an inline table, where it stands last before byte `end`
/// of the line.
fn mark_in_inline_table(line: &str, end: usize, key: &str) -> String {
    let name = key.rsplit('.').next().unwrap_or_default();
    let (Some(brace), Some(before_end)) = (line.find('{'), line.get(..end.min(line.len()))) else {
        return String::new();
    };
    let is_the_key = |at: &usize| {
        let before = line.get(..*at).unwrap_or_default().trim_end();
        let behind = line.get(at + name.len()..).unwrap_or_default().trim_start();
        *at > brace && before.ends_with(['{', ',']) && behind.starts_with('=')
    };
    let found = before_end.rmatch_indices(name).map(|(at, _)| at).find(is_the_key);
    found.filter(|_| !name.is_empty()).map_or_else(String::new, |at| {
        let column = line.get(..at).map_or(0, |before| before.chars().count());
        format!("\n      | {}{}", " ".repeat(column), "^".repeat(name.chars().count()))
    })
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
