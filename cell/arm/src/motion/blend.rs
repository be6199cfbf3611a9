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
//! Its speed passes from that of the first motion to that of the second: neither motion is faster than it is programmed, nor is the
//! tool faster than the faster of the two.

use super::along::{AXIS_RESERVE, AXIS_SPEED_RESERVE, is_resolved};
use super::chebyshev::{POINT_SHARES, SHARES, place_of};
use super::derivatives::{Derivatives, Samples};
use super::flange::Flange;
use super::node::{Node, Ratings, ramp_s};
use super::nodes::{Nodes, points_of};
use super::segment::Segment;
use crate::{Arm, Frame, Joints, TURNED_OVER_DEG, Violation, distance};

mod approach;

pub(super) use approach::entering_zone;
pub use approach::wanted_zone;
use approach::{Approach, End};

/// The slope of h at 1: how fast the way through the zone grows at the corner's border.
pub const BORDER_SLOPE: f64 = 2.0;

/// Share of the tool's programmed speed that is allowed at the nodes: between them the speed may be a little higher.
const BETWEEN_NODES: f64 = 0.998;

/// Largest number of pieces into which a corner is cut where its samples do not describe it well enough, and the least
/// share of one.
const PIECES: usize = 8;
const SHORTEST: f64 = 1.0 / 32.0;

/// A corner: which parts of both motions it replaces, and its nodes. Its unit is the share of its time.
#[derive(Clone, PartialEq, Debug)]
pub struct Blend {
    /// Length that it replaces at the end of the first motion, in that curve's unit.
    pub from_zone: f64,
    /// Length that it replaces at the start of the second motion, in that curve's unit.
    pub to_zone: f64,
    /// Largest distance of the path from the corner, in mm.
    pub distance_mm: f64,
    /// The limits of joints and tool along it.
    pub ratings: Ratings,
    /// Its nodes.
    pub nodes: Nodes,
}

impl Blend {
    /// The corner between two motions, with `share` (0…1) of the distance that they allow; none where the arm cannot
    /// follow it or no corner is left.
    #[must_use]
    pub fn between(first: &Segment, second: &Segment, share: f64, arm: &Arm) -> Option<Self> {
        Self::after_zone(wanted_zone(first, arm), first, second, share, arm)
    }

    /// As [`between`](Self::between), with the first motion's [`wanted_zone`].
    #[must_use]
    pub fn after_zone(
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
                ratings: both(first, second, arm),
                nodes: Nodes::new(),
            };
            match blend.find_nodes(first, second, arm) {
                Ok(()) => return Some(blend),
                Err(Unfit::Arm) => return None,
                Err(Unfit::TooFar) => distance_mm *= 0.9,
            }
        }
        None
    }

    /// The joints at share `w` of the corner's time.
    #[inline]
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
        // Within its zone each motion has the joints nearest to those of the corner. The joints of the blend may be far
        // from those of both motions.
        let one = first.curve.joints(from, arm, &first.end)?;
        let two = second.curve.joints(to, arm, &first.end)?;
        let joints = core::array::from_fn(|axis| one[axis] + two[axis] - first.end[axis]);
        arm.within_range(&joints)?;
        Ok(joints)
    }

    /// Returns the ways along both motions at some shares of the corner's time.
    fn ways<const N: usize>(&self, first: &Segment, shares: &[f64; N]) -> [(f64, f64); N] {
        shares.map(|w| self.ways_at(first, w))
    }

    /// The same at one share.
    #[must_use]
    #[inline]
    pub fn ways_at(&self, first: &Segment, w: f64) -> (f64, f64) {
        (first.curve.length() - self.from_zone * eased(1.0 - w), self.to_zone * eased(w))
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

    /// Checks reach, ranges of the joints and distance all along the corner, and finds its nodes.
    fn find_nodes(&mut self, first: &Segment, second: &Segment, arm: &Arm) -> Result<(), Unfit> {
        let leads_tool = self.tools(first, second, &[0.5]).is_some();
        let (mut start, mut width, mut near) = (0.0, 1.0, first.end);
        let (mut derivatives, mut pieces) = (Derivatives::NONE, 0);
        while start < 1.0 {
            let (samples, end) = self.sampled(first, second, (start, width), arm, &near)?;
            derivatives.find(&samples, width, arm.axes(), self.ratings.leads_tool().then_some(0));
            let can_cut = pieces + 1 < PIECES && width > SHORTEST;
            let off = if can_cut { 0.0 } else { 1.0 };
            let begun = self.nodes.len();
            for point in points_of(width, begun == 0) {
                let share = start + POINT_SHARES[point] * width;
                let at = (&derivatives, place_of(point), off);
                let mut node = Node::new(share, f64::INFINITY, at, false, &self.ratings);
                node.programmed = self.programmed(share, &node, leads_tool, first, second);
                self.nodes.push(node);
            }
            let most = [f64::INFINITY; 2];
            if can_cut
                && !is_resolved(&derivatives, 0.0, &self.nodes[begun..], most, &self.ratings, arm.axes())
            {
                self.nodes.truncate(begun);
                width /= 2.0;
                continue;
            }
            derivatives.within_range(width, arm).map_err(|_| Unfit::Arm)?;
            (near, start) = (end, start + width);
            pieces += 1;
            width = if pieces + 1 < PIECES { (2.0 * width).min(1.0 - start) } else { 1.0 - start };
        }
        // The corner ends with the joints of the second motion, not a turn away from them.
        if leads_tool && arm.largest_turn(&first.end, &near).1 > 180.0 {
            return Err(Unfit::Arm);
        }
        let is_possible = self.nodes.iter().all(|node| node.programmed > 0.0 && node.highest > 0.0);
        if is_possible { Ok(()) } else { Err(Unfit::Arm) }
    }

    /// Samples a piece of the corner from the joints at its start. Returns the joints at its end as well.
    fn sampled(
        &self,
        first: &Segment,
        second: &Segment,
        (start, width): (f64, f64),
        arm: &Arm,
        from: &Joints,
    ) -> Result<(Samples, Joints), Unfit> {
        let shares = SHARES.map(|share| start + share * width);
        let mut samples = Samples::default();
        let corner =
            first.curve.end_tool().map_or_else(|| first.tool_at(&first.end, arm), |tool| tool.position);
        let mut near = *from;
        let tools = self.tools(first, second, &shares);
        for (node, share) in shares.into_iter().enumerate() {
            let (joints, tool) = match &tools {
                Some((tools, flange)) => {
                    let joints = arm.follow(&flange.when_tool_at(tools[node]), &near);
                    (joints.map_err(|_| Unfit::Arm)?, tools[node].position)
                }
                None => {
                    let joints = self.joints(first, second, share, arm, &near).map_err(|_| Unfit::Arm)?;
                    (joints, first.tool_at(&joints, arm))
                }
            };
            let is_border = share == 0.0 || share == 1.0;
            if !is_border && distance(tool, corner) > self.distance_mm {
                return Err(Unfit::TooFar);
            }
            // In the corner the arm may change its configuration although it does not on either motion.
            let turns_over = node > 0 && arm.largest_turn(&near, &joints).1 > TURNED_OVER_DEG;
            if tools.is_some() && turns_over {
                return Err(Unfit::Arm);
            }
            samples.set(node, &joints, &tool);
            near = joints;
        }
        Ok((samples, near))
    }

    /// Returns the highest rate that the programmed speeds allow at a share of the corner's time.
    fn programmed(
        &self,
        share: f64,
        node: &Node,
        leads_tool: bool,
        first: &Segment,
        second: &Segment,
    ) -> f64 {
        let [one, other] = [first, second].map(Segment::programmed_speed);
        // Neither motion is faster than outside of the corner.
        let alone = (one / (self.from_zone * eased_slope(1.0 - share)))
            .min(other / (self.to_zone * eased_slope(share)));
        if leads_tool {
            // Nor is the tool, where the motions have a speed of the tool.
            let tool = BETWEEN_NODES * one.max(other) / node.tool_slope(&self.ratings);
            alone.min(tool)
        } else {
            // Nor are the joints, where both motions are point to point.
            let most = [first, second].map(Segment::programmed_share).into_iter().fold(0.0, f64::max);
            alone.min(BETWEEN_NODES * most * node.speed_of_joints(&self.ratings))
        }
    }
}

