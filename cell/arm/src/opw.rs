//! A six-axis arm with a parallel base and a spherical wrist, in the parameters a1, a2, b, c1…c4 of Brandstötter,
//! Angerer and Hofbaur (2014), which `rs-opw-kinematics` takes as well.
//!
//! ```text
//! model angle θ = sign·q − offset                k = √(a2² + c3²), ψ = atan2(a2, c3)
//! wrist centre in the plane of the arm, from axis 2:    n = c2·sin θ2 + k·sin(θ2 + θ3 + ψ)
//!                                                       h = c2·cos θ2 + k·cos(θ2 + θ3 + ψ)
//! orientation = Rz(θ1)·Ry(θ2 + θ3)·Rz(θ4)·Ry(θ5)·Rz(θ6)
//! ```
//!
//! The inverse kinematics of that crate finds all eight configurations, checks each by forward kinematics and returns
//! them in a new `Vec`: several microseconds and an allocation, 50 times for one line with its corner. A path needs only
//! the configuration of the previous point, so [`Opw`] solves for that one alone. The crate also takes its sines from the
//! C library, whose last bits differ from one processor to another. So both directions are our own; tests compare them
//! with the crate.

use super::angles::{degrees, sin_cos};
use super::branch::{Branch, SixAxes, to_joints, to_model};
use super::{Frame, Joints, Rotation, Skeleton, Violation};

/// Tangent of half of axis 5's angle below which axes 4 and 6 turn about one line; then axis 4 keeps its angle.
const WRIST_STRETCHED: f64 = 1e-9;

/// Share of the reach that rounding may add: a fully stretched arm is allowed.
const ROUNDING: f64 = 1e-9;

/// The geometry of a six-axis arm as numbers. Lengths in mm, offsets in degrees.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct OpwParameters {
    /// From axis 1 to axis 2, forward.
    pub a1: f64,
    /// From axis 3 to axis 4, across the forearm; negative where axis 4 lies above axis 3 with the forearm level.
    pub a2: f64,
    /// From the plane of the base to that of the arm, sideways.
    pub b: f64,
    /// From the root to axis 2, upward.
    pub c1: f64,
    /// From axis 2 to axis 3.
    pub c2: f64,
    /// From axis 3 to the wrist centre.
    pub c3: f64,
    /// From the wrist centre to the flange.
    pub c4: f64,
    /// Each joint's zero relative to that of the model.
    pub offsets: Joints,
    /// 1 if a joint turns in the model's direction, −1 if it turns in the opposite one.
    pub signs: [i8; 6],
}

/// A six-axis arm.
#[derive(Clone, Copy, Debug)]
pub struct Opw {
    parameters: OpwParameters,
    /// k: distance from axis 3 to the wrist centre.
    forearm: f64,
    /// ψ, in degrees: angle between axis 4 and the line from axis 3 to the wrist centre.
    lean: f64,
    lean_direction: Direction,
    /// c2² + k²: the square of the wrist centre's distance from axis 2 where the forearm is bent by 90°.
    stretch: f64,
    /// 1 / (2·c2·k): how the cosine of that bend grows with the square of the distance.
    bend_per_reach: f64,
}

impl Opw {
    /// Creates an arm of these numbers: all finite, c2 and c3 above 0, offsets within ±360°.
    #[must_use]
    pub fn new(parameters: OpwParameters) -> Self {
        let OpwParameters { a2, c2, c3, .. } = parameters;
        let forearm = (a2 * a2 + c3 * c3).sqrt();
        Self {
            parameters,
            forearm,
            lean: libm::atan2(a2, c3).to_degrees(),
            lean_direction: Direction::of(c3, a2, forearm),
            stretch: c2 * c2 + forearm * forearm,
            bend_per_reach: 1.0 / (2.0 * c2 * forearm),
        }
    }

    fn joints(&self, model: &Joints) -> Joints {
        to_joints(model, &self.parameters.offsets, &self.parameters.signs)
    }

