//! The rounded corner between two motions.
//!
//! While the first motion slows down evenly to its end, the second already speeds up from its start; the corner is
//! the sum of both. With the share w of the corner's time, 0…1, and the zones z₁, z₂ that the corner takes from both:
//!
//! ```text
//! s₁(w) = L₁ − z₁·(1 − w)²      s₂(w) = z₂·w²      x(w) = x₁(s₁) + x₂(s₂) − corner
//! ```
//!
//! For two lines that is the parabola through corner − r·u₁ and corner + r·u₂. It stays within the triangle of these
//! points, and so never farther from the corner than r, and takes the constant acceleration |u₂ − u₁|·v²/(2r). The
//! velocity turns straight from the old one to the new one: it never falls below their mean, and where the motions
//! are collinear it does not change. The same sum, taken over the joints, blends motions of any two kinds.

use super::curve::{Curve, Line};
use super::segment::Segment;
use crate::arm::{Arm, Frame, Joints, Violation, distance, length};

/// How fast a zone is passed at the corner's border, per share of the corner's time: the slope of w² at 1.
pub(super) const BORDER_SLOPE: f64 = 2.0;

/// Parts into which a corner is cut to check it.
const CHECKS: usize = 16;

/// What joint limits keep in reserve for what lies between the checked points.
const RESERVE: f64 = 0.97;

/// A zone is found to this share of itself; it errs to the smaller side.
const HALVINGS: usize = 24;

/// A corner: how much it takes from both motions, and how fast it may be passed.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Blend {
    /// What it takes from the end of the first motion, in that curve's unit.
    pub from_zone: f64,
    /// What it takes from the start of the second motion, in that curve's unit.
    pub to_zone: f64,
    /// The distance from the corner that it keeps, in mm.
    pub distance_mm: f64,
    /// The highest rate: one over the shortest time in s.
    pub max_rate: f64,
    /// The rate that the look-ahead chose.
    pub rate: f64,
}

impl Blend {
    /// The corner between two motions, with `share` (0…1) of the distance that they allow; none where the arm cannot
    /// follow it, or where nothing of it is left.
    #[must_use]
    pub fn between(first: &Segment, second: &Segment, share: f64, arm: &Arm) -> Option<Self> {
        let mut distance_mm = share * allowed_distance(first, second, arm);
        // A sum over joints is not quite a parabola of the tool: take a smaller one if it would leave the corner.
        for _ in 0..4 {
            if distance_mm < 1e-3 {
                return None;
            }
            let mut blend = Self {
                from_zone: zone(first, End::Last, distance_mm, arm),
                to_zone: zone(second, End::First, distance_mm, arm),
                distance_mm,
                max_rate: 0.0,
                rate: 0.0,
            };
            match blend.find_rate(first, second, arm) {
                Ok(()) => return Some(blend),
                Err(Unfit::Arm) => return None,
                Err(Unfit::TooFar) => distance_mm *= 0.9,
            }
        }
        None
    }

    /// The joints at share `w` of the corner's time.
    pub fn joints(
        &self,
        first: &Segment,
        second: &Segment,
        w: f64,
        arm: &Arm,
        near: &Joints,
    ) -> Result<Joints, Violation> {
        let from = first.curve.length() - self.from_zone * (1.0 - w) * (1.0 - w);
        let to = self.to_zone * w * w;
        match (&first.curve, &second.curve) {
            (Curve::Line(one), Curve::Line(two)) if one.flange() == two.flange() => {
                arm.follow(&one.flange().when_tool_at(sum(one, from, two, to)), near)
            }
            _ => {
                let one = first.curve.joints(from, arm, near)?;
                let two = second.curve.joints(to, arm, near)?;
                let joints = core::array::from_fn(|axis| one[axis] + two[axis] - first.end[axis]);
                arm.within_range(&joints)?;
                Ok(joints)
            }
        }
    }

