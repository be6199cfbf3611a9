//! The derivatives of joints and tool at a place of a part, and the limits there.
//!
//! With the speed v along the part and b = v², a joint has at a place with the derivatives q', q'' and q'''
//!
//! ```text
//! speed: q'·v        acceleration: q'·a + q''·b        jerk: (q'·κ + 3·q''·a + q'''·b)·v
//! ```
//!
//! where a = b'/2 is the acceleration along the part and κ = a' its change with the way. The same holds for the
//! position of the tool; the sizes of its vectors are compared with the programmed limits.

use super::derivatives::Derivatives;
use crate::{AXES, AxisLimits, Joints, dot};

/// Largest share of the jerk that a constant speed may use. The rest begins and ends changes of the speed.
const TWISTING: f64 = 0.9;

/// Limits of joints and tool along a part.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Ratings {
    /// Highest speeds of the joints, in degrees (mm) per second.
    pub speed: Joints,
    /// Highest accelerations of the joints, in degrees (mm) per second².
    pub acceleration: Joints,
    /// Times in which the accelerations rise, in s: acceleration over jerk.
    pub ramp_s: Joints,
    /// Highest acceleration of the tool, in mm/s²; infinite where no tool is led.
    pub tool_acceleration: f64,
    /// Time in which the acceleration of the tool rises, in s.
    pub tool_ramp_s: f64,
    /// Factor of the joints' accelerations for slowing down.
    pub deceleration: f64,
    /// Factor of the tool's acceleration for slowing down.
    pub tool_deceleration: f64,
}

/// Limits along a path that are the same everywhere, in mm and seconds.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Limits {
    /// Highest speed.
    pub speed: f64,
    /// Highest acceleration.
    pub acceleration: f64,
    /// Highest jerk.
    pub jerk: f64,
}

impl Ratings {
    /// Returns those of axes that lead no tool, with a share of their acceleration and their jerk.
    #[must_use]
    pub fn of_axes(rated: &AxisLimits, share: f64, reserve: f64) -> Self {
        Self {
            speed: rated.speed.map(|speed| reserve * speed),
            acceleration: rated.acceleration.map(|acceleration| reserve * share * acceleration),
            ramp_s: core::array::from_fn(|axis| ramp_s(rated.acceleration[axis], rated.jerk[axis])),
            tool_acceleration: f64::INFINITY,
            tool_ramp_s: 0.0,
            deceleration: 1.0,
            tool_deceleration: 1.0,
        }
    }

    /// The same with a tool.
    pub(super) fn with_tool(self, acceleration: f64, jerk: f64, reserve: f64) -> Self {
        Self { tool_acceleration: reserve * acceleration, tool_ramp_s: ramp_s(acceleration, jerk), ..self }
    }

    /// The joints' jerks.
    pub(super) fn jerk(&self) -> Joints {
        core::array::from_fn(|axis| self.acceleration[axis] / self.ramp_s[axis])
    }

    /// The joints' accelerations for slowing down.
    pub(super) fn joints_slow(&self) -> Joints {
        self.acceleration.map(|acceleration| self.deceleration * acceleration)
    }

    /// The tool's jerk, in mm/s³; infinite where no tool is led.
    pub(super) fn tool_jerk(&self) -> f64 {
        self.tool_acceleration / self.tool_ramp_s
    }

    pub(super) const fn leads_tool(&self) -> bool {
        self.tool_acceleration.is_finite()
    }
}

/// Returns the time in which an acceleration rises; 0 where there is no limit.
pub(super) fn ramp_s(acceleration: f64, jerk: f64) -> f64 {
    if jerk.is_finite() { acceleration / jerk } else { 0.0 }
}

/// A vector of the tool.
pub type Vector<T> = [T; 3];

/// A place of a part: the derivatives by the part's unit, over the limits of the accelerations.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Node {
    /// Where it is, in the part's unit.
    pub way: f64,
    /// The highest speed that is programmed.
    pub programmed: f64,
    /// The square of the highest speed that joints and tool allow.
    pub highest: f64,
    /// First derivatives of the joints.
    pub slope: [f32; AXES],
    /// Second derivatives of the joints.
    pub bend: [f32; AXES],
    /// Third derivatives of the joints.
    pub twist: [f32; AXES],
    /// First, second and third derivative of the tool's place.
    pub tool: [Vector<f32>; 3],
}

impl Node {
    /// Creates a node from the derivatives at a place; `off` is the share of their error that is added. For a line
    /// those of the tool are not needed.
    pub(super) fn new(
        way: f64,
        programmed: f64,
        (derivatives, place, off): (&Derivatives, usize, f64),
        is_line: bool,
        ratings: &Ratings,
    ) -> Self {
        let of_joints = |order: usize| {
            core::array::from_fn(|axis| {
                let joint = &derivatives.joints()[axis];
                let value = joint.at[order][place];
                let value = value + off * joint.off[order].copysign(value);
                (value / ratings.acceleration[axis]) as f32
            })
        };
        let tool = |order: usize| {
            let value = if is_line {
                [if order == 0 { 1.0 } else { 0.0 }, 0.0, 0.0]
            } else {
                derivatives.tool(order, place)
            };
            value.map(
                |value| if ratings.leads_tool() { (value / ratings.tool_acceleration) as f32 } else { 0.0 },
            )
        };
        let node = Self {
            way,
            programmed,
            highest: f64::INFINITY,
            slope: of_joints(0),
            bend: of_joints(1),
            twist: of_joints(2),
            tool: [tool(0), tool(1), tool(2)],
        };
        Self { highest: node.highest_of_tool(ratings).min(node.highest_of_joints(ratings).0), ..node }
    }

