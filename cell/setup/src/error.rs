//! Why a setup cannot be used: what was read, what was found, what would be correct.

use std::fmt;
use std::path::PathBuf;

use crate::exact::OF_INTEGERS;
use crate::nearest;

/// Why a setup cannot be used, or an application's file cannot be found.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The name is neither a built-in one nor a file.
    #[error("there is no {what} `{name}`: {}built in are {}; or give the path of a .toml file", did_you_mean(name, known), known.join(", "))]
    Unknown {
        /// "setup" or "application".
        what: &'static str,
        /// The given name.
        name: String,
        /// The built-in names.
        known: Vec<&'static str>,
    },
    /// The file cannot be read.
    #[error("cannot read the {what} file {}: {reason}", path.display())]
    Unreadable {
        /// "setup" or "application".
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's error.
        reason: std::io::Error,
    },
    /// The file is not a text of this program.
    #[error("{}: {problem}", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// What it is, and what it should be.
        problem: String,
    },
    /// The text does not have the expected format.
    #[error("{origin}:{line}: {}{expectation}\n{line:>5} | {text}", in_key(key))]
    Format {
        /// The file, or the name of a built-in one.
        origin: String,
        /// Line, counted from 1.
        line: usize,
        /// Path of the key; empty if the text is not TOML.
        key: String,
        /// What was found and what was expected.
        expectation: String,
        /// The line of the file, and below it one that points to the key if the key is one of several in the line.
        text: String,
    },
    /// The text is well formed, but a value makes no sense.
    #[error("{origin}: `{key}`: {problem}")]
    Value {
        /// The file, or the name of a built-in one.
        origin: String,
        /// Path of the key.
        key: String,
        /// What is wrong, and what would be correct.
        problem: String,
    },
    /// A setup of several stations, where one station is served.
    #[error(
        "{origin} has {} stations ({}), and one is served here; for several: bench --mode virtual, bench gate, bench study, plc-node, \
         plc-node plan --setup, robot-node --station NAME",
        stations.len(), stations.join(", ")
    )]
    Several {
        /// The file, or the name of a built-in one.
        origin: String,
        /// The names of its stations.
        stations: Vec<String>,
    },
    /// A setup cannot be written as TOML.
    #[error("cannot write the setup as TOML: {0}")]
    Write(toml::ser::Error),
}

// Not `#[from]`, which would also make it the source: then it would be printed twice.
impl From<toml::ser::Error> for Error {
    fn from(reason: toml::ser::Error) -> Self {
        Self::Write(reason)
    }
}

impl Error {
    pub(crate) fn format(origin: &str, text: &str, key: String, source: &toml::de::Error) -> Self {
        let key = path(&key);
        let span = source.span().unwrap_or_default();
        let before = text.get(..span.start).unwrap_or_default();
        let mut line = before.matches('\n').count() + 1;
        line += lines_to_unknown_field(text, line, source.message());
        let broken = text.lines().nth(line - 1).unwrap_or_default();
        let start_of_line = before.rfind('\n').map_or(0, |at| at + 1);
        Self::Format {
            origin: origin.to_owned(),
            line,
            text: broken.to_owned()
                + &mark_in_inline_table(broken, span.end.saturating_sub(start_of_line), &key),
            expectation: brackets(source.message(), broken, before)
                .or_else(|| bare_address(broken))
                .unwrap_or_else(|| {
                    in_words(source.message())
                        + &decimal_comma(source.message(), text.get(span.clone()).unwrap_or_default())
                }),
            key,
        }
    }
}

