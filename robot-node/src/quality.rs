//! How well the arm moves, by what it does in each robot cycle: off its path, stops, acceleration, jerk, and what
//! that costs.
//!
//! An [`Observer`] looks at the arm once a cycle and at nothing else, so that whatever makes the arm move (a profile,
//! a blend, an override) is measured alike. Speed, acceleration and jerk are differences of positions that lie one
//! cycle apart. When a skill ends the observer gives its [`Quality`]; those of consecutive skills add up.
//!
//! Where the arm has drives, it is where they are, and not where the controller sets it. Their positions are rounded to
//! increments: what rounding may add to a joint's speed, acceleration and jerk is subtracted.

mod course;

use serde::{Deserialize, Serialize};

use crate::arm::{AXES, Arm, Frame, Joints, Rated, distance, dot, length};
use crate::motion::{Curve, Interpolator, Segment};
use course::Course;

/// A cycle is the one in which the arm came to rest and left again, if its speed is at most this share of the mean of
/// its neighbours' speeds. Braking and starting at one rate, wherever in a cycle they meet, give a half at most; the
/// slowest corner that is no stop gives more.
const PASSING_REST: f64 = 0.6;

/// Speeds below this share of the rated ones are rounding.
const STILL: f64 = 1e-9;

/// Largest deviation of a ratio of speeds from 1 at which they count as equal: if a rest lies between two cycles, the
/// first one counts.
const EVEN: f64 = 1e-6;

/// Steps of the search for the nearest point of a curve; each squares the error.
const APPROACHES: usize = 4;

/// The share of a curve over which its slope is taken.
const SLOPE_STEP: f64 = 1e-4;

/// Error of a share of a rated value that rounding may cause.
const ROUNDING: f64 = 1e-3;

/// A joint exceeded its rating, which only an error of the controller can cause.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
#[error("a joint had {rated} of {:.1} % of its rating, by the differences from one robot cycle to the next", share * 100.0)]
pub struct RatingExceeded {
    /// The quantity that exceeded its rating by the largest share.
    pub rated: Rated,
    /// Its share of the rated value, above 1.
    pub share: f64,
}

/// How well the arm moved during one skill, or several after each other.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Quality {
    /// Time in which the arm moved, in s.
    pub moving_s: f64,
    /// How often the arm came to rest, at the end as well.
    pub rests: u32,
    /// Length of the tool's path, in mm: the sum of the distances from one robot cycle to the next.
    pub path_length_mm: f64,
    /// Farthest that the tool was from the programmed curves, in mm.
    pub path_deviation_mm: f64,
    /// Farthest that the drives brought the tool from the path of the set-points, in mm; 0 without drives.
    #[serde(default)]
    pub drive_deviation_mm: f64,
    /// The same for the joint that was farthest from its set-points, in degrees (mm).
    #[serde(default)]
    pub drive_deviation_deg: f64,
    /// Acceleration of the tool, in mm/s².
    pub tool_acceleration: Load,
    /// Jerk of the tool, in mm/s³.
    pub tool_jerk: Load,
    /// Speed of the joint that is nearest to its limit, as a share of its rated speed.
    #[serde(default)]
    pub joint_speed: Load,
    /// Acceleration of the joint that is nearest to its limit, as a share of its rated acceleration.
    pub joint_acceleration: Load,
    /// Jerk of the joint that is nearest to its limit, as a share of its rated jerk.
    pub joint_jerk: Load,
    /// What stands for energy and wear, in s at rated power: over all joints and cycles, the sum of
    /// |q̇₂² − q̇₁²| / 2, divided by the joint's rated speed and rated acceleration. That is ∫ |q̈ · q̇| dt, the work
    /// that accelerates and brakes an inertia, for the inertia that makes every drive as strong as its rating.
    /// Friction, gravity and what a drive feeds back are not in it.
    pub energy_proxy_s: f64,
}

/// The amount of a quantity: its peak, and the sums for its root mean square.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Load {
    /// Highest value.
    pub peak: f64,
    /// Integral of its square over time.
    pub square_s: f64,
}

impl Load {
    fn add(&mut self, value: f64, tick_s: f64) {
        self.peak = self.peak.max(value);
        self.square_s += value * value * tick_s;
    }

