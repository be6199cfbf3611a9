//! Lines of a file with their depth: what both printers write with.

use crate::form::{Expression, FormOperation};

/// A file of an export.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ExportFile {
    /// Its name.
    pub path: String,
    /// Its text.
    pub text: String,
}

/// Text under way.
#[derive(Default, Debug)]
pub(crate) struct PrintedLines {
    text: String,
    depth: usize,
}

impl PrintedLines {
    /// Adds a line.
    pub(crate) fn line(&mut self, line: impl AsRef<str>) {
        for _ in 0..self.depth {
            self.text.push_str("  ");
        }
        self.text.push_str(line.as_ref());
        self.text.push('\n');
    }

    /// Adds a line, and those that follow are one deeper.
    pub(crate) fn open(&mut self, line: impl AsRef<str>) {
        self.line(line);
        self.depth += 1;
    }

    /// Adds a line that is one less deep than those before it.
    pub(crate) fn close(&mut self, line: impl AsRef<str>) {
        self.depth = self.depth.saturating_sub(1);
        self.line(line);
    }

    /// Adds a line between two parts of a condition.
    pub(crate) fn middle(&mut self, line: impl AsRef<str>) {
        self.close(line);
        self.depth += 1;
    }

    /// Adds text as it is.
    pub(crate) fn text(&mut self, text: &str) {
        self.text.push_str(text);
    }

    pub(crate) fn finish(self) -> String {
        self.text
    }
}

/// A language's words for expressions.
pub(crate) trait Words {
    /// Name of a variable.
    fn name(&self, name: &str) -> String;
    /// A question to the controller.
    fn sense(&self, sense: crate::form::Sense) -> String;
    /// An operation on two operands, in parentheses.
    fn pair(&self, operation: FormOperation, one: &str, other: &str) -> String;

    /// Returns an expression as text.
    fn expression(&self, expression: &Expression) -> String {
        match expression {
            Expression::Number(number) if *number < 0 => format!("({number})"),
            Expression::Number(number) => number.to_string(),
            Expression::Truth(true) => "TRUE".into(),
            Expression::Truth(false) => "FALSE".into(),
            Expression::Value(name) => self.name(name),
            Expression::Pair(operation, one, other) => {
                self.pair(*operation, &self.expression(one), &self.expression(other))
            }
            Expression::Not(inner) => format!("(NOT {})", self.expression(inner)),
            Expression::Ask(sense) => self.sense(*sense),
        }
    }
}

/// Returns the sign of an operation that both languages write alike; none for those that they do not.
pub(crate) const fn sign(operation: FormOperation) -> Option<&'static str> {
    match operation {
        FormOperation::Add => Some("+"),
        FormOperation::Subtract => Some("-"),
        FormOperation::Unequal => Some("<>"),
        FormOperation::Less => Some("<"),
        FormOperation::Greater => Some(">"),
        FormOperation::And => Some("AND"),
        FormOperation::Or => Some("OR"),
        FormOperation::Equal
        | FormOperation::Divide
        | FormOperation::Modulo
        | FormOperation::BitAnd
        | FormOperation::BitXor => None,
    }
}

/// Returns a number as both languages take it: with a point and without an exponent.
pub(crate) fn real(value: f64) -> String {
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0');
    if text.ends_with('.') { format!("{text}0") } else { text.to_owned() }
}
