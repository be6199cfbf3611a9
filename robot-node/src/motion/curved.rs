//! What a curved path of the tool allows: the speed that its bends leave of the path acceleration, and of the joints.
//!
//! On a path of curvature κ the tool is accelerated by v²·κ across the path and by a along it; both together may be
//! as much as is programmed. At most [`ACROSS`] of it goes across, so that 0.6 is left along the path.

use super::curve::Curve;
use super::profile::Limits;
use super::segment::Segment;
use super::spline::Spline;
use crate::arm::{Arm, Joints, SINGULAR_SHARE, Violation};

/// Parts into which a curve is cut to check it.
const CHECKS: usize = 48;

/// What joint limits keep in reserve for what lies between the checked points.
const RESERVE: f64 = 0.96;

/// The share of the path acceleration that the bend gets at most.
const ACROSS: f64 = 0.8;

/// The programmed limits of a tool's path, reduced to what its sharpest bend allows; `curvature` in 1/mm.
#[must_use]
pub(super) fn on_bend(programmed: Limits, curvature: f64) -> Limits {
    let Limits { speed, acceleration } = programmed;
    let speed = speed.min((ACROSS * acceleration / curvature).sqrt());
    let across = speed * speed * curvature;
    Limits { speed, acceleration: (acceleration * acceleration - across * across).max(0.0).sqrt() }
}

/// The joints at the end of a tool's path that starts at `from`, and its limits, reduced to what the joints can follow
/// along all of it: as on a line, half of what an axis has for the path acceleration, and what is left for the speed.
///
/// # Errors
///
/// A point of it that the arm does not reach, or a singular position.
pub(super) fn followed(
    curve: &Curve,
    from: &Joints,
    wanted: Limits,
    arm: &Arm,
) -> Result<(Joints, Limits), Violation> {
    let step = curve.length() / CHECKS as f64;
    let mut joints = *from;
    let mut slopes = [[0.0; 6]; CHECKS];
    for (check, slope) in slopes.iter_mut().enumerate() {
        let next = curve.joints(step * (check + 1) as f64, arm, &joints)?;
        *slope = core::array::from_fn(|axis| (next[axis] - joints[axis]) / step);
        joints = next;
    }
    let rated = arm.limits();
    let steepest = slopes.iter().fold(0.0_f64, |load, slope| load.max(rated.acceleration_load(slope).share));
    let mut limits = wanted;
    limits.acceleration = limits.acceleration.min(RESERVE / (2.0 * steepest));
    let mut slowest_axis = 1;
    let mut keep = |slope: &Joints, bend: &Joints| {
        for axis in 0..arm.axes() {
            let left = RESERVE * rated.acceleration[axis] - slope[axis].abs() * limits.acceleration;
            let speed =
                (RESERVE * rated.speed[axis] / slope[axis].abs()).min((left / bend[axis].abs()).sqrt());
            if speed < limits.speed {
                (limits.speed, slowest_axis) = (speed, axis as u8 + 1);
            }
        }
    };
    let bend = |check: usize| -> Joints {
        core::array::from_fn(|axis| (slopes[check + 1][axis] - slopes[check][axis]) / step)
    };
    for check in 0..CHECKS - 1 {
        let steeper =
            core::array::from_fn(|axis| slopes[check][axis].abs().max(slopes[check + 1][axis].abs()));
        keep(&steeper, &bend(check));
    }
    // A curve bends up to its very ends, where no second difference is: it goes on there as it did before.
    for (end, last, before) in [(0, 0, 1), (CHECKS - 1, CHECKS - 2, CHECKS - 3)] {
        let (last, before) = (bend(last), bend(before));
        let beyond: Joints = core::array::from_fn(|axis| 2.0 * last[axis] - before[axis]);
        let slope: Joints =
            core::array::from_fn(|axis| slopes[end][axis].abs() + beyond[axis].abs() * step / 2.0);
        keep(&slope, &beyond);
    }
    if limits.speed < wanted.speed * SINGULAR_SHARE {
        return Err(Violation::Singular { axis: slowest_axis, share: limits.speed / wanted.speed });
    }
    Ok((joints, limits))
}

/// A motion of a spline in the shape that its neighbours give it, from the joints `from`; none where the arm cannot
/// follow that shape to the same joints.
#[must_use]
pub(super) fn reshaped(segment: &Segment, spline: Spline, from: &Joints, arm: &Arm) -> Option<Segment> {
    let curve = Curve::Spline(spline);
    let wanted = on_bend(spline.programmed(), spline.sharpest_curvature());
    let (end, limits) = followed(&curve, from, wanted, arm).ok()?;
    let same_turns = end.iter().zip(&segment.end).all(|(one, other)| (one - other).abs() < 1e-3);
    same_turns.then_some(Segment { curve, end, limits, ..*segment })
}