    fn plus(self, other: Self) -> Self {
        Self { peak: self.peak.max(other.peak), square_s: self.square_s + other.square_s }
    }
}

impl Quality {
    /// Combines this quality with that of the motion after it.
    #[must_use]
    pub fn then(self, other: Self) -> Self {
        Self {
            moving_s: self.moving_s + other.moving_s,
            rests: self.rests.saturating_add(other.rests),
            path_length_mm: self.path_length_mm + other.path_length_mm,
            path_deviation_mm: self.path_deviation_mm.max(other.path_deviation_mm),
            drive_deviation_mm: self.drive_deviation_mm.max(other.drive_deviation_mm),
            drive_deviation_deg: self.drive_deviation_deg.max(other.drive_deviation_deg),
            tool_acceleration: self.tool_acceleration.plus(other.tool_acceleration),
            tool_jerk: self.tool_jerk.plus(other.tool_jerk),
            joint_speed: self.joint_speed.plus(other.joint_speed),
            joint_acceleration: self.joint_acceleration.plus(other.joint_acceleration),
            joint_jerk: self.joint_jerk.plus(other.joint_jerk),
            energy_proxy_s: self.energy_proxy_s + other.energy_proxy_s,
        }
    }

    /// Returns how often the arm stopped on its path: the last rest is the end and does not count.
    #[must_use]
    pub const fn stops(&self) -> u32 {
        self.rests.saturating_sub(1)
    }

    /// Checks that no joint exceeded its ratings.
    ///
    /// # Errors
    ///
    /// The quantity that exceeded its rating by the largest share, rounding aside.
    pub fn check_ratings(&self) -> Result<(), RatingExceeded> {
        let peaks = [
            (Rated::Speed, self.joint_speed.peak),
            (Rated::Acceleration, self.joint_acceleration.peak),
            (Rated::Jerk, self.joint_jerk.peak),
        ];
        let worst = peaks.into_iter().max_by(|(_, one), (_, other)| one.total_cmp(other));
        match worst {
            Some((rated, share)) if share > 1.0 + ROUNDING => Err(RatingExceeded { rated, share }),
            _ => Ok(()),
        }
    }

    /// Returns the root mean square of one of its loads over the time in which the arm moved; 0 if it never moved.
    #[must_use]
    pub fn rms(&self, load: Load) -> f64 {
        if self.moving_s > 0.0 { (load.square_s / self.moving_s).sqrt() } else { 0.0 }
    }
}

/// Looks at the arm once a robot cycle. It allocates nothing.
#[derive(Clone, Debug)]
pub struct Observer {
    tick_s: f64,
    /// Joints of the last three cycles, the newest first.
    joints: [Joints; 3],
    /// The tool in the root in the same cycles.
    tool: [[f64; 3]; 3],
    /// The tool in the flange.
    tool_frame: Frame,
    /// Highest share of its rated speed that a joint had, in the last two cycles.
    speed: [f64; 2],
    /// The arm has moved since it last rested.
    moves: bool,
    /// What the set-points did lately; `None` without drives.
    course: Option<Course>,
    /// Resolution of the joints, in degrees (mm); 0 where they are exact.
    increment: f64,
    /// Two increments in a cycle, as a share of the slowest joint's rated speed.
    creep: f64,
    quality: Quality,
}

impl Observer {
    /// Starts with an arm that stands at `joints` and is observed every `tick_s` seconds.
    #[must_use]
    pub fn at_rest(arm: &Arm, joints: &Joints, tick_s: f64) -> Self {
        Self {
            tick_s,
            joints: [*joints; 3],
            tool: [arm.forward(joints).position; 3],
            tool_frame: Frame::IDENTITY,
            speed: [0.0; 2],
            moves: false,
            course: None,
            increment: 0.0,
            creep: 0.0,
            quality: Quality::default(),
        }
    }

    /// The same for an arm whose drives count their ways in increments of a degree (mm).
    #[must_use]
    pub fn of_drives(arm: &Arm, joints: &Joints, tick_s: f64, increment: f64) -> Self {
        let course = Some(Course::new(joints, arm.limits(), increment));
        let slowest = arm.limits().speed.iter().take(arm.axes()).fold(f64::INFINITY, |a, b| a.min(*b));
        let creep = 2.0 * increment / (tick_s * slowest);
        Self { course, increment, creep, ..Self::at_rest(arm, joints, tick_s) }
    }

