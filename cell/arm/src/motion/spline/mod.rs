//! One motion of a spline: the piece between two targets of a curve that goes through all of them.
//!
//! A piece is a blend of two parabolas: one through the three poses around its start, one through the three around
//! its end. With the share τ of the piece, and both parabolas over the common parameter u:
//!
//! ```text
//! r(u) = p₀(u) + w(τ)·(p₁(u) − p₀(u)),  w(τ) = 3τ² − 2τ³,  u grows by √(distance) from target to target
//! ```
//!
//! Both parabolas go through both ends of the piece, so that p₁ − p₀ = c·τ·(1 − τ): at its ends r has position, first
//! and second derivative of one parabola alone. The next piece has that same parabola there, and so the curve is
//! continuous in its second derivative by u (C²), and in tangent and curvature on the path (G²).
//!
//! The scheme is local because the PLC shows five motions ahead at most, and often fewer: a piece depends on its two
//! targets, the one before and the one after, and on nothing else. A spline that is C² and of degree three would depend
//! on every target to come, and change behind the arm with each that is written. Without a target before or after, the
//! piece is the parabola of the other end; with neither, it is a straight line.
//!
//! Square roots of the distances (the centripetal parameter) keep a long piece beside a short one from swinging out.
//! The orientation goes through the same blend as a quaternion and is normalised, so it is as smooth as the position.

mod quintic;
#[cfg(test)]
mod tests;
mod ways;

use super::flange::Flange;
use crate::{Frame, Rotation, distance, dot, length};
use quintic::{Pose, Quintic};
use ways::Ways;

/// Chords that enclose more than this many degrees, counted from straight on, turn back: the arm stops there.
const TURNS_BACK_DEG: f64 = 160.0;

/// A piece of a spline of the tool in the root. Its parameter is the way in mm.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Spline {
    before: Option<Frame>,
    from: Frame,
    to: Frame,
    after: Option<Frame>,
    curve: Quintic,
    ways: Ways,
    flange: Flange,
}

impl Spline {
    /// A piece without neighbours, a straight line, in mm.
    #[must_use]
    pub fn new(from: Frame, to: Frame, flange: Flange) -> Self {
        Self::between(None, from, to, None, flange)
    }

    /// This piece between the poses before its start and after its end, where they are known.
    #[must_use]
    pub fn with_neighbours(&self, before: Option<Frame>, after: Option<Frame>) -> Self {
        Self::between(before, self.from, self.to, after, self.flange)
    }

    fn between(before: Option<Frame>, from: Frame, to: Frame, after: Option<Frame>, flange: Flange) -> Self {
        let start = pose(&from, None);
        let end = pose(&to, Some(&start));
        let u = distance(from.position, to.position).sqrt();
        let slope: Pose = core::array::from_fn(|i| (end[i] - start[i]) / u);
        // The second derivative by u of the parabola through three poses, half of it.
        let bend = |other: Option<Frame>, near: &Frame, near_pose: &Pose, sign: f64| -> Option<Pose> {
            let other = other?;
            let other_pose = pose(&other, Some(near_pose));
            let other_u = distance(other.position, near.position).sqrt();
            Some(core::array::from_fn(|i| {
                let other_slope = sign * (other_pose[i] - near_pose[i]) / other_u;
                sign * (other_slope - slope[i]) / (u + other_u)
            }))
        };
        let at_start = bend(before, &from, &start, -1.0);
        let at_end = bend(after, &to, &end, 1.0);
        let at_start_or_end = (at_start.or(at_end), at_end.or(at_start));
        let (first, last) = (at_start_or_end.0.unwrap_or([0.0; 7]), at_start_or_end.1.unwrap_or([0.0; 7]));
        // p(τ) = start + τ·(end − start) − bend·u²·τ·(1 − τ); the difference of the two is (last − first) there.
        let mut factors = [[0.0; 7]; 6];
        for i in 0..7 {
            let (a, c) = (first[i] * u * u, (last[i] - first[i]) * u * u);
            let along = end[i] - start[i];
            let of_powers = [start[i], along - a, a, -3.0 * c, 5.0 * c, -2.0 * c];
            for (factor, value) in factors.iter_mut().zip(of_powers) {
                factor[i] = value;
            }
        }
        let curve = Quintic(factors);
        let ways = if before.is_none() && after.is_none() {
            Ways::of_line(distance(from.position, to.position))
        } else {
            Ways::of(&curve)
        };
        Self { before, from, to, after, curve, ways, flange }
    }

    /// The way from start to target, in mm.
    #[must_use]
    #[inline]
    pub const fn length(&self) -> f64 {
        self.ways.length()
    }

    /// Where it starts: the tool in the root.
    #[must_use]
    pub const fn from(&self) -> &Frame {
        &self.from
    }

    /// Its target: the tool in the root.
    #[must_use]
    pub const fn to(&self) -> &Frame {
        &self.to
    }

    /// Where the piece before it starts, if there is one.
    #[must_use]
    pub const fn before(&self) -> Option<Frame> {
        self.before
    }

    /// How the flange follows from the tool.
    #[must_use]
    pub const fn flange(&self) -> &Flange {
        &self.flange
    }

    /// Whether one curve can go through this piece and then to that one's target: the same tool, and no turn back.
    #[must_use]
    pub fn goes_on_to(&self, next: &Self) -> bool {
        let one = difference(self.to.position, self.from.position);
        let other = difference(next.to.position, next.from.position);
        let cos = dot(one, other) / (length(one) * length(other));
        self.flange == next.flange && cos > libm::cos(TURNS_BACK_DEG.to_radians())
    }

    /// The tool in the root after `way`.
    #[must_use]
    pub fn tool(&self, way: f64) -> Frame {
        let [tool] = self.tools(&[way]);
        tool
    }

    /// The tool in the root after each of some ways.
    #[must_use]
    pub fn tools<const N: usize>(&self, ways: &[f64; N]) -> [Frame; N] {
        let shares = self.ways.shares(&self.curve, ways);
        core::array::from_fn(|i| {
            if ways[i] <= 0.0 {
                return self.from;
            }
            if ways[i] >= self.length() {
                return self.to;
            }
            let [x, y, z, quaternion @ ..] = self.curve.at(shares[i]);
            Frame { position: [x, y, z], rotation: Rotation::from_quaternion(quaternion) }
        })
    }

    /// The tool's second derivative by the way after each of some ways, in 1/mm.
    pub(super) fn bends<const N: usize>(&self, ways: &[f64; N]) -> [[f64; 3]; N] {
        self.ways.shares(&self.curve, ways).map(|share| self.curve.bend_by_way(share))
    }

    /// Where the tool is after `way`.
    pub(super) fn position(&self, way: f64) -> [f64; 3] {
        if way <= 0.0 {
            return self.from.position;
        }
        if way >= self.length() {
            return self.to.position;
        }
        let [share] = self.ways.shares(&self.curve, &[way]);
        let [x, y, z, ..] = self.curve.at(share);
        [x, y, z]
    }
}

/// Position and quaternion; of the two quaternions of a rotation, the one that is nearer to that of `near`.
fn pose(frame: &Frame, near: Option<&Pose>) -> Pose {
    let [x, y, z] = frame.position;
    let [a, b, c, d] = frame.rotation.quaternion();
    let pose = [x, y, z, a, b, c, d];
    let along = near.map_or(1.0, |near| pose.iter().zip(near).skip(3).map(|(one, other)| one * other).sum());
    if along < 0.0 { [x, y, z, -a, -b, -c, -d] } else { pose }
}

fn difference(to: [f64; 3], from: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| to[i] - from[i])
}
