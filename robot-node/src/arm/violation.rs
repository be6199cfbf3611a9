//! Why a motion cannot be run: the quantity, what it is and what it may be.

use protocol::image::ErrorNumber;

/// Why a motion or a skill cannot be run.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum Violation {
    /// The error number says everything.
    #[error("{0}")]
    Plain(ErrorNumber),
    /// A coordinate of the target (1 to 6) or of the auxiliary point or force (7 to 9).
    #[error("coordinate {0} of target and auxiliary is not a finite number")]
    NotFinite(u8),
    /// Distance of the target from the first axis, in mm.
    #[error(
        "the target is {radius_mm:.3} mm from axis 1; the arm reaches from {nearest_mm:.3} to {farthest_mm:.3} mm"
    )]
    Radius {
        /// Its distance.
        radius_mm: f64,
        /// The least that the arm reaches.
        nearest_mm: f64,
        /// The most that the arm reaches.
        farthest_mm: f64,
    },
    /// Distance of the wrist centre from the second axis of a six-axis arm, in mm.
    #[error(
        "the wrist centre would be {distance_mm:.3} mm from axis 2; the arm reaches from {nearest_mm:.3} to \
         {farthest_mm:.3} mm"
    )]
    WristReach {
        /// Its distance.
        distance_mm: f64,
        /// The least that the arm reaches.
        nearest_mm: f64,
        /// The most that the arm reaches.
        farthest_mm: f64,
    },
    /// A line on which the arm would have to turn over into another configuration (elbow, wrist).
    #[error(
        "the line needs another configuration (elbow, wrist) from {way:.1} of its {length:.1} mm on: joint {axis} \
         would turn by {turn_deg:.1}° at once; go there point to point"
    )]
    Configuration {
        /// Which joint turns most, from 1.
        axis: u8,
        /// How far it would turn.
        turn_deg: f64,
        /// Where on the line, in mm; where the tool only turns, in degrees.
        way: f64,
        /// The line's length, in mm; where the tool only turns, in degrees.
        length: f64,
    },
    /// An arm that holds its tool upright was asked to tilt it.
    #[error(
        "the flange would be tilted by {tilt_deg:.3}° from straight down; this arm cannot tilt it (c = 180)"
    )]
    Tilt {
        /// The tilt from straight down.
        tilt_deg: f64,
    },
    /// A joint would leave its range. Degrees, mm on a linear joint.
    #[error("joint {axis} would be at {value:.3}, its range is {lower:.3} to {upper:.3}")]
    Axis {
        /// Which joint, from 1.
        axis: u8,
        /// Where it would be.
        value: f64,
        /// Its lowest value.
        lower: f64,
        /// Its highest value.
        upper: f64,
    },
    /// The path passes so close to a singular position that the arm could hardly move on it.
    #[error(
        "the path passes a singular position: joint {axis} would limit it to {share:.4} of the programmed velocity"
    )]
    Singular {
        /// Which joint, from 1.
        axis: u8,
        /// What is left of the velocity, 0…1.
        share: f64,
    },
    /// The target is where the motion starts.
    #[error("the target is {way_mm:.4} mm from the start; a motion along a path is at least 0.001 mm long")]
    ZeroLength {
        /// How far it is, in mm.
        way_mm: f64,
    },
    /// No circle through three points on one line.
    #[error(
        "the intermediate point is {offset_mm:.4} mm off the line from start to target; a circle needs {least_mm} mm"
    )]
    Collinear {
        /// How far it is off the line, in mm.
        offset_mm: f64,
        /// How far it must be at least, in mm.
        least_mm: f64,
    },
    /// A velocity: mm/s, or a share of the axes' rated speeds.
    #[error("the velocity is {value}, allowed is above 0 up to {limit} (mm/s; for PTP 1 is the rated speed)")]
    Velocity {
        /// As programmed.
        value: f64,
        /// The highest.
        limit: f64,
    },
    /// An acceleration: mm/s², or a share of the axes' rated accelerations.
    #[error(
        "the acceleration is {value}, allowed is above 0 up to {limit} (mm/s²; for PTP 1 is the rated one)"
    )]
    Acceleration {
        /// As programmed.
        value: f64,
        /// The highest.
        limit: f64,
    },
}

impl Violation {
    /// The number that the feedback image carries for it.
    #[must_use]
    pub const fn number(&self) -> ErrorNumber {
        match self {
            Self::Plain(number) => *number,
            Self::NotFinite(_) => ErrorNumber::TargetNotFinite,
            Self::Radius { .. } | Self::WristReach { .. } | Self::Tilt { .. } => ErrorNumber::Unreachable,
            Self::Configuration { .. } => ErrorNumber::ConfigurationChange,
            Self::Axis { .. } => ErrorNumber::AxisLimit,
            Self::Singular { .. } => ErrorNumber::Singular,
            Self::ZeroLength { .. } => ErrorNumber::ZeroLength,
            Self::Collinear { .. } => ErrorNumber::CollinearCircle,
            Self::Velocity { .. } => ErrorNumber::VelocityOutOfRange,
            Self::Acceleration { .. } => ErrorNumber::AccelerationOutOfRange,
        }
    }
}

impl From<ErrorNumber> for Violation {
    fn from(number: ErrorNumber) -> Self {
        Self::Plain(number)
    }
}
