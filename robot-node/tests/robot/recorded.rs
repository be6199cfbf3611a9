//! What the interpolator drives, recorded finely: the path between two rests, and how long the law took for it.

use protocol::image::{Motion, MotionKind, SLOTS};
use robot_node::RobotConfig;
use robot_node::arm::{AXES, Frame, Joints, distance};
use robot_node::motion::{Interpolator, Segment};

use crate::fastest::{Bounds, Point};

/// The recording's cycle, in s.
const CYCLE_S: f64 = 1e-4;

/// So little of a rated speed is a rest: twice as much is had within the next cycle.
const REST: f64 = 1e-6;

/// A path from rest to rest, as it was driven.
pub(crate) struct Section {
    /// How long the law took, in s.
    pub(crate) duration: f64,
    /// Every [`CYCLE_S`], from before its start until after its end.
    samples: Vec<Sample>,
}

#[derive(Clone, Copy)]
struct Sample {
    joints: Joints,
    /// The motions that the arm is in.
    motions: [usize; 2],
    /// In a corner: where on both of them it is, each with its programmed speed.
    ways: Option<[(f64, f64); 2]>,
}

/// The limits of one motion.
pub(crate) fn bounds(motion: &Motion, config: &RobotConfig) -> Bounds {
    let rated = config.arm.limits();
    if motion.kind.is_point_to_point() {
        let (speed, acceleration) = (motion.velocity_share(), motion.acceleration_share());
        let joints = [
            rated.speed.map(|limit| speed * limit),
            rated.acceleration.map(|limit| acceleration * limit),
            rated.jerk.map(|limit| acceleration * limit),
        ];
        Bounds { joints, tool: [f64::INFINITY; 3] }
    } else {
        let tool = [motion.velocity_mm_s(), motion.acceleration_mm_s2(), config.path_jerk_mm_s3];
        Bounds { joints: [rated.speed, rated.acceleration, rated.jerk], tool }
    }
}

/// Drives motions from joints where the arm rests, as a PLC that is never late feeds them. None if one is refused.
pub(crate) fn sections(motions: &[Motion], from: &Joints, config: &RobotConfig) -> Option<Vec<Section>> {
    let mut interpolator = Interpolator::at_rest(config.arm.clone(), *from, CYCLE_S);
    let rated = config.arm.limits().speed;
    let mut ends = Vec::new();
    let mut current = 0;
    let mut sections = Vec::new();
    let mut section = Section { duration: 0.0, samples: Vec::new() };
    let rest = |joints: &Joints| Sample { joints: *joints, motions: [0; 2], ways: None };
    section.samples.push(rest(from));
    loop {
        while ends.len() < motions.len() && ends.len() - (interpolator.path().executed() as usize) < SLOTS {
            let segment = interpolator.path().prepare(&motions[ends.len()], config).ok()?;
            ends.push(segment.end);
            interpolator.append(segment, ends.len() == motions.len());
        }
        let step = interpolator.drive(1.0).ok()?;
        // Pieces of a spline change their ends by rounding.
        let is_current = |segment: &Segment, end: &Joints| {
            segment.end.iter().zip(end).all(|(one, other)| (one - other).abs() < 2e-3)
        };
        if let Some(segment) = interpolator.path().current() {
            while current + 1 < ends.len() && !is_current(segment, &ends[current]) {
                current += 1;
            }
        }
        let next = current + usize::from(interpolator.path().corner().is_some());
        let joints = *interpolator.joints();
        let before = section.samples.last().unwrap().joints;
        let speed = (0..AXES)
            .map(|axis| (joints[axis] - before[axis]).abs() / CYCLE_S / rated[axis])
            .fold(0.0, f64::max);
        let ways = interpolator.path().corner_ways();
        section.samples.push(Sample { joints, motions: [current, next], ways });
        section.duration += CYCLE_S;
        let is_rest = speed < REST && section.samples.len() > 10;
        if is_rest || step.ended.is_some() {
            section.duration -= step.ended.unwrap_or(CYCLE_S / 2.0);
            sections.push(core::mem::replace(
                &mut section,
                Section { duration: 0.0, samples: vec![rest(&joints)] },
            ));
        }
        if step.ended.is_some() {
            sections.retain(|section: &Section| section.duration > 2e-3);
            return Some(sections);
        }
    }
}

