//! The course of the set-points over the last robot cycles: drives are compared with it.
//!
//! A drive is some cycles after its set-points, so the comparison is with the nearest place of the course and not with
//! one instant. An arm that lags on its path is on the path; one joint that lags leaves it.

use crate::arm::{AXES, AxisLimits, Joints};

/// Number of cycles kept: more than a second of 4 ms. A drive that is later than that is off its course.
const PLACES: usize = 300;

/// Distance from the course that ends the search, in increments.
const NEAR: f64 = 2.0;

/// Set-points of one cycle.
#[derive(Clone, Copy, Debug)]
struct Place {
    joints: Joints,
    deviation_mm: f64,
}

/// The place of the course next to the drives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    /// Set-points at that place, in degrees (mm).
    pub(super) joints: Joints,
    /// Distance of the tool from the programmed curves there, in mm.
    pub(super) deviation_mm: f64,
    /// Distance of the joint that is farthest from its set-point, in degrees (mm).
    pub(super) away: f64,
}

/// The last set-points.
#[derive(Clone, Debug)]
pub(super) struct Course {
    places: Box<[Place]>,
    /// Index of the newest one.
    newest: usize,
    /// Number of places since the start.
    count: usize,
    /// What makes the joints comparable: one by the rated speed; 0 for joints that the arm does not have.
    weights: Joints,
    increment: f64,
}

impl Course {
    /// Starts at `joints`.
    pub(super) fn new(joints: &Joints, limits: &AxisLimits, increment: f64) -> Self {
        let place = Place { joints: *joints, deviation_mm: 0.0 };
        let weights = limits.speed.map(|speed| if speed.is_normal() { speed.recip() } else { 0.0 });
        Self { places: vec![place; PLACES].into(), newest: 0, count: 1, weights, increment }
    }

    /// Starts anew at `joints`.
    pub(super) fn restart(&mut self, joints: &Joints) {
        (self.newest, self.count) = (0, 1);
        if let Some(place) = self.places.first_mut() {
            *place = Place { joints: *joints, deviation_mm: 0.0 };
        }
    }

    /// Adds the set-points of a cycle, with the tool's distance from the programmed curves.
    pub(super) fn add(&mut self, joints: &Joints, deviation_mm: f64) {
        self.newest = (self.newest + 1) % PLACES;
        self.count = (self.count + 1).min(PLACES);
        if let Some(place) = self.places.get_mut(self.newest) {
            *place = Place { joints: *joints, deviation_mm };
        }
    }

    /// Returns the place of the course that is nearest to these joints.
    pub(super) fn nearest(&self, joints: &Joints) -> Nearest {
        let newest = self.place(0);
        let mut best = self.between(&newest, &newest, joints);
        let mut least = self.square(&best.joints, joints);
        for age in 1..self.count {
            if best.away <= NEAR * self.increment {
                break;
            }
            let found = self.between(&self.place(age), &self.place(age - 1), joints);
            let square = self.square(&found.joints, joints);
            if square < least {
                (best, least) = (found, square);
            }
        }
        best
    }

    /// Returns the place of this age in cycles.
    fn place(&self, age: usize) -> Place {
        let index = (self.newest + PLACES - age) % PLACES;
        self.places.get(index).copied().unwrap_or(Place { joints: [f64::NAN; AXES], deviation_mm: f64::NAN })
    }

    /// Returns the nearest place between two cycles.
    fn between(&self, from: &Place, to: &Place, joints: &Joints) -> Nearest {
        let scaled = |one: &Joints, other: &Joints| -> Joints {
            core::array::from_fn(|axis| (one[axis] - other[axis]) * self.weights[axis])
        };
        let (step, off) = (scaled(&to.joints, &from.joints), scaled(joints, &from.joints));
        let along: f64 = step.iter().zip(&off).map(|(step, off)| step * off).sum();
        let length: f64 = step.iter().map(|step| step * step).sum();
        let share = if length > 0.0 { (along / length).clamp(0.0, 1.0) } else { 1.0 };
        let nearest: Joints =
            core::array::from_fn(|axis| from.joints[axis] + share * (to.joints[axis] - from.joints[axis]));
        let away = nearest.iter().zip(joints).map(|(set, actual)| (set - actual).abs()).fold(0.0, f64::max);
        Nearest { joints: nearest, deviation_mm: from.deviation_mm.max(to.deviation_mm), away }
    }

    fn square(&self, one: &Joints, other: &Joints) -> f64 {
        let away = |axis: usize| (one[axis] - other[axis]) * self.weights[axis];
        (0..AXES).map(|axis| away(axis) * away(axis)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: AxisLimits = AxisLimits {
        lower: [-180.0; AXES],
        upper: [180.0; AXES],
        speed: [100.0; AXES],
        acceleration: [1_000.0; AXES],
        jerk: [10_000.0; AXES],
    };

    fn joints(one: f64, two: f64) -> Joints {
        [one, two, 0.0, 0.0, 0.0, 0.0]
    }

    /// A course on which joint 1 moves from 0 to 10° and then joint 2.
    fn course() -> Course {
        let mut course = Course::new(&joints(0.0, 0.0), &LIMITS, 1e-5);
        for step in 1..=100 {
            course.add(&joints(f64::from(step) / 10.0, 0.0), 0.0);
        }
        for step in 1..=100 {
            course.add(&joints(10.0, f64::from(step) / 10.0), 0.5);
        }
        course
    }

    #[test]
    fn joints_that_lag_on_their_course_are_on_it_and_one_that_lags_alone_is_not() {
        let course = course();
        for on_course in [joints(10.0, 10.0), joints(10.0, 3.21), joints(4.567, 0.0), joints(0.0, 0.0)] {
            let Nearest { away, .. } = course.nearest(&on_course);
            assert!(away <= 2e-5, "{on_course:?}: {away}");
        }
        let nearest = course.nearest(&joints(9.0, 4.0));
        assert!((nearest.away - 1.0).abs() < 1e-9, "{nearest:?}");
        assert_eq!(nearest.deviation_mm, 0.5, "that of the second part");
    }

    #[test]
    fn after_a_new_start_the_old_course_counts_no_more() {
        let mut course = course();
        course.restart(&joints(10.0, 10.0));
        assert!((course.nearest(&joints(4.0, 0.0)).away - 10.0).abs() < 1e-9);
    }
}
