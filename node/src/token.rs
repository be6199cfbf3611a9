//! The secret that a controller and a node share: a controller that knows it may control the node.

use std::fmt;
use std::path::{Path, PathBuf};

/// Environment variable with the token, where no file is given.
pub const VARIABLE: &str = "SKILLBENCH_CONTROL_TOKEN";

/// Shortest token in bytes: a shorter one could be guessed.
const SHORTEST: usize = 16;

/// A token.
#[derive(Clone)]
pub struct ControlToken(String);

/// A token cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// Its file cannot be read.
    #[error("reading the control token from {}: {reason}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's error.
        reason: std::io::Error,
    },
    /// It is too short.
    #[error(
        "the control token has {0} characters: take {SHORTEST} or more, for example `head -c 24 /dev/urandom | base64`"
    )]
    Short(usize),
}

impl ControlToken {
    /// Returns the token in the first line of `file`, or in the environment; `None` if neither is given.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or the token is too short.
    pub fn find(file: Option<&Path>) -> Result<Option<Self>, TokenError> {
        let text = match file {
            Some(path) => Some(
                setup::read_plain_text(path)
                    .map_err(|reason| TokenError::Unreadable { path: path.to_owned(), reason })?,
            ),
            None => std::env::var(VARIABLE).ok(),
        };
        text.map(|text| Self::new(text.lines().next().unwrap_or_default())).transpose()
    }

    /// Creates a token with this text.
    ///
    /// # Errors
    ///
    /// It is too short.
    pub fn new(text: &str) -> Result<Self, TokenError> {
        let text = text.trim();
        if text.len() < SHORTEST {
            return Err(TokenError::Short(text.len()));
        }
        Ok(Self(text.to_owned()))
    }

    /// Returns the text, to send it to a node.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Returns whether a text is the token. The time that this takes depends on the length of the given text alone, so it
    /// does not reveal how many of its characters are right.
    #[must_use]
    pub fn is(&self, given: &str) -> bool {
        let own = self.0.as_bytes();
        let mut difference = u8::from(own.len() != given.len());
        for (index, byte) in given.bytes().enumerate() {
            let own = own.get(index % own.len()).copied().unwrap_or(0);
            difference = std::hint::black_box(difference | (own ^ byte));
        }
        difference == 0
    }
}

impl fmt::Debug for ControlToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ControlToken(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_known_by_every_byte_and_its_length_and_is_never_printed() {
        let token = ControlToken::new(" 0123456789abcdef\n").unwrap();
        assert!(token.is("0123456789abcdef"));
        for wrong in ["", "0", "0123456789abcdeF", "1123456789abcdef", "0123456789abcdef0123456789abcdef"] {
            assert!(!token.is(wrong), "{wrong}");
        }
        assert_eq!(format!("{token:?}"), "ControlToken(…)");
        assert!(matches!(ControlToken::new("0123456789abcde"), Err(TokenError::Short(15))));
    }

    #[test]
    fn a_token_file_that_is_not_there_is_named() {
        let error = ControlToken::find(Some(Path::new("/nowhere/token"))).unwrap_err().to_string();
        assert!(error.starts_with("reading the control token from /nowhere/token: "), "{error}");
    }
}
