//! The rounded corner between two motions.
//!
//! While the first motion slows down to its end, the second already speeds up from its start; the corner is the sum
//! of both. With the share w of the corner's time, 0…1, and the zones z₁, z₂ that the corner takes from both:
//!
//! ```text
//! h(w) = 2·w³ − w⁴      s₁(w) = L₁ − z₁·h(1 − w)      s₂(w) = z₂·h(w)      x(w) = x₁(s₁) + x₂(s₂) − corner
//! ```
//!
//! h'' is 0 at both ends: a corner begins and ends without acceleration, and its jerk is finite. h'(1) = 2, and
//! h'(w) + h'(1 − w) = 2: for two lines the velocity turns straight from the old one to the new one, never falls below
//! their mean, and where the motions are collinear it does not change. h(w) ≤ w: the corner stays within the triangle
//! of its ends and the corner point, and so never farther from the corner than its zone. That sum is taken over the tool's place
//! and orientation where both motions lead the same tool, and over the joints where one goes point to point.
//!
//! Its speed passes from that of the first motion to that of the second. [`Load`] leaves some room to change it in the corner,
//! for a stop on the path may come at any moment.

use super::curve::Curve;
use super::derivatives::{Derivatives, NODES, SHARES, Samples};
use super::flange::Flange;
use super::load::Load;
use super::profile::Limits;
use super::segment::Segment;
use crate::arm::{Arm, Frame, Joints, TURNED_OVER_DEG, Violation, distance};

/// How fast a zone is passed at the corner's border, per share of the corner's time: the slope of h at 1.
pub(super) const BORDER_SLOPE: f64 = 2.0;

/// Zones whose motions would take times that are this near to each other, as a share, are left as they are.
const MATCHED: f64 = 0.8;

/// A zone is found to this share of itself; it errs to the smaller side.
const ZONE_ACCURACY: f64 = 1e-3;

/// Steps in which a zone is searched for.
const ZONE_STEPS: usize = 12;

/// A corner: how much it takes from both motions, and how fast it may be passed.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Blend {
    /// What it takes from the end of the first motion, in that curve's unit.
    pub from_zone: f64,
    /// What it takes from the start of the second motion, in that curve's unit.
    pub to_zone: f64,
    /// The distance from the corner that it keeps, in mm.
    pub distance_mm: f64,
    /// The rate at which it would be passed if the motions beside it had their highest speeds.
    pub programmed_rate: f64,
    /// How fast its share may grow: the speed is the highest rate, one over the shortest time in s.
    pub limits: Limits,
}

impl Blend {
    /// The corner between two motions, with `share` (0…1) of the distance that they allow; none where the arm cannot
    /// follow it, or where nothing of it is left.
    #[must_use]
    pub fn between(first: &Segment, second: &Segment, share: f64, arm: &Arm) -> Option<Self> {
        Self::after_zone(wanted_zone(first, arm), first, second, share, arm)
    }

    /// The same where the first motion's [`wanted_zone`] is known.
    pub(super) fn after_zone(
        wanted_zone: f64,
        first: &Segment,
        second: &Segment,
        share: f64,
        arm: &Arm,
    ) -> Option<Self> {
        let (leaving, entering) =
            (Approach::new(first, End::Last, arm), Approach::new(second, End::First, arm));
        // What both motions allow: the first one's approximation distance, and at most the zones of either motion.
        let allowed_mm = first.approximation_mm.min(leaving.half_mm).min(entering.half_mm);
        let mut distance_mm = share * allowed_mm;
        // A sum over joints is not quite a sum of the tool's ways: take a smaller one if it would leave the corner.
        for _ in 0..4 {
            if distance_mm < 1e-3 {
                return None;
            }
            let is_as_wanted = distance_mm == first.approximation_mm;
            let mut blend = Self {
                from_zone: if is_as_wanted { wanted_zone } else { leaving.zone(distance_mm) },
                to_zone: entering.zone(distance_mm),
                distance_mm,
                programmed_rate: 0.0,
                limits: Limits { speed: 0.0, acceleration: 0.0, jerk: 0.0 },
            };
            match blend.find_limits(first, second, arm) {
                Ok(rate) => return Some(blend.with_matched_zones(rate, first, second, arm)),
                Err(Unfit::Arm) => return None,
                Err(Unfit::TooFar) => distance_mm *= 0.9,
            }
        }
        None
    }

