//! Options of several things on one command line: each begins with an argument of its own, and the options after it belong to it.

use std::ffi::OsString;

use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};

/// Options of one thing, such as a device by its file.
pub trait Grouped: Args {
    /// The argument with which a thing begins: its name in the struct.
    const FIRST: &'static str;
    /// The same as the user writes it.
    const WRITTEN: &'static str;
}

/// All things of the command line, in their order.
#[derive(Clone, Debug)]
pub struct Groups<G>(pub Vec<G>);

fn one<G: Grouped>() -> Command {
    G::augment_args(Command::new("one").no_binary_name(true).disable_help_flag(true))
}

fn takes_value(argument: &Arg) -> bool {
    matches!(argument.get_action(), ArgAction::Set | ArgAction::Append)
}

/// Words of one thing: its options, and then what stands without an option.
#[derive(Clone, Default)]
struct GroupWords {
    options: Vec<OsString>,
    plain: Vec<OsString>,
}

impl<G: Grouped> Args for Groups<G> {
    fn augment_args(command: Command) -> Command {
        let own = one::<G>();
        let arguments = own.get_arguments().cloned().map(|argument| {
            match (takes_value(&argument), argument.is_positional()) {
                (true, true) => argument.action(ArgAction::Append).num_args(1..),
                (true, false) => argument.action(ArgAction::Append),
                (false, _) => argument,
            }
        });
        command.args(arguments)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<G: Grouped> FromArgMatches for Groups<G> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let indices = |id: &str| matches.indices_of(id).into_iter().flatten();
        let starts: Vec<usize> = indices(G::FIRST).collect();
        let mut lines = vec![GroupWords::default(); starts.len()];
        let own = one::<G>();
        for argument in own.get_arguments() {
            let id = argument.get_id().as_str();
            let option = OsString::from(format!("--{}", argument.get_long().unwrap_or(id)));
            if !takes_value(argument) {
                if matches.get_flag(id) {
                    lines.iter_mut().for_each(|line| line.options.push(option.clone()));
                }
                continue;
            }
            let values = matches.get_raw(id).into_iter().flatten();
            for (index, value) in indices(id).zip(values) {
                let place = starts.iter().filter(|start| **start <= index).count();
                // With one thing the order does not matter.
                let line = match (place, lines.as_mut_slice()) {
                    (0, [line]) => line,
                    (0, _) => {
                        let (option, first) = (option.to_string_lossy(), G::WRITTEN);
                        return Err(refused(&format!(
                            "{option} in front of the first of several {first}: put it after the {first} that it is for"
                        )));
                    }
                    (place, lines) => match lines.get_mut(place - 1) {
                        Some(line) => line,
                        None => continue,
                    },
                };
                if argument.is_positional() {
                    line.plain.push(value.to_owned());
                    continue;
                }
                // A value may begin with a dash.
                let mut one = option.clone();
                one.push("=");
                one.push(value);
                line.options.push(one);
            }
        }
        let groups = lines.into_iter().map(|GroupWords { options, plain }| {
            let end_of_options = (!plain.is_empty()).then(|| OsString::from("--"));
            let words = options.into_iter().chain(end_of_options).chain(plain);
            let matched = own.clone().try_get_matches_from(words).map_err(|error| first_line(&error))?;
            G::from_arg_matches(&matched).map_err(|error| first_line(&error))
        });
        Ok(Self(groups.collect::<Result<_, _>>()?))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// Returns the error without the usage of one thing, which is not that of the command.
fn first_line(error: &clap::Error) -> clap::Error {
    let text = error.render().to_string();
    let first = text.lines().next().unwrap_or_default();
    refused(first.trim_start_matches("error: "))
}

fn refused(text: &str) -> clap::Error {
    clap::Error::raw(ErrorKind::ArgumentConflict, format!("{text}\n"))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Args, Clone, Debug, PartialEq)]
    struct Fruit {
        kind: String,
        #[arg(long)]
        colour: Option<String>,
        #[arg(long = "seed")]
        seeds: Vec<u8>,
    }

    impl Grouped for Fruit {
        const FIRST: &'static str = "kind";
        const WRITTEN: &'static str = "KIND";
    }

    #[derive(Parser)]
    struct FruitCommandLine {
        #[command(flatten)]
        fruits: Groups<Fruit>,
        #[arg(long)]
        run: bool,
    }

    fn parsed(line: &str) -> Result<Vec<Fruit>, String> {
        let words = std::iter::once("eat").chain(line.split_whitespace());
        FruitCommandLine::try_parse_from(words).map(|line| line.fruits.0).map_err(|error| error.to_string())
    }

    fn fruit(kind: &str, colour: Option<&str>, seeds: &[u8]) -> Fruit {
        Fruit { kind: kind.to_owned(), colour: colour.map(str::to_owned), seeds: seeds.to_vec() }
    }

    #[test]
    fn options_belong_to_the_word_in_front_of_them() {
        let line = "apple --colour red --seed 1 --run pear --seed 2 --seed 3 plum";
        let [apple, pear, plum] =
            [fruit("apple", Some("red"), &[1]), fruit("pear", None, &[2, 3]), fruit("plum", None, &[])];
        assert_eq!(parsed(line), Ok(vec![apple, pear, plum]));
        assert_eq!(parsed("--colour red apple"), Ok(vec![fruit("apple", Some("red"), &[])]));
    }

    #[test]
    fn options_of_nothing_and_those_that_one_thing_has_twice_are_refused() {
        let said = parsed("--colour red apple pear").unwrap_err();
        assert!(
            said.contains("--colour in front of the first of several KIND: put it after the KIND"),
            "{said}"
        );
        let said = parsed("apple --colour red --colour green").unwrap_err();
        assert!(said.contains("'--colour <COLOUR>' cannot be used multiple times"), "{said}");
        assert!(parsed("").is_err() && parsed("apple --seed many").is_err());
    }
}