    /// Creates a node of a point-to-point motion, whose derivatives are the whole ways of the joints.
    #[must_use]
    #[inline]
    pub fn of_axes(way: f64, programmed: f64, ways: &Joints, ratings: &Ratings) -> Self {
        let slope = core::array::from_fn(|axis| (ways[axis] / ratings.acceleration[axis]) as f32);
        let none = [0.0; AXES];
        let tool = [[0.0; 3]; 3];
        Self { way, programmed, highest: f64::INFINITY, slope, bend: none, twist: none, tool }
    }

    /// Returns the square of the highest speed that the joints allow, and the axis (from 1) that limits it.
    pub(super) fn highest_of_joints(&self, ratings: &Ratings) -> (f64, u8) {
        let mut slowest = (f64::INFINITY, 1);
        for axis in 0..AXES {
            let [slope, bend, twist] =
                [self.slope[axis], self.bend[axis], self.twist[axis]].map(|value| f64::from(value.abs()));
            let speed = ratings.speed[axis] / (slope * ratings.acceleration[axis]);
            let square = (speed * speed).min(1.0 / bend);
            // The limit by the jerk needs a cube root: only where it matters.
            let jerk = ratings.ramp_s[axis] * twist;
            let least = square.min(slowest.0);
            if least * least * least * jerk * jerk > TWISTING * TWISTING {
                let root = libm::cbrt(TWISTING / jerk);
                slowest = (root * root, axis as u8 + 1);
            } else if square < slowest.0 {
                slowest = (square, axis as u8 + 1);
            }
        }
        slowest
    }

    /// Returns the speed at which the first joint reaches its rated speed.
    pub(super) fn speed_of_joints(&self, ratings: &Ratings) -> f64 {
        let speed = |axis: usize| {
            ratings.speed[axis] / (f64::from(self.slope[axis].abs()) * ratings.acceleration[axis])
        };
        (0..AXES).map(speed).fold(f64::INFINITY, f64::min)
    }

    fn highest_of_tool(&self, ratings: &Ratings) -> f64 {
        let [_, bend, twist] = self.tool.map(|vector| square(vector.map(f64::from)));
        let highest = (1.0 / bend).sqrt();
        let jerk = twist * ratings.tool_ramp_s * ratings.tool_ramp_s;
        // A cube root: only where it matters.
        if highest * highest * highest * jerk > TWISTING * TWISTING {
            libm::cbrt(TWISTING * TWISTING / jerk)
        } else {
            highest
        }
    }

    /// Reduces limits to those that may all be used at once at this place: at most half of what the joints can do goes
    /// into acceleration and jerk, the rest into the speed.
    pub(super) fn steady(&self, limits: Limits, ratings: &Ratings) -> Limits {
        let Limits { mut speed, mut acceleration, mut jerk } = limits;
        for axis in 0..AXES {
            let slope = f64::from(self.slope[axis].abs());
            acceleration = acceleration.min(0.5 / slope);
            jerk = jerk.min(0.5 / (slope * ratings.ramp_s[axis]));
        }
        let fits = |speed: f64| {
            speed * speed <= self.highest
                && (0..AXES).all(|axis| {
                    let [slope, bend, twist] = [self.slope[axis], self.bend[axis], self.twist[axis]]
                        .map(|value| f64::from(value.abs()));
                    let turning = slope * jerk + (3.0 * bend * acceleration + twist * speed * speed) * speed;
                    slope * acceleration + bend * speed * speed <= 1.0
                        && turning * ratings.ramp_s[axis] <= 1.0
                })
        };
        // Steps of a twentieth are near enough for a reserve.
        while speed > 0.0 && !fits(speed) {
            speed *= 0.95;
        }
        Limits { speed, acceleration, jerk }
    }

    /// Returns the highest acceleration and the highest jerk along the part that joints and tool allow here from rest.
    pub(super) fn most_along(&self, ratings: &Ratings) -> [f64; 2] {
        let tool = square(self.tool[0].map(f64::from)).sqrt();
        let (mut steepest, mut ramp) = (tool, tool * ratings.tool_ramp_s);
        for axis in 0..AXES {
            let slope = f64::from(self.slope[axis].abs());
            steepest = steepest.max(slope);
            ramp = ramp.max(slope * ratings.ramp_s[axis]);
        }
        [1.0 / steepest, 1.0 / ramp]
    }

    /// Returns the speed of the tool per unit of the part's speed, in mm; 0 where no tool is led.
    pub(super) fn tool_slope(&self, ratings: &Ratings) -> f64 {
        square(self.tool[0].map(f64::from)).sqrt() * ratings.tool_acceleration
    }
}

/// Returns the square of a vector's length.
#[must_use]
#[inline]
pub fn square(vector: Vector<f64>) -> f64 {
    dot(vector, vector)
}

#[cfg(test)]
mod tests;
