//! Points, frames, straight lines and axis-aligned boxes, all in millimetres.

use std::ops::{Add, Mul, Sub};

/// A point or a direction in space, in mm.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Point {
    /// Along the base's x axis, in mm.
    pub x: f64,
    /// Along the base's y axis, in mm.
    pub y: f64,
    /// Along the base's z axis, in mm; up.
    pub z: f64,
}

impl Point {
    /// Creates a point from three coordinates in mm.
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self { x, y, z }
    }

    /// Returns its coordinates x, y, z in mm.
    #[must_use]
    pub const fn coordinates(self) -> [f64; 3] {
        [self.x, self.y, self.z]
    }

    /// Returns the dot product.
    #[must_use]
    pub fn dot(self, other: Self) -> f64 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// Returns the cross product.
    #[must_use]
    pub fn cross(self, other: Self) -> Self {
        Self::new(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )
    }

    /// Returns the distance from the origin, in mm.
    #[must_use]
    pub fn length(self) -> f64 {
        self.dot(self).sqrt()
    }

    /// Returns the direction as a vector of length 1; `None` for a vector without length.
    #[must_use]
    pub fn direction(self) -> Option<Self> {
        let length = self.length();
        (length > 1e-9).then(|| self * (1.0 / length))
    }

    /// Returns the point at `share` of the line to `other`: 0.0 is this point, 1.0 is `other`.
    #[must_use]
    pub fn toward(self, other: Self, share: f64) -> Self {
        self + (other - self) * share
    }

    /// Returns the angle between two directions, in degrees.
    #[must_use]
    pub fn angle_deg(self, other: Self) -> f64 {
        libm::atan2(self.cross(other).length(), self.dot(other)).to_degrees()
    }
}

impl From<[f64; 3]> for Point {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl Add for Point {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl Sub for Point {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl Mul<f64> for Point {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self::new(self.x * factor, self.y * factor, self.z * factor)
    }
}

/// Where the tool is and how it is turned.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Pose {
    /// Where its tip is.
    pub point: Point,
    /// The angles a, b, c about z, y', x'', in degrees.
    pub abc_deg: [f64; 3],
}

impl Pose {
    /// Creates a pose from x, y, z in mm and a, b, c in degrees.
    #[must_use]
    pub const fn new([x, y, z, a, b, c]: [f64; 6]) -> Self {
        Self { point: Point::new(x, y, z), abc_deg: [a, b, c] }
    }

    /// Returns x, y, z in mm and a, b, c in degrees.
    #[must_use]
    pub const fn mm_deg(self) -> [f64; 6] {
        let [a, b, c] = self.abc_deg;
        [self.point.x, self.point.y, self.point.z, a, b, c]
    }

    /// Returns a pose with the same orientation at another point.
    #[must_use]
    pub const fn at(self, point: Point) -> Self {
        Self { point, abc_deg: self.abc_deg }
    }

    /// Returns the angle in degrees, 0..=180, by which the tool turns from this orientation to that of `other`.
    #[must_use]
    pub fn turn_deg(self, other: Self) -> f64 {
        if self.abc_deg == other.abc_deg {
            return 0.0;
        }
        let (mine, theirs) = (axes(self.abc_deg), axes(other.abc_deg));
        let trace: f64 = mine.iter().zip(theirs).map(|(mine, theirs)| mine.dot(theirs)).sum();
        libm::acos(((trace - 1.0) / 2.0).clamp(-1.0, 1.0)).to_degrees()
    }

    /// Returns where the tip of tool `new` is while the tip of tool `old` is here; both tools are given from the flange.
    #[must_use]
    pub fn change_tool(self, old: Self, new: Self) -> Self {
        // flange = here · old⁻¹, tip = flange · new
        let (here, old_axes, new_axes) = (axes(self.abc_deg), axes(old.abc_deg), axes(new.abc_deg));
        let into_old = |vector: Point| {
            let [x, y, z] = old_axes;
            Point::new(x.dot(vector), y.dot(vector), z.dot(vector))
        };
        let turn = |vector: Point| {
            let [x, y, z] = here;
            let vector = into_old(vector);
            x * vector.x + y * vector.y + z * vector.z
        };
        let [x, y, z] = new_axes.map(turn);
        // R = Rz(a) · Ry(b) · Rx(c): the first column is (cos a · cos b, sin a · cos b, −sin b), the last row ends in
        // cos b · sin c, cos b · cos c.
        let a = libm::atan2(x.y, x.x);
        let b = libm::atan2(-x.z, (x.x * x.x + x.y * x.y).sqrt());
        let c = libm::atan2(y.z, z.z);
        Self {
            point: self.point + turn(new.point - old.point),
            abc_deg: [a.to_degrees(), b.to_degrees(), c.to_degrees()],
        }
    }
}

/// Returns the directions of the x, y and z axes of a frame that is turned by a, b, c degrees about z, y', x''.
fn axes(abc_deg: [f64; 3]) -> [Point; 3] {
    let [(sa, ca), (sb, cb), (sc, cc)] = abc_deg.map(|angle| libm::sincos(angle.to_radians()));
    [
        Point::new(ca * cb, sa * cb, -sb),
        Point::new(ca * sb * sc - sa * cc, sa * sb * sc + ca * cc, cb * sc),
        Point::new(ca * sb * cc + sa * sc, sa * sb * cc - ca * sc, cb * cc),
    ]
}

/// A box whose edges lie along the base's axes.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Cuboid {
    /// The corner of the lowest coordinates.
    pub lower: Point,
    /// The corner of the highest coordinates.
    pub upper: Point,
}

