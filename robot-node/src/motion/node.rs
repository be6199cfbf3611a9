//! What a place of a part asks of joints and tool, and what is allowed there.
//!
//! With the speed v along the part and b = v², a joint has at a place with the derivatives q', q'' and q'''
//!
//! ```text
//! speed: q'·v        acceleration: q'·a + q''·b        jerk: (q'·κ + 3·q''·a + q'''·b)·v
//! ```
//!
//! where a = b'/2 is the acceleration along the part and κ = a' how it changes with the way. The tool has the same with its place
//! x, whose vectors are held against the programmed limits.

use core::iter::zip;

use super::derivatives::Derivatives;
use crate::arm::{AXES, AxisLimits, Joints, dot};

/// The share of the jerk that a constant speed takes at most. The rest begins and ends its changes.
const TWISTING: f64 = 0.9;

/// The share of the jerk left at a speed that may go into changing the speed where the path bends. The rest begins and ends
/// the change.
const TURNING: f64 = 0.7;

/// Limits of joints and tool along a part.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Ratings {
    pub(super) speed: Joints,
    pub(super) acceleration: Joints,
    /// How long an acceleration takes to come up, in s: it over the jerk.
    pub(super) ramp_s: Joints,
    /// In mm/s²; infinite where no tool is led.
    pub(super) tool_acceleration: f64,
    pub(super) tool_ramp_s: f64,
    /// How much of the accelerations slowing down may have: of the joints', and of the tool's.
    pub(super) deceleration: f64,
    pub(super) tool_deceleration: f64,
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
    /// Of axes, with a share of their acceleration and their jerk, that lead no tool.
    pub(super) fn of_axes(rated: &AxisLimits, share: f64, reserve: f64) -> Self {
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

    /// The tool's jerk, in mm/s³; infinite where no tool is led.
    pub(super) fn tool_jerk(&self) -> f64 {
        self.tool_acceleration / self.tool_ramp_s
    }

    pub(super) const fn leads_tool(&self) -> bool {
        self.tool_acceleration.is_finite()
    }
}

/// How long an acceleration takes to come up; 0 where there is no limit.
pub(super) fn ramp_s(acceleration: f64, jerk: f64) -> f64 {
    if jerk.is_finite() { acceleration / jerk } else { 0.0 }
}

/// How the arm moves at a place: the square of its speed, and its acceleration.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub(super) struct Pace {
    pub(super) square: f64,
    pub(super) acceleration: f64,
}

impl Pace {
    pub(super) const REST: Self = Self { square: 0.0, acceleration: 0.0 };

    pub(super) fn is_rest(&self) -> bool {
        self.square == 0.0
    }

    /// How far from here the arm stands if it goes on braking like this; infinite where it does not brake.
    pub(super) fn brakes_within(&self) -> f64 {
        if self.acceleration < 0.0 { -self.square / (2.0 * self.acceleration) } else { f64::INFINITY }
    }
}

/// A vector of the tool.
type Vector<T> = [T; 3];

/// A place of a part: its derivatives by the part's unit, over what each acceleration may be.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Node {
    /// In the part's unit.
    pub(super) way: f64,
    /// The highest speed that is programmed.
    pub(super) programmed: f64,
    /// The square of the highest speed that joints and tool allow.
    pub(super) highest: f64,
    slope: [f32; AXES],
    bend: [f32; AXES],
    twist: [f32; AXES],
    tool: [Vector<f32>; 3],
}

impl Node {
    /// A place from the derivatives there, and from the share of what they may be off that counts as there. Of a line, whose tool
    /// goes straight on, the tool's are not asked for.
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

    /// A place of a motion of all axes together, whose derivatives are its whole ways.
    pub(super) fn of_axes(way: f64, programmed: f64, ways: &Joints, ratings: &Ratings) -> Self {
        let slope = core::array::from_fn(|axis| (ways[axis] / ratings.acceleration[axis]) as f32);
        let none = [0.0; AXES];
        let tool = [[0.0; 3]; 3];
        Self { way, programmed, highest: f64::INFINITY, slope, bend: none, twist: none, tool }
    }

