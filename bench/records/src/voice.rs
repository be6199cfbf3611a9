//! Lines for a person besides the display of a run.

use std::fmt;
use std::sync::Arc;

/// Prints lines besides the display of a run, wherever the display leaves room for them.
#[derive(Clone)]
pub struct Voice(Arc<dyn Fn(&str) + Send + Sync>);

impl Voice {
    /// Creates a voice that prints a line by this function.
    pub fn new(say: impl Fn(&str) + Send + Sync + 'static) -> Self {
        Self(Arc::new(say))
    }

    /// Prints a line.
    pub fn say(&self, line: &str) {
        (self.0)(line);
    }
}

impl fmt::Debug for Voice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Voice").finish_non_exhaustive()
    }
}
