//! The command line, parsed.

use std::error::Error as _;
use std::ffi::OsString;
use std::io::IsTerminal as _;
use std::num::{IntErrorKind, ParseFloatError, ParseIntError};

use clap::error::{ContextKind, ErrorKind};
use clap::{Command, Error, Parser};

use crate::{output, screen};

/// Width of help where standard output is not a terminal and COLUMNS is not set, in characters.
const HELP_WIDTH: usize = 80;

/// Width of help on a wide terminal, in characters: longer lines are hard to read.
const WIDEST_HELP: usize = 100;

/// Parses the arguments of a program, its name first. Prints help, or what is wrong, and ends the program where there is
/// nothing to run.
pub fn parse<C: Parser>(arguments: impl IntoIterator<Item = OsString>) -> C {
    parse_with(arguments, |command| command)
}

/// Parses arguments like [`parse`], by a command line that `adapt` has changed for a reader.
pub fn parse_with<C: Parser>(
    arguments: impl IntoIterator<Item = OsString>,
    adapt: impl FnOnce(Command) -> Command,
) -> C {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let command =
        usage_within(within_terminal(adapt(numbers_may_be_negative(C::command()))), terminal_width());
    parsed(&command, &arguments).unwrap_or_else(|error| {
        // The parser repeats arguments as they are, and drops control characters without a word.
        let shown = |text: &OsString| OsString::from(output::shown(&text.to_string_lossy()));
        let shown: Vec<_> = arguments.iter().map(shown).collect();
        let error =
            if shown == arguments { error } else { parsed::<C>(&command, &shown).err().unwrap_or(error) };
        not_a_number(&error, command).unwrap_or(error).exit()
    })
}

fn parsed<C: Parser>(command: &Command, arguments: &[OsString]) -> Result<C, Error> {
    let mut matches = command.clone().try_get_matches_from(arguments)?;
    C::from_arg_matches_mut(&mut matches)
}

/// Makes the help of a command fit the terminal.
fn within_terminal(command: Command) -> Command {
    let has_width = std::io::stdout().is_terminal() || std::env::var_os("COLUMNS").is_some();
    if has_width { command.max_term_width(WIDEST_HELP) } else { command.term_width(HELP_WIDTH) }
}

/// Returns the width of the help in characters.
fn terminal_width() -> usize {
    if std::io::stdout().is_terminal() {
        return screen::text_width();
    }
    let columns = std::env::var("COLUMNS").ok().and_then(|columns| columns.parse().ok());
    columns.unwrap_or(HELP_WIDTH).min(WIDEST_HELP)
}

/// Breaks the usage of a command, and of those below it, into lines of at most `width` characters: the parser leaves it on one
/// line.
#[must_use]
pub fn usage_within(mut command: Command, width: usize) -> Command {
    // Only then do the commands below know the program's name.
    command.build();
    broken_usage(command, width)
}

fn broken_usage(mut command: Command, width: usize) -> Command {
    let usage = command.render_usage().to_string();
    if usage.lines().any(|line| line.chars().count() > width) {
        let lines: Vec<_> = usage.lines().map(|line| usage_line_within(line, width)).collect();
        command = command.override_usage(lines.join("\n").trim_start().to_owned());
    }
    command.mut_subcommands(|below| broken_usage(below, width))
}

/// Breaks a line of usage. An option stays beside its value.
fn usage_line_within(line: &str, width: usize) -> String {
    const HEADING: &str = "Usage: ";
    let text = line.strip_prefix(HEADING).unwrap_or(line).trim_start().replace(" <", "\u{A0}<");
    screen::wrapped_within(&text, HEADING.len(), HEADING.len() + 2, width).replace('\u{A0}', " ")
}

/// Returns the error for a value that is not a number in words: the parser's own say "invalid digit found in string".
fn not_a_number(error: &Error, mut command: Command) -> Option<Error> {
    let source = error.source()?;
    let expected = match source.downcast_ref::<ParseIntError>().map(ParseIntError::kind) {
        Some(IntErrorKind::PosOverflow | IntErrorKind::NegOverflow) => "the number is out of range",
        Some(_) => "expected a whole number",
        None if source.is::<ParseFloatError>() => "expected a number",
        None => return None,
    };
    let [option, value] = [ContextKind::InvalidArg, ContextKind::InvalidValue].map(|kind| error.get(kind));
    let text = format!("invalid value '{}' for '{}': {expected}", value?, option?);
    Some(command.error(ErrorKind::ValueValidation, text))
}

/// Makes `-1` the value of an option that takes one: it is refused as a number out of range then, and not as an unknown
/// option.
fn numbers_may_be_negative(command: Command) -> Command {
    command
        .mut_args(|arg| if arg.get_action().takes_values() { arg.allow_negative_numbers(true) } else { arg })
        .mut_subcommands(numbers_may_be_negative)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::not_a_number;

    #[derive(Parser, Debug)]
    struct Options {
        #[arg(long)]
        reps: Option<u32>,
        #[arg(long)]
        share: Option<f64>,
        #[arg(long)]
        port: Option<u16>,
    }

    #[test]
    fn a_value_that_is_not_a_number_is_refused_by_what_was_expected() {
        let said = |option: &str, value: &str| {
            let error = Options::try_parse_from(["bench", option, value]).unwrap_err();
            let command = <Options as clap::CommandFactory>::command();
            not_a_number(&error, command)
                .unwrap_or(error)
                .to_string()
                .lines()
                .next()
                .unwrap_or_default()
                .to_owned()
        };
        assert_eq!(
            said("--reps", "x"),
            "error: invalid value 'x' for '--reps <REPS>': expected a whole number"
        );
        assert_eq!(
            said("--reps", "2.5"),
            "error: invalid value '2.5' for '--reps <REPS>': expected a whole number"
        );
        assert_eq!(
            said("--share", "much"),
            "error: invalid value 'much' for '--share <SHARE>': expected a number"
        );
        // The range of a type is in the parser's own words.
        assert_eq!(
            said("--port", "70000"),
            "error: invalid value '70000' for '--port <PORT>': 70000 is not in 0..=65535"
        );
    }
}
