//! The arm of a cell: conversion between joints and poses, and the limits of the joints.
//!
//! The robot node moves the arm, and planning checks before a run whether the arm reaches what is planned. Both use the
//! same [`Arm`], which a setup describes ([`Installation::from_setup`]).
//!
//! Lengths are in mm, angles in degrees and joints in degrees (mm on a linear joint) everywhere, as on the wire.

mod angles;
mod branch;
mod configuration;
mod frame;
mod installation;
pub mod motion;
mod opw;
mod scara;
mod skeleton;
mod standing;
mod surface;
mod three_parallel;
mod violation;

use core::fmt::Debug;
use std::sync::Arc;

pub use frame::{Frame, Rotation, cross, distance, dot, length};
pub use installation::{ConfigError, Frames, Installation};
pub use opw::{Opw, OpwParameters};
pub use scara::Scara;
pub use skeleton::{MOST_POINTS, Skeleton};
pub use surface::{Surface, contact_force};
pub use three_parallel::{ThreeParallel, ThreeParallelParameters};
pub use violation::{Count, LEAST_WAY_MM, Rated, SINGULAR_SHARE, TURN_SHARE, TURNED_OVER_DEG, Violation};

// A file of the tests is also a module of the robot node's tests, and names this crate.
#[cfg(test)]
extern crate self as arm;

/// Largest number of joints of an arm. Joints that an arm does not have stay 0.
pub const AXES: usize = 6;

/// What rounding may bring a joint beyond a limit that a target is on, in degrees (mm).
const ROUNDING: f64 = 1e-6;

/// One value per joint: degrees, or mm for a linear joint.
pub type Joints = [f64; AXES];

/// The geometry of an arm. [`Arm`] adds the limits of the joints.
pub trait Kinematics: Debug + Send + Sync {
    /// Returns the number of joints, at most [`AXES`].
    fn axes(&self) -> usize;

    /// Returns whether a full turn of this joint, counted from 0, leads to the same pose.
    fn is_rotary(&self, axis: usize) -> bool;

    /// Returns the pose of the flange in the root frame.
    fn forward(&self, joints: &Joints) -> Frame;

    /// Returns the points along which the arm's bodies lie, from the root to the flange.
    fn skeleton(&self, joints: &Joints, limits: &AxisLimits) -> Skeleton;

    /// Returns the joints for this pose of the flange, in the configuration (elbow, wrist) of `near`; rotary joints
    /// may be off by full turns.
    fn inverse(&self, flange: &Frame, near: &Joints) -> Result<Joints, Violation>;

    /// Returns the bits of a configuration's [status](protocol::image::Configuration) that this arm has.
    fn status_bits(&self) -> u8;

    /// Returns the status of the arm in these joints.
    fn status(&self, joints: &Joints) -> u8;

    /// Returns the joints for this pose of the flange with this status; rotary joints by any number of turns. A joint that
    /// may have any value keeps that of `near`.
    fn inverse_with(&self, flange: &Frame, status: u8, near: &Joints) -> Result<Joints, Violation>;
}

/// Range, rated speed, acceleration and jerk of every joint. A joint that the arm does not have has no limits.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct AxisLimits {
    /// Lowest values, in degrees (mm).
    pub lower: Joints,
    /// Highest values, in degrees (mm).
    pub upper: Joints,
    /// Rated speeds, in degrees (mm) per second.
    pub speed: Joints,
    /// Rated accelerations, in degrees (mm) per second².
    pub acceleration: Joints,
    /// Rated jerks, in degrees (mm) per second³.
    pub jerk: Joints,
}

impl AxisLimits {
    /// No limits at all.
    pub const NONE: Self = Self {
        lower: [f64::NEG_INFINITY; AXES],
        upper: [f64::INFINITY; AXES],
        speed: [f64::INFINITY; AXES],
        acceleration: [f64::INFINITY; AXES],
        jerk: [f64::INFINITY; AXES],
    };

    /// Returns the joint that these speeds load most, and the share of its rated speed.
    #[must_use]
    pub fn speed_load(&self, speeds: &Joints) -> Load {
        Load::highest(speeds, &self.speed)
    }

    /// Returns the joint that these accelerations load most, and the share of its rated acceleration.
    #[must_use]
    pub fn acceleration_load(&self, accelerations: &Joints) -> Load {
        Load::highest(accelerations, &self.acceleration)
    }

    /// Returns the joint that these jerks load most, and the share of its rated jerk.
    #[must_use]
    pub fn jerk_load(&self, jerks: &Joints) -> Load {
        Load::highest(jerks, &self.jerk)
    }
}

/// The joint closest to its limit.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Load {
    /// Number of the joint, from 1.
    pub axis: u8,
    /// Share of its limit; 1 is the limit.
    pub share: f64,
}

