//! Printing like `print!` and `eprintln!`, but to a reader that may be gone.
//!
//! A reader that closes its end of a pipe, as `head` does, wants no more output. That is no failure of a running
//! node, nor of a run whose results are saved.
//!
//! Names and texts come from files and peers. A control character in them could move the cursor, hide lines or answer
//! for the user, so each is shown as `\u001b` and none is sent. The form is also valid in a JSON string.

use std::fmt::{self, Arguments, Write as _};
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
    match stdout().write_fmt(format_args!("{}", EscapedArguments(words))) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error),
        _ => Ok(()),
    }
}

/// Writes a line to standard error, for [`errln!`]. A failure cannot be reported to anybody.
pub fn to_stderr(words: Arguments<'_>) {
    let _ = writeln!(stderr(), "{}", EscapedArguments(words));
}

/// Text with its control characters escaped, except line ends and tabs.
struct EscapedArguments<'a>(Arguments<'a>);

impl fmt::Display for EscapedArguments<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Escaping(f).write_fmt(self.0)
    }
}

/// Writes text to a formatter, and escapes what a terminal would act on.
struct Escaping<'a, 'b>(&'a mut fmt::Formatter<'b>);

impl fmt::Write for Escaping<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let mut rest = text;
        while let Some((at, char)) = rest.char_indices().find(|(_, char)| !is_harmless(*char)) {
            let (plain, from) = rest.split_at(at);
            write!(self.0, "{plain}\\u{:04x}", u32::from(char))?;
            rest = from.get(char.len_utf8()..).unwrap_or_default();
        }
        self.0.write_str(rest)
    }
}

/// Returns whether a terminal only shows the character, or goes to the next line or tab stop.
fn is_harmless(char: char) -> bool {
    matches!(char, '\n' | '\t') || device_files::is_printable(char)
}

/// Returns a text as it may be shown on a terminal: each other character is escaped.
#[must_use]
pub fn shown(text: &str) -> String {
    EscapedArguments(format_args!("{text}")).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_of_a_foreign_text_are_shown_and_not_sent() {
        assert_eq!(shown("a\x1b[2Jb\x07\r\n\tc"), "a\\u001b[2Jb\\u0007\\u000d\n\tc");
        assert_eq!(shown("\u{9b}31m\u{202e}x\u{feff}"), "\\u009b31m\\u202ex\\ufeff");
        assert_eq!(shown("Förderband · 3 µs − ✓"), "Förderband · 3 µs − ✓");
    }

    #[test]
    fn an_escaped_json_string_is_still_the_same_string() {
        let text = "a\u{9b}31m\u{202e}b\x7f";
        let json = shown(&serde_json::to_string(text).unwrap());
        assert!(json.chars().all(is_harmless));
        assert_eq!(serde_json::from_str::<String>(&json).unwrap(), text);
    }
}
