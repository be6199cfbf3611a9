//! How near the course of the tool comes to an obstacle.
//!
//! A course runs along a straight leg and may leave it, most in the middle and not at the ends: at the share s of the leg
//! by no more than 4·bow·s·(1 − s) along each axis. It comes too near where it may be inside the obstacle's box with every
//! face moved outwards by the distance and by that much. For one face that is a parabola in s below zero, so an interval
//! of s; for the box it is what the intervals of its six faces have in common.

use crate::geometry::{Cuboid, Point};

/// A straight leg, and how far the course may leave it in its middle, in mm along x, y and z.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Leg {
    pub(crate) from: Point,
    pub(crate) to: Point,
    pub(crate) bow_mm: [f64; 3],
}

impl Leg {
    /// Returns the part of the leg, within `shares` of it, on which the course may come nearer to the box than
    /// `distance_mm`: its beginning and its end. A leg that only touches that distance is not nearer.
    pub(crate) fn nearer(
        &self,
        space: &Cuboid,
        distance_mm: f64,
        (begin, end): (f64, f64),
    ) -> Option<(f64, f64)> {
        let (lower, upper) = (space.lower.coordinates(), space.upper.coordinates());
        let (from, way) = (self.from.coordinates(), (self.to - self.from).coordinates());
        let (mut enters, mut leaves) = (begin, end);
        for ((((lower, upper), from), way), bow) in
            lower.into_iter().zip(upper).zip(from).zip(way).zip(self.bow_mm)
        {
            let past_lower = below_zero([4.0 * bow, -4.0 * bow - way, lower - distance_mm - from])?;
            let before_upper = below_zero([4.0 * bow, way - 4.0 * bow, from - upper - distance_mm])?;
            enters = enters.max(past_lower.0).max(before_upper.0);
            leaves = leaves.min(past_lower.1).min(before_upper.1);
        }
        (enters < leaves).then_some((enters, leaves))
    }

    /// Returns whether the course may come nearer to the box than `distance_mm`, and within `cut_mm` of either end than
    /// `distance_at_ends_mm`, which is more.
    pub(crate) fn is_too_near(
        &self,
        space: &Cuboid,
        distance_mm: f64,
        distance_at_ends_mm: f64,
        cut_mm: f64,
    ) -> bool {
        // Most obstacles are nowhere near: one test of the whole leg first.
        if self.nearer(space, distance_at_ends_mm, (0.0, 1.0)).is_none() {
            return false;
        }
        let cut = (cut_mm / (self.to - self.from).length()).min(1.0);
        self.nearer(space, distance_mm, (0.0, 1.0)).is_some()
            || self.nearer(space, distance_at_ends_mm, (0.0, cut)).is_some()
            || self.nearer(space, distance_at_ends_mm, (1.0 - cut, 1.0)).is_some()
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point> {
        prop::array::uniform3(-300.0..300.0_f64).prop_map(Point::from)
    }

    proptest! {
        #[test]
        fn a_leg_is_nearer_where_one_of_its_points_is_and_nowhere_else(
            from in point(), to in point(), lower in point(),
            size in prop::array::uniform3(1.0..200.0_f64),
            bow in prop_oneof![Just([0.0; 3]), prop::array::uniform3(0.0..80.0_f64)],
            distance in 0.0..30.0_f64,
        ) {
            let space = Cuboid { lower, upper: lower + size.into() };
            let leg = Leg { from, to, bow_mm: bow };
            let found = leg.nearer(&space, distance, (0.0, 1.0));
            for step in 1..200_u32 {
                let share = f64::from(step) / 200.0;
                let grown = bow.map(|bow| distance + 4.0 * bow * share * (1.0 - share));
                let at = from.toward(to, share).coordinates();
                let (lower, upper) = (space.lower.coordinates(), space.upper.coordinates());
                let faces = at.into_iter().zip(grown).zip(lower).zip(upper);
                let depth = faces
                    .map(|(((at, grown), lower), upper)| (at - lower + grown).min(upper + grown - at))
                    .fold(f64::INFINITY, f64::min);
                if depth.abs() > 1e-6 {
                    let is_nearer = found.is_some_and(|(enters, leaves)| enters < share && share < leaves);
                    prop_assert_eq!(is_nearer, depth > 0.0, "at {}: {:?}", share, found);
                }
            }
        }
    }

    #[test]
    fn a_leg_that_slides_along_the_grown_box_is_not_nearer() {
        let space = Cuboid { lower: Point::new(0.0, 0.0, 0.0), upper: Point::new(10.0, 10.0, 10.0) };
        let (from, to) = (Point::new(-50.0, 5.0, 15.0), Point::new(50.0, 5.0, 15.0));
        let sliding = Leg { from, to, bow_mm: [0.0; 3] };
        assert_eq!(sliding.nearer(&space, 5.0, (0.0, 1.0)), None);
        assert_eq!(sliding.nearer(&space, 6.0, (0.0, 1.0)), Some((0.44, 0.66)));
        let bowing = Leg { bow_mm: [0.0, 0.0, 1.0], ..sliding };
        assert!(bowing.nearer(&space, 5.0, (0.0, 1.0)).is_some());
    }
}
