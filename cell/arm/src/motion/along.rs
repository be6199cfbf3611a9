//! The nodes of a curve: the places where the derivatives of joints and tool are known.
//!
//! The curve is sampled in pieces. A piece that its samples do not describe well enough is cut in two. So there are
//! many nodes where the joints turn fast (near a singular position, in a tight bend), and few elsewhere.

use arrayvec::ArrayVec;

use super::chebyshev::{NODES, POINT_SHARES, POINTS, SHARES, place_of};
use super::curve::Curve;
use super::derivatives::{Derivatives, Samples};
use super::node::{Node, Ratings};
use super::nodes::{Nodes, PIECES, points_of};
use crate::{Arm, Joints, SINGULAR_SHARE, TURN_SHARE, TURNED_OVER_DEG, Violation, distance, length};

/// Share of the limits of axes and tool that is kept in reserve for the error of the samples. Where the error is
/// larger, the curve is cut.
pub(super) const AXIS_RESERVE: f64 = 0.955;
pub(super) const TOOL_RESERVE: f64 = 0.965;

/// The same of the joints' speeds: less, since a cycle's way is never longer than its highest speed allows, and samples give a first
/// derivative better than a third one. Six tenths are for the error of the samples, as below; the law may exceed what is left of a
/// speed by 0.8 % of it.
pub(super) const AXIS_SPEED_RESERVE: f64 = 0.98;

/// Shares of those reserves that the error of the samples may use. The rest is for the places between the nodes; near a singular
/// position joints change fast there.
const AXIS_LEFT_OUT: f64 = 0.6;
const TOOL_LEFT_OUT: f64 = 0.85;

/// Least length of a piece, as a share of the curve.
const SHORTEST: f64 = 1.0 / 4096.0;

/// An arc of more degrees than this is cut at once: the samples of one piece never describe it well enough.
const RESOLVED_ARC_DEG: f64 = 135.0;

/// Largest turn of a joint between two samples of a piece that need not be cut, in degrees.
const RESOLVED_DEG: f64 = 75.0;

/// Largest turn of a rotary joint within the zone of a corner, in degrees, counted from the corner. Up to 180° the
/// solution nearest to the corner's joints is the right one; the rest is for the error of the samples.
const UNAMBIGUOUS_DEG: f64 = 150.0;

/// How the arm follows a curve.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Followed {
    /// The joints at its end.
    pub(super) end: Joints,
    pub(super) nodes: Nodes,
    /// Whether the reserve covers the error of the samples everywhere.
    pub(super) is_resolved: bool,
    /// Largest parts of the curve that the corners at its start and at its end may replace, in the curve's unit: half
    /// of it, and no more than the stretch on which the joints nearest to the corner's are the right ones.
    pub(super) zones: [f64; 2],
}

/// Ways along a curve that were sampled, and the joints there.
type Trail = ArrayVec<(f64, Joints), { PIECES * NODES }>;

