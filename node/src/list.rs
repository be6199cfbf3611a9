//! Options with several values.

use std::fmt::Display;
use std::str::FromStr;

/// Values in one argument, separated by commas, blanks or both.
///
/// An option of type `Vec<List<T>>` with `num_args = 1..` takes `1,2`, `1 2`, `1, 2` and `"1 2"` alike; [`flat`] returns
/// its values.
#[derive(Clone, PartialEq, Debug)]
pub struct List<T>(Vec<T>);

impl<T: FromStr<Err: Display>> FromStr for List<T> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        list(str::parse)(text)
    }
}

/// Returns a parser of arguments whose values `value` parses. An argument without a value is refused: it mostly is an
/// empty variable of a shell, and not the wish for none.
pub fn list<T, E: Display>(
    value: impl Fn(&str) -> Result<T, E> + Clone,
) -> impl Fn(&str) -> Result<List<T>, String> + Clone {
    move |text| {
        let parsed = values(text).map(|one| value(one).map_err(|error| error.to_string()));
        let parsed: Vec<T> = parsed.collect::<Result<_, _>>()?;
        if parsed.is_empty() {
            return Err("it holds no value; leave the option out for its default".to_owned());
        }
        Ok(List(parsed))
    }
}

/// Returns the values of all arguments.
#[must_use]
pub fn flat<T: Clone>(arguments: &[List<T>]) -> Vec<T> {
    arguments.iter().flat_map(|List(values)| values.iter().cloned()).collect()
}

/// Splits an argument into its values.
pub fn values(text: &str) -> impl Iterator<Item = &str> {
    text.split([',', ' ', '\t', '\n']).filter(|value| !value.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commas_and_blanks_separate_alike() {
        for arguments in [&["1,2"][..], &["1 2"], &["1, 2"], &["1,", "2"], &["1", "2"], &["1", ",2 "]] {
            let lists: Vec<List<u8>> = arguments.iter().map(|argument| argument.parse().unwrap()).collect();
            assert_eq!(flat(&lists), [1, 2], "{arguments:?}");
        }
    }

    #[test]
    fn an_argument_without_a_value_is_refused() {
        for argument in ["", " ", ",", " , "] {
            let error = argument.parse::<List<u8>>().unwrap_err();
            assert_eq!(error, "it holds no value; leave the option out for its default", "{argument:?}");
        }
    }
}
