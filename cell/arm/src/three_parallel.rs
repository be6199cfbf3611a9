//! A six-axis arm without a spherical wrist, whose axes 2, 3 and 4 are parallel, such as those of Universal Robots. Its
//! parameters are the Denavit-Hartenberg ones that Universal Robots publishes.
//!
//! ```text
//! model angle θ = sign·q − offset
//! x along the arm's plane, n across it, up:    x = (cos θ1, sin θ1, 0), n = (sin θ1, −cos θ1, 0)
//! axis 4 in the plane, from axis 2:            a2·(cos θ2, sin θ2) + a3·(cos(θ2 + θ3), sin(θ2 + θ3))
//! with φ = θ2 + θ3 + θ4:                       z4 = (sin φ, −cos φ) in the plane
//!                                              z6 = −sin θ5·(cos φ, sin φ) in the plane + cos θ5·n
//! flange = d1·up + axis 4 + d4·n + d5·z4 + d6·z6
//! ```
//!
//! The inverse has a closed form. z6 and the flange give the point before the flange, whose distance d4 from the arm's
//! plane gives axis 1 (two ways). The part of z6 across the plane gives axis 5 (two ways), the rest of z6 gives φ, and
//! the flange's x and y, seen along x at θ6 = 0, which is cos θ5·(cos φ, sin φ) in the plane + sin θ5·n, give axis 6. Two links in a plane remain (two ways).

use super::angles::{degrees, sin_cos};
use super::branch::{Branch, SixAxes, to_joints, to_model};
use super::{Frame, Joints, Rotation, Skeleton, Violation, dot};

/// Sine of axis 5's angle below which axis 6 is parallel to axes 2, 3 and 4; then axis 6 keeps its angle.
const WRIST_STRETCHED: f64 = 1e-9;

/// Share of the reach that rounding may add: a fully stretched arm is allowed.
const ROUNDING: f64 = 1e-9;

/// The geometry of such an arm as numbers. Lengths in mm, offsets in degrees.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct ThreeParallelParameters {
    /// From the root to axis 2, upward.
    pub d1: f64,
    /// From axis 2 to axis 3; negative where the arm points backward at zero, as of Universal Robots.
    pub a2: f64,
    /// From axis 3 to axis 4, with the sign of `a2`.
    pub a3: f64,
    /// From the plane of axis 1 to axis 5, across the arm.
    pub d4: f64,
    /// From axis 4 to axis 6, along axis 5.
    pub d5: f64,
    /// From axis 5 to the flange.
    pub d6: f64,
    /// Each joint's zero relative to that of the model.
    pub offsets: Joints,
    /// 1 if a joint turns in the model's direction, −1 if it turns in the opposite one.
    pub signs: [i8; 6],
}

/// A six-axis arm with three parallel axes.
#[derive(Clone, Copy, Debug)]
pub struct ThreeParallel(ThreeParallelParameters);

impl ThreeParallel {
    /// Creates an arm of these numbers: all finite, a2 and a3 not 0 and of one sign, offsets within ±360°.
    #[must_use]
    pub const fn new(parameters: ThreeParallelParameters) -> Self {
        Self(parameters)
    }

    fn joints(&self, model: &Joints) -> Joints {
        to_joints(model, &self.0.offsets, &self.0.signs)
    }

    /// Returns 1 if the arm points along x at zero, −1 if it points against it.
    const fn forward_sign(&self) -> f64 {
        if self.0.a2 < 0.0 { -1.0 } else { 1.0 }
    }

    /// Returns x of the arm's plane, which axis 1 turns, and how far along it the point before the flange lies.
    fn plane(&self, [x, y, _]: [f64; 3], front: bool) -> Result<([f64; 2], f64), Violation> {
        let d4 = self.0.d4;
        let square = x * x + y * y - d4 * d4;
        if square < -ROUNDING * d4 * d4 {
            let distance_mm = (x * x + y * y).sqrt();
            return Err(Violation::WristRadius { distance_mm, nearest_mm: d4.abs() });
        }
        let along = square.max(0.0).sqrt();
        let radial = if front { along } else { -along } * self.forward_sign();
        // Exactly above axis 1 there is no direction, and d4 is 0, so any direction is right.
        let ground = radial * radial + d4 * d4;
        if ground == 0.0 {
            return Ok(([1.0, 0.0], 0.0));
        }
        Ok(([(radial * x - d4 * y) / ground, (radial * y + d4 * x) / ground], radial))
    }

