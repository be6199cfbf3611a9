//! Poses and operations on them: a rotation and a displacement.

use core::ops::Mul;

use super::angles::sin_cos;
use super::shortest_turn;

/// A rotation, as a unit quaternion.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Rotation {
    w: f64,
    v: [f64; 3],
}

impl Rotation {
    /// No rotation.
    pub const IDENTITY: Self = Self { w: 1.0, v: [0.0; 3] };

    /// Returns the rotation by `angle` degrees about the unit vector `axis`.
    #[must_use]
    pub fn about(axis: [f64; 3], angle: f64) -> Self {
        let ([sin], [cos]) = sin_cos([angle / 2.0]);
        Self { w: cos, v: axis.map(|part| part * sin) }
    }

    /// Returns the rotation of a tool that points straight down, turned by `yaw` degrees about the upward z axis: a =
    /// yaw, b = 0, c = 180.
    #[must_use]
    pub fn pointing_down(yaw: f64) -> Self {
        let ([sin], [cos]) = sin_cos([yaw / 2.0]);
        Self { w: 0.0, v: [cos, sin, 0.0] }
    }

    /// Converts the angles a, b, c in degrees about z, y' and x''.
    #[must_use]
    pub fn from_angles([a, b, c]: [f64; 3]) -> Self {
        Self::about([0.0, 0.0, 1.0], a) * Self::about([0.0, 1.0, 0.0], b) * Self::about([1.0, 0.0, 0.0], c)
    }

    /// Returns the angles a, b, c in degrees about z, y' and x''; a and c within (−180, 180]. Where b is ±90, a and c turn
    /// about the same axis; then c is 0.
    #[must_use]
    pub fn angles(self) -> [f64; 3] {
        let Self { w, v: [x, y, z] } = self;
        let sin_b = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0);
        let (sin_a, cos_a) = (2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
        if sin_a.abs().max(cos_a.abs()) < LEAST_COS_B {
            let a = 2.0 * libm::atan2(z, w).to_degrees();
            return [half_open(shortest_turn(a)), 90.0_f64.copysign(sin_b), 0.0];
        }
        let a = libm::atan2(sin_a, cos_a);
        let c = libm::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y));
        [half_open(a.to_degrees()), libm::asin(sin_b).to_degrees(), half_open(c.to_degrees())]
    }

    /// Returns the unit quaternion w, x, y, z.
    #[must_use]
    pub const fn quaternion(self) -> [f64; 4] {
        let [x, y, z] = self.v;
        [self.w, x, y, z]
    }

    /// Converts a quaternion w, x, y, z without normalising it. If its length is not 1, it may only be used in
    /// products and in ratios of their parts.
    pub(super) const fn from_parts([w, x, y, z]: [f64; 4]) -> Self {
        Self { w, v: [x, y, z] }
    }

    /// Converts a quaternion w, x, y, z of any length except zero.
    #[must_use]
    pub fn from_quaternion(quaternion: [f64; 4]) -> Self {
        let scale = 1.0 / quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
        let [w, x, y, z] = quaternion.map(|part| part * scale);
        Self { w, v: [x, y, z] }
    }

    /// Returns the inverse rotation.
    #[must_use]
    pub fn inverse(self) -> Self {
        Self { w: self.w, v: self.v.map(|part| -part) }
    }

    /// Returns the angle in degrees, 0…180, from this orientation to another one.
    #[must_use]
    pub fn turn_to(self, other: Self) -> f64 {
        (self.inverse() * other).axis_angle().1
    }

    /// Returns unit axis and angle in degrees, 0…180, of the shorter rotation.
    #[must_use]
    pub fn axis_angle(self) -> ([f64; 3], f64) {
        let sign = if self.w < 0.0 { -1.0 } else { 1.0 };
        let sin = length(self.v);
        if sin < 1e-12 {
            return ([0.0, 0.0, 1.0], 0.0);
        }
        (self.v.map(|part| sign * part / sin), 2.0 * libm::atan2(sin, sign * self.w).to_degrees())
    }

    /// Returns the rotated z axis.
    #[must_use]
    #[inline]
    pub fn z_axis(self) -> [f64; 3] {
        let Self { w, v: [x, y, z] } = self;
        [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)]
    }

    /// Returns the square of the sine of half of [`tilt_from_down`](Self::tilt_from_down).
    #[must_use]
    pub fn half_tilt_square(self) -> f64 {
        self.w * self.w + self.v[2] * self.v[2]
    }

    /// Returns the angle in degrees between the rotated z axis and straight down.
    #[must_use]
    pub fn tilt_from_down(self) -> f64 {
        let Self { w, v: [x, y, z] } = self;
        2.0 * libm::atan2((w * w + z * z).sqrt(), (x * x + y * y).sqrt()).to_degrees()
    }

    /// Returns cosine and sine of half of the angle by which a tool that points straight down is turned about z.
    #[must_use]
    pub const fn half_yaw_pointing_down(self) -> [f64; 2] {
        let [cos, sin, _] = self.v;
        [cos, sin]
    }

    /// Rotates a vector.
    #[must_use]
    #[inline]
    pub fn rotate(self, vector: [f64; 3]) -> [f64; 3] {
        let twice = cross(self.v, vector).map(|part| 2.0 * part);
        let turned = cross(self.v, twice);
        core::array::from_fn(|i| vector[i] + self.w * twice[i] + turned[i])
    }
}

