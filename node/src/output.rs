//! Printing like `print!` and `eprintln!`, but to a reader that may be gone.
//!
//! A reader that closes its end of a pipe, as `head` does, wants no more output. That is no failure of a running
//! node, nor of a run whose results are saved.

use std::fmt::Arguments;
use std::io::{ErrorKind, Result, Write as _, stderr, stdout};

/// Prints like [`eprintln!`], without a panic if the reader is gone.
#[macro_export]
macro_rules! errln {
    ($($words:tt)*) => { $crate::output::to_stderr(format_args!($($words)*)) };
}

/// Writes to standard output.
///
/// # Errors
///
/// Writing failed although there is a reader, for example on a full disk.
pub fn to_stdout(words: Arguments<'_>) -> Result<()> {
    match stdout().write_fmt(words) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error),
        _ => Ok(()),
    }
}

/// Writes a line to standard error, for [`errln!`]. A failure cannot be reported to anybody.
pub fn to_stderr(words: Arguments<'_>) {
    let _ = writeln!(stderr(), "{words}");
}
