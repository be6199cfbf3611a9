//! How much of a motion a corner of some size may replace.

use super::super::curve::Curve;
use super::super::segment::Segment;
use crate::{Arm, distance};

/// Accuracy of a zone, as a share of it; the error is to the smaller side.
pub(super) const ZONE_ACCURACY: f64 = 1e-3;

/// What rounding may change of a distance, as a share of it.
const SAME_DISTANCE: f64 = 1e-9;

/// A corner that does not replace half of a motion replaces this share of that half at most: else what is left between two corners
/// can be so short that rounding decides which jerk a law has there.
const NEARLY_HALF: f64 = 0.99;

/// Largest number of steps of the search for a zone.
const ZONE_STEPS: usize = 12;

/// Which end of a motion.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum End {
    First,
    Last,
}

/// Returns the largest length that a corner may replace at the end of a motion, in its curve's unit.
#[must_use]
pub fn wanted_zone(segment: &Segment, arm: &Arm) -> f64 {
    Approach::new(segment, End::Last, arm).zone(segment.approximation_mm)
}

/// Returns the largest length that a corner of this size in mm may replace at the start of a motion, in its curve's unit.
pub(in super::super) fn entering_zone(segment: &Segment, distance_mm: f64, arm: &Arm) -> f64 {
    Approach::new(segment, End::First, arm).zone(distance_mm)
}

/// One end of a motion, at a corner: the distances of its tool from the corner.
pub(super) struct Approach<'a> {
    segment: &'a Segment,
    end: End,
    arm: &'a Arm,
    /// The tool at the corner, in the root.
    corner: [f64; 3],
    /// Largest length of the motion that the corner may replace, half of it as a rule, in its curve's unit.
    pub(super) half: f64,
    /// How far from the corner that is, in mm.
    pub(super) half_mm: f64,
}

impl<'a> Approach<'a> {
    pub(super) fn new(segment: &'a Segment, end: End, arm: &'a Arm) -> Self {
        let half = match end {
            End::First => segment.zones[0],
            End::Last => segment.zones[1],
        };
        let mut approach = Self { segment, end, arm, corner: [0.0; 3], half, half_mm: 0.0 };
        approach.corner = approach.place(0.0);
        approach.half_mm = approach.distance_at(half);
        approach
    }

    /// Returns the length of the motion that a corner of `distance_mm` replaces, in its curve's unit: half of it, or less by as much
    /// as a law can notice.
    pub(super) fn zone(&self, distance_mm: f64) -> f64 {
        if distance_mm >= self.half_mm * (1.0 - SAME_DISTANCE) {
            return self.half;
        }
        self.way_within(distance_mm).min(NEARLY_HALF * self.half)
    }

    /// Returns the length of the motion within a distance of the corner that is less than that of half of it.
    fn way_within(&self, distance_mm: f64) -> f64 {
        if matches!(self.segment.curve, Curve::Line(_)) {
            return distance_mm;
        }
        let (mut inside, mut outside) = ((0.0, 0.0), (self.half, self.half_mm));
        // The distance grows nearly evenly with the way: the secant method, aimed a little short, takes a few steps.
        let aim = distance_mm * (1.0 - ZONE_ACCURACY / 2.0);
        for step in 0..ZONE_STEPS {
            if inside.1 >= distance_mm * (1.0 - ZONE_ACCURACY) {
                break;
            }
            let share = if step % 4 == 3 { 0.5 } else { (aim - inside.1) / (outside.1 - inside.1) };
            let way = inside.0 + share * (outside.0 - inside.0);
            let next = (way, self.distance_at(way));
            *if next.1 <= distance_mm { &mut inside } else { &mut outside } = next;
        }
        inside.0
    }

    /// Returns the distance of the tool from the corner in mm where the way to the corner is `way`.
    pub(super) fn distance_at(&self, way: f64) -> f64 {
        distance(self.corner, self.place(way))
    }

    /// Returns the tool in the root where the way to the corner is `way`.
    pub(super) fn place(&self, way: f64) -> [f64; 3] {
        let way = match self.end {
            End::First => way,
            End::Last => self.segment.curve.length() - way,
        };
        match &self.segment.curve {
            Curve::Axes(axes) => self.segment.tool_at(&axes.joints(way), self.arm),
            cartesian => cartesian.position(way).unwrap_or([f64::NAN; 3]),
        }
    }
}
