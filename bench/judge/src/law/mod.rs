//! The laws that an arm has to keep whatever is commanded, checked in each robot cycle.
//!
//! # What sampling may add
//!
//! Joints are seen every T = one robot cycle. With a law of motion whose jerk is bounded the n-th difference of the samples,
//! divided by Tⁿ, is the mean of the n-th derivative over n cycles, weighted by the B-spline of that order:
//!
//! ```text
//! (q₁ − q₀)/T = ∫ q̇·b₁      (q₂ − 2q₁ + q₀)/T² = ∫ q̈·b₂      (q₃ − 3q₂ + 3q₁ − q₀)/T³ = ∫ q⃛·b₃      bₙ ≥ 0, ∫ bₙ = 1
//! ```
//!
//! A mean is never above the highest value, so sampling adds nothing, neither where the jerk changes within a cycle nor
//! at a path's ends. The same holds for the tool: a chord is never longer than its arc. What is left is rounding:
//! `SHARE` of the limit, which is a thousand times the error of the robot's laws over their lengths (10⁻⁹), and 2ⁿ
//! times the error of a sample itself (`JOINT_NOISE`, `TOOL_NOISE_MM`).
//!
//! An exact stop lies between two samples. From or to rest a way of ½·a·t² is gone in the time t, so the samples beside
//! it are within ½·a·T² of the target; a curve leaves the chord of two samples by a·T²/8.

mod counts;
mod course;
mod feedback;
mod joints;
mod pace;
mod stops;

use protocol::image::{Command, Digest, Feedback};

use crate::case::{Case, Execution, Kind, Programmed, by_joint};
use crate::kinematics::{AXES, Joints, Links, Pose, Vector, difference, distance};
use crate::violation::{Broken, Class, Violation};
use crate::way::Way;
use pace::Pace;

/// What rounding may add to a limit, as a share of it.
const SHARE: f64 = 1e-6;

/// What a joint's sample may be off, in degrees (mm): rounding, magnified near a singular position.
const JOINT_NOISE: f64 = 1e-11;

/// What a sample of the tool's place may be off, in mm.
const TOOL_NOISE_MM: f64 = 1e-9;

/// Where the tool is on its course, in mm and degrees: rounding of chains of frames that are a metre long.
const PLACE_MM: f64 = 1e-6;
const PLACE_DEG: f64 = 1e-6;

/// What is seen in a robot cycle, after it.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// What the PLC commanded; none without a connection.
    pub command: Option<&'a Command>,
    /// What the robot reports.
    pub feedback: &'a Feedback,
    /// Where the joints are, in degrees (mm).
    pub joints: &'a Joints,
    /// The motions that the robot put on its path.
    pub accepted: &'a Digest,
}

/// The motions that a sample of the arm may belong to, by index: that one, and beyond a corner that it is in the next.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
struct Among {
    first: usize,
    last: usize,
}

impl Among {
    fn and(self, other: Self) -> Self {
        Self { first: self.first.min(other.first), last: self.last.max(other.last) }
    }

    const fn is_one(self) -> bool {
        self.first == self.last
    }
}

/// The arm in one robot cycle.
#[derive(Clone, Copy, Debug)]
struct Sample {
    joints: Joints,
    flange: Pose,
    among: Among,
}

/// The judge of one case.
#[derive(Clone, Debug)]
pub struct Law {
    /// The classes that are looked for.
    classes: u32,
    links: Links,
    axes: usize,
    cycle_s: f64,
    /// A cycle to the power of 1, 2 and 3.
    powers: [f64; 3],
    lower: Joints,
    upper: Joints,
    /// The limits of the differences of joints from one cycle to the next: speed, acceleration, jerk.
    differences: [Joints; 3],
    path_jerk: f64,
    /// The farthest that a tool is accelerated by all joints together, in mm/s².
    tool_acceleration_by_joints: f64,
    /// Cycles in which an acceleration can be taken back, as the robot and the arm are rated.
    settles_in_rated: u32,
    /// The same by the motions of this skill.
    settles_in: u32,
    force_tolerance_n: f64,
    stiffest_n_per_mm: f64,
    surfaces: Vec<crate::case::Surface>,
    tools: [Pose; 16],
    bases: [Pose; 16],

    cycle: u32,
    /// The last samples, the newest first.
    samples: [Sample; 4],
    /// Cycles since the start of this skill: earlier samples say nothing about its course.
    samples_of_skill: u32,
    skill: Skill,
    ways: Vec<Way>,
    pace: Pace,
    /// Tool and base, as the root in it, of the pose that the feedback shows.
    shown: (Pose, Pose),
    before: Option<Feedback>,
    found: Option<Violation>,
}

/// The skill that is judged.
#[derive(Clone, Debug)]
struct Skill {
    number: u16,
    execution: Execution,
    /// The flange where it started.
    start: Pose,
    sent: Digest,
    executed: u32,
    has_moved: bool,
    has_ended: bool,
    /// The last motion that was executed holds its force.
    holds: bool,
    /// Cycles in which nothing moved although it should.
    idle: u32,
}