impl Cuboid {
    /// Returns the same box with every face moved outwards by `margin` mm.
    #[must_use]
    pub fn grown(self, margin: f64) -> Self {
        let by = Point::new(margin, margin, margin);
        Self { lower: self.lower - by, upper: self.upper + by }
    }

    /// Returns how deep inside the box a point is: the distance to the nearest face in mm; not positive for a point
    /// outside or on a face.
    #[must_use]
    pub fn depth_mm(self, point: Point) -> f64 {
        -self.beyond_mm(point).into_iter().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Returns how far a point is beyond the faces of the box along x, y and z, in mm: negative between two faces.
    pub(crate) fn beyond_mm(self, point: Point) -> [f64; 3] {
        let (below, above) = (self.lower - point, point - self.upper);
        [below.x.max(above.x), below.y.max(above.y), below.z.max(above.z)]
    }

    /// Returns the distance of a point from the box, in mm; 0 for a point in it.
    #[must_use]
    pub fn distance_mm(self, point: Point) -> f64 {
        Point::from(self.beyond_mm(point).map(|beyond| beyond.max(0.0))).length()
    }

    /// Returns which part of the straight line lies inside the box: the shares of its length at which it enters and
    /// leaves. A line that only touches a face is not inside.
    #[must_use]
    pub fn inside(self, from: Point, to: Point) -> Option<(f64, f64)> {
        let way = (to - from).coordinates();
        let (lower, upper, from) = (self.lower.coordinates(), self.upper.coordinates(), from.coordinates());
        let (mut enters, mut leaves) = (0.0_f64, 1.0_f64);
        for (((way, from), lower), upper) in way.into_iter().zip(from).zip(lower).zip(upper) {
            if way == 0.0 {
                if from <= lower || from >= upper {
                    return None;
                }
                continue;
            }
            let (one, other) = ((lower - from) / way, (upper - from) / way);
            enters = enters.max(one.min(other));
            leaves = leaves.min(one.max(other));
        }
        (enters < leaves).then_some((enters, leaves))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: Cuboid = Cuboid { lower: Point::new(0.0, 0.0, 0.0), upper: Point::new(1.0, 1.0, 1.0) };

    #[test]
    fn a_line_through_a_box_enters_and_leaves_it_and_one_that_slides_along_a_face_does_not() {
        let inside = UNIT.inside(Point::new(-1.0, 0.5, 0.5), Point::new(3.0, 0.5, 0.5));
        assert_eq!(inside, Some((0.25, 0.5)));
        assert_eq!(UNIT.inside(Point::new(-1.0, 0.5, 1.0), Point::new(3.0, 0.5, 1.0)), None);
        assert_eq!(UNIT.inside(Point::new(-1.0, 0.5, 0.5), Point::new(-0.5, 0.5, 0.5)), None);
    }

    #[test]
    fn turning_about_the_approach_axis_is_measured_whatever_the_tool_looks_at() {
        let down = Pose::new([0.0, 0.0, 0.0, 0.0, 0.0, 180.0]);
        let turned = Pose::new([5.0, 0.0, 0.0, 30.0, 0.0, 180.0]);
        assert!((down.turn_deg(turned) - 30.0).abs() < 1e-6);
    }

    #[test]
    fn a_longer_tool_that_looks_down_has_its_tip_lower() {
        let here = Pose::new([100.0, 0.0, 50.0, 20.0, 0.0, 180.0]);
        let (flange, nozzle) = (Pose::new([0.0; 6]), Pose::new([10.0, 0.0, 80.0, 0.0, 0.0, 0.0]));
        let tip = here.change_tool(flange, nozzle);
        assert!((tip.point.z + 30.0).abs() < 1e-9, "{tip:?}");
        assert!(tip.turn_deg(here) < 1e-6);
        let back = tip.change_tool(nozzle, flange);
        assert!((back.point - here.point).length() < 1e-9 && back.turn_deg(here) < 1e-6);
    }
}
