//! Errors in the values of a setup, by their keys.

/// A key and the error in its value.
#[derive(Debug)]
pub(crate) struct Problem {
    pub(crate) key: String,
    pub(crate) text: String,
}

pub(crate) type Check = Result<(), Problem>;

pub(crate) fn problem(key: impl Into<String>, text: impl Into<String>) -> Problem {
    Problem { key: key.into(), text: text.into() }
}