impl Law {
    /// The judge of a case; `setup` is [its own](Case::its_setup). Only the `classes` are looked for.
    #[must_use]
    pub fn new(case: &Case, setup: &setup::Setup, classes: &[Class]) -> Self {
        let arm = &case.arm;
        let robot = &setup.robot;
        let cycle_s = f64::from(robot.cycle_us.value) / 1e6;
        let powers = [cycle_s, cycle_s * cycle_s, cycle_s * cycle_s * cycle_s];
        let rated = [&arm.speed_deg_s, &arm.acceleration_deg_s2, &arm.jerk_deg_s3]
            .map(|limits| by_joint(limits, f64::INFINITY));
        let reach_mm = arm.links.reach_mm() + longest(&case.tools);
        let axes = arm.links.axes();
        let by_joints = (0..axes).map(|axis| {
            if arm.links.is_linear(axis) { rated[1][axis] } else { rated[1][axis].to_radians() * reach_mm }
        });
        let by_path = robot.path_acceleration_mm_s2.value / robot.path_jerk_mm_s3.value;
        let settling_s = (0..axes).map(|axis| rated[1][axis] / rated[2][axis]).fold(by_path, f64::max);
        let home = arm.home();
        let flange = arm.links.flange(&home);
        let sample = Sample { joints: home, flange, among: Among::default() };
        Self {
            classes: classes.iter().fold(0, |bits, class| bits | 1 << *class as u32),
            links: arm.links,
            axes,
            cycle_s,
            powers,
            lower: by_joint(&arm.lower_deg, f64::NEG_INFINITY),
            upper: by_joint(&arm.upper_deg, f64::INFINITY),
            differences: [0, 1, 2].map(|order| rated[order].map(|limit| limit * powers[order])),
            path_jerk: robot.path_jerk_mm_s3.value,
            tool_acceleration_by_joints: by_joints.sum(),
            settles_in_rated: (settling_s / cycle_s).ceil() as u32 + 3,
            settles_in: 0,
            force_tolerance_n: robot.force.as_ref().map_or(0.0, |force| force.tolerance_n.value),
            stiffest_n_per_mm: robot.force.as_ref().map_or(0.0, |force| force.stiffest_n_per_mm.value),
            surfaces: case.surfaces.clone(),
            tools: frames(&case.tools),
            bases: frames(&case.bases),
            cycle: 0,
            samples: [sample; 4],
            samples_of_skill: 0,
            skill: Skill {
                number: 0,
                execution: Execution::Continuous,
                start: flange,
                sent: Digest::default(),
                executed: 0,
                has_moved: false,
                has_ended: true,
                holds: false,
                idle: 0,
            },
            ways: Vec::with_capacity(longest_run(case)),
            pace: Pace::default(),
            shown: (Pose::IDENTITY, Pose::IDENTITY),
            before: None,
            found: None,
        }
    }

    /// The first law that was broken.
    #[must_use]
    pub const fn found(&self) -> Option<&Violation> {
        self.found.as_ref()
    }

    /// From now on the PLC commands these motions as the skill of this number.
    pub fn start(&mut self, number: u16, execution: Execution, motions: &[Programmed]) {
        let start = self.samples[0].flange;
        let mut sent = Digest::default();
        let mut flange = start;
        self.ways.clear();
        for motion in motions {
            sent.add(&motion.motion());
            let way = Way::new(motion, &flange, &self.links, &self.tools, &self.bases);
            flange = way.end;
            self.ways.push(way);
        }
        self.limit_zones();
        self.settles_in = self.settling_cycles();
        for sample in &mut self.samples {
            sample.among = Among::default();
        }
        self.samples_of_skill = 0;
        self.skill = Skill {
            number,
            execution,
            start,
            sent,
            executed: 0,
            has_moved: false,
            has_ended: false,
            holds: self.skill.holds,
            idle: 0,
        };
    }

    /// A corner takes at most half of either motion; pieces of a spline go on without one, and the last motion and one
    /// before a LIN force stop.
    fn limit_zones(&mut self) {
        for index in 0..self.ways.len() {
            let half = self.ways[index].half_mm();
            let next = self.ways.get(index + 1).map(|next| (next.kind, next.half_mm()));
            let way = &mut self.ways[index];
            way.zone_mm = match next {
                None => 0.0,
                Some((next, _)) if next.has_force() => 0.0,
                Some((Kind::Spline, _)) if way.kind == Kind::Spline => 0.0,
                Some(_) if way.kind.has_force() => 0.0,
                Some((_, next_half)) => way.approximation_mm.min(half).min(next_half),
            };
        }
    }

