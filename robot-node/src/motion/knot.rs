//! A place of a stretch, with the speeds and accelerations that joints and tool allow there.

use core::iter::zip;

use super::extremes::smaller;
use super::load::Ramps;
use super::node::{Node, Ratings, Vector, square};
use super::slopes::Slopes;
use crate::arm::{AXES, Joints, dot};

/// Share of the jerk left at a speed that a change of the speed may use where the path bends. The rest begins and ends
/// the change.
const TURNING: f64 = 0.7;

/// A node in the unit of a stretch from rest to rest.
#[derive(Clone, Copy, Debug)]
pub(super) struct Knot {
    /// Way along the stretch.
    pub(super) way: f64,
    /// The square of the highest speed, as programmed and as joints and tool allow.
    pub(super) highest: f64,
    /// The square of the highest speed that is programmed.
    pub(super) programmed: f64,
    /// Share of the acceleration and of the jerk that may be used.
    pub(super) tightness: [f64; 2],
    pub(super) slopes: Slopes,
    pub(super) rates: Rates,
    /// Reciprocals of the joints' slopes.
    flatness: Joints,
    /// Largest contributions of bends and of twists to the jerk.
    most_turning: [f64; 2],
}

/// The part of [`Ratings`] that a law needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rates {
    pub(super) ramps: Ramps,
    /// Reciprocals of the joints' ramps.
    quickness: Joints,
    /// Times in s in which the joints would reach their rated speeds: speeds over accelerations.
    speed_s: Joints,
}

impl Rates {
    pub(super) fn of(ratings: &Ratings) -> Self {
        let quickness = ratings.ramp_s.map(|ramp_s| 1.0 / ramp_s);
        let speed_s = core::array::from_fn(|axis| ratings.speed[axis] / ratings.acceleration[axis]);
        Self { ramps: Ramps::of(ratings), quickness, speed_s }
    }

    /// The square of the speed at which the first joint has its rated speed, by the joints' first derivatives.
    pub(super) fn highest(&self, slope: &Joints) -> f64 {
        let speeds = zip(&self.speed_s, slope).map(|(speed_s, slope)| speed_s / slope.abs());
        let least = speeds.fold(f64::INFINITY, |least, speed| if speed < least { speed } else { least });
        least * least
    }
}

impl Knot {
    /// `unit` is the number of the node's units per unit of the stretch.
    pub(super) fn new(node: &Node, rates: &Rates, way: f64, unit: f64) -> Self {
        let speed = node.programmed / unit;
        Self::with(Slopes::of(node, unit), [speed * speed, node.highest / (unit * unit)], way, *rates)
    }

    /// Between two nodes, at a share of the way from the first to the second.
    pub(super) fn between(one: &Node, other: &Node, share: f64, rates: &Rates, way: f64, unit: f64) -> Self {
        let mix = |one: f64, other: f64| one + share * (other - one);
        let speed = mix(one.programmed, other.programmed) / unit;
        let highest = mix(one.highest, other.highest) / (unit * unit);
        Self::with(Slopes::between(one, other, share, unit), [speed * speed, highest], way, *rates)
    }

    fn with(slopes: Slopes, [programmed, allowed]: [f64; 2], way: f64, rates: Rates) -> Self {
        let most = |of_joints: &Joints, of_tool: &Vector<f64>| {
            let of_joints = zip(of_joints, &rates.ramps.ramp_s).map(|(value, ramp)| value.abs() * ramp);
            of_joints.fold(square(*of_tool).sqrt() * rates.ramps.tool_ramp_s, f64::max)
        };
        let Slopes { bend, twist, tool, .. } = &slopes;
        let most_turning = [most(bend, &tool[1]), most(twist, &tool[2])];
        let flatness = slopes.slope.map(|slope| 1.0 / slope);
        let highest = programmed.min(allowed);
        Self { way, highest, programmed, tightness: [1.0; 2], slopes, rates, flatness, most_turning }
    }

    /// A place between this one and another one of the same part, at a share of the way to it.
    pub(super) fn toward(&self, other: &Self, share: f64) -> Self {
        let length = other.way - self.way;
        let slopes = self.slopes.toward(&other.slopes, length, share);
        let [one, two] = [self, other].map(|knot| knot.most_turning);
        Self {
            way: self.way + share * length,
            // At the border to a slower part only the other value is that of this part.
            highest: self.highest.max(other.highest),
            programmed: self.programmed.max(other.programmed),
            tightness: [1.0; 2],
            slopes,
            rates: self.rates,
            flatness: slopes.slope.map(|slope| 1.0 / slope),
            most_turning: core::array::from_fn(|order| one[order].max(two[order])),
        }
    }

    /// Whether what is here is what two others let expect between them.
    pub(super) fn is_between(&self, one: &Self, other: &Self) -> bool {
        let length = other.way - one.way;
        let expected = one.slopes.toward(&other.slopes, length, (self.way - one.way) / length);
        self.slopes.is_about(&expected, length)
    }

