//! Why a motion is not planned: which quantity is beyond which limit.

use std::fmt;

use setup::Figure;

/// Which quantity of a motion is beyond which limit.
#[derive(Clone, PartialEq, Debug)]
pub enum Refusal {
    /// The motion ends where it begins.
    ZeroLength {
        /// Its length in mm.
        length_mm: f64,
    },
    /// A motion of a kind that has a direction ends at the point where it begins.
    TurnOnTheSpot {
        /// Distance from its start to its target, in mm.
        way_mm: f64,
    },
    /// A path only turns where its pre- or post-movement begins, so that this has no direction.
    NoDirection {
        /// `approach_mm` or `retreat_mm`.
        key: &'static str,
        /// Length of the path's motion there, in mm.
        length_mm: f64,
    },
    /// The three points of a circle lie on one line.
    Collinear {
        /// How far the intermediate point is off the line from start to end, in mm.
        off_mm: f64,
    },
    /// A speed or an acceleration is 0 or above the robot's.
    OutOfRange {
        /// Which one.
        quantity: &'static str,
        /// Its value, in `unit`.
        value: f64,
        /// The highest that is allowed, in `unit`.
        highest: f64,
        /// `mm/s`, `mm/s²` or `%`.
        unit: &'static str,
    },
    /// A force of nothing, or not a number.
    NoForce {
        /// The force in N.
        force_n: [f64; 3],
    },
    /// The robot has no such tool or base frame.
    UnknownFrame {
        /// `tool` or `base`.
        what: &'static str,
        /// Its number in the application.
        number: u8,
        /// The numbers that the setup has.
        known: Vec<u8>,
    },
    /// A target lies inside an obstacle.
    Enclosed {
        /// The frame or the motion whose target it is.
        target: String,
        /// The obstacle.
        obstacle: String,
        /// How deep inside it is, in mm.
        depth_mm: f64,
    },
    /// A way would begin or end nearer to an obstacle than allowed.
    TooNear {
        /// What lies too near.
        target: String,
        /// The obstacle.
        obstacle: String,
        /// How much of the distance is missing, in mm.
        missing_mm: f64,
        /// The distance that is to be kept, in mm.
        distance_mm: f64,
    },
    /// A path runs through an obstacle.
    Through {
        /// The obstacle.
        obstacle: String,
        /// How much of the path lies inside it, in mm.
        inside_mm: f64,
    },
    /// A path comes nearer to an obstacle than the clearance.
    PathTooNear {
        /// The obstacle.
        obstacle: String,
        /// How much of the path is nearer, in mm.
        near_mm: f64,
        /// The clearance of the application, in mm.
        clearance_mm: f64,
    },
    /// No way over the obstacles is free below the ceiling.
    NoWay {
        /// The obstacle in the way.
        obstacle: String,
        /// Its top, in mm.
        top_mm: f64,
        /// The height that would be free, in mm, if one is.
        needs_mm: Option<f64>,
        /// How much of a way at the ceiling is too near the obstacle, in mm.
        inside_mm: f64,
        /// The highest that is allowed, in mm.
        ceiling_mm: f64,
    },
}

/// Below this, in mm, a motion has no length and a point is on a line: the resolution of the wire's distances.
pub const LEAST_MM: f64 = 0.01;

/// Below this, in degrees, the tool does not turn.
pub(crate) const LEAST_TURN_DEG: f64 = 0.001;

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ZeroLength { length_mm } => write!(
                f,
                "its length is {length_mm:.3} mm and it does not turn; a motion needs at least {LEAST_MM} mm: \
                 remove it or move its frame"
            ),
            Self::TurnOnTheSpot { way_mm } => write!(
                f,
                "its target is {way_mm:.3} mm from its start, and a circle, a spline's piece or a press needs at least \
                 {LEAST_MM} mm: move its frame, or turn by a line, which may turn on the spot"
            ),
            Self::NoDirection { key, length_mm } => write!(
                f,
                "it turns over {length_mm:.3} mm, which gives {key} no direction; that needs at least {LEAST_MM} mm: \
                 remove {key} or move its frame"
            ),
            Self::Collinear { off_mm } => write!(
                f,
                "the intermediate point is {off_mm:.3} mm off the line from start to end; a circle needs at least \
                 {LEAST_MM} mm: use a line or move the point"
            ),
            Self::OutOfRange { quantity, value, highest, unit } => {
                let (value, highest) = (Figure(*value), Figure(*highest));
                write!(f, "the {quantity} is {value} {unit}; it must be above 0 and at most {highest} {unit}")
            }
            Self::NoForce { force_n: [x, y, z] } => {
                write!(f, "the force is ({x}, {y}, {z}) N; to press it must be finite and above 0 N")
            }
            Self::UnknownFrame { what, number, known } => {
                let known: Vec<String> = known.iter().map(u8::to_string).collect();
                write!(f, "the setup's robot has no {what} {number}; it has {}", known.join(", "))
            }
            Self::Enclosed { target, obstacle, depth_mm } => write!(
                f,
                "obstacle `{obstacle}` encloses {target}, {depth_mm:.1} mm deep; at most 0 mm are allowed: correct \
                 the frame or the obstacle"
            ),
            Self::TooNear { target, obstacle, missing_mm, distance_mm } => write!(
                f,
                "{target} lies {missing_mm:.1} mm too near obstacle `{obstacle}` to travel freely; {distance_mm:.1} mm \
                 are needed: move its frame or the obstacle, lengthen the step's approach_mm or retreat_mm, or lower \
                 clearance_mm"
            ),
            Self::Through { obstacle, inside_mm } => write!(
                f,
                "the path runs through obstacle `{obstacle}` for {inside_mm:.1} mm; 0 mm are allowed: correct the \
                 frames or the obstacle"
            ),
            Self::PathTooNear { obstacle, near_mm, clearance_mm } => write!(
                f,
                "the path comes nearer to obstacle `{obstacle}` than clearance_mm = {clearance_mm} for {near_mm:.1} mm \
                 (at a blend, half the approximation distance more): correct the frames or the obstacle, or lower \
                 clearance_mm"
            ),
            Self::NoWay { obstacle, top_mm, needs_mm, inside_mm, ceiling_mm } => {
                write!(f, "no way over obstacle `{obstacle}`, {top_mm:.1} mm high, is free: ")?;
                what_helps(f, *needs_mm, *inside_mm, *ceiling_mm)
            }
        }
    }
}

/// Writes what would make a way over an obstacle free.
fn what_helps(
    f: &mut fmt::Formatter<'_>,
    needs_mm: Option<f64>,
    inside_mm: f64,
    ceiling_mm: f64,
) -> fmt::Result {
    match needs_mm {
        Some(needs) => write!(
            f,
            "it needs a height of {needs:.1} mm, {:.1} mm above ceiling_mm = {ceiling_mm}: raise that, or move the \
             frames or the obstacle",
            needs - ceiling_mm
        ),
        None => write!(
            f,
            "no height helps; at ceiling_mm = {ceiling_mm} the way is too near for {inside_mm:.1} mm: move the frames \
             or lower clearance_mm"
        ),
    }
}