    /// Returns axes 1 and 2 of the model that bring the wrist centre to this point, the angle between forearm and upper
    /// arm (axis 3 and ψ), and the orientation of the forearm there as a quaternion of any length.
    fn arm(&self, [x, y, z]: [f64; 3], branch: Branch) -> Result<([Direction; 3], Rotation), Violation> {
        let OpwParameters { a1, b, c1, c2, .. } = self.parameters;
        let forearm = self.forearm;
        let ground = x * x + y * y;
        let square = ground - b * b;
        if square < -ROUNDING * b * b {
            return Err(Violation::WristRadius { distance_mm: ground.sqrt(), nearest_mm: b.abs() });
        }
        let along = square.max(0.0).sqrt();
        let radial = if branch.front { along } else { -along };
        let (n, h) = (radial - a1, z - c1);
        let reach = n * n + h * h;
        let bend = (reach - self.stretch) * self.bend_per_reach;
        if bend.abs() > 1.0 + ROUNDING {
            return Err(Violation::WristReach {
                distance_mm: reach.sqrt(),
                nearest_mm: (c2 - forearm).abs(),
                farthest_mm: c2 + forearm,
            });
        }
        let bend = bend.clamp(-1.0, 1.0);
        let sine = (1.0 - bend * bend).sqrt();
        let sine = if branch.elbow_positive { sine } else { -sine };
        let (along, across) = (c2 + forearm * bend, forearm * sine);
        // Products of two vectors of equal length, so that their length, a root, is not needed.
        let base = Direction::of(x * radial + y * b, y * radial - x * b, ground);
        let shoulder = Direction::of(h * along + n * across, n * along - h * across, reach);
        let elbow = Direction { cos: bend, sin: sine, length: 1.0 };
        // Rz(θ1)·Ry(θ2 + θ3)
        let (turn, lift) = (base.half(), shoulder.and(elbow).and(self.lean_direction.opposite()).half());
        let turned = [turn.0 * lift.0, -turn.1 * lift.1, turn.0 * lift.1, turn.1 * lift.0];
        Ok(([base, shoulder, elbow], Rotation::from_parts(turned)))
    }
}

/// Returns whether the sine of an angle in degrees is not below 0.
fn is_within_the_first_half_turn(degrees: f64) -> bool {
    if degrees.abs() < 360.0 {
        return (0.0..=180.0).contains(&degrees) || degrees <= -180.0;
    }
    degrees - 360.0 * (degrees / 360.0).floor() <= 180.0
}

/// An angle as a vector in the plane: angles are added and halved without computing any arc tangent. Cosine and sine are
/// multiplied by `length`; only their ratio counts, and a length of 1 would cost a root and a division each time.
#[derive(Clone, Copy, Debug)]
struct Direction {
    cos: f64,
    sin: f64,
    length: f64,
}

impl Direction {
    /// Returns the angle of a vector with this length; 0 for a vector of length 0.
    const fn of(cos: f64, sin: f64, length: f64) -> Self {
        if length > 0.0 { Self { cos, sin, length } } else { Self { cos: 1.0, sin: 0.0, length: 1.0 } }
    }

    const fn opposite(self) -> Self {
        Self { sin: -self.sin, ..self }
    }

    /// Returns the sum of two angles.
    const fn and(self, other: Self) -> Self {
        Self {
            cos: self.cos * other.cos - self.sin * other.sin,
            sin: self.sin * other.cos + self.cos * other.sin,
            length: self.length * other.length,
        }
    }

    /// Returns cosine and sine of half of the angle, which counts from −180° to 180°, times some length.
    fn half(self) -> (f64, f64) {
        // Of the two formulas the one without a subtraction, which loses no digits.
        if self.cos >= 0.0 {
            (self.length + self.cos, self.sin)
        } else {
            (self.sin.abs(), (self.length - self.cos).copysign(self.sin))
        }
    }
}

impl SixAxes for Opw {
    #[inline]
    fn model(&self, joints: &Joints) -> Joints {
        to_model(joints, &self.parameters.offsets, &self.parameters.signs)
    }

