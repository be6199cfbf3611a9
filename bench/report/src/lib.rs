//! Output of the bench, for people and for other programs.
//!
//! ```text
//! table      the printed table; figures are its first part, quality is its second
//! verdicts   how far a run is from the paper, and which of its claims it supports
//! progress   the lines of a run that is going on, on the terminal
//! live       the page of a run in progress, and its server
//! pages      report.html and race.html of a run, and comparisons of runs; html has what all pages share
//! export     the results in formats of other programs
//! timeline   a trace for Perfetto
//! playback   a trace for Foxglove and Rerun, if it is built in
//! cell_files both, of a cell with several stations; cell_table: its table; cell_export: other formats
//! ```
//!
//! This module has `print!` and `println!` for a reader that may be gone; [`errln!`] is the nodes'. Output that is lost
//! although there is a reader, for example on a full disk, is a failure, because it was meant to be kept.

mod cell_export;
pub mod cell_files;
pub mod cell_table;
pub mod export;
pub mod export_text;
pub mod figures;
pub mod html;
pub mod live;
pub mod pages;
#[cfg(feature = "mcap")]
pub mod playback;
pub mod progress;
pub mod quality;
pub mod table;
pub mod timeline;
pub mod verdicts;

use std::fmt::{Arguments, Display};
use std::process;

pub use node::errln;
use node::output;

use records::exit::Exit;

/// Prints like [`print!`], without a panic if the reader is gone.
#[macro_export]
macro_rules! out {
    ($($words:tt)*) => { $crate::to_stdout(format_args!($($words)*)) };
}

/// Prints like [`println!`], without a panic if the reader is gone.
#[macro_export]
macro_rules! outln {
    ($($words:tt)*) => { $crate::out!("{}\n", format_args!($($words)*)) };
}

/// Returns an argument as a shell takes it, for commands that a reader may copy.
#[must_use]
pub fn in_shell(argument: impl Display) -> String {
    let argument = argument.to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+,:@%".contains(c);
    if argument.chars().all(is_plain) {
        return argument;
    }
    format!("'{}'", argument.replace('\'', r"'\''"))
}

/// Writes to standard output, for [`out!`]. Ends the program if writing fails although there is a reader.
pub fn to_stdout(words: Arguments<'_>) {
    if let Err(error) = output::to_stdout(words) {
        errln!("error: cannot write to standard output: {error}");
        process::exit(Exit::Internal as i32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shown_command_can_be_pasted_wherever_the_cell_is() {
        assert_eq!(in_shell("cells/my-cell_1.toml"), "cells/my-cell_1.toml");
        assert_eq!(in_shell("my cell/setup.toml"), "'my cell/setup.toml'");
        assert_eq!(in_shell("it's $HOME"), r"'it'\''s $HOME'");
    }
}
