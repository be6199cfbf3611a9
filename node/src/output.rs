//! What `print!` and `eprintln!` do, for a reader that may be gone.
//!
//! Who closes the other end of a pipe, as `head` does, wants no more; that is no failure of a node that runs, or of a run
//! whose results are saved.

use std::fmt::Arguments;
use std::io::{ErrorKind, Result, Write as _, stderr, stdout};

/// As [`eprintln!`], and no panic where nobody reads any more.
#[macro_export]
macro_rules! errln {
    ($($words:tt)*) => { $crate::output::to_stderr(format_args!($($words)*)) };
}

/// Writes to standard output.
///
/// # Errors
///
/// The words cannot be written although somebody wants them, on a full disk for instance.
pub fn to_stdout(words: Arguments<'_>) -> Result<()> {
    match stdout().write_fmt(words) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error),
        _ => Ok(()),
    }
}

/// What [`errln!`] does: writes a line to standard error. Nobody could be told that it failed.
pub fn to_stderr(words: Arguments<'_>) {
    let _ = writeln!(stderr(), "{words}");
}
