//! A row of a trace: one cycle of a node as a line of text, written by the node's process and read by the bench.
//!
//! A row starts with the time of the cycle in ns of the node's clock; the columns of the node's sample follow. The type of
//! the sample alone knows its columns: it names, writes and reads them.

use std::fmt::{Debug, Write as _};
use std::str::{FromStr, Split};

use machine::Instant;

/// What a node did in one cycle, as columns of a table.
pub trait TraceSample: Copy + Debug + Send + 'static {
    /// Names of the columns, with units, separated by commas.
    const COLUMNS: &'static str;

    /// The last of these columns, with a comma in front, that older versions did not write.
    const ADDED: &'static str = "";

    /// Appends the columns to a line, separated by commas.
    fn write(&self, line: &mut String);

    /// Reads the columns; `None` if one is missing or has a wrong value.
    fn read(fields: &mut Fields<'_>) -> Option<Self>;
}

/// The fields of a line, separated by commas.
#[derive(Clone, Debug)]
pub struct Fields<'a>(Split<'a, char>);

impl<'a> Fields<'a> {
    /// Returns the fields of a line.
    #[must_use]
    pub fn of(line: &'a str) -> Self {
        Self(line.split(','))
    }

    /// Returns the next field as text.
    pub fn text(&mut self) -> Option<&'a str> {
        self.0.next()
    }

    /// Parses the next field.
    pub fn value<T: FromStr>(&mut self) -> Option<T> {
        self.text()?.parse().ok()
    }

    /// Reads a sample, which must take all fields that are left.
    pub fn sample<S: TraceSample>(mut self) -> Option<S> {
        let sample = S::read(&mut self)?;
        self.text().is_none().then_some(sample)
    }
}

/// Appends a row, without a newline.
pub fn write_row<S: TraceSample>(at: Instant, sample: &S, line: &mut String) {
    let _ = write!(line, "{},", at.as_nanos());
    sample.write(line);
}

/// Reads the rows that a node wrote. A last line without a newline is left out: a killed node did not finish it.
///
/// # Errors
///
/// The number of the first line that is not a row, counted from 1.
pub fn read_rows<S: TraceSample>(text: &str) -> Result<Vec<(Instant, S)>, usize> {
    let complete = text.rsplit_once('\n').map_or("", |(complete, _)| complete);
    let row = |line| {
        let mut fields = Fields::of(line);
        Some((Instant::from_nanos(fields.value()?), fields.sample()?))
    };
    complete.lines().enumerate().map(|(index, line)| row(line).ok_or(index + 1)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Copy, PartialEq, Debug)]
    struct Count(u32);

    impl TraceSample for Count {
        const COLUMNS: &'static str = "count";

        fn write(&self, line: &mut String) {
            let _ = write!(line, "{}", self.0);
        }

        fn read(fields: &mut Fields<'_>) -> Option<Self> {
            fields.value().map(Self)
        }
    }

    #[test]
    fn rows_are_read_as_they_were_written_and_a_line_that_was_not_finished_is_left_out() {
        let mut line = String::new();
        write_row(Instant::from_nanos(7), &Count(3), &mut line);
        let rows = |text: &str| read_rows::<Count>(text);
        assert_eq!(
            rows(&format!("{line}\n9,4\n11,5")),
            Ok(vec![(Instant::from_nanos(7), Count(3)), (Instant::from_nanos(9), Count(4))])
        );
        assert_eq!(rows(""), Ok(Vec::new()));
        assert_eq!(rows("7,3\n9,4,1\n"), Err(2), "a column too many");
        assert_eq!(rows("7,-3\n"), Err(1));
    }
}
