//! Units of execution times in tables of others, and which unit fits times that the setup lets expect.

/// Unit of a column of times.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum SampleUnit {
    /// Nanoseconds.
    Nanoseconds,
    /// Microseconds, as `SB_Core` counts.
    Microseconds,
    /// Milliseconds.
    Milliseconds,
    /// Seconds.
    Seconds,
}

impl SampleUnit {
    /// All units, the shortest first.
    pub const ALL: [Self; 4] = [Self::Nanoseconds, Self::Microseconds, Self::Milliseconds, Self::Seconds];

    /// Returns the name of the column that has times in this unit.
    #[must_use]
    pub const fn column(self) -> &'static str {
        match self {
            Self::Nanoseconds => "sample_ns",
            Self::Microseconds => "sample_us",
            Self::Milliseconds => "sample_ms",
            Self::Seconds => "sample_s",
        }
    }

    /// Returns how many ns the unit has.
    #[must_use]
    pub const fn nanos(self) -> f64 {
        match self {
            Self::Nanoseconds => 1.0,
            Self::Microseconds => 1e3,
            Self::Milliseconds => 1e6,
            Self::Seconds => 1e9,
        }
    }

    /// Returns what a time must be: not longer than UDINT holds in µs.
    pub(crate) const fn range(self) -> &'static str {
        match self {
            Self::Nanoseconds => "a time in ns, up to 4,294,967,295,000",
            Self::Microseconds => "a time in µs, up to 4,294,967,295",
            Self::Milliseconds => "a time in ms, up to 4,294,967.295",
            Self::Seconds => "a time in s, up to 4,294.967295",
        }
    }
}

/// A time that is another one by so much, up or down, is in another unit or of another application: the square root of the factor
/// between two units, rounded.
const FACTOR: f64 = 30.0;

/// Returns whether a time is of the magnitude of the expected one, in any unit.
#[must_use]
pub fn is_plausible(time: f64, expected: f64) -> bool {
    let ratio = time / expected;
    (1.0 / FACTOR..=FACTOR).contains(&ratio)
}

/// Returns the unit for a column whose times, read as `unit`, are implausible; `None` if they are implausible in each unit.
#[must_use]
pub fn fitting_unit(unit: SampleUnit, time: f64, expected: f64) -> Option<SampleUnit> {
    SampleUnit::ALL.into_iter().find(|other| is_plausible(time / unit.nanos() * other.nanos(), expected))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_in_another_unit_are_recognised_and_those_of_a_slow_or_fast_robot_are_not_taken_for_them() {
        use SampleUnit::{Microseconds, Milliseconds, Nanoseconds, Seconds};
        for (time, unit) in [(3.7, Milliseconds), (0.0037, Seconds), (3_700_000.0, Nanoseconds)] {
            assert!(!is_plausible(time, 3_700.0), "{time}");
            assert_eq!(fitting_unit(Microseconds, time, 3_700.0), Some(unit), "{time}");
        }
        // An override of 10 %, and one that is never there.
        assert!(is_plausible(37_000.0, 3_700.0) && is_plausible(370.0, 3_700.0));
        assert_eq!(fitting_unit(Milliseconds, 3_700_000.0, 3_700.0), Some(Microseconds));
        // Times of another application: too short even in the longest unit, and between the units where none fits.
        assert_eq!(fitting_unit(Seconds, 50.0, 3_700.0), None);
        assert!(
            (1.0 / FACTOR..FACTOR).contains(&(1_000.0 / FACTOR / FACTOR)),
            "units cover all between them"
        );
    }
}