/// Follows a curve that starts at the joints `from`, with a programmed speed and limits of the acceleration and of the jerk along
/// it, all in the curve's unit.
///
/// # Errors
///
/// A point of it that the arm does not reach, a turn into another configuration, a singular position, or a turn of the tool
/// that is too far for the way and the speed.
pub(super) fn along(
    curve: &Curve,
    from: &Joints,
    speed: f64,
    most: [f64; 2],
    ratings: &Ratings,
    arm: &Arm,
) -> Result<Followed, Violation> {
    let (mut trail, mut nodes) = (Trail::new(), Nodes::new());
    let reached = speed.min(fastest_around(curve, most[0]));
    let is_line = matches!(curve, Curve::Line(_));
    let is_cut = matches!(curve, Curve::Arc(arc) if arc.opening_deg() > RESOLVED_ARC_DEG);
    let (mut joints, mut start, mut share) = (*from, 0.0, if is_cut { 0.5 } else { 1.0 });
    let (mut derivatives, mut all_resolved, mut pieces) = (Derivatives::NONE, true, 0);
    while start < 1.0 {
        let length = curve.length();
        let (begin, width) = (start * length, share * length);
        let (samples, end, (turned, (axis, turn_deg))) = sampled(curve, &joints, begin, width, arm)?;
        let left = PIECES - pieces;
        let can_cut = share > SHORTEST && pieces_to_end(share / 2.0, 1.0 - start) <= left;
        if !can_cut && turn_deg > TURNED_OVER_DEG {
            return Err(Violation::Configuration { axis, turn_deg, way: turned, length });
        }
        if can_cut && turn_deg >= RESOLVED_DEG {
            share /= 2.0;
            continue;
        }
        derivatives.find(&samples, width, arm.axes(), (!is_line).then_some(0));
        let off = if can_cut { 0.0 } else { 1.0 };
        let first = nodes.len();
        for point in points_of(share, first == 0) {
            let at = (&derivatives, place_of(point), off);
            nodes.push(Node::new(begin + POINT_SHARES[point] * width, speed, at, is_line, ratings));
        }
        let bends = bends_off(curve, &derivatives, begin, width);
        if !is_resolved(&derivatives, bends, &nodes[first..], most, ratings, arm.axes()) {
            if can_cut {
                nodes.truncate(first);
                share /= 2.0;
                continue;
            }
            all_resolved = false;
        }
        derivatives.within_range(width, arm)?;
        let mut hardly = nodes[first..].iter().filter_map(|node| {
            let (highest, axis) = node.highest_of_joints(ratings);
            let share = highest.sqrt() / reached;
            (share < SINGULAR_SHARE).then_some((share, axis))
        });
        if let Some(found) = hardly.next() {
            let least = hardly.fold(found, |least, next| if next.0 < least.0 { next } else { least });
            return Err(turn_too_fast(curve, reached, least, arm)
                .unwrap_or(Violation::Singular { axis: found.1, share: found.0 }));
        }
        (0..NODES).for_each(|node| trail.push((begin + SHARES[node] * width, samples.joints(node))));
        (joints, start) = (end, start + share);
        pieces += 1;
        share = (2.0 * share).min(1.0 - start);
    }
    let length = curve.length();
    let from_start = unambiguous(from, trail.iter().map(|(way, joints)| (*way, joints)), length / 2.0, arm);
    let from_end = trail.iter().rev().map(|(way, joints)| (length - way, joints));
    let zones = [from_start, unambiguous(&joints, from_end, length / 2.0, arm)];
    Ok(Followed { end: joints, nodes, is_resolved: all_resolved, zones })
}

/// Returns the highest speed that this acceleration of the tool allows across a curve. A joint that does not follow a higher one is no
/// sign of a singular position.
fn fastest_around(curve: &Curve, acceleration: f64) -> f64 {
    match curve {
        Curve::Arc(arc) => (acceleration * arc.radius()).sqrt(),
        _ => f64::INFINITY,
    }
}

/// Returns the violation of a curve on which the turn of the tool alone leaves nearly nothing of the programmed velocity: no
/// singular position is to blame. `least` is the smallest share that is left, and the joint that limits it.
fn turn_too_fast(curve: &Curve, speed_mm_s: f64, least: (f64, u8), arm: &Arm) -> Option<Violation> {
    let (share, axis) = least;
    let (turn_deg, way_mm) = (curve.turn_deg(), curve.length());
    let rated_deg_s = *arm.limits().speed.get(usize::from(axis).checked_sub(1)?)?;
    let slower_mm_s = speed_mm_s * share / SINGULAR_SHARE;
    let violation = Violation::TurnTooFast { axis, turn_deg, way_mm, speed_mm_s, rated_deg_s, slower_mm_s };
    (rated_deg_s * way_mm < TURN_SHARE * speed_mm_s * turn_deg).then_some(violation)
}

/// Returns how many pieces there are to the end of a curve if this is the next one and each is twice as long as the one
/// before. `left` is the share of the curve that is left.
fn pieces_to_end(share: f64, left: f64) -> usize {
    let (mut pieces, mut piece, mut end) = (0, share, 0.0);
    while end < left {
        end += piece;
        piece *= 2.0;
        pieces += 1;
    }
    pieces
}

/// Returns the distance from a corner, at most `half`, within which no rotary joint turns by more than
/// [`UNAMBIGUOUS_DEG`] from its value in the corner. `trail` leads away from the corner.
fn unambiguous<'a>(
    corner: &Joints,
    trail: impl Iterator<Item = (f64, &'a Joints)>,
    half: f64,
    arm: &Arm,
) -> f64 {
    let mut free = 0.0;
    for (way, joints) in trail {
        if arm.largest_turn(corner, joints).1 > UNAMBIGUOUS_DEG {
            return free;
        }
        if way >= half {
            break;
        }
        free = way;
    }
    half
}

