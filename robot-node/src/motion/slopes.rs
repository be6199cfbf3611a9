//! The derivatives of joints and tool at a place of a stretch.

use super::extremes::larger;
use super::node::{Node, Vector, square};
use crate::arm::{AXES, Joints, dot};

/// What slopes may differ by and still be about the same, as a share of the largest one.
const ABOUT: f64 = 2e-3;

/// First, second and third derivatives of joints and tool by the way of a stretch, over the limits of the
/// accelerations.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slopes {
    pub(super) slope: Joints,
    pub(super) bend: Joints,
    pub(super) twist: Joints,
    pub(super) tool: [Vector<f64>; 3],
}

impl Slopes {
    /// Those of a node, whose unit grows by `unit` for each unit of the stretch.
    pub(super) fn of(node: &Node, unit: f64) -> Self {
        let mut slopes = Self::in_own_unit(node);
        slopes.by_unit(unit);
        slopes
    }

    /// Those of a node in its own unit.
    pub(super) fn in_own_unit(node: &Node) -> Self {
        Self {
            slope: node.slope.map(f64::from),
            bend: node.bend.map(f64::from),
            twist: node.twist.map(f64::from),
            tool: node.tool.map(|vector| vector.map(f64::from)),
        }
    }

    /// Those between two nodes, at a share of the way from the first to the second.
    pub(super) fn between(one: &Node, other: &Node, share: f64, unit: f64) -> Self {
        let [from, to] = [one, other].map(Self::in_own_unit);
        let mut slopes = from.toward(&to, other.way - one.way, share);
        slopes.by_unit(unit);
        slopes
    }

    fn by_unit(&mut self, unit: f64) {
        let (square, cube) = (unit * unit, unit * unit * unit);
        let [along, across, around] = &mut self.tool;
        let values = self.slope.iter_mut().chain(along);
        values.for_each(|value| *value *= unit);
        let values = self.bend.iter_mut().chain(across);
        values.for_each(|value| *value *= square);
        let values = self.twist.iter_mut().chain(around);
        values.for_each(|value| *value *= cube);
    }

    /// What the square of the speed, the acceleration along the stretch and its growth add to the tool's acceleration along its
    /// path. A deceleration below the acceleration holds there only: else a tool could not slow down at all in a bend that takes
    /// more than that.
    pub(super) fn along_path(&self) -> Vector<f64> {
        let [along, across, _] = self.tool;
        along_path([along, across])
    }

    /// The same at a share of the way to others, which are `length` away.
    pub(super) fn along_path_toward(&self, other: &Self, length: f64, share: f64) -> Vector<f64> {
        along_path(self.tool_toward(other, length, share))
    }

    /// Whether these differ from others by hardly anything: from rest, along a way of this length.
    pub(super) fn is_about(&self, other: &Self, length: f64) -> bool {
        let Self { slope, bend, twist, tool: [along, across, around] } = self;
        let steepest = slope.iter().fold(square(*along).sqrt(), |most, slope| most.max(slope.abs()));
        let most = [1.0, 1.0 / length, 1.0 / (length * length)].map(|unit| ABOUT * steepest * unit);
        let near = |one: &[f64], other: &[f64], most: f64| {
            one.iter().zip(other).all(|(one, other)| (one - other).abs() <= most)
        };
        near(slope, &other.slope, most[0])
            && near(bend, &other.bend, most[1])
            && near(twist, &other.twist, most[2])
            && near(along, &other.tool[0], most[0])
            && near(across, &other.tool[1], most[1])
            && near(around, &other.tool[2], most[2])
    }

