//! What a person or another program gets to see.
//!
//! ```text
//! table      what is printed; quality is its second part, screen lays both out
//! progress   the live view
//! report     report.html of a run, and runs beside each other; html has what all pages share
//! export     the results once more, in the forms that other programs read
//! timeline   a trace as Perfetto opens it
//! playback   a trace as Foxglove and Rerun open it, where it is built in
//! exit       the exit codes
//! ```
//!
//! Here are `print!` and `println!` for a reader that may be gone; [`errln!`] is that of the nodes.
//! Words that are lost although somebody wants them, on a full disk for instance, are a failure: they were to be kept.

pub mod exit;
pub mod export;
pub(crate) mod html;
#[cfg(feature = "mcap")]
pub mod playback;
pub mod progress;
pub mod quality;
pub mod report;
pub(crate) mod screen;
pub mod table;
pub mod timeline;

use std::fmt::Arguments;
use std::process;

pub use node::errln;
use node::output;

use exit::Exit;

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
