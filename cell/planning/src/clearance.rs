//! How near the course of the tool comes to an obstacle.
//!
//! A course runs along a straight leg and may leave it, most in the middle and not at the ends: at the share s of the leg
//! by no more than 4·bow·s·(1 − s). It comes too near where its distance from the obstacle's box may be less than the
//! distance to keep. The distance of a point on the leg from the box, less that bound, is convex in s: so it is below the
//! distance to keep on one interval of s, whose ends lie on either side of where it is least.

use crate::geometry::{Cuboid, Point};

/// How often the part of a leg in which the least gap lies is cut to two thirds: to 10⁻¹⁰ of it.
const CUTS: u32 = 57;

/// How often the part of a leg in which the gap becomes zero is halved.
const HALVINGS: u32 = 40;

/// A straight leg, and how far the course may leave it in its middle.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Leg {
    pub(crate) from: Point,
    pub(crate) to: Point,
    /// In any direction, in mm.
    pub(crate) bow_mm: f64,
    /// In the horizontal plane, in mm.
    pub(crate) sideways_mm: f64,
}

/// How the distance of a course from a box is taken.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Measure {
    /// From its faces, along each axis: past an edge or a corner more room is kept than the distance.
    Faces,
    /// From its nearest point.
    Nearest,
}

impl Leg {
    /// Returns a leg that the course does not leave.
    pub(crate) const fn straight([from, to]: [Point; 2]) -> Self {
        Self { from, to, bow_mm: 0.0, sideways_mm: 0.0 }
    }

    /// Returns the part of the leg, within `shares` of it, on which the course may come nearer to the box than
    /// `distance_mm`: its beginning and its end. A leg that only touches that distance is not nearer.
    pub(crate) fn nearer(&self, space: &Cuboid, distance_mm: f64, shares: (f64, f64)) -> Option<(f64, f64)> {
        let (begin, end) = self.inside(space, distance_mm, shares)?;
        let gap = |share: f64| self.gap_mm(space, share) - distance_mm;
        let nearest = below_zero_within((begin, end), self.steepest_mm(), gap)?;
        let limit = |outer: f64| if gap(outer) < 0.0 { outer } else { zero_between(nearest, outer, gap) };
        Some((limit(begin), limit(end)))
    }

    /// Returns the part of the leg, within `shares` of it, on which the course may be in the box with every face moved outwards
    /// by the distance and by its bow. It contains the part that is nearer, and takes no search: for one face that is a
    /// parabola below zero, and for the box it is what the intervals of its faces have in common.
    pub(crate) fn inside(
        &self,
        space: &Cuboid,
        distance_mm: f64,
        (begin, end): (f64, f64),
    ) -> Option<(f64, f64)> {
        let (lower, upper) = (space.lower.coordinates(), space.upper.coordinates());
        let (from, way) = (self.from.coordinates(), (self.to - self.from).coordinates());
        let (mut enters, mut leaves) = (begin, end);
        let sideways = self.bow_mm + self.sideways_mm;
        for ((((lower, upper), from), way), bow) in
            lower.into_iter().zip(upper).zip(from).zip(way).zip([sideways, sideways, self.bow_mm])
        {
            let past_lower = below_zero([4.0 * bow, -4.0 * bow - way, lower - distance_mm - from])?;
            let before_upper = below_zero([4.0 * bow, way - 4.0 * bow, from - upper - distance_mm])?;
            enters = enters.max(past_lower.0).max(before_upper.0);
            leaves = leaves.min(past_lower.1).min(before_upper.1);
        }
        (enters < leaves).then_some((enters, leaves))
    }

    /// Returns the most by which the gap changes over the whole leg, in mm.
    fn steepest_mm(&self) -> f64 {
        (self.to - self.from).length() + 4.0 * (self.bow_mm + self.sideways_mm)
    }

    /// Returns the least distance in mm that the course may have from the box at a share of the leg; inside the box it is
    /// negative.
    fn gap_mm(&self, space: &Cuboid, share: f64) -> f64 {
        let [x, y, z] = space.beyond_mm(self.from.toward(self.to, share));
        let part = 4.0 * share * (1.0 - share);
        joined(joined(x, y) - part * self.sideways_mm, z) - part * self.bow_mm
    }

