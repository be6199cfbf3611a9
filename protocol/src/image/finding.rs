//! The figures of an error: the quantity that is wrong and its limits.

use core::fmt;

use super::ErrorNumber;

/// The quantity that an [`ErrorNumber`] refers to: its value and the limits that it must keep.
///
/// What `index`, `value`, `lower` and `upper` mean follows from the number; [`Finding::in_words`] says it in words.
///
/// | error number | index | value | lower, upper |
/// |---|---|---|---|
/// | `AxisLimit` | joint, from 1 | where it would be, in degrees (mm) | its range |
/// | `Unreachable` | 1 | distance from axis 1 in mm | what the arm reaches |
/// | `Unreachable` | 2 | distance of the wrist centre from axis 2 in mm | what the arm reaches |
/// | `Unreachable` | 3 | tilt of the flange in degrees | 0, 0 |
/// | `Singular` | joint, from 1 | what it leaves of the programmed velocity | at least, 1 |
/// | `ConfigurationChange` | joint, from 1 | what it would turn at once, in degrees | −, at most |
/// | `ConfigurationMismatch` | joint, from 1 | where it would be, in degrees | its range |
/// | `ConfigurationMismatch` | 7 | status of the motion | 0, all bits that this arm has |
/// | `ConfigurationMismatch` | 8 | turn of the motion | 0, all bits that this arm has |
/// | `ConfigurationMismatch` | 9 | status that the line leads to | that of the motion, the same |
/// | `ConfigurationMismatch` | 10 | turn that the line leads to | that of the motion, the same |
/// | `ConfigurationMismatch` | 11 | | the target is joints |
/// | `VelocityOutOfRange` | | in mm/s, or the share of the rated speed | above 0, at most |
/// | `AccelerationOutOfRange` | | in mm/s², or the share of the rated one | above 0, at most |
/// | `DecelerationOutOfRange` | | in mm/s², or the share of the rated acceleration | above 0, at most |
/// | `JerkOutOfRange` | | in mm/s³, or the share of the rated one | above 0, at most |
/// | `ZeroLength` | | way in mm | at least, − |
/// | `CollinearCircle` | | intermediate point off the line in mm | at least, − |
/// | `TargetNotFinite` | coordinate, 1 to 6, of the auxiliary 7 to 9 | | |
/// | `UnknownTool`, `UnknownBase`, `UnknownMotionKind` | the number or kind | | |
/// | `OverrideOutOfRange` | | in % | 0, 100 |
/// | `ForceOutOfRange` | | in N | above 0, at most |
/// | `ForceDirection` | | angle between force and line in degrees | 0, at most |
/// | `ForceNotReached` | | found, in N | wanted in N, way along the line in mm |
/// | `ForceUnsteady` | | highest, in N | wanted in N, stiffest surface that the force controller is set for in N/mm |
/// | `NotOneMotion` | 1 `total`, 2 `written` | as commanded | 1, 1 |
/// | `JointSpeed`, `JointAcceleration`, `JointJerk` | joint, from 1 | in degrees (mm) and s | 0, what it is rated for |
/// | `TurnTooFast` | joint, from 1 | turn of the tool in degrees per s | 0, rated speed of the joint |
/// | `DriveFault` | axis, from 1 | error code of the drive, object 0x603F of CiA 402 | |
/// | `DriveStopped` | axis, from 1 | | |
/// | `FollowingError` | axis, from 1 | set-point minus actual position, in degrees (mm) | 0, following error window |
/// | `DriveNotArrived` | axis, from 1 | set-point minus actual position, in degrees (mm) | 0, window of the exact stop |
/// | `DriveNotOn` | axis, from 1; 0 without a connection to the drives | | |
/// | `PointHead` | 1 resolution, in µm; 2 coordinates; 3 content | as commanded | at least, at most |
/// | `PointHead` | 4: `COMPACT` is not set | | |
///
/// The figures are kept as their bits, so that findings can be compared and hashed.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Finding {
    /// Which joint, coordinate or number; 0 if there is only one.
    pub index: u8,
    value: u32,
    lower: u32,
    upper: u32,
}