    /// The square of the highest speed that the joints allow, and the axis, from 1, that allows no more.
    pub(super) fn highest_of_joints(&self, ratings: &Ratings) -> (f64, u8) {
        let mut slowest = (f64::INFINITY, 1);
        for axis in 0..AXES {
            let [slope, bend, twist] =
                [self.slope[axis], self.bend[axis], self.twist[axis]].map(|value| f64::from(value.abs()));
            let speed = ratings.speed[axis] / (slope * ratings.acceleration[axis]);
            let square = (speed * speed).min(1.0 / bend);
            // The jerk's limit has a root of the third degree: only where it counts.
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

    /// The speed at which the first joint has its rated speed.
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
        // A root of the third degree: only where it counts.
        if highest * highest * highest * jerk > TWISTING * TWISTING {
            libm::cbrt(TWISTING * TWISTING / jerk)
        } else {
            highest
        }
    }

    /// Reduces limits to what may all be made use of at once at this place: half of what the joints have goes into acceleration
    /// and jerk at most, what is left into the speed.
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
        // It is a matter of reserve: steps of a twentieth are near enough.
        while speed > 0.0 && !fits(speed) {
            speed *= 0.95;
        }
        Limits { speed, acceleration, jerk }
    }

    /// The highest acceleration along the part and the highest jerk that joints and tool allow here, from rest.
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

    /// How fast the tool is per unit of the part's speed, in mm; 0 where no tool is led.
    pub(super) fn tool_slope(&self, ratings: &Ratings) -> f64 {
        square(self.tool[0].map(f64::from)).sqrt() * ratings.tool_acceleration
    }
}

/// A node in the unit of a stretch from rest to rest.
#[derive(Clone, Copy, Debug)]
pub(super) struct Knot {
    /// The way along the stretch.
    pub(super) way: f64,
    /// The square of the highest speed, as programmed and as joints and tool allow.
    pub(super) highest: f64,
    /// The share of acceleration and of jerk that may be made use of.
    pub(super) tightness: [f64; 2],
    slope: [f64; AXES],
    bend: [f64; AXES],
    twist: [f64; AXES],
    tool: [Vector<f64>; 3],
    /// One over the slopes.
    flatness: [f64; AXES],
    ratings: Ramps,
    /// The largest of what the rows' bends and twists count to the jerk.
    most_turning: [f64; 2],
}

/// What of the [`Ratings`] a knot needs.
#[derive(Clone, Copy, Debug)]
struct Ramps {
    ramp_s: Joints,
    /// One over that.
    quickness: Joints,
    tool_ramp_s: f64,
    deceleration: f64,
    tool_deceleration: f64,
}

impl Knot {
    /// `unit` is what the node's unit grows by for each unit of the stretch.
    pub(super) fn new(node: &Node, ratings: &Ratings, way: f64, unit: f64) -> Self {
        let mut knot = Self::between(node, node, 0.0, ratings, way, unit);
        knot.highest = knot.highest.min(node.highest / (unit * unit));
        knot
    }