    /// Returns whether the course may come nearer to the box than `distance_mm`, and within `cut_mm` of the start or the end than
    /// the distances `at_ends_mm`, which are no less.
    pub(crate) fn is_too_near(
        &self,
        space: &Cuboid,
        distance_mm: f64,
        at_ends_mm: [f64; 2],
        cut_mm: f64,
        measure: Measure,
    ) -> bool {
        // Most obstacles are nowhere near: one test of the whole leg first.
        let most_mm = at_ends_mm.into_iter().fold(distance_mm, f64::max);
        if self.inside(space, most_mm, (0.0, 1.0)).is_none() {
            return false;
        }
        let cut = (cut_mm / (self.to - self.from).length()).min(1.0);
        let [at_start_mm, at_end_mm] = at_ends_mm;
        let parts = [(distance_mm, (0.0, 1.0)), (at_start_mm, (0.0, cut)), (at_end_mm, (1.0 - cut, 1.0))];
        parts.into_iter().any(|(distance_mm, shares)| {
            let (space, distance_mm) = match measure {
                Measure::Faces => (space.grown(distance_mm), 0.0),
                Measure::Nearest => (*space, distance_mm),
            };
            let gap = |share: f64| self.gap_mm(&space, share) - distance_mm;
            let inside = self.inside(&space, distance_mm, shares);
            inside.and_then(|part| below_zero_within(part, self.steepest_mm(), gap)).is_some()
        })
    }
}

/// Returns a share from `begin` to `end` at which a convex gap is below zero, which changes by no more than `steepest` from 0
/// to 1.
fn below_zero_within((begin, end): (f64, f64), steepest: f64, gap: impl Fn(f64) -> f64) -> Option<f64> {
    let (mut first, mut last) = (begin, end);
    let mut nearest = f64::midpoint(begin, end);
    for _ in 0..CUTS {
        let least = gap(nearest);
        if least < 0.0 {
            break;
        }
        if least > steepest * (last - first) {
            return None;
        }
        let third = (last - first) / 3.0;
        let (one, other) = (first + third, last - third);
        if gap(one) <= gap(other) {
            (last, nearest) = (other, one);
        } else {
            (first, nearest) = (one, other);
        }
    }
    // The nearest place may be an end, to which the thirds only come close.
    [nearest, begin, end].into_iter().find(|&share| gap(share) < 0.0)
}

/// Returns the open interval of s in which a·s² + b·s + c is below zero, if there is one; `a` must not be negative.
fn below_zero([a, b, c]: [f64; 3]) -> Option<(f64, f64)> {
    if a == 0.0 {
        return if b > 0.0 {
            Some((f64::NEG_INFINITY, -c / b))
        } else if b < 0.0 {
            Some((-c / b, f64::INFINITY))
        } else {
            (c < 0.0).then_some((f64::NEG_INFINITY, f64::INFINITY))
        };
    }
    let square = b * b - 4.0 * a * c;
    if square.is_nan() || square <= 0.0 {
        return None;
    }
    // Of both ways to a root the one that subtracts nothing, and so loses no digits.
    let half = -(b + square.sqrt().copysign(b)) / 2.0;
    let (one, other) = (half / a, c / half);
    Some((one.min(other), one.max(other)))
}

/// Returns the place between a share at which the gap is below zero and one at which it is not, from which on it is.
fn zero_between(mut below: f64, mut above: f64, gap: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(below, above);
        if gap(middle) < 0.0 {
            below = middle;
        } else {
            above = middle;
        }
    }
    above
}