impl Finding {
    /// No figures.
    pub const NONE: Self = Self { index: 0, value: 0, lower: 0, upper: 0 };

    /// Creates a finding of a value and its limits.
    #[must_use]
    pub const fn new(index: u8, value: f32, lower: f32, upper: f32) -> Self {
        Self { index, value: value.to_bits(), lower: lower.to_bits(), upper: upper.to_bits() }
    }

    /// Returns the value found.
    #[must_use]
    pub const fn value(self) -> f32 {
        f32::from_bits(self.value)
    }

    /// Returns the lower limit.
    #[must_use]
    pub const fn lower(self) -> f32 {
        f32::from_bits(self.lower)
    }

    /// Returns the upper limit.
    #[must_use]
    pub const fn upper(self) -> f32 {
        f32::from_bits(self.upper)
    }

    /// Combines the error number and its figures into text for a person.
    #[must_use]
    pub const fn in_words(self, number: ErrorNumber) -> InWords {
        InWords { number, finding: self }
    }
}

impl fmt::Debug for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Finding")
            .field("index", &self.index)
            .field("value", &self.value())
            .field("lower", &self.lower())
            .field("upper", &self.upper())
            .finish()
    }
}

/// An error number with its figures, as text; created by [`Finding::in_words`].
#[derive(Clone, Copy, Debug)]
pub struct InWords {
    number: ErrorNumber,
    finding: Finding,
}

impl fmt::Display for InWords {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { number, finding } = *self;
        write!(f, "{number}")?;
        if finding == Finding::NONE {
            return Ok(());
        }
        let (index, value, lower, upper) = (finding.index, finding.value(), finding.lower(), finding.upper());
        match number {
            ErrorNumber::DriveFault => write!(f, " (axis {index}, error code 0x{:04X})", value as u16),
            ErrorNumber::DriveStopped | ErrorNumber::DriveNotOn => write!(f, " (axis {index})"),
            ErrorNumber::FollowingError | ErrorNumber::DriveNotArrived => {
                write!(f, " (axis {index} is {value:.4} degrees or mm away, at most {upper} are allowed)")
            }
            ErrorNumber::AxisLimit => {
                write!(f, " (joint {index} would be at {value}, its range is {lower} to {upper})")
            }
            ErrorNumber::Unreachable => finding.write_unreachable(f),
            ErrorNumber::Singular => write!(
                f,
                " (joint {index} leaves {value} of the programmed velocity, at least {lower} must be left)"
            ),
            ErrorNumber::TurnTooFast => write!(
                f,
                " (the tool would turn at {value}° per s, joint {index} is rated for {upper}° per s)"
            ),
            ErrorNumber::ConfigurationChange => {
                write!(f, " (joint {index} would turn by {value}° at once, at most by {upper}°)")
            }
            ErrorNumber::ConfigurationMismatch => finding.write_configuration_mismatch(f),
            ErrorNumber::VelocityOutOfRange => finding.write_out_of_range(f, "mm/s"),
            ErrorNumber::AccelerationOutOfRange | ErrorNumber::DecelerationOutOfRange => {
                finding.write_out_of_range(f, "mm/s²")
            }
            ErrorNumber::JerkOutOfRange => finding.write_out_of_range(f, "mm/s³"),
            // The digits of a rounding error are not worth printing.
            ErrorNumber::ZeroLength => {
                write!(f, " (it is {value:.6} mm away, at least {lower} mm are a motion)")
            }
            ErrorNumber::CollinearCircle => {
                write!(f, " (the intermediate point is {value:.6} mm off it, at least {lower} mm are needed)")
            }
            ErrorNumber::TargetNotFinite => write!(f, " (coordinate {index} of target and auxiliary)"),
            ErrorNumber::UnknownTool | ErrorNumber::UnknownBase | ErrorNumber::UnknownMotionKind => {
                write!(f, " (number {index})")
            }
            ErrorNumber::OverrideOutOfRange => {
                write!(f, " (it is {value} %, allowed is {lower} to {upper} %)")
            }
            ErrorNumber::ForceOutOfRange => {
                write!(f, " (it is {value} N, allowed is above {lower} up to {upper} N)")
            }
            ErrorNumber::ForceDirection => {
                write!(f, " (it points {value}° away from the line, at most {upper}°)")
            }
            ErrorNumber::ForceNotReached => write!(f, " (found {value} N of {lower} N after {upper} mm)"),
            ErrorNumber::ForceUnsteady => write!(
                f,
                " (up to {value} N for {lower} N; the force controller is set for surfaces of up to {upper} N/mm)"
            ),
            ErrorNumber::NotOneMotion => {
                let field = if index == 1 { "total" } else { "written" };
                write!(f, " (`{field}` is {value})")
            }
            ErrorNumber::PointHead => match index {
                1 => write!(f, " (its resolution is {value} µm, allowed is {lower} to {upper} µm)"),
                2 => write!(f, " (it has {value} coordinates, allowed are {lower} and {upper})"),
                3 => write!(f, " (its content is {value}, only 0, positions, is known)"),
                _ => write!(f, " (control bit 8, COMPACT, is not set)"),
            },
            ErrorNumber::JointSpeed => finding.write_above_rating(f, "s"),
            ErrorNumber::JointAcceleration => finding.write_above_rating(f, "s²"),
            ErrorNumber::JointJerk => finding.write_above_rating(f, "s³"),
            _ => write!(f, " (it is {value}, allowed is {lower} to {upper})"),
        }
    }
}