/// Returns the advice for a table whose header has a bracket too few or too many; `line` is its line, `before` the text before it.
fn brackets(message: &str, line: &str, before: &str) -> Option<String> {
    let header = line.trim_start();
    let name = header.trim_start_matches('[').split(']').next().unwrap_or_default().trim();
    let is_list = header.starts_with("[[");
    if !header.starts_with('[') || name.is_empty() {
        return None;
    }
    if message.starts_with("duplicate key") {
        let is_the_other = |line: &str| line.trim_start().starts_with(&format!("[{name}]"));
        let other = before.lines().position(|line| is_list && is_the_other(line))? + 1;
        return Some(format!(
            "`[{name}]` in line {other} begins a single table: write `[[{name}]]` there too"
        ));
    }
    match (message.strip_prefix("invalid type: ")?.split_once(", expected ")?, is_list) {
        (("map", "a sequence"), false) => {
            Some(format!("`[{name}]` is a single table, expected a list of them: write `[[{name}]]`"))
        }
        (("sequence", _), true) => {
            Some(format!("`[[{name}]]` begins a list, expected a single table: write `[{name}]`"))
        }
        _ => None,
    }
}

/// Returns the advice for a line whose value is an IP address without quotes.
fn bare_address(line: &str) -> Option<String> {
    let (key, value) = line.split_once('=')?;
    let value = value.split('#').next()?.trim();
    let (address, _) = value.split_once('/').unwrap_or((value, ""));
    let _: std::net::Ipv4Addr = address.parse().ok()?;
    Some(format!("{value} is a text: write `{} = \"{value}\"`", key.trim()))
}

/// Returns the beginning of an answer if one of the known names was probably meant.
fn did_you_mean(name: &str, known: &[&str]) -> String {
    nearest(name, known.iter().copied()).map_or_else(String::new, |meant| format!("did you mean `{meant}`? "))
}

/// Returns what an unknown key or value was probably meant to be, if the message lists those that are known.
fn meant(message: &str) -> Option<String> {
    let (found, expected) = message.strip_prefix("unknown ")?.split_once(", expected ")?;
    let found = found.split('`').nth(1)?;
    let meant = nearest(found, expected.split('`').skip(1).step_by(2))?;
    let what = if message.starts_with("unknown field") { "key" } else { "value" };
    Some(format!("unknown {what} `{found}`: did you mean `{meant}`?"))
}

/// A number of a file as an error shows it: with an exponent where its digits would hide the rest of the sentence.
#[derive(Clone, Copy, Debug)]
pub struct Figure(pub f64);

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(value) = self;
        let is_short = *value == 0.0 || !value.is_finite() || (1e-9..1e12).contains(&value.abs());
        if is_short { write!(f, "{value}") } else { write!(f, "{value:e}") }
    }
}

/// Returns the error in a name or title that contains a control character; none if it has none.
#[must_use]
pub fn control_character(text: &str) -> Option<String> {
    let found = text.chars().find(|character| character.is_control())?;
    Some(format!("has the control character U+{:04X}; names and titles are printable text", found as u32))
}

/// Returns a message of the TOML parser in the words of the documentation: the parser's own are those of Rust.
fn in_words(message: &str) -> String {
    const BEGINNINGS: [(&str, &str); 10] = [
        ("unknown field ", "unknown key "),
        ("missing field ", "missing key "),
        ("unknown variant ", "unknown value "),
        ("invalid type: floating point ", "invalid type: number "),
        ("invalid value: floating point ", "invalid value: number "),
        ("invalid type: string ", "invalid type: text "),
        ("invalid type: sequence", "invalid type: list"),
        ("invalid type: map", "invalid type: table"),
        ("invalid IPv4 address syntax", "not an IPv4 address: expected four numbers of 0 to 255"),
        ("wanted exactly 1 element, more than 1 element", "invalid table: more than one key, expected one"),
    ];
    const EXPECTED: [(&str, &str); 6] = [
        ("f64", "a number"),
        ("u8", "an integer, 0 to 255"),
        ("u16", "an integer, 0 to 65535"),
        ("u32", "an integer, 0 to 4294967295"),
        ("u64", "an integer, 0 or more"),
        ("i8", "an integer, -128 to 127"),
    ];
    if let Some((found, expected)) = lengths(message) {
        return format!("found {found} numbers, expected {expected}");
    }
    if let Some(meant) = meant(message) {
        return meant;
    }
    let begun = BEGINNINGS.iter().find_map(|(theirs, ours)| Some((message.strip_prefix(theirs)?, ours)));
    let message = begun.map_or_else(|| message.to_owned(), |(rest, ours)| format!("{ours}{rest}"));
    let Some((found, expected)) = message.rsplit_once(", expected ") else { return message };
    let ours = EXPECTED.iter().find(|(theirs, _)| *theirs == expected).map_or(expected, |(_, ours)| ours);
    let found = found.strip_suffix(" as i128").unwrap_or(found);
    let number = found.strip_suffix('`').and_then(|found| found.rsplit_once('`'));
    match number.and_then(|(kind, number)| Some((kind, number.parse().ok()?))) {
        Some((kind, number)) => format!("{kind}`{}`, expected {ours}", Figure(number)),
        None => format!("{found}, expected {ours}"),
    }
}

