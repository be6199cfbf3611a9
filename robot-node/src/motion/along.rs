//! What a curve allows along it: the tool's limits where it bends, and those of every joint.
//!
//! With joints q(s) a joint's speed, acceleration and jerk are
//!
//! ```text
//! q'·ṡ        q'·s̈ + q''·ṡ²        q'·s⃛ + 3·q''·ṡ·s̈ + q'''·ṡ³
//! ```
//!
//! and so are the tool's, with its place x(s). Limits that surely hold come first: acceleration and jerk along the curve get
//! at most half of what an axis has, whatever the speed, and the speed all that is left. Where they are below the programmed
//! ones, a better [`Split`] of the same limits is sought for the length of the curve.

use arrayvec::ArrayVec;

use super::curve::Curve;
use super::derivatives::{Channel, Derivatives, NODES, PLACES, SHARES, Samples, largest, most};
use super::profile::Limits;
use super::split::{Bend, Split};
use crate::arm::{Arm, Joints, SINGULAR_SHARE, TURNED_OVER_DEG, Violation, length};

/// What is kept in reserve for what the samples do not show. Where they leave out more, the curve is cut.
const RESERVE: f64 = 0.97;

/// Into so many pieces a curve is cut at most.
const PIECES: u32 = 2;

/// An arc that goes round farther than this, in degrees, is cut at once: one piece's samples never tell enough of it.
const RESOLVED_ARC_DEG: f64 = 135.0;

/// The most that a joint turns, in degrees, from one sample to the next in a piece that need not be cut.
const RESOLVED_DEG: f64 = 75.0;

/// The share of the tool's acceleration, and of its jerk, that goes across the path at most, so that 0.6 is left along
/// it.
const ACROSS: f64 = 0.8;

/// The shares of the tool's jerk that a constant speed takes at most: across the path, where the bend changes, and
/// against it, where the acceleration across turns with the path.
const CHANGING: f64 = 0.6;
const TURNING: f64 = 0.4;

/// How far a rotary joint may be turned from where it is in a corner, in degrees, within the zone of that corner. Up to
/// half a turn, the joints of a place are those that lie nearest to the corner's; the rest is for what the samples do not
/// show.
const UNAMBIGUOUS_DEG: f64 = 150.0;

/// What the arm does on a curve.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Followed {
    /// The joints at its end.
    pub(super) end: Joints,
    /// The programmed limits, reduced to what tool and joints can follow along all of it.
    pub(super) limits: Limits,
    /// What corners at its start and at its end may take of it at most, in the curve's unit: half of it, and no more than
    /// where the joints are still told by those of the corner.
    pub(super) zones: [f64; 2],
}

/// The ways along a curve that were looked at, and the joints there.
type Trail = ArrayVec<(f64, Joints), { PIECES as usize * NODES }>;

/// Follows a curve that starts at the joints `from`. The limits are the best ones for a way of this length from rest to rest.
///
/// # Errors
///
/// A point of it that the arm does not reach, a turn into another configuration, or a singular position.
pub(super) fn along(
    curve: &Curve,
    from: &Joints,
    programmed: Limits,
    way: f64,
    arm: &Arm,
) -> Result<Followed, Violation> {
    let mut trail = Trail::new();
    let mut found = Found { limits: programmed, slowest_axis: 1, bend: Bend::default() };
    let mut pieces = [Derivatives::NONE; PIECES as usize];
    let mut count = 0;
    let is_cut = matches!(curve, Curve::Arc(arc) if arc.opening_deg() > RESOLVED_ARC_DEG);
    let (mut joints, mut done, mut size) = (*from, 0, if is_cut { 1 } else { PIECES });
    while done < PIECES {
        let unit = curve.length() / f64::from(PIECES);
        let (start, width) = (unit * f64::from(done), unit * f64::from(size));
        let (samples, end, turn) = sampled(curve, &joints, start, width, arm)?;
        let (turned, (axis, turn_deg)) = turn;
        if size == 1 && turn_deg > TURNED_OVER_DEG {
            return Err(Violation::Configuration { axis, turn_deg, way: turned, length: curve.length() });
        }
        if size > 1 && turn_deg >= RESOLVED_DEG {
            size /= 2;
            continue;
        }
        // By the way, the tool's first derivative is 1.
        let tool_from = (!matches!(curve, Curve::Line(_))).then_some(1);
        let derivatives = &mut pieces[count];
        derivatives.find(&samples, width, arm.axes(), tool_from);
        let mut next = found;
        next.keep(curve, derivatives, programmed, size == 1, arm);
        let is_resolved = next.limits.speed >= programmed.speed * SINGULAR_SHARE
            && holds_with_what_is_left_out(&next.limits, curve, derivatives, arm);
        if size > 1 && !is_resolved {
            size /= 2;
            continue;
        }
        derivatives.within_range(width, arm)?;
        (0..NODES).for_each(|node| trail.push((start + SHARES[node] * width, samples.joints(node))));
        (found, joints, done, count) = (next, end, done + size, count + 1);
    }
    let Found { mut limits, slowest_axis, bend } = found;
    if limits.speed < programmed.speed * SINGULAR_SHARE {
        return Err(Violation::Singular { axis: slowest_axis, share: limits.speed / programmed.speed });
    }
    if limits != programmed {
        limits = better(limits, (curve, way), &pieces[..count], bend, programmed, arm);
    }
    let length = curve.length();
    let from_start = unambiguous(from, trail.iter().map(|(way, joints)| (*way, joints)), length / 2.0, arm);
    let from_end = trail.iter().rev().map(|(way, joints)| (length - way, joints));
    let zones = [from_start, unambiguous(&joints, from_end, length / 2.0, arm)];
    Ok(Followed { end: joints, limits, zones })
}

