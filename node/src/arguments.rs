//! The command line, parsed.

use std::ffi::OsString;

use clap::{Command, Parser};

/// Parses the arguments of a program, its name first. Prints help, or what is wrong, and ends the program where there is
/// nothing to run.
pub fn parse<C: Parser>(arguments: impl IntoIterator<Item = OsString>) -> C {
    let parsed = numbers_may_be_negative(C::command()).try_get_matches_from(arguments);
    parsed.and_then(|mut matches| C::from_arg_matches_mut(&mut matches)).unwrap_or_else(|error| error.exit())
}

/// Makes `-1` the value of an option that takes one: it is refused as a number out of range then, and not as an unknown
/// option.
fn numbers_may_be_negative(command: Command) -> Command {
    command
        .mut_args(|arg| if arg.get_action().takes_values() { arg.allow_negative_numbers(true) } else { arg })
        .mut_subcommands(numbers_may_be_negative)
}
