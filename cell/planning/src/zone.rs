//! Step IV: how large each blend is, and why.

use std::fmt;

use protocol::image::PathForm;

use crate::geometry::Point;
use crate::motion::{Motion, Role};

/// Largest difference of directions in degrees that count as the same: over a zone of 100 mm the path moves by less than
/// the wire's 0.01 mm.
const COLLINEAR_DEG: f64 = 0.01;

/// Largest difference of directions in degrees that count as tangent: frames taught to a tenth of a millimetre differ by
/// as much.
pub(crate) const TANGENT_DEG: f64 = 0.5;

/// The smallest zone that the wire carries, in mm.
pub(crate) const LEAST_ZONE_MM: f64 = 0.01;

/// The reason for something in a plan.
#[derive(Clone, PartialEq, Debug)]
pub enum Why {
    /// No zone: labelled *accurate stop*, and what happens there.
    AccurateStop {
        /// The action at the stop.
        then: Option<String>,
    },
    /// No zone: the arm waits at a mark.
    Mark {
        /// Number of the first mark there.
        mark: u32,
    },
    /// No zone: the motion ends in contact.
    Contact,
    /// No zone: the motions after this one were refused.
    LastGood,
    /// The full approximation distance.
    Blending,
    /// No zone: the setup or the application programs none.
    NoApproximation,
    /// Less than the approximation distance, as one of both motions is too short for it. A warning.
    Shrunk {
        /// The approximation distance in mm.
        wanted_mm: f64,
        /// Index of the motion that is short.
        short: usize,
    },
    /// A zone on an accurate path that does not leave it, as both motions go straight in one direction: nothing is
    /// rounded, the robot only does not stop.
    Collinear {
        /// Whether the zone is half of a short motion; as nothing is rounded, that is no warning.
        halved: bool,
    },
    /// A zone on an accurate path no larger than the path's tolerance: both motions touch in one direction.
    Tangent,
    /// A zone that only says that there is no stop: the spline passes through the point.
    SplinePoint,
    /// No zone where an accurate path begins or ends.
    PathEnd {
        /// Angle of the corner in degrees, where both directions are known.
        corner_deg: Option<f64>,
    },
    /// No zone within an accurate path, which so stops at a corner. A warning.
    PathCorner {
        /// Angle of the corner in degrees, where both directions are known.
        corner_deg: Option<f64>,
    },
    /// An intermediate position: not a zone but a point.
    Over {
        /// The obstacle.
        obstacle: String,
        /// Its top in mm.
        top_mm: f64,
        /// The raster of heights in mm, on which it is the lowest that is free.
        step_mm: f64,
        /// Whether another way of the cycle has it too.
        again: bool,
    },
    /// The zone reaches beyond the intermediate point of a circle, so that the tool does not pass it. A warning.
    SwallowsPoint {
        /// Index of the circle.
        circle: usize,
        /// How far the intermediate point is from the corner, in mm.
        distance_mm: f64,
    },
    /// The setup's programmed speed is below what the step allows. A warning.
    Slower {
        /// What the step names, in mm/s.
        wanted_mm_s: f64,
        /// What the setup programs, in mm/s.
        programmed_mm_s: f64,
    },
}

impl Why {
    /// Returns whether a person should look at it.
    #[must_use]
    pub const fn is_warning(&self) -> bool {
        matches!(
            self,
            Self::Shrunk { .. } | Self::PathCorner { .. } | Self::SwallowsPoint { .. } | Self::Slower { .. }
        )
    }

    /// Returns whether it is the reason for the size of a zone; every motion has exactly one such reason.
    #[must_use]
    pub const fn is_of_zone(&self) -> bool {
        !matches!(self, Self::Over { .. } | Self::SwallowsPoint { .. } | Self::Slower { .. })
    }
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let corner = |f: &mut fmt::Formatter<'_>, angle: &Option<f64>| match angle {
            Some(angle) => write!(f, "a corner of {angle:.0}°"),
            None => f.write_str("the direction depends on the arm"),
        };
        match self {
            Self::AccurateStop { then: Some(then) } => write!(f, "{then} happens here"),
            Self::AccurateStop { then: None } => f.write_str("stops exactly"),
            Self::Mark { mark } => write!(f, "waits at mark {mark}"),
            Self::Contact => f.write_str("ends in contact"),
            Self::LastGood => f.write_str("the last motion before one that was refused"),
            Self::Blending => f.write_str("the approximation distance"),
            Self::NoApproximation => f.write_str("the approximation distance is 0"),
            Self::Shrunk { wanted_mm, .. } => {
                write!(f, "{wanted_mm} mm wanted: half of a short motion")
            }
            Self::Collinear { halved: false } => {
                f.write_str("the next motion continues straight, so blending stays on the path")
            }
            Self::Collinear { halved: true } => f.write_str(
                "the next motion continues straight, so blending stays on the path; half of a short motion",
            ),
            Self::Tangent => f.write_str("smooth: within path_tolerance_mm"),
            Self::SplinePoint => f.write_str("the spline passes through the point"),
            Self::PathEnd { corner_deg } => {
                f.write_str("no blending: ")?;
                corner(f, corner_deg)
            }
            Self::PathCorner { corner_deg } => {
                f.write_str("stops on the path: ")?;
                corner(f, corner_deg)
            }
            Self::Over { obstacle, top_mm, again: true, .. } => {
                write!(
                    f,
                    "over `{obstacle}`, {top_mm:.0} mm high, by the intermediate position of the way before"
                )
            }
            Self::Over { obstacle, top_mm, step_mm, again: false } => {
                write!(
                    f,
                    "over `{obstacle}`, {top_mm:.0} mm high: the lowest free height in steps of {step_mm} mm"
                )
            }
            Self::SwallowsPoint { distance_mm, .. } => write!(
                f,
                "the zone reaches beyond the intermediate point of the circle, {distance_mm:.2} mm away, so that the \
                 tool does not pass it: lower approximation_mm or move the point"
            ),
            Self::Slower { wanted_mm_s, programmed_mm_s } => {
                write!(f, "the step allows {wanted_mm_s} mm/s, the setup programs {programmed_mm_s} mm/s")
            }
        }
    }
}