    /// Checks reach, ranges and distance all along the corner, and finds the highest rate at which the arm follows.
    fn find_rate(&mut self, first: &Segment, second: &Segment, arm: &Arm) -> Result<(), Unfit> {
        let corner = first.tool_at(&first.end, arm);
        let axis_share = first.axis_share.min(second.axis_share);
        let is_parabola = matches!((&first.curve, &second.curve), (Curve::Line(_), Curve::Line(_)));
        let reserve = if is_parabola { 1.0 } else { RESERVE };
        let tool_acceleration = reserve * first.tool_acceleration.min(second.tool_acceleration);
        let rated = arm.limits();
        let bend_allows = |(joints, tool): Bend| {
            let of_joints = RESERVE * axis_share / rated.acceleration_load(&joints).share;
            of_joints.min(tool_acceleration / length(tool)).sqrt()
        };
        let mut rate = (first.limits.speed / (BORDER_SLOPE * self.from_zone))
            .min(second.limits.speed / (BORDER_SLOPE * self.to_zone));
        let step = 1.0 / CHECKS as f64;
        let mut before = self.joints(first, second, 0.0, arm, &first.end).map_err(|_| Unfit::Arm)?;
        let mut tool_before = first.tool_at(&before, arm);
        let (mut slope, mut bend_before) = (None::<Bend>, None::<Bend>);
        for check in 1..=CHECKS {
            let joints =
                self.joints(first, second, step * check as f64, arm, &before).map_err(|_| Unfit::Arm)?;
            let tool = first.tool_at(&joints, arm);
            if check < CHECKS && distance(tool, corner) > self.distance_mm {
                return Err(Unfit::TooFar);
            }
            let next = (difference(&joints, &before, step), difference(&tool, &tool_before, step));
            rate = rate.min(RESERVE / rated.speed_load(&next.0).share);
            if let Some(slope) = slope {
                let bend = (difference(&next.0, &slope.0, step), difference(&next.1, &slope.1, step));
                rate = rate.min(bend_allows(bend));
                // Half a step of the corner's start and end has no difference of its own.
                if let Some(before) = bend_before.replace(bend) {
                    if check == 3 {
                        rate = rate.min(bend_allows(beyond(&bend, &before)));
                    } else if check == CHECKS {
                        rate = rate.min(bend_allows(beyond(&before, &bend)));
                    }
                }
            }
            (before, tool_before, slope) = (joints, tool, Some(next));
        }
        self.max_rate = rate;
        if rate > 0.0 { Ok(()) } else { Err(Unfit::Arm) }
    }
}

/// A first or second derivative of joints and tool by the share of the corner's time.
type Bend = (Joints, [f64; 3]);

fn difference<const N: usize>(to: &[f64; N], from: &[f64; N], step: f64) -> [f64; N] {
    core::array::from_fn(|i| (to[i] - from[i]) / step)
}

/// What comes a step after `last`, if things go on as from `before` to `last`.
fn beyond(before: &Bend, last: &Bend) -> Bend {
    (
        core::array::from_fn(|i| 2.0 * last.0[i] - before.0[i]),
        core::array::from_fn(|i| 2.0 * last.1[i] - before.1[i]),
    )
}

/// Why a corner cannot be rounded as tried.
enum Unfit {
    /// The arm cannot follow.
    Arm,
    /// The tool would be too far from the corner.
    TooFar,
}

#[derive(Clone, Copy, PartialEq)]
enum End {
    First,
    Last,
}

/// The sum of two lines that meet at the end of the first.
fn sum(one: &Line, from: f64, two: &Line, to: f64) -> Frame {
    let (corner, one, two) = (one.end(), one.tool(from), two.tool(to));
    Frame {
        position: core::array::from_fn(|i| one.position[i] + two.position[i] - corner.position[i]),
        rotation: one.rotation * corner.rotation.inverse() * two.rotation,
    }
}

/// What both motions allow: the first one's approximation distance, and at most half of either motion.
fn allowed_distance(first: &Segment, second: &Segment, arm: &Arm) -> f64 {
    let half = |segment: &Segment, end| distance_at(segment, end, segment.curve.length() / 2.0, arm);
    first.approximation_mm.min(half(first, End::Last)).min(half(second, End::First))
}

/// What the end of a motion gives to a corner at most, in its curve's unit.
#[must_use]
pub(super) fn wanted_zone(segment: &Segment, arm: &Arm) -> f64 {
    zone(segment, End::Last, segment.approximation_mm, arm)
}

/// How much of a motion's end lies within `distance_mm` of the corner, in its curve's unit; at most half of it.
fn zone(segment: &Segment, end: End, distance_mm: f64, arm: &Arm) -> f64 {
    let half = segment.curve.length() / 2.0;
    if matches!(segment.curve, Curve::Line(_)) {
        return distance_mm.min(half);
    }
    if distance_at(segment, end, half, arm) <= distance_mm {
        return half;
    }
    let (mut inside, mut outside) = (0.0, half);
    for _ in 0..HALVINGS {
        let middle = (inside + outside) / 2.0;
        if distance_at(segment, end, middle, arm) <= distance_mm { inside = middle } else { outside = middle }
    }
    inside
}

/// How far the tool is from the motion's end when the way to it is `way`, in mm.
fn distance_at(segment: &Segment, end: End, way: f64, arm: &Arm) -> f64 {
    let whole = segment.curve.length();
    let (corner, there) = match end {
        End::First => (0.0, way),
        End::Last => (whole, whole - way),
    };
    let place = |way| match &segment.curve {
        Curve::Axes(axes) => segment.tool_at(&axes.joints(way), arm),
        cartesian => cartesian.tool(way).map_or([f64::NAN; 3], |tool| tool.position),
    };
    distance(place(corner), place(there))
}