    /// Starts anew with an arm that stands at `joints`.
    pub fn rest_at(&mut self, arm: &Arm, joints: &Joints) {
        (self.joints, self.tool) = ([*joints; 3], [arm.forward(joints).position; 3]);
        (self.tool_frame, self.speed, self.moves) = (Frame::IDENTITY, [0.0; 2], false);
        self.quality = Quality::default();
        if let Some(course) = &mut self.course {
            course.restart(joints);
        }
    }

    /// Returns the quality since the last [`end`](Self::end).
    #[must_use]
    pub const fn quality(&self) -> &Quality {
        &self.quality
    }

    /// Observes one robot cycle. `actual` are the joints of the drives, where the arm has some.
    pub fn look(&mut self, arm: &Arm, interpolator: &Interpolator, actual: Option<&Joints>) {
        let path = interpolator.path();
        if let Some(segment) = path.current()
            && segment.tool != self.tool_frame
        {
            // From this cycle on another point of the flange is the tool; the earlier cycles are converted to it.
            self.tool_frame = segment.tool;
            self.tool = self.joints.map(|joints| arm.forward(&joints).origin_of(&segment.tool));
        }
        let tool = interpolator.flange().origin_of(&self.tool_frame);
        // Elsewhere the tool is on its curve: the joints are made from it.
        let deviation = path.corner().map_or(0.0, |[first, second]| {
            let off_first = off_curve(first, first.curve.length(), tool, arm);
            off_first.min(off_curve(second, 0.0, tool, arm))
        });
        let off_path = match (actual, &mut self.course) {
            (Some(actual), Some(course)) => {
                course.add(interpolator.joints(), deviation);
                let nearest = course.nearest(actual);
                let actual_tool = arm.forward(actual).origin_of(&self.tool_frame);
                let off_mm = distance(actual_tool, arm.forward(&nearest.joints).origin_of(&self.tool_frame));
                let quality = &mut self.quality;
                quality.drive_deviation_mm = quality.drive_deviation_mm.max(off_mm);
                quality.drive_deviation_deg = quality.drive_deviation_deg.max(nearest.away);
                self.see(arm, actual, actual_tool);
                nearest.deviation_mm + off_mm
            }
            _ => {
                self.see(arm, interpolator.joints(), tool);
                deviation
            }
        };
        self.quality.path_deviation_mm = self.quality.path_deviation_mm.max(off_path);
    }

    /// Ends a skill, after which the arm stands at `joints`, and returns its quality. The next skill starts from zero.
    pub fn end(&mut self, arm: &Arm, joints: &Joints) -> Quality {
        // The skill ends in the cycle in which the arm arrives; that it then stands still belongs to it. Drives within the
        // window of an exact stop go the rest of the way meanwhile.
        let moved = *joints != self.joints[0];
        let tool = if moved { arm.forward(joints).origin_of(&self.tool_frame) } else { self.tool[0] };
        for _ in 0..self.joints.len() + usize::from(moved) {
            self.see(arm, joints, tool);
        }
        core::mem::take(&mut self.quality)
    }