impl Mul for Rotation {
    type Output = Self;

    /// Combines two rotations: first `rhs`, then `self`, as frames of a chain from left to right.
    #[inline]
    fn mul(self, rhs: Self) -> Self {
        let (p, q) = (self.v, rhs.v);
        let turned = cross(p, q);
        Self {
            w: self.w * rhs.w - dot(p, q),
            v: core::array::from_fn(|i| self.w * q[i] + rhs.w * p[i] + turned[i]),
        }
    }
}

/// Pose of one frame in another: position of its origin and orientation.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Frame {
    /// Origin, in mm.
    pub position: [f64; 3],
    /// Orientation.
    pub rotation: Rotation,
}

impl Frame {
    /// The identity.
    pub const IDENTITY: Self = Self { position: [0.0; 3], rotation: Rotation::IDENTITY };

    /// Converts x, y, z in mm and a, b, c in degrees about z, y', x''.
    #[must_use]
    pub fn from_mm_deg([x, y, z, a, b, c]: [f64; 6]) -> Self {
        Self { position: [x, y, z], rotation: Rotation::from_angles([a, b, c]) }
    }

    /// Returns x, y, z in mm and a, b, c in degrees about z, y', x''.
    #[must_use]
    pub fn to_mm_deg(self) -> [f64; 6] {
        let ([x, y, z], [a, b, c]) = (self.position, self.rotation.angles());
        [x, y, z, a, b, c]
    }

    /// Converts a point of this frame to the outer frame, in mm.
    #[must_use]
    #[inline]
    pub fn point(&self, point: [f64; 3]) -> [f64; 3] {
        sum(self.position, self.rotation.rotate(point))
    }

    /// Returns the origin in the outer frame, in mm, of a frame that is given in this one.
    #[must_use]
    #[inline]
    pub fn origin_of(&self, inner: &Self) -> [f64; 3] {
        if *inner == Self::IDENTITY { self.position } else { self.point(inner.position) }
    }

    /// Returns the distance in mm and the angle in degrees, 0…180, from this pose to another one.
    #[must_use]
    pub fn offset_to(&self, other: &Self) -> [f64; 2] {
        [distance(self.position, other.position), self.rotation.turn_to(other.rotation)]
    }

    /// Returns the pose of the outer frame in this one.
    #[must_use]
    pub fn inverse(self) -> Self {
        let rotation = self.rotation.inverse();
        Self { position: rotation.rotate(self.position).map(|part| -part), rotation }
    }
}

impl Mul for Frame {
    type Output = Self;