/// Limits with which `way`, driven from rest to rest along the curve's pieces, takes less time than with those that are
/// known, if there are any.
fn better(
    known: Limits,
    (curve, way): (&Curve, f64),
    pieces: &[Derivatives],
    bend: Bend,
    programmed: Limits,
    arm: &Arm,
) -> Limits {
    let is_cut = pieces.len() > 1;
    let mut split = Split::new(bend, programmed);
    pieces.iter().for_each(|piece| split.add(piece, arm, RESERVE, if is_cut { 1.0 } else { 0.0 }));
    // Of what the samples leave out little is known: the safe limits have more room for it.
    let is_allowed =
        |limits: &Limits| pieces.iter().all(|piece| holds_with_what_is_left_out(limits, curve, piece, arm));
    split.fastest(way, known, is_allowed)
}

/// How far from a corner, at most `half`, no rotary joint turns by more than [`UNAMBIGUOUS_DEG`] from where it is in the
/// corner. `trail` leads away from there.
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

/// The largest turn of a joint from one sample to the next: after which way, which joint, from 1, and by how many
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

/// What is found so far.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Found {
    limits: Limits,
    slowest_axis: u8,
    bend: Bend,
}

impl Found {
    /// Reduces the limits to what a piece allows; `with_off` counts what the samples leave out as there.
    fn keep(&mut self, curve: &Curve, piece: &Derivatives, programmed: Limits, with_off: bool, arm: &Arm) {
        let scale = if with_off { 1.0 } else { 0.0 };
        if !matches!(curve, Curve::Line(_)) {
            let (mut bends, mut changes) = ([0.0; PLACES], [0.0; PLACES]);
            for (at, (bend, change)) in bends.iter_mut().zip(&mut changes).enumerate() {
                *bend = piece.tool_product(1, 1, at);
                // By the way, the third derivative is -curvature² along the path. The rest of it is across.
                *change = (piece.tool_product(2, 2, at) - *bend * *bend).max(0.0);
            }
            let (mut curvature, mut change) = (largest(&bends).sqrt(), largest(&changes).sqrt());
            curvature += scale * length(piece.tool_off(1));
            change += scale * length(piece.tool_off(2));
            self.bend = self.bend.max(Bend { curvature, change });
            self.keep_tool(curvature, change, programmed);
        }
        let rated = arm.limits();
        let limits = &mut self.limits;
        let joints = || piece.joints().iter().enumerate().take(arm.axes());
        for (axis, joint) in joints() {
            let steepest = joint.largest(0, scale);
            limits.acceleration =
                limits.acceleration.min(RESERVE * rated.acceleration[axis] / (2.0 * steepest));
            limits.jerk = limits.jerk.min(RESERVE * rated.jerk[axis] / (2.0 * steepest));
        }
        for (axis, joint) in joints() {
            let rated = Limits {
                speed: RESERVE * rated.speed[axis],
                acceleration: RESERVE * rated.acceleration[axis],
                jerk: RESERVE * rated.jerk[axis],
            };
            let slowest = speed_of_joint(joint, scale, limits, &rated);
            if slowest < limits.speed {
                (limits.speed, self.slowest_axis) = (slowest, axis as u8 + 1);
            }
        }
    }