    /// Returns the directions of axes 2 and 3 that bring axis 4 there in the arm's plane, seen from axis 2.
    fn links(&self, [u, v]: [f64; 2], elbow_positive: bool) -> Result<([f64; 2], [f64; 2]), Violation> {
        let ThreeParallelParameters { a2, a3, .. } = self.0;
        let reach = u * u + v * v;
        let cos_3 = (reach - a2 * a2 - a3 * a3) / (2.0 * a2 * a3);
        if cos_3.is_nan() || cos_3.abs() > 1.0 + ROUNDING {
            return Err(Violation::WristReach {
                distance_mm: reach.sqrt(),
                nearest_mm: (a2 - a3).abs(),
                farthest_mm: (a2 + a3).abs(),
            });
        }
        let cos_3 = cos_3.clamp(-1.0, 1.0);
        let sine = (1.0 - cos_3 * cos_3).sqrt();
        let sin_3 = if elbow_positive { sine } else { -sine };
        let (along, across) = (a2 + a3 * cos_3, a3 * sin_3);
        Ok(([u * along + v * across, v * along - u * across], [cos_3, sin_3]))
    }
}

impl SixAxes for ThreeParallel {
    #[inline]
    fn model(&self, joints: &Joints) -> Joints {
        to_model(joints, &self.0.offsets, &self.0.signs)
    }

    #[inline]
    fn pose(&self, &[q1, q2, q3, q4, q5, q6]: &Joints) -> Frame {
        let ThreeParallelParameters { d1, a2, a3, d4, d5, d6, .. } = self.0;
        let lift = q2 + q3 + q4;
        let (
            [sin_1, sin_2, sin_23, sin_lift, sin_5, half_sin_1, half_sin_lift, half_sin_5, half_sin_6],
            [cos_1, cos_2, cos_23, cos_lift, cos_5, half_cos_1, half_cos_lift, half_cos_5, half_cos_6],
        ) = sin_cos([q1, q2, q2 + q3, lift, q5, q1 / 2.0, lift / 2.0, q5 / 2.0, q6 / 2.0]);
        let along = a2 * cos_2 + a3 * cos_23 + d5 * sin_lift - d6 * sin_5 * cos_lift;
        let up = d1 + a2 * sin_2 + a3 * sin_23 - d5 * cos_lift - d6 * sin_5 * sin_lift;
        let across = d4 + d6 * cos_5;
        // Rz(θ1)·Rx(90°)·Rz(φ)·Rx(90°)·Rz(θ5)·Rx(−90°)·Rz(θ6), which is Rz(θ1)·Ry(−φ)·Rx(90°)·Ry(−θ5)·Rz(θ6):
        // Rx(90°) turns z to −y.
        let turn = |half_cos: f64, axis: [f64; 3], half_sin: f64| {
            let [x, y, z] = axis.map(|part| part * half_sin);
            Rotation::from_parts([half_cos, x, y, z])
        };
        let rotation = turn(half_cos_1, [0.0, 0.0, 1.0], half_sin_1)
            * turn(half_cos_lift, [0.0, -1.0, 0.0], half_sin_lift)
            * Rotation::from_parts([
                core::f64::consts::FRAC_1_SQRT_2,
                core::f64::consts::FRAC_1_SQRT_2,
                0.0,
                0.0,
            ])
            * turn(half_cos_5, [0.0, -1.0, 0.0], half_sin_5)
            * turn(half_cos_6, [0.0, 0.0, 1.0], half_sin_6);
        Frame { position: [along * cos_1 + across * sin_1, along * sin_1 - across * cos_1, up], rotation }
    }

