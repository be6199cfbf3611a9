//! Mistakes of a program: those that the checker finds, and traps of its execution.

use core::fmt;

/// A place in a text, both counted from 1.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct Place {
    /// Line.
    pub line: u32,
    /// Column, in characters.
    pub column: u32,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.line, self.column)
    }
}

/// A mistake that was found before the execution.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Mistake {
    /// File of the text.
    pub file: String,
    /// Place of the mistake.
    pub place: Place,
    /// Description of the mistake.
    pub text: String,
}

impl Mistake {
    pub(crate) fn new(place: Place, text: impl Into<String>) -> Self {
        Self { file: String::new(), place, text: text.into() }
    }

    pub(crate) fn in_file(self, file: &str) -> Self {
        Self { file: file.into(), ..self }
    }
}

impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.place, self.text)
    }
}

impl core::error::Error for Mistake {}

/// What went wrong in an execution.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Trap {
    /// The result of an operation is outside its type.
    Overflow,
    /// The value does not fit the type that it is converted to.
    Narrowing,
    /// The divisor is 0.
    DivisionByZero,
    /// The index is outside the array.
    Index,
    /// The result of a REAL operation is infinite or not a number.
    NotFinite,
    /// The scan took more steps than its budget: a loop does not end.
    Steps,
    /// The step of a FOR is 0.
    StepOfZero,
}

impl fmt::Display for Trap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Overflow => "the result is outside its type; check the operands or use a larger type",
            Self::Narrowing => "the value does not fit the target type of the conversion; check it before",
            Self::DivisionByZero => "division by 0; check the divisor before",
            Self::Index => "the index is outside the array; check it before",
            Self::NotFinite => "the REAL result is infinite or not a number; check the operands",
            Self::Steps => "the scan exceeds its budget of steps; a loop does not end",
            Self::StepOfZero => "the step of FOR is 0; use 1 or -1",
        })
    }
}

/// A trap with its place.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct RunError {
    /// File of the text.
    pub file: String,
    /// Place of the statement or operation.
    pub place: Place,
    /// Scan in which it happened, from 1.
    pub scan: u64,
    /// The trap.
    pub trap: Trap,
}

impl fmt::Display for RunError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: scan {}: {}", self.file, self.place, self.scan, self.trap)
    }
}

impl core::error::Error for RunError {}