/// Returns the limits of joints and tool where two motions meet: the lower ones of both.
fn both(first: &Segment, second: &Segment, arm: &Arm) -> Ratings {
    let least = |of: fn(&Ratings) -> f64| of(&first.ratings).min(of(&second.ratings));
    let axes = |one: &Joints, other: &Joints| core::array::from_fn(|axis| one[axis].min(other[axis]));
    let (one, other) = (first.ratings.jerk(), second.ratings.jerk());
    let rated = arm.limits();
    // On a point-to-point motion all places are alike, and less is kept in reserve.
    let acceleration = axes(&first.ratings.acceleration, &second.ratings.acceleration);
    let acceleration = axes(&acceleration, &rated.acceleration.map(|rated| AXIS_RESERVE * rated));
    let jerk = axes(&axes(&one, &other), &rated.jerk.map(|rated| AXIS_RESERVE * rated));
    let (one_slows, other_slows) = (first.ratings.joints_slow(), second.ratings.joints_slow());
    // Each motion has a factor of its own acceleration; that of the lower one is no lower limit than both.
    let deceleration = (0..acceleration.len())
        .map(|axis| {
            one_slows[axis].min(other_slows[axis]).min(AXIS_RESERVE * rated.acceleration[axis])
                / acceleration[axis]
        })
        .fold(f64::INFINITY, f64::min);
    let tool_acceleration = least(|ratings| ratings.tool_acceleration);
    let tool_deceleration =
        least(|ratings| ratings.tool_acceleration * ratings.tool_deceleration) / tool_acceleration;
    let tool_jerk = least(Ratings::tool_jerk);
    Ratings {
        speed: rated.speed.map(|speed| AXIS_SPEED_RESERVE * speed),
        ramp_s: core::array::from_fn(|axis| ramp_s(acceleration[axis], jerk[axis])),
        acceleration,
        tool_acceleration,
        tool_ramp_s: ramp_s(tool_acceleration, tool_jerk),
        deceleration: if deceleration.is_finite() { deceleration } else { 1.0 },
        // Where both lead no tool there is no ratio.
        tool_deceleration: if tool_deceleration.is_finite() { tool_deceleration } else { 1.0 },
    }
}

/// How far the eased share of a zone has come: 2·w³ − w⁴.
#[inline]
fn eased(w: f64) -> f64 {
    w * w * w * (2.0 - w)
}

/// How fast it does.
#[inline]
fn eased_slope(w: f64) -> f64 {
    w * w * (6.0 - 4.0 * w)
}

/// Why a corner cannot be rounded with this zone.
enum Unfit {
    /// The arm cannot follow.
    Arm,
    /// The tool would be too far from the corner.
    TooFar,
}

/// The sum of two ways of a tool that meet at a corner.
fn sum(one: &Frame, corner: &Frame, two: &Frame) -> Frame {
    Frame {
        position: core::array::from_fn(|i| one.position[i] + two.position[i] - corner.position[i]),
        rotation: one.rotation * corner.rotation.inverse() * two.rotation,
    }
}

#[cfg(test)]
pub(super) mod tests;