    #[inline]
    fn pose(&self, &[q1, q2, q3, q4, q5, q6]: &Joints) -> Frame {
        let OpwParameters { a1, a2, b, c1, c2, c3, c4, .. } = self.parameters;
        let lift = q2 + q3;
        // Axes 1 to 3 as they are, and half of what turns the flange: axes 4 and 6 together, and one against the other.
        let ([s1, s2, s_lift, s_turn, s_lifted, s_sum, s_difference, s_bend], cosines) =
            sin_cos([q1, q2, lift, q1 / 2.0, lift / 2.0, (q4 + q6) / 2.0, (q4 - q6) / 2.0, q5 / 2.0]);
        let [k1, k2, k_lift, k_turn, k_lifted, k_sum, k_difference, k_bend] = cosines;
        // Rz(θ1)·Ry(θ2 + θ3) and Rz(θ4)·Ry(θ5)·Rz(θ6)
        let forearm = [k_turn * k_lifted, -s_turn * s_lifted, k_turn * s_lifted, s_turn * k_lifted];
        let wrist = [k_bend * k_sum, -s_bend * s_difference, s_bend * k_difference, k_bend * s_sum];
        let rotation = Rotation::from_parts(forearm) * Rotation::from_parts(wrist);
        // k·sin(θ + ψ) is c3·sin θ + a2·cos θ.
        let n = a1 + c2 * s2 + c3 * s_lift + a2 * k_lift;
        let h = c1 + c2 * k2 + c3 * k_lift - a2 * s_lift;
        let centre = [n * k1 - b * s1, n * s1 + b * k1, h];
        let hand = rotation.z_axis();
        Frame { position: core::array::from_fn(|i| centre[i] + c4 * hand[i]), rotation }
    }

    fn bodies(&self, model: &Joints) -> Skeleton {
        let OpwParameters { a1, a2, b, c1, c2, c3, .. } = self.parameters;
        let &[q1, q2, q3, ..] = model;
        let ([s1, s2, s_lift], [k1, k2, k_lift]) = sin_cos([q1, q2, q2 + q3]);
        // Forward in the plane of the arm and up, as a point in the root frame.
        let point = |n: f64, up: f64| [n * k1 - b * s1, n * s1 + b * k1, up];
        let elbow = (a1 + c2 * s2, c1 + c2 * k2);
        let beside = (elbow.0 + a2 * k_lift, elbow.1 - a2 * s_lift);
        let wrist = point(beside.0 + c3 * s_lift, beside.1 + c3 * k_lift);
        let [elbow, beside] = [elbow, beside].map(|(n, up)| point(n, up));
        let flange = self.pose(model).position;
        Skeleton::new(&[[0.0; 3], [0.0, 0.0, c1], point(a1, c1), elbow, beside, wrist, flange])
    }

    fn branch(&self, &[_, q2, q3, _, q5, _]: &Joints) -> Branch {
        let elbow = q3 + self.lean;
        let OpwParameters { a1, c2, .. } = self.parameters;
        let wrist_centre = || {
            let ([upper_arm, forearm], _) = sin_cos([q2, q2 + elbow]);
            a1 + c2 * upper_arm + self.forearm * forearm
        };
        // If all of its parts lie in front, their sum need not be computed.
        let front =
            (a1 >= 0.0 && is_within_the_first_half_turn(q2) && is_within_the_first_half_turn(q2 + elbow))
                || wrist_centre() >= 0.0;
        Branch {
            front,
            elbow_positive: is_within_the_first_half_turn(elbow),
            wrist_positive: is_within_the_first_half_turn(q5),
        }
    }

    fn solve(&self, flange: &Frame, branch: Branch, near: &Joints) -> Result<Joints, Violation> {
        let hand = flange.rotation.z_axis().map(|part| part * self.parameters.c4);
        let centre = core::array::from_fn(|i| flange.position[i] - hand[i]);
        let ([base, shoulder, elbow], forearm) = self.arm(centre, branch)?;
        // What the wrist does: half of axes 4 and 6 together, half of one against the other, and axis 5.
        let [w, x, y, z] = (forearm.inverse() * flange.rotation).quaternion();
        // The squares of the sine and of the cosine of half of axis 5.
        let (sine, cosine) = (x * x + y * y, w * w + z * z);
        let [q1, q2, bend, half_sum, half_difference, q5] = degrees(
            [base.cos, shoulder.cos, elbow.cos, w, y, cosine - sine],
            [base.sin, shoulder.sin, elbow.sin, z, x, 2.0 * (sine * cosine).sqrt()],
        );
        let (q4, q6) = (half_sum - half_difference, half_sum + half_difference);
        let [q4, q5, q6] = if sine < WRIST_STRETCHED * WRIST_STRETCHED * cosine {
            [near[3], 0.0, 2.0 * half_sum - near[3]]
        } else if branch.wrist_positive {
            [q4, q5, q6]
        } else {
            [q4 + 180.0, -q5, q6 - 180.0]
        };
        Ok(self.joints(&[q1, q2, bend - self.lean, q4, q5, q6]))
    }
}

#[cfg(test)]
mod tests;
