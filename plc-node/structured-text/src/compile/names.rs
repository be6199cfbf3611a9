//! Names that a program cannot give.

use super::Compiler;
use crate::{Mistake, Place, Scalar};

/// Standard functions of IEC 61131-3, tables 22 to 36, beside the conversions; makers' compilers know them all.
const STANDARD: [&str; 53] = [
    "ABS", "SQRT", "LN", "LOG", "EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "ATAN2", "ADD", "MUL",
    "SUB", "DIV", "EXPT", "MOVE", "SHL", "SHR", "ROR", "ROL", "SEL", "MAX", "MIN", "LIMIT", "MUX", "GT",
    "GE", "EQ", "LE", "LT", "NE", "LEN", "LEFT", "RIGHT", "MID", "CONCAT", "INSERT", "DELETE", "REPLACE",
    "FIND", "TRUNC", "SR", "RS", "R_TRIG", "F_TRIG", "CTU", "CTD", "CTUD", "TP", "TON", "TOF",
];

impl Compiler {
    /// Checks a name that a type, function or function block is to have.
    pub(super) fn check_new(&self, name: &str, place: Place) -> Result<(), Mistake> {
        self.check_free(name, place, "is declared twice")
    }

    /// Checks the name of a variable.
    pub(super) fn check_variable(&self, name: &str, place: Place) -> Result<(), Mistake> {
        self.check_free(name, place, "is also a type or function; use another name")
    }

    fn check_free(&self, name: &str, place: Place, fault: &str) -> Result<(), Mistake> {
        check(name, place)?;
        let key = name.to_ascii_lowercase();
        if self.types.contains_key(&key) || self.unit_by_name.contains_key(&key) {
            return Err(Mistake::new(place, format!("`{name}` {fault}")));
        }
        Ok(())
    }
}

fn check(name: &str, place: Place) -> Result<(), Mistake> {
    let is_standard = STANDARD.iter().any(|standard| standard.eq_ignore_ascii_case(name));
    if Scalar::named(name).is_some() || is_standard || conversion(name).is_some() {
        return Err(Mistake::new(place, format!("`{name}` is a word of the language; use another name")));
    }
    Ok(())
}

/// Returns the types of a conversion's name: `UDINT_TO_REAL`.
pub(super) fn conversion(name: &str) -> Option<(Scalar, Scalar)> {
    let upper = name.to_ascii_uppercase();
    let (from, to) = upper.split_once("_TO_")?;
    Some((Scalar::named(from)?, Scalar::named(to)?))
}