    /// Between two nodes, at a share of the way from the first to the second.
    pub(super) fn between(
        one: &Node,
        other: &Node,
        share: f64,
        ratings: &Ratings,
        way: f64,
        unit: f64,
    ) -> Self {
        let (square_unit, cube) = (unit * unit, unit * unit * unit);
        let length = other.way - one.way;
        let rows = |one: [&[f32; AXES]; 2], other: [&[f32; AXES]; 2], scale: f64| {
            core::array::from_fn::<_, AXES, _>(|axis| {
                let [one, other] = [one, other].map(|rows| rows.map(|row| f64::from(row[axis])));
                hermite(one, other, length, share) * scale
            })
        };
        let vector = |order: usize, scale: f64| {
            core::array::from_fn(|i| {
                let [one, other] = [one, other].map(|node| {
                    let next = node.tool.get(order + 1).map_or(0.0, |next| f64::from(next[i]));
                    [f64::from(node.tool[order][i]), next]
                });
                let value = if order < 2 {
                    hermite(one, other, length, share)
                } else {
                    one[0] + share * (other[0] - one[0])
                };
                value * scale
            })
        };
        let slope = rows([&one.slope, &one.bend], [&other.slope, &other.bend], unit);
        let bend = rows([&one.bend, &one.twist], [&other.bend, &other.twist], square_unit);
        let twist = core::array::from_fn(|axis| {
            let [one, other] = [one, other].map(|node| f64::from(node.twist[axis]));
            (one + share * (other - one)) * cube
        });
        let tool = [vector(0, unit), vector(1, square_unit), vector(2, cube)];
        let most = |of_joints: &[f64; AXES], of_tool: &Vector<f64>| {
            let of_joints = zip(of_joints, &ratings.ramp_s).map(|(value, ramp)| value.abs() * ramp);
            of_joints.fold(square(*of_tool).sqrt() * ratings.tool_ramp_s, f64::max)
        };
        let programmed = one.programmed + share * (other.programmed - one.programmed);
        let speed = programmed / unit;
        Self {
            way,
            highest: (speed * speed).min((one.highest + share * (other.highest - one.highest)) / square_unit),
            tightness: [1.0; 2],
            slope,
            flatness: slope.map(|slope| 1.0 / slope),
            most_turning: [most(&bend, &tool[1]), most(&twist, &tool[2])],
            bend,
            twist,
            tool,
            ratings: Ramps {
                ramp_s: ratings.ramp_s,
                quickness: ratings.ramp_s.map(|ramp_s| 1.0 / ramp_s),
                tool_ramp_s: ratings.tool_ramp_s,
                deceleration: ratings.deceleration,
                tool_deceleration: ratings.tool_deceleration,
            },
        }
    }

    /// A place between this one and another one of the same part, at a share of the way to it.
    pub(super) fn toward(&self, other: &Self, share: f64) -> Self {
        let mix = |one: f64, other: f64| one + share * (other - one);
        let length = other.way - self.way;
        let rows = |one: [&[f64; AXES]; 2], other: [&[f64; AXES]; 2]| {
            core::array::from_fn(|axis| {
                hermite(one.map(|row| row[axis]), other.map(|row| row[axis]), length, share)
            })
        };
        let tool = |order: usize| {
            core::array::from_fn(|i| {
                let [one, other] = [self, other].map(|knot| [knot.tool[order][i], knot.tool[order + 1][i]]);
                hermite(one, other, length, share)
            })
        };
        let twist = core::array::from_fn(|i| mix(self.tool[2][i], other.tool[2][i]));
        let slope = rows([&self.slope, &self.bend], [&other.slope, &other.bend]);
        Self {
            way: mix(self.way, other.way),
            // At the border to a slower part only the other one is that of this part.
            highest: self.highest.max(other.highest),
            tightness: [1.0; 2],
            slope,
            flatness: slope.map(|slope| 1.0 / slope),
            bend: rows([&self.bend, &self.twist], [&other.bend, &other.twist]),
            twist: core::array::from_fn(|axis| mix(self.twist[axis], other.twist[axis])),
            tool: [tool(0), tool(1), twist],
            ratings: self.ratings,
            most_turning: core::array::from_fn(|order| {
                self.most_turning[order].max(other.most_turning[order])
            }),
        }
    }

    /// Where another part begins with this knot: its rows from now on, with what holds on both sides.
    pub(super) fn join(&mut self, next: Self) {
        let ratio = self.steepest() / next.steepest();
        let highest = self.highest.min(next.highest);
        *self = Self { highest, ..next };
        if ratio > 1.0 && ratio.is_finite() {
            for rows in [&mut self.slope, &mut self.bend, &mut self.twist] {
                rows.iter_mut().for_each(|value| *value *= ratio);
            }
            self.tool.iter_mut().flatten().for_each(|value| *value *= ratio);
            self.most_turning.iter_mut().for_each(|value| *value *= ratio);
            self.flatness.iter_mut().for_each(|value| *value /= ratio);
        }
    }