/// Returns the largest turn of a joint from one sample to the next: the way there, the joint (from 1) and the turn in
/// degrees.
type Turn = (f64, (u8, f64));

fn sampled(
    curve: &Curve,
    from: &Joints,
    start: f64,
    width: f64,
    arm: &Arm,
) -> Result<(Samples, Joints, Turn), Violation> {
    let mut samples = Samples::default();
    let (mut joints, mut turn, mut before) = (*from, (start, (1, 0.0)), start);
    let ways = SHARES.map(|share| start + share * width);
    let tools = curve.tools(&ways);
    for (node, way) in ways.into_iter().enumerate() {
        let tool = tools.as_ref().map(|(tools, flange)| (tools[node], flange));
        let next = match tool {
            _ if node == 0 => joints,
            Some((tool, flange)) => arm.follow(&flange.when_tool_at(tool), &joints)?,
            None => curve.joints(way, arm, &joints)?,
        };
        let next_turn = arm.largest_turn(&joints, &next);
        if next_turn.1 > turn.1.1 {
            turn = (before, next_turn);
        }
        before = way;
        joints = next;
        samples.set(node, &joints, &tool.map_or([0.0; 3], |(tool, _)| tool.position));
    }
    Ok((samples, joints, turn))
}

/// Returns how far the second derivative of the tool is from that of the curve at the start, in the middle and at the end of a
/// piece, in 1/mm. A spline can bend within a thousandth of its length, between two samples; the bends of the other curves are
/// the same everywhere.
fn bends_off(curve: &Curve, piece: &Derivatives, begin: f64, width: f64) -> f64 {
    let Curve::Spline(spline) = curve else { return 0.0 };
    let bends = spline.bends(&[begin, begin + width / 2.0, begin + width]);
    let points = [0, POINTS / 2, POINTS - 1];
    let off = |(point, bend): (usize, _)| distance(bend, piece.tool(1, place_of(point)));
    points.into_iter().zip(bends).map(off).fold(0.0, f64::max)
}

/// Returns whether the reserve covers the error of a piece's samples at the highest speed there. `bends` is what is known of the
/// error of the tool's second derivative. `most` are the limits of acceleration and jerk along the piece, in its unit.
pub(super) fn is_resolved(
    piece: &Derivatives,
    bends: f64,
    nodes: &[Node],
    most: [f64; 2],
    ratings: &Ratings,
    axes: usize,
) -> bool {
    let square =
        nodes.iter().map(|node| node.highest.min(node.programmed * node.programmed)).fold(0.0, f64::max);
    let speed = square.sqrt();
    // All joints and the tool share one acceleration and one jerk along the piece. These are highest where the joints
    // turn least.
    let jerks = ratings.jerk();
    let allowed = nodes.iter().map(|node| node.most_along(ratings));
    let allowed = allowed.fold([0.0; 2], |most: [f64; 2], node| [most[0].max(node[0]), most[1].max(node[1])]);
    let [acceleration, jerk] = [most[0].min(allowed[0]), most[1].min(allowed[1])];
    let [slow, reserve] = [AXIS_SPEED_RESERVE, AXIS_RESERVE].map(|reserve| AXIS_LEFT_OUT * (1.0 - reserve));
    let of_joints = piece.joints().iter().enumerate().take(axes).all(|(axis, joint)| {
        let [slope, bend, twist] = joint.off;
        slope * speed <= slow * ratings.speed[axis]
            && slope * acceleration + bend * square <= reserve * ratings.acceleration[axis]
            && slope * jerk + 3.0 * bend * speed * acceleration + twist * speed * square
                <= reserve * jerks[axis]
    });
    if !ratings.leads_tool() {
        return of_joints;
    }
    let reserve = TOOL_LEFT_OUT * (1.0 - TOOL_RESERVE);
    let (bend, twist) = (length(piece.tool_off(1)).max(bends), length(piece.tool_off(2)));
    let of_tool = bend * square <= reserve * ratings.tool_acceleration
        && 3.0 * bend * speed * acceleration + twist * speed * square <= reserve * ratings.tool_jerk();
    of_joints && of_tool
}

#[cfg(test)]
mod tests;