    /// Judges one more robot cycle. After a broken law nothing more is judged.
    pub fn look(&mut self, seen: &Seen<'_>) {
        self.cycle += 1;
        if self.found.is_some() {
            return;
        }
        let joints = *seen.joints;
        if let Some(axis) = joints.iter().position(|joint| !joint.is_finite()) {
            return self.report(Class::Finite, joint(axis, joints[axis], 0.0, "°"));
        }
        let last = &self.samples[0];
        let flange = if last.joints == joints { last.flange } else { self.links.flange(&joints) };
        let executed = if seen.feedback.number == self.skill.number { seen.feedback.executed } else { 0 };
        self.take_up_force(executed, &flange);
        let among = self.among(executed, &flange);
        self.samples.rotate_right(1);
        self.samples[0] = Sample { joints, flange, among };
        self.samples_of_skill = self.samples_of_skill.saturating_add(1);
        self.pace.command(self.cycle, seen.command);
        self.check_joints();
        self.check_course();
        self.check_pace();
        self.check_counts(seen);
        self.check_feedback(seen);
        self.before = Some(*seen.feedback);
    }

    /// The PLC has waited in vain for the end of a skill.
    pub fn is_stuck(&mut self) {
        self.report(Class::Stuck, Broken::Words("the skill does not come to an end"));
    }

    fn report(&mut self, class: Class, what: Broken) {
        if self.classes & 1 << class as u32 == 0 || self.found.is_some() {
            return;
        }
        let motion = self.samples[0].among.first as u32 + 1;
        self.found = Some(Violation { class, cycle: self.cycle, skill: self.skill.number, motion, what });
    }

    /// Reports a figure that is beyond its limit.
    fn report_figure(
        &mut self,
        class: Class,
        quantity: &'static str,
        [figure, limit]: [f64; 2],
        unit: &'static str,
    ) {
        self.report(class, Broken::Figure { quantity, figure, limit, unit });
    }

    /// Which motions a sample may belong to, when so many are executed.
    fn among(&self, executed: u32, flange: &Pose) -> Among {
        let last = self.ways.len().saturating_sub(1);
        let index = (executed as usize).min(last);
        // Where the next motion leads another tool, each is measured by its own.
        let is_in_zone = |index: usize| {
            let (Some(way), Some(next)) = (self.ways.get(index), self.ways.get(index + 1)) else {
                return false;
            };
            let least = way.zone_mm + PLACE_MM;
            way.zone_mm > 0.0
                && (distance(flange.point(way.tool.at), way.target.at) <= least
                    || distance(flange.point(next.tool.at), way.end.point(next.tool.at)) <= least)
        };
        let before = index.checked_sub(1).filter(|before| is_in_zone(*before));
        let after = (index < last && is_in_zone(index)).then_some(index + 1);
        Among { first: before.unwrap_or(index), last: after.unwrap_or(index) }
    }

    /// The motions that the last samples may belong to.
    fn among_last(&self, samples: usize) -> Among {
        self.samples.iter().take(samples).fold(self.samples[0].among, |all, sample| all.and(sample.among))
    }

    fn ways_among(&self, among: Among) -> &[Way] {
        self.ways.get(among.first..=among.last).unwrap_or(&[])
    }

    /// Whether any joint moved in the last cycle.
    fn has_moved(&self) -> bool {
        self.samples[0].joints != self.samples[1].joints
    }

    /// By how much a joint moved in the last cycle, by how much more than before, and how that changed.
    fn joint_differences(&self, axis: usize) -> [f64; 3] {
        let [q0, q1, q2, q3] = self.samples.map(|sample| sample.joints[axis]);
        let first = q0 - q1;
        let second = first - (q1 - q2);
        [first, second, second - (q1 - 2.0 * q2 + q3)]
    }

    /// The tool's chords from sample to sample, the newest first.
    fn chords(&self, tool: &Pose) -> [Vector; 3] {
        let [p0, p1, p2, p3] = self.tools(tool);
        [(p0, p1), (p1, p2), (p2, p3)].map(|(to, from)| difference(from, to))
    }

    /// The tool's places in the last samples, the newest first.
    fn tools(&self, tool: &Pose) -> [Vector; 4] {
        self.samples.map(|sample| sample.flange.point(tool.at))
    }
}

/// A figure of a joint, counted from 0.
const fn joint(axis: usize, figure: f64, limit: f64, unit: &'static str) -> Broken {
    Broken::Joint { joint: axis as u8 + 1, figure, limit, unit }
}

fn frames(numbered: &[crate::case::Frame]) -> [Pose; 16] {
    let mut frames = [Pose::IDENTITY; 16];
    for frame in numbered {
        if let Some(pose) = frames.get_mut(usize::from(frame.number)) {
            *pose = Pose::from_mm_deg(frame.mm_deg);
        }
    }
    frames
}

fn longest(tools: &[crate::case::Frame]) -> f64 {
    tools.iter().map(|tool| crate::kinematics::length(Pose::from_mm_deg(tool.mm_deg).at)).fold(0.0, f64::max)
}

fn longest_run(case: &Case) -> usize {
    case.runs.iter().map(|run| run.motions.len()).max().unwrap_or(0)
}

/// Joints that no arm has are not judged.
const _: () = assert!(AXES == robot_node::arm::AXES);