    /// The square of the highest speed, where limits are drawn tighter.
    pub(super) fn highest(&self) -> f64 {
        self.highest * self.tightness[0].min(self.tightness[1])
    }

    fn steepest(&self) -> f64 {
        self.slope.iter().fold(square(self.tool[0]).sqrt(), |most, slope| most.max(slope.abs()))
    }

    /// The highest acceleration from rest, and the highest jerk there.
    pub(super) fn at_rest(&self) -> (f64, f64) {
        let (tool, steepest) = (square(self.tool[0]).sqrt(), self.steepest());
        let ramps = zip(&self.slope, &self.ratings.ramp_s).map(|(slope, ramp)| slope.abs() * ramp);
        let jerk = ramps.fold(tool * self.ratings.tool_ramp_s, f64::max);
        (self.tightness[0] / steepest, self.tightness[1] / jerk)
    }

    /// The highest square x that a neighbour `distance` away may have, where the square is `known` on this side and x counts
    /// `weight` at this place; `sign` is that of the acceleration from here to there.
    pub(super) fn reach(&self, known: f64, distance: f64, weight: f64, sign: f64) -> f64 {
        let slope = sign / (2.0 * distance);
        let (joints, tool) =
            if sign < 0.0 { (self.ratings.deceleration, self.ratings.tool_deceleration) } else { (1.0, 1.0) };
        let mut most = f64::INFINITY;
        let left = self.tightness[0] * joints;
        for axis in 0..AXES {
            let factor = self.slope[axis] * slope + self.bend[axis] * weight;
            let rest = (self.bend[axis] * (1.0 - weight) - self.slope[axis] * slope) * known;
            let x = (left - rest * 1.0_f64.copysign(factor)) / factor.abs();
            most = if x < most { x } else { most };
        }
        let left = self.tightness[0] * tool;
        let [along, bend, _] = &self.tool;
        let factor: Vector<f64> = core::array::from_fn(|i| along[i] * slope + bend[i] * weight);
        let rest: Vector<f64> =
            core::array::from_fn(|i| (bend[i] * (1.0 - weight) - along[i] * slope) * known);
        most = most.min(largest(square(factor), dot(factor, rest), square(rest) - left * left));
        // What turning takes of the jerk.
        let [bend, twist] = self.most_turning;
        let speed = known.sqrt();
        let turning = TURNING * (self.tightness[1] - twist * known * speed).max(0.0) / (3.0 * bend * speed);
        most.min(known + 2.0 * distance * turning)
    }

    /// By how much the acceleration may grow (`sign` 1) or fall (−1) with the way.
    pub(super) fn bend_room(&self, square_speed: f64, acceleration: f64, sign: f64) -> f64 {
        let whole = self.tightness[1] / square_speed.max(f64::MIN_POSITIVE).sqrt();
        let mut least = f64::INFINITY;
        for axis in 0..AXES {
            let taken = 3.0 * self.bend[axis] * acceleration + self.twist[axis] * square_speed;
            // Of a joint that stands this is no number, and does not count.
            let flatness = self.flatness[axis];
            let x = whole * self.ratings.quickness[axis] * flatness.abs() - sign * taken * flatness;
            least = if x < least { x } else { least };
        }
        let ramp = self.ratings.tool_ramp_s;
        if ramp > 0.0 {
            let [along, bend, twist] = &self.tool;
            let taken: Vector<f64> =
                core::array::from_fn(|i| sign * (3.0 * bend[i] * acceleration + twist[i] * square_speed));
            let whole = whole / ramp;
            least = least.min(largest(square(*along), dot(*along, taken), square(taken) - whole * whole));
        }
        least.max(0.0)
    }

    /// How much of what is allowed a law takes here, with its speed's square, its acceleration, and its jerk: of the acceleration,
    /// and of the jerk.
    pub(super) fn loads(&self, square_speed: f64, acceleration: f64, jerk: f64) -> [f64; 2] {
        self.loads_by([&self.slope, &self.bend, &self.twist], &self.tool, [square_speed, acceleration, jerk])
    }