    /// The upper arm lies beside axis 1, and the forearm back above it.
    fn bodies(&self, model: &Joints) -> Skeleton {
        let ThreeParallelParameters { d1, a2, a3, d4, d5, .. } = self.0;
        let &[q1, q2, q3, q4, ..] = model;
        let ([sin_1, sin_2, sin_23, sin_lift], [cos_1, cos_2, cos_23, cos_lift]) =
            sin_cos([q1, q2, q2 + q3, q2 + q3 + q4]);
        // Along the arm's plane, up and across it, as a point in the root frame.
        let point = |[along, up, across]: [f64; 3]| {
            [along * cos_1 + across * sin_1, along * sin_1 - across * cos_1, up]
        };
        let elbow = [a2 * cos_2, d1 + a2 * sin_2];
        let wrist = [elbow[0] + a3 * cos_23, elbow[1] + a3 * sin_23];
        let points = [
            [0.0, d1, 0.0],
            [0.0, d1, d4],
            [elbow[0], elbow[1], d4],
            [elbow[0], elbow[1], 0.0],
            [wrist[0], wrist[1], 0.0],
            [wrist[0], wrist[1], d4],
            [wrist[0] + d5 * sin_lift, wrist[1] - d5 * cos_lift, d4],
        ]
        .map(point);
        let [axis_2, shoulder, beside, elbow, wrist, axis_5, axis_6] = points;
        let flange = self.pose(model).position;
        Skeleton::new(&[[0.0; 3], axis_2, shoulder, beside, elbow, wrist, axis_5, axis_6, flange])
    }

    fn branch(&self, &[_, q2, q3, q4, q5, _]: &Joints) -> Branch {
        let ([_, _, along_5, elbow, wrist], [along_2, along_3, ..]) =
            sin_cos([q2, q2 + q3, q2 + q3 + q4, q3, q5]);
        let radial = self.0.a2 * along_2 + self.0.a3 * along_3 + self.0.d5 * along_5;
        Branch {
            front: radial * self.forward_sign() >= 0.0,
            elbow_positive: elbow >= 0.0,
            wrist_positive: wrist >= 0.0,
        }
    }

    fn solve(&self, flange: &Frame, branch: Branch, near: &Joints) -> Result<Joints, Violation> {
        let ThreeParallelParameters { d1, d5, d6, .. } = self.0;
        let [x6, y6, z6] =
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| flange.rotation.rotate(axis));
        let before: [f64; 3] = core::array::from_fn(|i| flange.position[i] - d6 * z6[i]);
        let ([cos_1, sin_1], radial) = self.plane(before, branch.front)?;
        let along = |vector: [f64; 3]| vector[0] * cos_1 + vector[1] * sin_1;
        let across = |vector: [f64; 3]| dot(vector, [sin_1, -cos_1, 0.0]);
        let cos_5 = across(z6);
        let sine = (along(z6) * along(z6) + z6[2] * z6[2]).sqrt();
        let sign = if branch.wrist_positive { 1.0 } else { -1.0 };
        let (angle_6, cos_lift, sin_lift) = if sine < WRIST_STRETCHED {
            // Axes 2, 3, 4 and 6 turn about parallel lines: x6 in the plane is at φ + θ6, or at φ − θ6 + 180°.
            let ([sin_6], [cos_6]) = sin_cos([near[5]]);
            let (x, y) = (along(x6), x6[2]);
            if cos_5 > 0.0 {
                (None, x * cos_6 + y * sin_6, y * cos_6 - x * sin_6)
            } else {
                (None, -(x * cos_6 - y * sin_6), -(y * cos_6 + x * sin_6))
            }
        } else {
            let part = -sign / sine;
            let (cos_lift, sin_lift) = (along(z6) * part, z6[2] * part);
            // The direction of x6 where θ6 is 0. Near a stretched wrist φ is hardly known; θ6 measured from this
            // makes up for what it lacks.
            let zero = |vector: [f64; 3]| {
                cos_5 * (along(vector) * cos_lift + vector[2] * sin_lift) + sign * sine * across(vector)
            };
            (Some([zero(x6), -zero(y6)]), cos_lift, sin_lift)
        };
        let (u, v) = (radial - d5 * sin_lift, before[2] - d1 + d5 * cos_lift);
        let ([shoulder_cos, shoulder_sin], [cos_3, sin_3]) = self.links([u, v], branch.elbow_positive)?;
        let six = angle_6.unwrap_or([1.0, 0.0]);
        let [q1, q2, q3, lift, q5, q6] = degrees(
            [cos_1, shoulder_cos, cos_3, cos_lift, cos_5, six[0]],
            [sin_1, shoulder_sin, sin_3, sin_lift, sign * sine, six[1]],
        );
        let q6 = if angle_6.is_some() { q6 } else { near[5] };
        Ok(self.joints(&[q1, q2, q3, lift - q2 - q3, q5, q6]))
    }
}

#[cfg(test)]
mod tests;