    /// Reduces the limits to what the tool may do where its path has at most this curvature, in 1/mm, which changes by
    /// this much, in 1/mm².
    fn keep_tool(&mut self, curvature: f64, change: f64, programmed: Limits) {
        let Limits { speed, acceleration, jerk } = &mut self.limits;
        *speed = speed
            .min((ACROSS * programmed.acceleration / curvature).sqrt())
            .min(libm::cbrt(CHANGING * programmed.jerk / change))
            .min(libm::cbrt(TURNING * programmed.jerk / (curvature * curvature)));
        let along = |whole: f64, across: f64| (whole * whole - across * across).max(0.0).sqrt();
        let changing = change * cube(*speed);
        *acceleration = acceleration
            .min(along(programmed.acceleration, *speed * *speed * curvature))
            .min((ACROSS * programmed.jerk - changing) / (3.0 * curvature * *speed));
        let across = changing + 3.0 * curvature * *speed * *acceleration;
        *jerk = jerk.min(along(programmed.jerk, across) - curvature * curvature * cube(*speed));
    }
}

/// Whether these limits keep what the arm allows even if the derivatives are off by as much as they may be.
fn holds_with_what_is_left_out(limits: &Limits, curve: &Curve, piece: &Derivatives, arm: &Arm) -> bool {
    let Limits { speed, acceleration, jerk } = *limits;
    let reserve = 1.0 - RESERVE;
    let rated = arm.limits();
    let of_joints = piece.joints().iter().enumerate().take(arm.axes()).all(|(axis, joint)| {
        let [slope, bend, twist] = joint.off;
        slope * speed <= reserve * rated.speed[axis]
            && slope * acceleration + bend * speed * speed <= reserve * rated.acceleration[axis]
            && slope * jerk + 3.0 * bend * speed * acceleration + twist * cube(speed)
                <= reserve * rated.jerk[axis]
    });
    let (bend, twist) = (length(piece.tool_off(1)), length(piece.tool_off(2)));
    let of_tool = bend * speed * speed <= 1e-3 * acceleration
        && 3.0 * bend * speed * acceleration + twist * cube(speed) <= 1e-3 * jerk;
    of_joints && (of_tool || matches!(curve, Curve::Line(_)))
}

fn cube(value: f64) -> f64 {
    value * value * value
}

/// The highest speed up to that of `limits` at which a joint stays within what it is rated for, while the other limits
/// are made use of; with `share` of what its derivatives may be off.
fn speed_of_joint(joint: &Channel, share: f64, limits: &Limits, rated: &Limits) -> f64 {
    // What the speed makes of slope, bend and twist, and what acceleration and jerk along the curve leave for it.
    let loads = |at: usize, speed: f64| {
        let [slope, bend, twist] = [0, 1, 2].map(|order| joint.size(order, at, share));
        let turning = 3.0 * bend * limits.acceleration;
        let square = speed * speed;
        (
            (slope * speed, rated.speed),
            (bend * square, rated.acceleration - slope * limits.acceleration),
            ((turning + twist * square) * speed, rated.jerk - slope * limits.jerk),
        )
    };
    let mut slowest = limits.speed;
    // As a rule nothing is too fast at any point, and so there is nothing to divide.
    let too_much = most(0.0, |at| {
        let (speed, acceleration, jerk) = loads(at, slowest);
        let (speed, acceleration, jerk) =
            (speed.0 - speed.1, acceleration.0 - acceleration.1, jerk.0 - jerk.1);
        let more = if speed > acceleration { speed } else { acceleration };
        if jerk > more { jerk } else { more }
    });
    if too_much == 0.0 {
        return slowest;
    }
    for at in 0..PLACES {
        let (speed, acceleration, jerk) = loads(at, slowest);
        if speed.0 <= speed.1 && acceleration.0 <= acceleration.1 && jerk.0 <= jerk.1 {
            continue;
        }
        let [slope, bend, twist] = [0, 1, 2].map(|order| joint.size(order, at, share));
        slowest = slowest.min(speed.1 / slope).min((acceleration.1 / bend).sqrt());
        slowest = speed_within_jerk(slowest, 3.0 * bend * limits.acceleration, twist, jerk.1);
    }
    slowest
}

/// The highest speed v up to `speed` with linear·v + cubic·v³ ≤ jerk.
fn speed_within_jerk(mut speed: f64, linear: f64, cubic: f64, jerk: f64) -> f64 {
    // Newton's method from above on a convex function comes down to the root and never passes it.
    for _ in 0..8 {
        let square = cubic * speed * speed;
        let over = (linear + square) * speed - jerk;
        if over <= jerk * 1e-6 {
            break;
        }
        speed -= over / (linear + 3.0 * square);
    }
    speed
}
