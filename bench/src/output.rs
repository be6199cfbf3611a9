//! `print!` and `println!` for a reader that may be gone; [`errln!`] is that of the nodes.
//!
//! Words that are lost although somebody wants them, on a full disk for instance, are a failure: they were to be kept.

use std::fmt::Arguments;
use std::process;

pub use protocol_linux::errln;
use protocol_linux::output;

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

/// What [`out!`] does. Ends the program where the words cannot be written although somebody wants them.
pub fn to_stdout(words: Arguments<'_>) {
    if let Err(error) = output::to_stdout(words) {
        errln!("error: cannot write to standard output: {error}");
        process::exit(Exit::Internal as i32);
    }
}