    fn see(&mut self, arm: &Arm, joints: &Joints, tool: [f64; 3]) {
        let Self { tick_s, quality, .. } = self;
        let (tick_s, limits) = (*tick_s, arm.limits());
        let ([j1, j2, j3], [t1, t2, t3]) = (&self.joints, &self.tool);
        let [per_s, per_s2, per_s3] = [tick_s, tick_s * tick_s, tick_s * tick_s * tick_s].map(f64::recip);

        quality.path_length_mm += distance(tool, *t1);
        let jerk: [f64; 3] = core::array::from_fn(|i| tool[i] - 3.0 * (t1[i] - t2[i]) - t3[i]);
        let acceleration: [f64; 3] = core::array::from_fn(|i| tool[i] - 2.0 * t1[i] + t2[i]);
        quality.tool_acceleration.add(length(acceleration) * per_s2, tick_s);
        quality.tool_jerk.add(length(jerk) * per_s3, tick_s);

        let per = |change: Joints, rate: f64| change.map(|change| change * rate);
        let before = per(core::array::from_fn(|i| j1[i] - j2[i]), per_s);
        let velocity = per(core::array::from_fn(|i| joints[i] - j1[i]), per_s);
        let acceleration = per(core::array::from_fn(|i| joints[i] - 2.0 * j1[i] + j2[i]), per_s2);
        let jerk = per(core::array::from_fn(|i| joints[i] - 3.0 * (j1[i] - j2[i]) - j3[i]), per_s3);
        let [one, two, four] = [1.0, 2.0, 4.0].map(|count| count * self.increment);
        let acceleration = beyond(acceleration, two * per_s2);
        quality.joint_acceleration.add(limits.acceleration_load(&acceleration).share, tick_s);
        quality.joint_jerk.add(limits.jerk_load(&beyond(jerk, four * per_s3)).share, tick_s);
        for axis in 0..AXES {
            let work = (velocity[axis] * velocity[axis] - before[axis] * before[axis]).abs() / 2.0;
            quality.energy_proxy_s += work / (limits.speed[axis] * limits.acceleration[axis]);
        }

        let (newest, [newer, oldest]) = (limits.speed_load(&beyond(velocity, one * per_s)).share, self.speed);
        quality.joint_speed.add(newest, tick_s);
        let is_still = newest < STILL;
        let arrived = is_still && self.moves;
        // The rounded steps of a joint that creeps differ by an increment: a rest ends with more than that.
        self.moves = !is_still && (self.moves || newest >= STILL + self.creep);
        let passed = newer >= STILL
            && newest >= STILL
            && newer < oldest * (1.0 - EVEN)
            && newer <= newest * (1.0 + EVEN)
            && newer + self.creep <= PASSING_REST * f64::midpoint(newest, oldest);
        quality.rests = quality.rests.saturating_add(u32::from(arrived || passed));
        if newest >= STILL {
            quality.moving_s += tick_s;
        }

        self.joints = [*joints, *j1, *j2];
        self.tool = [tool, *t1, *t2];
        self.speed = [newest, newer];
    }
}

/// Returns by how much each value is beyond what rounding may cause.
fn beyond(values: Joints, rounding: f64) -> Joints {
    if rounding == 0.0 { values } else { values.map(|value| (value.abs() - rounding).max(0.0)) }
}

/// Returns the distance of the tool from a motion's curve, in mm; `way` is a place on the curve close by.
fn off_curve(segment: &Segment, way: f64, tool: [f64; 3], arm: &Arm) -> f64 {
    let whole = segment.curve.length();
    let place = |way: f64| match &segment.curve {
        Curve::Axes(axes) => segment.tool_at(&axes.joints(way), arm),
        cartesian => cartesian.position(way).unwrap_or([f64::NAN; 3]),
    };
    let (mut way, mut here) = (way, place(way));
    let mut nearest = distance(here, tool);
    for _ in 0..APPROACHES {
        // A place beyond the end of the curve does not exist.
        let step = if way > whole / 2.0 { -SLOPE_STEP } else { SLOPE_STEP } * whole;
        let there = place(way + step);
        let slope: [f64; 3] = core::array::from_fn(|i| (there[i] - here[i]) / step);
        let square = dot(slope, slope);
        if square <= 0.0 || !square.is_finite() {
            break;
        }
        let off = core::array::from_fn(|i| tool[i] - here[i]);
        let next = (way + dot(off, slope) / square).clamp(0.0, whole);
        if next == way {
            break;
        }
        (way, here) = (next, place(next));
        nearest = nearest.min(distance(here, tool));
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_exceeds_its_rating_by_the_largest_share_is_named_and_rounding_is_forgiven() {
        let load = |peak| Load { peak, square_s: 0.0 };
        let of = |speed, acceleration, jerk| Quality {
            joint_speed: load(speed),
            joint_acceleration: load(acceleration),
            joint_jerk: load(jerk),
            ..Quality::default()
        };
        assert_eq!(of(1.0, 1.000_9, 0.5).check_ratings(), Ok(()));
        let exceeded = of(1.1, 1.2, 0.5).check_ratings().unwrap_err();
        assert_eq!(exceeded, RatingExceeded { rated: Rated::Acceleration, share: 1.2 });
    }
}