    /// The same with a smaller zone of the slower motion, if that takes less time. Else both motions would share its whole
    /// zone, and the faster one be as slow there. At `rate` the corner could be passed if only the arm counted.
    fn with_matched_zones(self, rate: f64, first: &Segment, second: &Segment, arm: &Arm) -> Self {
        let speeds = [first.limits.speed, second.limits.speed];
        let [one, other] =
            [self.from_zone / speeds[0], self.to_zone / speeds[1]].map(|time| BORDER_SLOPE * time);
        let share = one.min(other).max(1.0 / rate) / one.max(other);
        if share > MATCHED {
            return self;
        }
        let mut matched = self;
        *if one > other { &mut matched.from_zone } else { &mut matched.to_zone } *= share;
        let duration = |blend: &Self| {
            let left_out = [self.from_zone - blend.from_zone, self.to_zone - blend.to_zone];
            1.0 / blend.limits.speed + left_out[0] / speeds[0] + left_out[1] / speeds[1]
        };
        let is_better =
            matched.find_limits(first, second, arm).is_ok() && duration(&matched) < duration(&self);
        if is_better { matched } else { self }
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
        if let Some(([tool], flange)) = self.tools(first, second, &[w]) {
            return arm.follow(&flange.when_tool_at(tool), near);
        }
        let [(from, to)] = self.ways(first, &[w]);
        // Within its zone either motion has the joints that lie nearest to the corner's. The sum of both may be far from
        // those of either.
        let one = first.curve.joints(from, arm, &first.end)?;
        let two = second.curve.joints(to, arm, &first.end)?;
        let joints = core::array::from_fn(|axis| one[axis] + two[axis] - first.end[axis]);
        arm.within_range(&joints)?;
        Ok(joints)
    }

    /// How far both motions are at some shares of the corner's time.
    fn ways<const N: usize>(&self, first: &Segment, shares: &[f64; N]) -> [(f64, f64); N] {
        let length = first.curve.length();
        shares.map(|w| (length - self.from_zone * eased(1.0 - w), self.to_zone * eased(w)))
    }

    /// The tool in the root at some shares of the corner's time, and how the flange follows from it; none where the motions
    /// do not lead the same tool.
    fn tools<'a, const N: usize>(
        &self,
        first: &'a Segment,
        second: &Segment,
        shares: &[f64; N],
    ) -> Option<([Frame; N], &'a Flange)> {
        let corner = first.curve.end_tool().filter(|_| first.curve.flange() == second.curve.flange())?;
        let ways = self.ways(first, shares);
        let (one, flange) = first.curve.tools(&ways.map(|(from, _)| from))?;
        let (two, _) = second.curve.tools(&ways.map(|(_, to)| to))?;
        Some((core::array::from_fn(|i| sum(&one[i], corner, &two[i])), flange))
    }

    /// Checks reach, ranges and distance all along the corner, and finds the limits within which the arm follows. Returns the
    /// highest rate at which it would if the motions' speeds did not count.
    fn find_limits(&mut self, first: &Segment, second: &Segment, arm: &Arm) -> Result<f64, Unfit> {
        let mut samples = Samples::default();
        let corner =
            first.curve.end_tool().map_or_else(|| first.tool_at(&first.end, arm), |tool| tool.position);
        let mut near = first.end;
        let tools = self.tools(first, second, &SHARES);
        for (node, share) in SHARES.iter().enumerate() {
            let (joints, tool) = match &tools {
                Some((tools, flange)) => {
                    let joints = arm.follow(&flange.when_tool_at(tools[node]), &near);
                    (joints.map_err(|_| Unfit::Arm)?, tools[node].position)
                }
                None => {
                    let joints = self.joints(first, second, *share, arm, &near).map_err(|_| Unfit::Arm)?;
                    (joints, first.tool_at(&joints, arm))
                }
            };
            let is_border = node == 0 || node == NODES - 1;
            if !is_border && distance(tool, corner) > self.distance_mm {
                return Err(Unfit::TooFar);
            }
            // Between both motions the arm may turn over into another configuration, though on neither of them.
            let turns_over = node > 0 && arm.largest_turn(&near, &joints).1 > TURNED_OVER_DEG;
            if tools.is_some() && turns_over {
                return Err(Unfit::Arm);
            }
            samples.set(node, &joints, &tool);
            near = joints;
        }
        // The corner ends with the joints of the second motion, not a turn away from them.
        if tools.is_some() && arm.largest_turn(&first.end, &near).1 > 180.0 {
            return Err(Unfit::Arm);
        }
        let tool_acceleration = first.tool_acceleration.min(second.tool_acceleration);
        let mut corner = Derivatives::NONE;
        corner.find(&samples, 1.0, arm.axes(), tool_acceleration.is_finite().then_some(0));
        corner.within_range(1.0, arm).map_err(|_| Unfit::Arm)?;
        let load = Load {
            corner: &corner,
            arm,
            axis_share: first.axis_share.min(second.axis_share),
            tool_acceleration,
            tool_jerk: first.tool_jerk.min(second.tool_jerk),
        };
        self.programmed_rate = (first.limits.speed / (BORDER_SLOPE * self.from_zone))
            .min(second.limits.speed / (BORDER_SLOPE * self.to_zone));
        let rate = load.highest_rate();
        self.limits = load.limits(rate.min(self.programmed_rate));
        if self.limits.speed > 0.0 { Ok(rate) } else { Err(Unfit::Arm) }
    }
}