// The texts that depend on the index, and those that differ from each other only by the unit.
impl Finding {
    fn write_unreachable(self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (value, lower, upper) = (self.value(), self.lower(), self.upper());
        match self.index {
            2 => write!(
                f,
                " (the wrist centre would be {value} mm from axis 2, reached are {lower} to {upper} mm)"
            ),
            3 => write!(f, " (the flange would be tilted by {value}°, which this arm cannot)"),
            _ => write!(f, " (it is {value} mm from axis 1, reached are {lower} to {upper} mm)"),
        }
    }

    fn write_configuration_mismatch(self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (index, value, lower, upper) = (self.index, self.value(), self.lower(), self.upper());
        match index {
            7 => write!(f, " (it has status {value}, this arm has only the bits of {upper})"),
            8 => write!(f, " (it has turn {value}, this arm has only the bits of {upper})"),
            9 => write!(f, " (it has status {lower}, the line leads to status {value})"),
            10 => write!(f, " (it has turn {lower}, the line leads to turn {value})"),
            11 => write!(f, " (a target of joints has none; leave it out)"),
            _ => write!(
                f,
                " (by its turn joint {index} would be at {value}, its range is {lower} to {upper}; change bit {} of the turn)",
                index.saturating_sub(1)
            ),
        }
    }

    /// Writes the limits of a motion's velocity, acceleration or jerk, in this unit.
    fn write_out_of_range(self, f: &mut fmt::Formatter<'_>, unit: &str) -> fmt::Result {
        let (value, lower, upper) = (self.value(), self.lower(), self.upper());
        write!(f, " (it is {value}, allowed is above {lower} up to {upper}: {unit}, for PTP 1 is rated)")
    }

    /// Writes the rating of a joint's speed, acceleration or jerk, per this power of a second.
    fn write_above_rating(self, f: &mut fmt::Formatter<'_>, per: &str) -> fmt::Result {
        let (index, value, upper) = (self.index, self.value(), self.upper());
        write!(f, " (joint {index}: {value} degrees or mm per {per}, it is rated for {upper})")
    }
}

#[cfg(test)]
mod tests {
    extern crate alloc;

    use super::*;
    use alloc::string::ToString;

    #[test]
    fn an_error_number_with_figures_is_a_sentence_and_without_figures_the_bare_error() {
        let axis = Finding::new(3, 176.0, 0.0, 175.5);
        assert_eq!(
            axis.in_words(ErrorNumber::AxisLimit).to_string(),
            "a joint would leave its range (joint 3 would be at 176, its range is 0 to 175.5)"
        );
        let number = ErrorNumber::ConnectionLost;
        assert_eq!(Finding::NONE.in_words(number).to_string(), number.to_string());
    }
}