impl Load {
    fn highest(values: &Joints, limits: &Joints) -> Self {
        let mut highest = Self { axis: 1, share: 0.0 };
        for (axis, (value, limit)) in (1..).zip(values.iter().zip(limits)) {
            let share = value.abs() / limit;
            if share > highest.share {
                highest = Self { axis, share };
            }
        }
        highest
    }
}

/// An arm with its limits.
#[derive(Clone, Debug)]
pub struct Arm {
    kinematics: Arc<dyn Kinematics>,
    limits: AxisLimits,
    axes: usize,
    /// Whether each joint is rotary.
    rotary: [bool; AXES],
}

impl Arm {
    /// Creates an arm of this geometry within these limits.
    #[must_use]
    pub fn new(kinematics: Arc<dyn Kinematics>, limits: AxisLimits) -> Self {
        let axes = kinematics.axes();
        let rotary = core::array::from_fn(|axis| axis < axes && kinematics.is_rotary(axis));
        Self { kinematics, limits, axes, rotary }
    }

    /// Returns the number of joints.
    #[must_use]
    pub const fn axes(&self) -> usize {
        self.axes
    }

    /// Returns the limits of the joints.
    #[must_use]
    pub const fn limits(&self) -> &AxisLimits {
        &self.limits
    }

    /// Returns the pose of the flange in the root frame.
    #[must_use]
    pub fn forward(&self, joints: &Joints) -> Frame {
        self.kinematics.forward(joints)
    }

    /// Returns the points along which the arm's bodies lie, from the root to the flange, in the root frame.
    #[must_use]
    pub fn skeleton(&self, joints: &Joints) -> Skeleton {
        self.kinematics.skeleton(joints, &self.limits)
    }

    /// Returns the joints for this pose of the flange without a turn or a change of configuration from `near`: for
    /// the next point of a path.
    pub fn follow(&self, flange: &Frame, near: &Joints) -> Result<Joints, Violation> {
        let mut joints = self.kinematics.inverse(flange, near)?;
        for ((joint, near), is_rotary) in joints.iter_mut().zip(near).zip(self.rotary) {
            if is_rotary {
                *joint = near + shortest_turn(*joint - near);
            }
        }
        self.within_range(&joints)?;
        Ok(joints)
    }

    /// Returns the joints for this pose of the flange in the configuration of `near`, each rotary joint by the
    /// shortest turn within its range: for a target of a point-to-point motion.
    pub fn inverse(&self, flange: &Frame, near: &Joints) -> Result<Joints, Violation> {
        let joints = self.turned_least(&self.kinematics.inverse(flange, near)?, near);
        self.within_range(&joints)?;
        Ok(joints)
    }

    /// Changes each rotary joint by whole turns to the value nearest to `near` that is within its range.
    fn turned_least(&self, joints: &Joints, near: &Joints) -> Joints {
        let mut joints = *joints;
        let range = self.limits.lower.iter().zip(&self.limits.upper);
        for (((joint, near), (lower, upper)), is_rotary) in
            joints.iter_mut().zip(near).zip(range).zip(self.rotary)
        {
            if is_rotary {
                let shortest = near + shortest_turn(*joint - near);
                let within = [shortest, shortest - 360.0, shortest + 360.0];
                *joint = within.into_iter().find(|turn| (lower..=upper).contains(&turn)).unwrap_or(shortest);
            }
        }
        joints
    }

    /// Returns the rotary joint (from 1) that turns most from one point of a path to the next, and its turn in
    /// degrees.
    #[must_use]
    pub fn largest_turn(&self, from: &Joints, to: &Joints) -> (u8, f64) {
        let mut largest = (1, 0.0);
        for (axis, (from, to)) in from.iter().zip(to).enumerate() {
            let turn = (to - from).abs();
            if turn > largest.1 && self.rotary[axis] {
                largest = (axis as u8 + 1, turn);
            }
        }
        largest
    }

    /// Returns whether every joint is within its range: a target on the limit itself is, in spite of rounding.
    pub fn within_range(&self, joints: &Joints) -> Result<(), Violation> {
        let AxisLimits { lower, upper, .. } = &self.limits;
        for (axis, ((value, lower), upper)) in joints.iter().zip(lower).zip(upper).enumerate() {
            if *value < lower - ROUNDING || *value > upper + ROUNDING {
                return Err(Violation::Axis {
                    axis: axis as u8 + 1,
                    rotary: self.rotary[axis],
                    value: *value,
                    lower: *lower,
                    upper: *upper,
                });
            }
        }
        Ok(())
    }
}

/// Returns the same turn within [−180, 180].
fn shortest_turn(degrees: f64) -> f64 {
    if degrees.abs() <= 180.0 { degrees } else { degrees - 360.0 * (degrees / 360.0).round() }
}