/// Returns the circle whose intermediate point lies within the zone at a junction: motion number `index` or the next one.
pub(crate) fn swallowed_point(index: usize, motion: &Motion, next: &Motion, zone_mm: f64) -> Option<Why> {
    let corner = motion.target.point;
    [(index, motion), (index + 1, next)].into_iter().find_map(|(circle, motion)| {
        let distance_mm = (Point::from(motion.auxiliary) - corner).length();
        let is_swallowed = motion.kind.path() == Some(PathForm::Circle) && distance_mm <= zone_mm;
        is_swallowed.then_some(Why::SwallowsPoint { circle, distance_mm })
    })
}

/// The rules by which the zones of an application on a setup get their size.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sizes {
    /// The approximation distance in mm.
    pub(crate) approximation_mm: f64,
    /// Largest deviation from an accurate path where it continues smoothly, in mm.
    pub(crate) path_tolerance_mm: f64,
}

impl Sizes {
    /// Returns the zone in mm between motion number `index` and the next one of its continuous motion, with the reason.
    pub(crate) fn zone(&self, index: usize, motion: &Motion, next: &Motion) -> (f64, Why) {
        if motion.kind.has_force() {
            return (0.0, Why::Contact);
        }
        let within_a_path = motion.role == Role::Path && next.role == Role::Path && motion.step == next.step;
        if within_a_path && [motion, next].iter().all(|it| it.kind.path() == Some(PathForm::Spline)) {
            return (self.path_tolerance_mm.max(LEAST_ZONE_MM), Why::SplinePoint);
        }
        if motion.accurate_path || next.accurate_path {
            return self.on_an_accurate_path(index, motion, next, within_a_path);
        }
        self.blend(index, motion, next)
    }

    fn on_an_accurate_path(
        &self,
        index: usize,
        motion: &Motion,
        next: &Motion,
        within_a_path: bool,
    ) -> (f64, Why) {
        let corner_deg = match (motion.arrives, next.leaves) {
            (Some(arrives), Some(leaves)) => Some(arrives.angle_deg(leaves)),
            _ => None,
        };
        match corner_deg {
            Some(angle) if angle < COLLINEAR_DEG && motion.keeps_straight() && next.keeps_straight() => {
                return match self.blend(index, motion, next) {
                    (zone, Why::Shrunk { .. }) => (zone, Why::Collinear { halved: true }),
                    (zone, Why::Blending) => (zone, Why::Collinear { halved: false }),
                    other => other,
                };
            }
            Some(angle) if angle < TANGENT_DEG && self.path_tolerance_mm >= LEAST_ZONE_MM => {
                let zone = self.path_tolerance_mm.min(motion.length_mm / 2.0).min(next.length_mm / 2.0);
                return (zone, Why::Tangent);
            }
            _ => {}
        }
        (0.0, if within_a_path { Why::PathCorner { corner_deg } } else { Why::PathEnd { corner_deg } })
    }

    /// Returns the approximation distance, but at most half of either motion.
    fn blend(&self, index: usize, motion: &Motion, next: &Motion) -> (f64, Why) {
        let wanted_mm = self.approximation_mm;
        if wanted_mm < LEAST_ZONE_MM {
            return (0.0, Why::NoApproximation);
        }
        let shorter = motion.length_mm.min(next.length_mm);
        if shorter / 2.0 >= wanted_mm {
            return (wanted_mm, Why::Blending);
        }
        let short = if motion.length_mm <= next.length_mm { index } else { index + 1 };
        (shorter / 2.0, Why::Shrunk { wanted_mm, short })
    }
}