    /// Returns the square of the highest speed under the reduced limits.
    pub(super) fn highest(&self) -> f64 {
        self.highest * self.tightness[0].min(self.tightness[1])
    }

    /// The highest jerk at rest.
    pub(super) fn jerk_at_rest(&self) -> f64 {
        let tool = square(self.slopes.tool[0]).sqrt();
        let ramps = zip(&self.slopes.slope, &self.rates.ramps.ramp_s).map(|(slope, ramp)| slope.abs() * ramp);
        self.tightness[1] / ramps.fold(tool * self.rates.ramps.tool_ramp_s, f64::max)
    }

    /// The highest acceleration at rest or where the path is straight, if `sign` is that of speeding up, else the highest
    /// deceleration.
    pub(super) fn acceleration_at_rest(&self, sign: f64) -> f64 {
        let (joints, tool, _) = self.factors(sign);
        let tool = square(self.slopes.tool[0]).sqrt() / tool;
        let steepest = self.slopes.slope.iter().fold(tool, |most, slope| most.max(slope.abs() / joints));
        self.tightness[0] / steepest
    }

    /// The factors of the accelerations of joints and tool, and of the tool with what bends its path.
    const fn factors(&self, sign: f64) -> (f64, f64, f64) {
        let ramps = &self.rates.ramps;
        match sign < 0.0 {
            true => (ramps.deceleration, ramps.tool_deceleration, ramps.bent_tool_deceleration()),
            false => (1.0, 1.0, 1.0),
        }
    }

    /// Returns the highest square x of the speed at a neighbour `distance` away. The square is `known` on this side, x
    /// has the weight `weight` at this place, and `sign` is that of the acceleration from here to there.
    pub(super) fn reach(&self, known: f64, distance: f64, weight: f64, sign: f64) -> f64 {
        let slope = sign / (2.0 * distance);
        let (joints, tool, bent_tool) = self.factors(sign);
        let mut most = f64::INFINITY;
        let left = self.tightness[0] * joints;
        for axis in 0..AXES {
            let factor = self.slopes.slope[axis] * slope + self.slopes.bend[axis] * weight;
            let rest = (self.slopes.bend[axis] * (1.0 - weight) - self.slopes.slope[axis] * slope) * known;
            let x = (left - rest * 1.0_f64.copysign(factor)) / factor.abs();
            most = smaller(most, x);
        }
        let left = self.tightness[0] * bent_tool;
        let [along, bend, _] = &self.slopes.tool;
        let factor: Vector<f64> = core::array::from_fn(|i| along[i] * slope + bend[i] * weight);
        let rest: Vector<f64> =
            core::array::from_fn(|i| (bend[i] * (1.0 - weight) - along[i] * slope) * known);
        most = smaller(most, largest(square(factor), dot(factor, rest), square(rest) - left * left));
        if tool < 1.0 {
            let [by_square, by_acceleration, _] = self.slopes.along_path();
            let factor = by_acceleration * slope + by_square * weight;
            let rest = (by_square * (1.0 - weight) - by_acceleration * slope) * known;
            if factor < 0.0 {
                most = smaller(most, ((self.tightness[0] * tool + rest) / -factor).max(0.0));
            }
        }
        // The jerk that turning takes.
        let [bend, twist] = self.most_turning;
        let speed = known.sqrt();
        let turning = TURNING * (self.tightness[1] - twist * known * speed).max(0.0) / (3.0 * bend * speed);
        smaller(most, known + 2.0 * distance * turning)
    }

    /// Returns how fast the acceleration may grow (`sign` 1) or fall (−1) with the way.
    pub(super) fn bend_room(&self, square_speed: f64, acceleration: f64, sign: f64) -> f64 {
        let whole = self.tightness[1] / square_speed.max(f64::MIN_POSITIVE).sqrt();
        let mut least = f64::INFINITY;
        for axis in 0..AXES {
            let taken = 3.0 * self.slopes.bend[axis] * acceleration + self.slopes.twist[axis] * square_speed;
            // For a joint that stands this is no number, and does not count.
            let flatness = self.flatness[axis];
            let x = whole * self.rates.quickness[axis] * flatness.abs() - sign * taken * flatness;
            least = smaller(least, x);
        }
        let ramp = self.rates.ramps.tool_ramp_s;
        if ramp > 0.0 {
            let [along, bend, twist] = &self.slopes.tool;
            let taken: Vector<f64> =
                core::array::from_fn(|i| sign * (3.0 * bend[i] * acceleration + twist[i] * square_speed));
            let whole = whole / ramp;
            let most = largest(square(*along), dot(*along, taken), square(taken) - whole * whole);
            least = smaller(least, most);
        }
        least.max(0.0)
    }
}

/// Returns the largest x ≥ 0 with square·x² + 2·along·x + rest ≤ 0, or the nearest to that; infinite where nothing
/// limits it.
pub(super) fn largest(square: f64, along: f64, rest: f64) -> f64 {
    if square == 0.0 {
        return f64::INFINITY;
    }
    let inside = (along * along - square * rest).max(0.0);
    ((inside.sqrt() - along) / square).max(0.0)
}