/// Returns the distance from a space that has these distances along two directions at right angles; inside it, where
/// neither is positive, the negative distance to the nearer face.
fn joined(one: f64, other: f64) -> f64 {
    if one <= 0.0 || other <= 0.0 {
        return one.max(other);
    }
    (one * one + other * other).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point> {
        prop::array::uniform3(-300.0..300.0_f64).prop_map(Point::from)
    }

    fn leg(from: Point, to: Point) -> Leg {
        Leg::straight([from, to])
    }

    fn distance(point: Point, space: &Cuboid) -> f64 {
        let (lower, upper) = (space.lower.coordinates(), space.upper.coordinates());
        let outside: [f64; 3] = std::array::from_fn(|axis| {
            let at = point.coordinates()[axis];
            (lower[axis] - at).max(at - upper[axis]).max(0.0)
        });
        Point::from(outside).length()
    }

    proptest! {
        #[test]
        fn a_leg_is_nearer_where_one_of_its_points_is_and_nowhere_else(
            from in point(), to in point(), lower in point(),
            size in prop::array::uniform3(1.0..200.0_f64),
            bow in prop_oneof![Just(0.0), 0.0..80.0_f64],
            least in 0.1..30.0_f64,
        ) {
            let space = Cuboid { lower, upper: lower + size.into() };
            let found = Leg { bow_mm: bow, ..leg(from, to) }.nearer(&space, least, (0.0, 1.0));
            for step in 1..200_u32 {
                let share = f64::from(step) / 200.0;
                let away = distance(from.toward(to, share), &space);
                let missing = least + 4.0 * bow * share * (1.0 - share) - away;
                if missing.abs() > 1e-6 {
                    let is_nearer = found.is_some_and(|(enters, leaves)| enters < share && share < leaves);
                    prop_assert_eq!(is_nearer, missing > 0.0, "at {}: {:?}", share, found);
                }
            }
        }

        #[test]
        fn wherever_a_course_goes_beside_its_leg_the_part_that_is_nearer_contains_it(
            from in point(), to in point(), lower in point(),
            size in prop::array::uniform3(1.0..200.0_f64),
            bow in 0.0..80.0_f64, sideways in 0.0..80.0_f64, least in 0.0..30.0_f64,
            share in 0.01..0.99_f64, turn in 0.0..std::f64::consts::TAU, off in point(),
        ) {
            let space = Cuboid { lower, upper: lower + size.into() };
            let part = 4.0 * share * (1.0 - share);
            let (sine, cosine) = libm::sincos(turn);
            let aside = Point::new(cosine, sine, 0.0) * (part * sideways);
            let off = off.direction().unwrap_or_default() * (part * bow);
            if distance(from.toward(to, share) + aside + off, &space) < least - 1e-6 {
                let course = Leg { from, to, bow_mm: bow, sideways_mm: sideways };
                let found = course.nearer(&space, least, (0.0, 1.0));
                prop_assert!(found.is_some_and(|(enters, leaves)| enters <= share && share <= leaves));
            }
        }
    }

    #[test]
    fn a_leg_past_an_edge_of_a_box_is_as_far_from_it_as_the_nearest_point_of_the_edge() {
        let space = Cuboid { lower: Point::new(0.0, 0.0, 0.0), upper: Point::new(10.0, 10.0, 10.0) };
        // Along the edge, 8 mm beside and 8 mm above: 11.3 mm away.
        let beside = leg(Point::new(-50.0, 18.0, 18.0), Point::new(50.0, 18.0, 18.0));
        assert_eq!(beside.nearer(&space, 11.3, (0.0, 1.0)), None);
        assert!(beside.nearer(&space, 11.4, (0.0, 1.0)).is_some());
    }

    #[test]
    fn a_leg_that_slides_along_the_grown_box_is_not_nearer() {
        let space = Cuboid { lower: Point::new(0.0, 0.0, 0.0), upper: Point::new(10.0, 10.0, 10.0) };
        let (from, to) = (Point::new(-50.0, 5.0, 15.0), Point::new(50.0, 5.0, 15.0));
        let sliding = leg(from, to);
        assert_eq!(sliding.nearer(&space, 5.0, (0.0, 1.0)), None);
        // 3 mm before and behind the box, 4 mm above are 5 mm.
        let (enters, leaves) =
            Leg { from: Point::new(-50.0, 5.0, 14.0), to: Point::new(50.0, 5.0, 14.0), ..sliding }
                .nearer(&space, 5.0, (0.0, 1.0))
                .unwrap();
        assert!((enters - 0.47).abs() < 1e-9 && (leaves - 0.63).abs() < 1e-9, "{enters} {leaves}");
        let bowing = Leg { bow_mm: 1.0, ..sliding };
        assert!(bowing.nearer(&space, 5.0, (0.0, 1.0)).is_some());
        let bowing_sideways = Leg { sideways_mm: 1.0, ..sliding };
        assert_eq!(bowing_sideways.nearer(&space, 5.0, (0.0, 1.0)), None);
    }
}
