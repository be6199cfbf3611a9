//! The circle of one motion: through an intermediate point to the target.

use super::flange::Flange;
use crate::{Frame, LEAST_WAY_MM, Rotation, Violation, cross, dot, length};

/// How far the intermediate point must be off the line from start to target, in mm: beyond what single precision on
/// the wire leaves of a position within half a metre.
const LEAST_OFFSET_MM: f64 = 0.01;

/// A circle of the tool in the root, orientation turning evenly about one axis, whatever the intermediate point's
/// orientation would be. Its parameter is the way in mm.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Arc {
    from: Frame,
    to: Frame,
    centre: [f64; 3],
    /// From the centre to the start.
    outward: [f64; 3],
    /// As long, and 90 degrees further on the way.
    forward: [f64; 3],
    radius: f64,
    /// How much of the circle, in radians: 0…2π.
    opening: f64,
    axis: [f64; 3],
    angle: f64,
    flange: Flange,
}

impl Arc {
    /// From tool pose to tool pose through a point, all in the root, in mm.
    ///
    /// # Errors
    ///
    /// Start and target are one point, or no circle goes through the three.
    pub fn new(from: Frame, through: [f64; 3], to: Frame, flange: Flange) -> Result<Self, Violation> {
        let chord = difference(to.position, from.position);
        let way_mm = length(chord);
        if way_mm < LEAST_WAY_MM {
            return Err(Violation::ZeroLength { way_mm });
        }
        let first = difference(through, from.position);
        // Normal to the circle's plane; seen against it, start, intermediate point and target go round to the left.
        let normal = cross(first, chord);
        let offset_mm = length(normal) / way_mm;
        if offset_mm.is_nan() || offset_mm < LEAST_OFFSET_MM {
            return Err(Violation::Collinear { offset_mm, least_mm: LEAST_OFFSET_MM });
        }
        let (square_1, square_2) = (dot(first, first), dot(chord, chord));
        let mixed: [f64; 3] = core::array::from_fn(|i| square_1 * chord[i] - square_2 * first[i]);
        // The circumcentre of a triangle, seen from one of its corners.
        let inward = cross(mixed, normal).map(|part| part / (2.0 * dot(normal, normal)));
        let centre = core::array::from_fn(|i| from.position[i] + inward[i]);
        let outward = inward.map(|part| -part);
        let unit = normal.map(|part| part / length(normal));
        let forward = cross(unit, outward);
        let end = difference(to.position, centre);
        let opening = libm::atan2(dot(end, forward), dot(end, outward)).rem_euclid(core::f64::consts::TAU);
        let (axis, angle) = (from.rotation.inverse() * to.rotation).axis_angle();
        let radius = length(outward);
        Ok(Self { from, to, centre, outward, forward, radius, opening, axis, angle, flange })
    }

    /// The way from start to target, in mm.
    #[must_use]
    #[inline]
    pub const fn length(&self) -> f64 {
        self.radius * self.opening
    }

    /// The radius, in mm.
    #[must_use]
    pub const fn radius(&self) -> f64 {
        self.radius
    }

    /// How much of the circle it is, in degrees: 0…360.
    #[must_use]
    pub const fn opening_deg(&self) -> f64 {
        self.opening.to_degrees()
    }

    /// By how many degrees the tool turns, 0…180.
    #[must_use]
    pub const fn turn_deg(&self) -> f64 {
        self.angle
    }

    /// The centre in the root, in mm.
    #[must_use]
    pub const fn centre(&self) -> [f64; 3] {
        self.centre
    }

    /// The tool in the root after `way`.
    #[must_use]
    #[inline]
    pub fn tool(&self, way: f64) -> Frame {
        let rotation = if self.angle == 0.0 {
            self.to.rotation
        } else {
            self.from.rotation * Rotation::about(self.axis, way / self.length() * self.angle)
        };
        Frame { position: self.position(way), rotation }
    }

    /// Where the tool is after `way`.
    pub(super) fn position(&self, way: f64) -> [f64; 3] {
        let (sin, cos) = libm::sincos(way / self.radius);
        core::array::from_fn(|i| self.centre[i] + cos * self.outward[i] + sin * self.forward[i])
    }

    /// Its target: the tool in the root.
    #[must_use]
    pub const fn to(&self) -> &Frame {
        &self.to
    }

    /// How the flange follows from the tool.
    #[must_use]
    pub const fn flange(&self) -> &Flange {
        &self.flange
    }
}

fn difference(to: [f64; 3], from: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| to[i] - from[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distance;
    use proptest::prelude::*;

    fn at(position: [f64; 3]) -> Frame {
        Frame { position, rotation: Rotation::pointing_down(0.0) }
    }

    fn arc(from: [f64; 3], through: [f64; 3], to: [f64; 3]) -> Result<Arc, Violation> {
        Arc::new(at(from), through, at(to), Flange::of_tool(&Frame::IDENTITY))
    }

    #[test]
    fn three_quarters_of_a_circle_are_gone_the_long_way_round() {
        let arc = arc([100.0, 0.0, 0.0], [-100.0, 0.0, 0.0], [0.0, -100.0, 0.0]).unwrap();
        assert!((arc.length() - 1.5 * core::f64::consts::PI * 100.0).abs() < 1e-9);
        assert!(distance(arc.tool(arc.length() / 3.0).position, [0.0, 100.0, 0.0]) < 1e-9);
    }

    #[test]
    fn three_points_on_a_line_are_refused_with_the_offset() {
        let error = arc([0.0; 3], [50.0, 0.002, 0.0], [100.0, 0.0, 0.0]).unwrap_err();
        insta::assert_snapshot!(error, @"the intermediate point is 0.0020 mm off the line from start to target; a circle needs 0.01 mm");
        let error = arc([0.0; 3], [0.0; 3], [100.0, 0.0, 0.0]).unwrap_err();
        assert!(matches!(error, Violation::Collinear { .. }), "the intermediate point is the start");
    }

    #[test]
    fn a_circle_that_ends_where_it_starts_is_refused() {
        let error = arc([1.0, 2.0, 3.0], [50.0, 2.0, 3.0], [1.0, 2.0, 3.0]).unwrap_err();
        insta::assert_snapshot!(error, @"the target is 0.0000 mm from the start; a motion along a path is at least 0.001 mm long");
    }

    proptest! {
        #[test]
        fn every_sample_is_at_the_radius_and_the_circle_passes_its_three_points(
            from in proptest::array::uniform3(-300.0..300.0_f64),
            through in proptest::array::uniform3(-300.0..300.0_f64),
            to in proptest::array::uniform3(-300.0..300.0_f64),
        ) {
            let Ok(arc) = arc(from, through, to) else { return Ok(()) };
            prop_assume!(arc.radius() < 1e5);
            prop_assert!(distance(arc.tool(0.0).position, from) < 1e-6);
            prop_assert!(distance(arc.tool(arc.length()).position, to) < 1e-6);
            let mut nearest = f64::INFINITY;
            for step in 0..=2000 {
                let place = arc.tool(arc.length() * f64::from(step) / 2000.0).position;
                prop_assert!((distance(place, arc.centre()) - arc.radius()).abs() < 1e-6);
                nearest = nearest.min(distance(place, through));
            }
            prop_assert!(nearest <= arc.length() / 2000.0, "{nearest} mm from the intermediate point");
        }
    }
}