    /// Those at a share of the way to others, which are `length` away: cubic between two values with their slopes.
    pub(super) fn toward(&self, other: &Self, length: f64, share: f64) -> Self {
        let mut found = *self;
        for axis in 0..AXES {
            let [one, two] = [self, other].map(|at| [at.slope[axis], at.bend[axis]]);
            found.slope[axis] = hermite(one, two, length, share);
            let [one, two] = [self, other].map(|at| [at.bend[axis], at.twist[axis]]);
            found.bend[axis] = hermite(one, two, length, share);
            found.twist[axis] = self.twist[axis] + share * (other.twist[axis] - self.twist[axis]);
        }
        let [along, across] = self.tool_toward(other, length, share);
        found.tool = [along, across, found.tool[2]];
        for i in 0..3 {
            found.tool[2][i] = self.tool[2][i] + share * (other.tool[2][i] - self.tool[2][i]);
        }
        found
    }

    /// The tool's first and second derivatives there.
    fn tool_toward(&self, other: &Self, length: f64, share: f64) -> [Vector<f64>; 2] {
        [0, 1].map(|order| {
            core::array::from_fn(|i| {
                let [one, two] = [self, other].map(|at| [at.tool[order][i], at.tool[order + 1][i]]);
                hermite(one, two, length, share)
            })
        })
    }

    /// Returns the second derivatives of joints and tool at a share of the way to others, which are `length` away.
    pub(super) fn bends_toward(&self, other: &Self, length: f64, share: f64) -> (Joints, Vector<f64>) {
        let joints = core::array::from_fn(|axis| {
            let [one, two] = [self, other].map(|at| [at.bend[axis], at.twist[axis]]);
            hermite(one, two, length, share)
        });
        let tool = core::array::from_fn(|i| {
            let [one, two] = [self, other].map(|at| [at.tool[1][i], at.tool[2][i]]);
            hermite(one, two, length, share)
        });
        (joints, tool)
    }

    /// Returns the joints' first derivatives at a share of the way to others, which are `length` away.
    pub(super) fn slope_toward(&self, other: &Self, length: f64, share: f64) -> Joints {
        core::array::from_fn(|axis| {
            let [one, two] = [self, other].map(|at| [at.slope[axis], at.bend[axis]]);
            hermite(one, two, length, share)
        })
    }

    /// Returns for each joint a first derivative that none on the way to others exceeds in size, by the control points of the cubic.
    pub(super) fn steepest_toward(&self, other: &Self, length: f64) -> Joints {
        let third = length / 3.0;
        core::array::from_fn(|axis| {
            let [one, two] = [self.slope[axis], other.slope[axis]];
            let inner = larger((one + third * self.bend[axis]).abs(), (two - third * other.bend[axis]).abs());
            larger(larger(one.abs(), two.abs()), inner)
        })
    }

    /// Those half-way to others.
    pub(super) fn half_way(&self, other: &Self, length: f64) -> Self {
        let eighth = length / 8.0;
        let between =
            |one: f64, other: f64, slope: f64, next: f64| 0.5 * (one + other) + eighth * (slope - next);
        let mut found = *self;
        for axis in 0..AXES {
            let (one, two) = (self, other);
            found.slope[axis] = between(one.slope[axis], two.slope[axis], one.bend[axis], two.bend[axis]);
            found.bend[axis] = between(one.bend[axis], two.bend[axis], one.twist[axis], two.twist[axis]);
            found.twist[axis] = 0.5 * (one.twist[axis] + two.twist[axis]);
        }
        let (one, two) = (&self.tool, &other.tool);
        for i in 0..3 {
            for order in 0..2 {
                let next = order + 1;
                found.tool[order][i] = between(one[order][i], two[order][i], one[next][i], two[next][i]);
            }
            found.tool[2][i] = 0.5 * (one[2][i] + two[2][i]);
        }
        found
    }
}

fn along_path([along, across]: [Vector<f64>; 2]) -> Vector<f64> {
    let steep = square(along).sqrt();
    [dot(along, across) / steep, steep, 0.0]
}

/// Returns the cubic between two values with their slopes, at a share of the way.
fn hermite([one, slope]: [f64; 2], [other, other_slope]: [f64; 2], length: f64, share: f64) -> f64 {
    let rest = 1.0 - share;
    let (bend, other_bend) = (length * slope - (other - one), (other - one) - length * other_slope);
    one + share * (other - one) + share * rest * (rest * bend + share * other_bend)
}
