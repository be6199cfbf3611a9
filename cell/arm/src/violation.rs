//! Why a motion cannot be run: the quantity, what it is and what it may be.
//!
//! The violations with their texts are one list; what the feedback image carries of them is in `feedback`.

mod feedback;

use core::fmt;

use protocol::image::{Configuration, ErrorNumber, Finding};

/// Largest turn of a joint, in degrees, from one sample of a curve's finest piece to the next. If a joint would turn
/// farther, the arm cannot follow the curve: it would turn over into another configuration there.
pub const TURNED_OVER_DEG: f64 = 60.0;

/// Share of the programmed velocity below which a curve counts as singular, if a joint leaves no more than that.
pub const SINGULAR_SHARE: f64 = 0.01;

/// Share of the programmed velocity below which the turn of the tool alone is the reason why a joint leaves no more than
/// [`SINGULAR_SHARE`]: a wrist that stands well turns about as fast as the tool, or a few times as fast.
pub const TURN_SHARE: f64 = 3.0 * SINGULAR_SHARE;

/// Length in mm below which a motion has no length: single precision on the wire causes some micrometres.
pub const LEAST_WAY_MM: f64 = 1e-3;

/// What an axis is rated for besides its range.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Rated {
    /// In degrees (mm) per second.
    Speed,
    /// In degrees (mm) per second².
    Acceleration,
    /// In degrees (mm) per second³.
    Jerk,
}

impl fmt::Display for Rated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Speed => "a speed",
            Self::Acceleration => "an acceleration",
            Self::Jerk => "a jerk",
        })
    }
}

/// A count of motions in the command image.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Count {
    /// All motions of the skill.
    Total,
    /// Motions written into the slots so far.
    Written,
}

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Total => "`total`",
            Self::Written => "`written`",
        })
    }
}

