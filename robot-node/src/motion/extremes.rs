//! The larger and the smaller of two numbers, with one instruction, where `f64::max` and `f64::min` take five.

/// Returns the larger one, and `most` if the other is not a number.
#[inline]
pub(super) fn larger(most: f64, other: f64) -> f64 {
    if other > most { other } else { most }
}

/// Returns the smaller one, and `least` if the other is not a number.
#[inline]
pub(super) fn smaller(least: f64, other: f64) -> f64 {
    if other < least { other } else { least }
}
