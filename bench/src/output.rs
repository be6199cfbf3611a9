//! `print!`, `println!` and `eprintln!` for a reader that may be gone.
//!
//! Who closes the other end of a pipe, as `head` does, wants no more; that is no failure of a run whose results are saved.
//! Words that are lost otherwise, on a full disk for instance, are one: they were to be kept.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write as _, stderr, stdout};
use std::process;

use crate::exit::Exit;

/// As [`print!`], and no panic where nobody reads any more.
#[macro_export]
macro_rules! out {
    ($($words:tt)*) => { $crate::output::to_stdout(format_args!($($words)*)) };
}

/// As [`println!`], and no panic where nobody reads any more.
#[macro_export]
macro_rules! outln {
    ($($words:tt)*) => { $crate::out!("{}\n", format_args!($($words)*)) };
}

/// As [`eprintln!`], and no panic where nobody reads any more.
#[macro_export]
macro_rules! errln {
    ($($words:tt)*) => { $crate::output::to_stderr(format_args!($($words)*)) };
}

/// What [`out!`] does. Ends the program where the words cannot be written although somebody wants them.
pub fn to_stdout(words: Arguments<'_>) {
    match stdout().write_fmt(words) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            to_stderr(format_args!("error: cannot write to standard output: {error}"));
            process::exit(Exit::Internal as i32);
        }
        _ => {}
    }
}

/// What [`errln!`] does, with a line. Nobody could be told that it failed.
pub fn to_stderr(words: Arguments<'_>) {
    let _ = writeln!(stderr(), "{words}");
}