/// Why a motion or a skill cannot be run.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum Violation {
    /// A violation that its error number describes completely.
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
    /// Distance of an arm's wrist from the first axis, in mm, where the arm lies beside that axis.
    #[error(
        "the wrist would be {distance_mm:.3} mm from axis 1; the arm lies beside that axis and reaches from \
         {nearest_mm:.3} mm on"
    )]
    WristRadius {
        /// Its distance.
        distance_mm: f64,
        /// The least that the arm reaches.
        nearest_mm: f64,
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
    /// A status with bits that the arm does not have.
    #[error("the configuration has status {status}, this arm has only the bits of {bits}; clear the others")]
    Status {
        /// As programmed.
        status: u8,
        /// The bits that the arm has.
        bits: u8,
    },
    /// A turn with bits of axes that the arm does not have, or that are linear.
    #[error("the configuration has turn {turn}, this arm has only the bits of {bits}; clear the others")]
    TurnBits {
        /// As programmed.
        turn: u8,
        /// The bits that the arm has.
        bits: u8,
    },
    /// A turn that brings a joint out of its range. Degrees.
    #[error(
        "by the configuration's turn joint {axis} would be at {value:.3}, its range is {lower:.3} to {upper:.3}; \
         change bit {} of the turn",
        axis - 1
    )]
    Turn {
        /// Which joint, from 1.
        axis: u8,
        /// Value that it would have.
        value: f64,
        /// Its lowest value.
        lower: f64,
        /// Its highest value.
        upper: f64,
    },
    /// A path that ends in another configuration than its target has.
    #[error(
        "the configuration of the target is {wanted}, the line leads to {found}; go there point to point, or leave \
         the configuration out"
    )]
    OtherConfiguration {
        /// As programmed.
        wanted: Configuration,
        /// The one that the arm would have.
        found: Configuration,
    },
    /// A target of joints with a configuration.
    #[error("a target of joints has a configuration ({0}); leave it out")]
    NotCartesian(Configuration),
    /// A joint would leave its range. Degrees, mm on a linear joint.
    #[error("joint {axis} would be at {value:.3}{unit}, its range is {lower:.3} to {upper:.3}{unit}", unit = sign(*.rotary))]
    Axis {
        /// Which joint, from 1.
        axis: u8,
        /// Whether it turns; the other kind is linear.
        rotary: bool,
        /// Value that it would have.
        value: f64,
        /// Its lowest value.
        lower: f64,
        /// Its highest value.
        upper: f64,
    },
    /// The next robot cycle would exceed the rating of a joint: the plan is wrong, and the arm does not follow it.
    #[error(
        "joint {axis} would move at {rated} of {value:.3}, it is rated for {limit:.3} (degrees or mm, s)"
    )]
    Rated {
        /// Which joint, from 1.
        axis: u8,
        /// Which of its ratings.
        rated: Rated,
        /// Value that the cycle needs.
        value: f64,
        /// The joint's rating.
        limit: f64,
    },
    /// The path passes so close to a singular position that the arm could hardly move on it.
    #[error(
        "the path passes a singular position: joint {axis} would limit it to {share:.4} of the programmed velocity"
    )]
    Singular {
        /// Which joint, from 1.
        axis: u8,
        /// Share of the velocity that is left, 0…1.
        share: f64,
    },
    /// The tool turns so far on so short a way that no wrist could follow at nearly the programmed velocity, wherever the arm
    /// stands.
    #[error(
        "it turns the tool by {turn_deg:.1}° on {way_mm:.3} mm; at {speed_mm_s:.1} mm/s the wrist would need \
         {:.0} degrees per s, and joint {axis} is rated for {rated_deg_s:.0}; lower the speed to {slower_mm_s:.1} mm/s or \
         lengthen the motion",
        speed_mm_s * turn_deg / way_mm
    )]
    TurnTooFast {
        /// Which joint limits it most, from 1.
        axis: u8,
        /// How far the tool turns, in degrees.
        turn_deg: f64,
        /// The length of the motion, in mm.
        way_mm: f64,
        /// The programmed velocity, in mm/s.
        speed_mm_s: f64,
        /// The rated speed of the joint, in degrees per second.
        rated_deg_s: f64,
        /// The highest velocity with which the motion is not refused, as far as it was checked, in mm/s.
        slower_mm_s: f64,
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
    /// The tool frame's number.
    #[error("there is no tool {0}")]
    Tool(u8),
    /// The base frame's number.
    #[error("there is no base {0}")]
    Base(u8),
    /// The code of a motion kind.
    #[error("motion kind {0} is not one that this robot runs")]
    Kind(u8),
    /// An override above 100 %.
    #[error("the override is {percent} %, allowed is 0 to 100 %; the previous one stays in effect")]
    Override {
        /// As the PLC wrote it.
        percent: u8,
    },
    /// A count of a skill of one motion that is not 1.
    #[error("{field} is {value}: a skill of one motion needs 1")]
    NotOneMotion {
        /// Which count.
        field: Count,
        /// As the PLC wrote it.
        value: u32,
    },
    /// A head of compact points with a field that it cannot have.
    #[error("{}", .0.in_words(ErrorNumber::PointHead))]
    PointHead(Finding),
    /// A contact force to be reached, in N.
    #[error("the force is {value_n} N, allowed is above 0 up to {limit_n} N")]
    Force {
        /// As programmed.
        value_n: f64,
        /// The highest.
        limit_n: f64,
    },
    /// A contact force that does not point along its line.
    #[error("the force points {angle_deg:.1}° away from the line, allowed are {limit_deg}°")]
    ForceDirection {
        /// Between the two.
        angle_deg: f64,
        /// At most.
        limit_deg: f64,
    },
    /// An approach so fast that it would press too hard before it stops on the stiffest surface.
    #[error(
        "an approach at {value:.3} mm/s would press with more than {force_n} N before it stops on a surface of \
         {stiffness_n_per_mm} N/mm; at most {limit:.3} mm/s"
    )]
    Approach {
        /// As programmed, in mm/s.
        value: f64,
        /// The highest, in mm/s.
        limit: f64,
        /// The force to be reached.
        force_n: f64,
        /// Of the stiffest surface that the robot is set for.
        stiffness_n_per_mm: f64,
    },
    /// An end of the line was reached without the contact force: too little at its end, or too much at its start.
    #[error("found {found_n:.3} N of {wanted_n} N at an end of the line, after {way_mm:.3} mm")]
    ForceNotReached {
        /// The force there, in N.
        found_n: f64,
        /// The force to be reached, in N.
        wanted_n: f64,
        /// How far along the line that end is, in mm.
        way_mm: f64,
    },
    /// The contact force swings about the one to be reached.
    #[error(
        "the force swings up to {highest_n:.1} N about {wanted_n} N; the force controller is set for surfaces of up to \
         {stiffness_n_per_mm} N/mm"
    )]
    ForceUnsteady {
        /// The highest force, in N.
        highest_n: f64,
        /// The force to be reached, in N.
        wanted_n: f64,
        /// Of the stiffest surface that the robot is set for.
        stiffness_n_per_mm: f64,
    },
    /// A deceleration: mm/s², or a share of the axes' rated accelerations.
    #[error(
        "the deceleration is {value}, allowed is up to {limit} (mm/s²; for PTP 1 is the rated acceleration)"
    )]
    Deceleration {
        /// As programmed.
        value: f64,
        /// The highest.
        limit: f64,
    },
    /// A jerk: mm/s³, or a share of the axes' rated jerks.
    #[error("the jerk is {value}, allowed is up to {limit} (mm/s³; for PTP 1 is the rated one)")]
    Jerk {
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
    /// Returns how much of the arm's reach or of a joint's range is missing, with its unit; `None` for a violation of
    /// another kind.
    #[must_use]
    pub fn missing(&self) -> Option<(f64, &'static str)> {
        let beyond = |value: f64, lower: f64, upper: f64| (lower - value).max(value - upper);
        Some(match *self {
            Self::Radius { radius_mm, nearest_mm, farthest_mm } => {
                (beyond(radius_mm, nearest_mm, farthest_mm), "mm")
            }
            Self::WristReach { distance_mm, nearest_mm, farthest_mm } => {
                (beyond(distance_mm, nearest_mm, farthest_mm), "mm")
            }
            Self::WristRadius { distance_mm, nearest_mm } => (nearest_mm - distance_mm, "mm"),
            Self::Axis { rotary, value, lower, upper, .. } => {
                (beyond(value, lower, upper), if rotary { "degrees" } else { "mm" })
            }
            _ => return None,
        })
    }
}

/// Returns what stands behind the value of a joint.
const fn sign(rotary: bool) -> &'static str {
    if rotary { "°" } else { " mm" }
}

impl From<ErrorNumber> for Violation {
    fn from(number: ErrorNumber) -> Self {
        Self::Plain(number)
    }
}