    /// Returns the pose of `rhs`, which is given in `self`, in the outer frame of `self`.
    #[inline]
    fn mul(self, rhs: Self) -> Self {
        Self {
            position: sum(self.position, self.rotation.rotate(rhs.position)),
            rotation: self.rotation * rhs.rotation,
        }
    }
}

/// Returns the distance in mm between two points.
#[must_use]
#[inline]
pub fn distance(from: [f64; 3], to: [f64; 3]) -> f64 {
    length(core::array::from_fn(|i| to[i] - from[i]))
}

/// Returns the length of a vector.
#[must_use]
#[inline]
pub fn length(vector: [f64; 3]) -> f64 {
    dot(vector, vector).sqrt()
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Returns the dot product.
#[must_use]
#[inline]
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the cross product.
#[must_use]
#[inline]
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Below this cosine of b its rounding decides about a and c. Either way the orientation is right to some 10⁻⁶ degrees.
const LEAST_COS_B: f64 = 3e-8;

/// Maps −180 to 180: both are the same direction, and a display should not alternate between them.
fn half_open(degrees: f64) -> f64 {
    if degrees <= -180.0 + 1e-9 { degrees + 360.0 } else { degrees }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn assert_near(actual: [f64; 6], expected: [f64; 6]) {
        for (actual, expected) in actual.iter().zip(expected) {
            assert!((actual - expected).abs() < 1e-9, "{actual} is not {expected}");
        }
    }

    #[test]
    fn the_x_axis_of_a_base_turned_by_90_degrees_is_the_roots_y_axis() {
        let base = Frame::from_mm_deg([300.0, -150.0, 40.0, 90.0, 0.0, 0.0]);
        let target = Frame::from_mm_deg([100.0, 20.0, 5.0, 0.0, 0.0, 180.0]);
        assert_near((base * target).to_mm_deg(), [280.0, -50.0, 45.0, 90.0, 0.0, 180.0]);
    }

    #[test]
    fn a_tool_that_points_down_has_c_180() {
        assert_near(
            Frame { position: [0.0; 3], rotation: Rotation::pointing_down(30.0) }.to_mm_deg(),
            [0.0, 0.0, 0.0, 30.0, 0.0, 180.0],
        );
        assert!(Rotation::from_angles([17.0, 0.0, 180.0]).tilt_from_down() < 1e-9);
        assert!((Rotation::from_angles([17.0, 10.0, 180.0]).tilt_from_down() - 10.0).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn a_frame_and_its_inverse_cancel(
            pose in proptest::array::uniform6(-170.0..170.0_f64),
            point in proptest::array::uniform3(-500.0..500.0_f64),
        ) {
            let frame = Frame::from_mm_deg(pose);
            let back = frame.inverse() * (frame * Frame { position: point, rotation: Rotation::IDENTITY });
            prop_assert!(distance(back.position, point) < 1e-9);
        }

        #[test]
        fn angles_are_those_of_the_rotation_however_near_b_is_to_90_degrees(
            a in -180.0..180.0_f64, c in -180.0..180.0_f64, exponent in -12.0..1.0_f64, up in any::<bool>(), exact in any::<bool>(),
        ) {
            let off = if exact { 0.0 } else { libm::exp10(exponent) };
            let rotation = Rotation::from_angles([a, if up { 90.0 - off } else { off - 90.0 }, c]);
            let told = rotation.angles();
            prop_assert!(told.iter().all(|angle| (-180.0..=180.0).contains(angle)), "{:?}", told);
            let (_, turn) = (Rotation::from_angles(told) * rotation.inverse()).axis_angle();
            prop_assert!(turn < 1e-5, "{:?} is turned by {} degrees", told, turn);
        }

        #[test]
        fn angles_survive_a_round_trip(a in -179.0..179.0_f64, b in -89.0..89.0_f64, c in -179.0..179.0_f64) {
            let angles = Rotation::from_angles([a, b, c]).angles();
            for (angle, expected) in angles.iter().zip([a, b, c]) {
                prop_assert!((angle - expected).abs() < 1e-6);
            }
        }
    }
}