/// Returns the lengths of a list in a message of the parser, found and expected: all lists of fixed length are of numbers.
fn lengths(message: &str) -> Option<(usize, usize)> {
    let (found, expected) = message.strip_prefix("invalid length ")?.split_once(", expected ")?;
    let expected = expected
        .strip_prefix("an array of length ")
        .or_else(|| expected.strip_suffix(" elements in sequence"))?;
    let expected = expected.strip_suffix(OF_INTEGERS).unwrap_or(expected);
    Some((found.parse().ok()?, expected.parse().ok()?))
}

/// Returns how the first number with a decimal comma should be written, if a list has too many numbers because of such commas.
fn decimal_comma(message: &str, list: &str) -> String {
    match lengths(message) {
        Some((found, expected)) if found > expected && !message.ends_with(OF_INTEGERS) => {
            with_points(list, expected).unwrap_or_default()
        }
        _ => String::new(),
    }
}

/// Returns the advice for a list that has the `expected` numbers if each comma between two whole numbers without a space is a
/// decimal one. In `1,2,3,4` for three numbers none is: there is a number too many.
fn with_points(list: &str, expected: usize) -> Option<String> {
    let is_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let lines = list.lines().map(|line| line.split('#').next().unwrap_or_default());
    let text = lines.collect::<Vec<_>>().join("\n");
    let elements = text.trim_matches(['[', ']']).trim_end().trim_end_matches(',').split(',');
    // Elements that only commas without a space join.
    let mut groups: Vec<Vec<&str>> = Vec::new();
    for element in elements {
        let is_whole = |before: &&str| is_digits(before.trim_start().trim_start_matches('-'));
        let is_joined = groups.last().and_then(|group| group.last()).is_some_and(is_whole);
        match groups.last_mut() {
            Some(group) if is_joined && is_digits(element.trim_end()) => group.push(element),
            _ => groups.push(vec![element]),
        }
    }
    let numbers: usize = groups.iter().map(|group| group.len().div_ceil(2)).sum();
    let is_in_pairs = groups.iter().all(|group| group.len() == 1 || group.len() % 2 == 0);
    let decimal = groups.iter().find(|group| group.len() > 1)?;
    let (&[whole, fraction, ..], true) = (decimal.as_slice(), is_in_pairs && numbers == expected) else {
        return None;
    };
    let (whole, fraction) = (whole.trim(), fraction.trim());
    Some(format!("; write {whole}.{fraction}, not {whole},{fraction}"))
}

/// Returns the path of a key as a user would write it; empty if there is none.
fn path(key: &str) -> String {
    // What the parser keeps beside a value to know its place.
    const PLACE: &str = ".$__serde_spanned_private_value";
    if key == "." { String::new() } else { key.replace(PLACE, "") }
}

fn in_key(key: &str) -> String {
    if key.is_empty() { String::new() } else { format!("in `{key}`: ") }
}