/// How far the eased share of a zone has come: 2·w³ − w⁴.
fn eased(w: f64) -> f64 {
    w * w * w * (2.0 - w)
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

/// The sum of two ways of a tool that meet at a corner.
fn sum(one: &Frame, corner: &Frame, two: &Frame) -> Frame {
    Frame {
        position: core::array::from_fn(|i| one.position[i] + two.position[i] - corner.position[i]),
        rotation: one.rotation * corner.rotation.inverse() * two.rotation,
    }
}

/// What the end of a motion gives to a corner at most, in its curve's unit.
#[must_use]
pub(super) fn wanted_zone(segment: &Segment, arm: &Arm) -> f64 {
    Approach::new(segment, End::Last, arm).zone(segment.approximation_mm)
}

/// A motion near a corner at one of its ends: how far its tool is from there.
struct Approach<'a> {
    segment: &'a Segment,
    end: End,
    arm: &'a Arm,
    /// The tool at the corner, in the root.
    corner: [f64; 3],
    /// The most that the motion gives to the corner, half of it as a rule, in its curve's unit.
    half: f64,
    /// How far from the corner that is, in mm.
    half_mm: f64,
}

impl<'a> Approach<'a> {
    fn new(segment: &'a Segment, end: End, arm: &'a Arm) -> Self {
        let half = match end {
            End::First => segment.zones[0],
            End::Last => segment.zones[1],
        };
        let mut approach = Self { segment, end, arm, corner: [0.0; 3], half, half_mm: 0.0 };
        approach.corner = approach.place(0.0);
        approach.half_mm = approach.distance_at(half);
        approach
    }

    /// How much of the motion lies within `distance_mm` of the corner, in its curve's unit; at most half of it.
    fn zone(&self, distance_mm: f64) -> f64 {
        if matches!(self.segment.curve, Curve::Line(_)) {
            return distance_mm.min(self.half);
        }
        let (mut inside, mut outside) = ((0.0, 0.0), (self.half, self.half_mm));
        if outside.1 <= distance_mm {
            return self.half;
        }
        // The distance grows nearly evenly with the way: a secant, aimed a little short, is there in a few steps.
        let aim = distance_mm * (1.0 - ZONE_ACCURACY / 2.0);
        for step in 0..ZONE_STEPS {
            if inside.1 >= distance_mm * (1.0 - ZONE_ACCURACY) {
                break;
            }
            let share = if step % 4 == 3 { 0.5 } else { (aim - inside.1) / (outside.1 - inside.1) };
            let way = inside.0 + share * (outside.0 - inside.0);
            let next = (way, self.distance_at(way));
            *if next.1 <= distance_mm { &mut inside } else { &mut outside } = next;
        }
        inside.0
    }

    /// How far the tool is from the corner when the way to it is `way`, in mm.
    fn distance_at(&self, way: f64) -> f64 {
        distance(self.corner, self.place(way))
    }

    /// The tool in the root when the way to the corner is `way`.
    fn place(&self, way: f64) -> [f64; 3] {
        let way = match self.end {
            End::First => way,
            End::Last => self.segment.curve.length() - way,
        };
        match &self.segment.curve {
            Curve::Axes(axes) => self.segment.tool_at(&axes.joints(way), self.arm),
            cartesian => cartesian.position(way).unwrap_or([f64::NAN; 3]),
        }
    }
}