    /// The same half-way to another knot.
    pub(super) fn loads_between(
        &self,
        other: &Self,
        square_speed: f64,
        acceleration: f64,
        jerk: f64,
    ) -> [f64; 2] {
        // Between two values, what their slopes make of it.
        let eighth = (other.way - self.way) / 8.0;
        let between =
            |one: [f64; 2], other: [f64; 2]| 0.5 * (one[0] + other[0]) + eighth * (one[1] - other[1]);
        let slope = core::array::from_fn(|axis| {
            between([self.slope[axis], self.bend[axis]], [other.slope[axis], other.bend[axis]])
        });
        let bend = core::array::from_fn(|axis| {
            between([self.bend[axis], self.twist[axis]], [other.bend[axis], other.twist[axis]])
        });
        let twist = core::array::from_fn(|axis| 0.5 * (self.twist[axis] + other.twist[axis]));
        let vector = |order: usize| -> Vector<f64> {
            core::array::from_fn(|i| {
                let [one, other] = [self, other].map(|knot| [knot.tool[order][i], knot.tool[order + 1][i]]);
                between(one, other)
            })
        };
        let tool_twist = core::array::from_fn(|i| 0.5 * (self.tool[2][i] + other.tool[2][i]));
        let tool = [vector(0), vector(1), tool_twist];
        self.loads_by([&slope, &bend, &twist], &tool, [square_speed, acceleration, jerk])
    }

    fn loads_by(
        &self,
        [slope, bend, twist]: [&[f64; AXES]; 3],
        [along, across, around]: &[Vector<f64>; 3],
        [square_speed, acceleration, jerk]: [f64; 3],
    ) -> [f64; 2] {
        let speed = square_speed.max(0.0).sqrt();
        let (bending, twisting) = (3.0 * acceleration * speed, square_speed * speed);
        let mut most = [0.0_f64; 2];
        for axis in 0..AXES {
            let accelerated = (slope[axis] * acceleration + bend[axis] * square_speed).abs();
            let jerked = (slope[axis] * jerk + bend[axis] * bending + twist[axis] * twisting).abs();
            let jerked = jerked * self.ratings.ramp_s[axis];
            most[0] = if accelerated > most[0] { accelerated } else { most[0] };
            most[1] = if jerked > most[1] { jerked } else { most[1] };
        }
        let (mut accelerated, mut jerked) = (0.0, 0.0);
        for i in 0..3 {
            let one = along[i] * acceleration + across[i] * square_speed;
            let other = along[i] * jerk + across[i] * bending + around[i] * twisting;
            (accelerated, jerked) = (accelerated + one * one, jerked + other * other);
        }
        let (mut accelerated, jerked) = (accelerated.sqrt(), jerked.sqrt() * self.ratings.tool_ramp_s);
        if acceleration < 0.0 {
            most[0] /= self.ratings.deceleration;
            accelerated /= self.ratings.tool_deceleration;
        }
        [most[0].max(accelerated), most[1].max(jerked)]
    }
}

/// Between two values with their slopes, at a share of the way.
fn hermite([one, slope]: [f64; 2], [other, other_slope]: [f64; 2], length: f64, share: f64) -> f64 {
    let rest = 1.0 - share;
    let (bend, other_bend) = (length * slope - (other - one), (other - one) - length * other_slope);
    one + share * (other - one) + share * rest * (rest * bend + share * other_bend)
}

fn square(vector: Vector<f64>) -> f64 {
    dot(vector, vector)
}

/// The largest x ≥ 0 with square·x² + 2·along·x + rest ≤ 0, or what comes nearest to that; none where nothing limits it.
fn largest(square: f64, along: f64, rest: f64) -> f64 {
    if square == 0.0 {
        return f64::INFINITY;
    }
    let inside = (along * along - square * rest).max(0.0);
    ((inside.sqrt() - along) / square).max(0.0)
}