/// Returns a line that points to the last part of the path `key` in an inline table, where it stands last before byte `end`
/// of the line.
fn mark_in_inline_table(line: &str, end: usize, key: &str) -> String {
    let name = key.rsplit('.').next().unwrap_or_default();
    let (Some(brace), Some(before_end)) = (line.find('{'), line.get(..end.min(line.len()))) else {
        return String::new();
    };
    let is_the_key = |at: &usize| {
        let before = line.get(..*at).unwrap_or_default().trim_end();
        let behind = line.get(at + name.len()..).unwrap_or_default().trim_start();
        *at > brace && before.ends_with(['{', ',']) && behind.starts_with('=')
    };
    let found = before_end.rmatch_indices(name).map(|(at, _)| at).find(is_the_key);
    found.filter(|_| !name.is_empty()).map_or_else(String::new, |at| {
        let column = line.get(..at).map_or(0, |before| before.chars().count());
        format!("\n      | {}{}", " ".repeat(column), "^".repeat(name.chars().count()))
    })
}

/// Returns how many lines below the reported one the unknown key is: if `kind` selects the table's format, the parser
/// reports the line of the table's header.
fn lines_to_unknown_field(text: &str, line: usize, message: &str) -> usize {
    let name = message.strip_prefix("unknown field `").and_then(|rest| rest.split('`').next());
    let Some(name) = name else { return 0 };
    let is_its_line = |text: &str| {
        text.trim_start().strip_prefix(name).is_some_and(|rest| rest.trim_start().starts_with('='))
    };
    text.lines().skip(line - 1).position(is_its_line).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::{decimal_comma, in_words};

    #[test]
    fn the_first_decimal_comma_of_a_list_with_too_many_numbers_is_written_as_it_should_be() {
        let advice = |list| decimal_comma("invalid length 4, expected an array of length 3", list);
        assert_eq!(advice("[7, -50,25, 1,5]"), "; write -50.25, not -50,25");
        assert_eq!(advice("[\n  7,\n  0,5,\n  1,\n]"), "; write 0.5, not 0,5");
        assert_eq!(advice("[15,0,-50,5,0,0]"), "; write 15.0, not 15,0");
        assert_eq!(advice("[ # 1,2\n 7,5, # 3,4\n 8, 9]"), "; write 7.5, not 7,5", "comments are no numbers");
        assert_eq!(advice("[7, 8, 9, 10]"), "");
        assert_eq!(advice("[7,8,9,10]"), "", "a number too many, without spaces");
        assert_eq!(advice("[7,8,9, 10]"), "");
        let integers = "invalid length 4, expected an array of length 3 of integers";
        assert_eq!(decimal_comma(integers, "[1,2, 3, 4]"), "", "an integer has no decimals");
        assert_eq!(advice("[7.5,8.5, 9.0, 10.0]"), "", "both are numbers with a point");
        let short = decimal_comma("invalid length 2, expected an array of length 3", "[7,5]");
        assert_eq!(short, "", "a list that is too short has no number too many");
    }

    #[test]
    fn the_parsers_messages_have_the_words_of_the_documentation() {
        let cases = [
            (
                "invalid type: string \"70 mm\", expected f64",
                "invalid type: text \"70 mm\", expected a number",
            ),
            (
                "invalid value: integer `-1`, expected u8",
                "invalid value: integer `-1`, expected an integer, 0 to 255",
            ),
            (
                "invalid type: integer `9` as i128, expected f64",
                "invalid type: integer `9`, expected a number",
            ),
            ("invalid length 5, expected an array of length 6", "found 5 numbers, expected 6"),
            ("invalid length 9, expected an array of length 3", "found 9 numbers, expected 3"),
            ("unknown field `u8`, expected `a` or `b`", "unknown key `u8`, expected `a` or `b`"),
            ("missing field `from`", "missing key `from`"),
            (
                &format!("invalid type: floating point `{}`, expected u32", 1e308),
                "invalid type: number `1e308`, expected an integer, 0 to 4294967295",
            ),
            ("invalid basic string, expected `\"`", "invalid basic string, expected `\"`"),
        ];
        for (theirs, ours) in cases {
            assert_eq!(in_words(theirs), ours);
        }
    }
}