impl Section {
    /// Points of the path at even steps of the law's time, `steps` of them; see [`fastest`](crate::fastest::fastest).
    pub(crate) fn points(&self, steps: usize, motions: &[Motion], config: &RobotConfig) -> (Vec<Point>, f64) {
        let half = self.duration / (2 * steps) as f64;
        let (turns_from, only_turns) = self.turn(motions, config);
        let points = (0..=2 * steps).map(|index| {
            let joints = self.joints(index as f64 * half);
            let at = ((index as f64 * half / CYCLE_S) as usize + 1).min(self.samples.len() - 1);
            let [one, next] = self.samples[at].motions.map(|motion| &motions[motion]);
            let tool = config.tools[usize::from(one.tool)].unwrap();
            let pose = config.arm.forward(&joints) * tool;
            // A degree counts as a millimetre where the tool only turns.
            let turned = || [(pose.rotation * turns_from.rotation.inverse()).axis_angle().1, 0.0, 0.0];
            let tool = if only_turns { turned() } else { pose.position };
            let ways = self.ways(index as f64 * half);
            Point { joints, tool, ways, bounds: both(bounds(one, config), bounds(next, config)) }
        });
        (points.collect(), half)
    }

    /// Returns where the tool is at the start, and whether it is there at the end as well.
    fn turn(&self, motions: &[Motion], config: &RobotConfig) -> (Frame, bool) {
        let [from, to] = [self.samples[0], self.samples[self.samples.len() - 1]].map(|sample| {
            let tool = config.tools[usize::from(motions[sample.motions[0]].tool)].unwrap();
            (config.arm.forward(&sample.joints) * tool, sample.motions)
        });
        let only_turns = motions.len() == 1 && distance(from.0.position, to.0.position) < 1e-3;
        (from.0, only_turns && motions[0].kind == MotionKind::LinCartesian)
    }

    /// The joints of all samples.
    pub(crate) fn all_joints(&self) -> impl Iterator<Item = Joints> {
        self.samples.iter().map(|sample| sample.joints)
    }

    /// The joints at a time.
    fn joints(&self, time: f64) -> Joints {
        let (samples, weights) = self.samples_around(time);
        core::array::from_fn(|axis| {
            samples.iter().zip(weights).map(|(sample, weight)| weight * sample.joints[axis]).sum()
        })
    }

    /// The corner that the arm is in at a time, and where on both of its motions it is, as times in s at their programmed
    /// speeds; none where it is not well within a corner.
    fn ways(&self, time: f64) -> Option<(usize, [f64; 2])> {
        let (samples, weights) = self.samples_around(time);
        let mut ways = [0.0; 2];
        for (sample, weight) in samples.iter().zip(weights) {
            if sample.motions != samples[0].motions {
                return None;
            }
            for (sum, (way, programmed)) in ways.iter_mut().zip(sample.ways?) {
                *sum += weight * way / programmed;
            }
        }
        Some((samples[0].motions[0], ways))
    }

    /// The samples around a time, and what each counts in a polynomial of degree five through them.
    fn samples_around(&self, time: f64) -> ([Sample; 6], [f64; 6]) {
        let at = time / CYCLE_S;
        let first = at.floor() - 2.0;
        let share = at - first;
        let samples = core::array::from_fn(|node| {
            let index = (first as isize + node as isize).clamp(0, self.samples.len() as isize - 1);
            self.samples[index as usize]
        });
        let weights = core::array::from_fn(|node| {
            (0..6)
                .filter(|other| *other != node)
                .map(|other| (share - other as f64) / (node as f64 - other as f64))
                .product()
        });
        (samples, weights)
    }
}

/// What both limits allow in a corner, where the speed passes from that of one motion to that of the other.
fn both(one: Bounds, other: Bounds) -> Bounds {
    let of = |order: usize, one: f64, other: f64| if order == 0 { one.max(other) } else { one.min(other) };
    let joints = |order: usize| {
        let (one, other) = (&one.joints[order], &other.joints[order]);
        core::array::from_fn(|axis| of(order, one[axis], other[axis]))
    };
    Bounds {
        joints: core::array::from_fn(joints),
        tool: core::array::from_fn(|order| of(order, one.tool[order], other.tool[order])),
    }
}

/// Returns the time of a motion from rest in the robot's own cycle, in s.
pub(crate) fn seconds(motion: &Motion, from: &Joints, config: &RobotConfig) -> f64 {
    let cycle_s = config.cycle.as_secs_f64();
    let mut interpolator = Interpolator::at_rest(config.arm.clone(), *from, cycle_s);
    let segment = interpolator.path().prepare(motion, config).unwrap();
    interpolator.append(segment, true);
    let mut seconds = 0.0;
    loop {
        let step = interpolator.drive(1.0).unwrap();
        seconds += cycle_s;
        if let Some(left) = step.ended {
            return seconds - left;
        }
    }
}
