//! Motions that belong together.

mod points;
mod singular;

use setup::Setup;

use super::arm::{anywhere, within};
use super::dice::Dice;
use crate::case::{Arm, Case, Kind, Programmed, Surface};
use crate::kinematics::{Joints, Links, Pose, Vector, difference, distance, length};
use crate::way::joints_of;

/// The longest that one motion may take at its programmed velocity, in s: slow ones are short ones.
const LONGEST_S: f64 = 1.5;

/// The least share of its acceleration, or of the highest jerk, that a motion may have for slowing down, or as its jerk.
const SOFTEST: f64 = 0.1;

/// Walks from target to target, and knows where the arm would be.
#[derive(Debug)]
pub(super) struct Walk<'a> {
    arm: &'a Arm,
    frames: [[Pose; 3]; 2],
    /// The stiffest surface that the robot presses on, in N/mm.
    stiffest: Option<f64>,
    path: [f64; 2],
    joints: Joints,
    flange: Pose,
    tool: u8,
    base: u8,
    has_surface: bool,
    surface: Option<Surface>,
}

/// Kinds of phrases.
#[derive(Clone, Copy, Debug)]
enum Phrase {
    Point,
    Line,
    Shift,
    Circle,
    Chain,
    Spline,
    Wrist,
    Turn,
    PastShoulder,
    PastWrist,
    Force,
}

impl<'a> Walk<'a> {
    /// A walk from where the case's last motion ends. It does not matter where the arm really is: a target is a target.
    pub(super) fn new(case: &'a Case, setup: &'a Setup) -> Self {
        let numbered = |frames: &[crate::case::Frame]| {
            let mut poses = [Pose::IDENTITY; 3];
            for frame in frames {
                if let Some(pose) = poses.get_mut(usize::from(frame.number)) {
                    *pose = Pose::from_mm_deg(frame.mm_deg);
                }
            }
            poses
        };
        let joints = case.arm.home();
        let robot = &setup.robot;
        Self {
            arm: &case.arm,
            frames: [numbered(&case.tools), numbered(&case.bases)],
            stiffest: robot.force.as_ref().map(|force| force.stiffest_n_per_mm.value),
            path: [robot.path_velocity_mm_s.value, robot.path_acceleration_mm_s2.value],
            joints,
            flange: case.arm.links.flange(&joints),
            tool: 0,
            base: 0,
            has_surface: !case.surfaces.is_empty(),
            surface: None,
        }
    }

    /// The surface that a LIN force of this walk presses on.
    pub(super) const fn surface(self) -> Option<Surface> {
        self.surface
    }

    /// Some motions more, up to `count` in all.
    pub(super) fn phrase(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>, count: usize) {
        if motions.is_empty() || dice.chance(0.2) {
            let frame = |dice: &mut Dice| dice.pick(&[(0_u8, 2), (1, 1), (2, 1)]).unwrap_or(0);
            (self.tool, self.base) = (frame(dice), frame(dice));
        }
        let drawn = dice.pick(&[
            (Phrase::Point, 20),
            (Phrase::Line, 24),
            (Phrase::Shift, 14),
            (Phrase::Circle, 10),
            (Phrase::Chain, 7),
            (Phrase::Spline, 8),
            (Phrase::Wrist, 15),
            (Phrase::Turn, 4),
            (Phrase::PastShoulder, 4),
            (Phrase::PastWrist, 4),
            (Phrase::Force, 2),
        ]);
        let left = count - motions.len();
        match drawn.unwrap_or(Phrase::Line) {
            Phrase::Point => self.point(dice, motions),
            Phrase::Line => self.line(dice, motions, Kind::Lin),
            Phrase::Shift => self.shift(dice, motions),
            Phrase::Circle => self.circle(dice, motions),
            Phrase::Chain => self.chain(dice, motions, left),
            Phrase::Spline => {
                for _ in 0..left.min(2 + dice.below(4)) {
                    self.line(dice, motions, Kind::Spline);
                }
            }
            Phrase::Wrist => self.wrist(dice, motions, left),
            Phrase::Turn => self.turn(dice, motions),
            Phrase::PastShoulder => self.past_shoulder(dice, motions),
            Phrase::PastWrist => self.past_wrist(dice, motions),
            Phrase::Force => self.press(dice, motions),
        }
    }

    /// Point to point: near, far, or with a joint at the end of its range.
    fn point(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>) {
        let mut joints = if dice.chance(0.4) { anywhere(dice, self.arm) } else { self.near(dice, 0.5) };
        if dice.chance(0.1) {
            let axis = dice.below(self.arm.links.axes());
            joints[axis] = self.at_an_end(dice, axis);
        }
        self.go_to(dice, motions, joints);
    }

    /// Point to point to these joints, given as joints or as a place.
    fn go_to(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>, joints: Joints) {
        self.joints = joints;
        let kind = if dice.chance(0.5) { Kind::Ptp } else { Kind::PtpJoint };
        let target = if kind == Kind::PtpJoint {
            joints.map(|joint| joint as f32)
        } else {
            self.target_of(&self.arm.links.flange(&joints))
        };
        let [velocity, acceleration] =
            [dice.scale(0.1, 1.0), dice.scale(0.1, 1.0)].map(|share| (share * 1e4) as u16);
        self.push(dice, motions, Programmed { velocity, acceleration, ..self.motion(kind, target) });
    }

    /// The end of a joint's range, or next to it.
    fn at_an_end(&self, dice: &mut Dice, axis: usize) -> f64 {
        let end = if dice.chance(0.5) { 0.0 } else { 1.0 };
        let off: f64 = if dice.chance(0.5) { 0.0 } else { dice.scale(1e-6, 1e-2) };
        within((end - off).abs(), self.arm, axis)
    }

    /// Joints near to the present ones: each moved by up to `most` of its range, and mostly by much less.
    fn near(&self, dice: &mut Dice, most: f64) -> Joints {
        let scale = dice.scale(2e-3, most);
        let mut joints = self.joints;
        for (axis, joint) in joints.iter_mut().enumerate().take(self.arm.links.axes()) {
            let (lower, upper) = (within(0.01, self.arm, axis), within(0.99, self.arm, axis));
            let moved = *joint + dice.between(-scale, scale) * (upper - lower);
            *joint = moved.clamp(lower, upper);
        }
        // Lines keep the elbow and the wrist as they are, as a rule.
        let (elbow, wrist) = self.configuration();
        for axis in [elbow, wrist].into_iter().flatten() {
            let (now, zero) = (self.joints[axis], self.zero_of(axis));
            if (joints[axis] - zero) * (now - zero) < 0.0 && dice.chance(0.9) {
                joints[axis] = now;
            }
        }
        joints
    }

    /// The joints at which the arm is stretched out, by index.
    const fn configuration(&self) -> (Option<usize>, Option<usize>) {
        match self.arm.links {
            Links::Scara { .. } => (Some(1), None),
            Links::SixAxes { .. } | Links::ThreeParallel { .. } => (Some(2), Some(4)),
        }
    }

    /// Where that is, in degrees.
    fn zero_of(&self, axis: usize) -> f64 {
        match self.arm.links {
            Links::Scara { .. } => 0.0,
            Links::SixAxes { offsets_deg, signs, .. } | Links::ThreeParallel { offsets_deg, signs, .. } => {
                offsets_deg[axis] * f64::from(signs[axis])
            }
        }
    }

    /// A line, or a piece of a spline, to joints nearby.
    fn line(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>, kind: Kind) {
        let joints = self.near(dice, if kind == Kind::Spline { 0.05 } else { 0.2 });
        self.joints = joints;
        let target = self.target_of(&self.arm.links.flange(&joints));
        self.cartesian(dice, motions, kind, target, [0.0; 3]);
    }

    /// A line that does not turn the tool.
    fn shift(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>) {
        let (way, direction) = (dice.scale(0.2, 150.0), dice.direction());
        let mut flange = self.flange;
        for (place, part) in flange.at.iter_mut().zip(direction) {
            *place += way * part;
        }
        let target = self.target_of(&flange);
        self.cartesian(dice, motions, Kind::Lin, target, [0.0; 3]);
    }

    fn circle(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>) {
        let joints = self.near(dice, 0.15);
        let end = self.arm.links.flange(&joints);
        let tool = self.frames[0][usize::from(self.tool)];
        let (from, to) = (self.flange.point(tool.at), end.point(tool.at));
        let offset = distance(from, to) * dice.scale(0.05, 0.8);
        let direction = dice.direction();
        let through: Vector = core::array::from_fn(|i| f64::midpoint(from[i], to[i]) + offset * direction[i]);
        let base = self.frames[1][usize::from(self.base)].inverse();
        self.joints = joints;
        let target = self.target_of(&end);
        self.cartesian(dice, motions, Kind::Circ, target, base.point(through).map(|part| part as f32));
    }

    /// A row of lines along one line, all alike.
    fn chain(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>, left: usize) {
        let links = (3 + dice.below(20)).min(left).max(1);
        self.joints = self.near(dice, 0.15);
        let end = self.arm.links.flange(&self.joints);
        let (start, turn) = (self.flange, self.flange.turn_to(&end));
        let way = difference(start.at, end.at);
        let [velocity, acceleration] = self.pace(dice, length(way));
        let approximation = if dice.chance(0.7) { self.zone(dice) } else { 0 };
        for link in 1..=links {
            let share = link as f64 / links as f64;
            let mut flange = start.turned_by(turn.map(|part| part * share));
            flange.at = core::array::from_fn(|i| start.at[i] + share * way[i]);
            let motion = self.motion(Kind::Lin, self.target_of(&flange));
            self.add(motions, Programmed { velocity, acceleration, approximation, ..motion });
        }
    }

    /// A point-to-point motion that turns the last joint, or the wrist, far, and lines after it.
    fn wrist(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>, left: usize) {
        let mut joints = self.near(dice, 0.1);
        let axes = self.arm.links.axes();
        let last = axes - 1;
        joints[last] = within(dice.share(), self.arm, last);
        if axes == 6 && dice.chance(0.5) {
            joints[3] = within(dice.share(), self.arm, 3);
        }
        self.go_to(dice, motions, joints);
        for _ in 1..left.min(1 + dice.below(4)) {
            self.line(dice, motions, Kind::Lin);
        }
    }

    /// A line into a surface across it; one a case, so that what is felt is known.
    fn press(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>) {
        let Some(stiffest) = self.stiffest.filter(|_| !self.has_surface) else {
            return self.line(dice, motions, Kind::Lin);
        };
        self.has_surface = true;
        let direction = if dice.chance(0.5) { [0.0, 0.0, -1.0] } else { dice.direction() };
        let (way, depth) = (dice.between(3.0, 12.0), dice.between(0.5, 0.95));
        let mut flange = self.flange;
        flange.at = core::array::from_fn(|i| self.flange.at[i] + way * direction[i]);
        let tool = self.frames[0][usize::from(self.tool)];
        let from = self.flange.point(tool.at);
        self.surface = Some(Surface {
            point_mm: core::array::from_fn(|i| from[i] + depth * way * direction[i]),
            normal: direction.map(|part| -part),
            stiffness_n_per_mm: dice.scale(2.0, stiffest),
        });
        let wanted = dice.between(2.0, 40.0);
        let base = self.frames[1][usize::from(self.base)].inverse();
        let auxiliary = base.vector(direction).map(|part| (part * wanted) as f32);
        let motion = Programmed {
            auxiliary,
            velocity: dice.between(30.0, 120.0) as u16,
            acceleration: dice.between(500.0, 5_000.0) as u16,
            ..self.motion(Kind::LinForce, self.target_of(&flange))
        };
        self.add(motions, motion);
    }

    /// A motion of the tool along a path.
    fn cartesian(
        &mut self,
        dice: &mut Dice,
        motions: &mut Vec<Programmed>,
        kind: Kind,
        target: [f32; 6],
        auxiliary: [f32; 3],
    ) {
        let motion = Programmed { auxiliary, ..self.motion(kind, target) };
        let way = distance(self.flange.at, self.flange_of(&motion).at);
        let [velocity, acceleration] = self.pace(dice, way);
        self.push(dice, motions, Programmed { velocity, acceleration, ..motion });
    }

    /// A velocity and an acceleration along a path of this length.
    fn pace(&self, dice: &mut Dice, way_mm: f64) -> [u16; 2] {
        let [fastest, most] = self.path;
        let slowest = (way_mm / LONGEST_S).clamp(10.0, fastest);
        let velocity = dice.scale(slowest, fastest);
        // It is there soon enough with half of its time for speeding up.
        let least = (4.0 * way_mm / (LONGEST_S * LONGEST_S)).clamp(100.0, most);
        [(velocity * 10.0) as u16, dice.scale(least, most) as u16]
    }

    fn zone(&self, dice: &mut Dice) -> u16 {
        (dice.scale(0.01, 400.0) * 100.0) as u16
    }

    fn motion(&self, kind: Kind, target: [f32; 6]) -> Programmed {
        Programmed {
            kind,
            target,
            auxiliary: [0.0; 3],
            velocity: 0,
            acceleration: 0,
            deceleration: 0,
            jerk: 0,
            approximation: 0,
            tool: self.tool,
            base: self.base,
            written_in_cycle: 0,
        }
    }

    fn push(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>, motion: Programmed) {
        let approximation = if dice.chance(0.75) { self.zone(dice) } else { 0 };
        self.add(motions, Programmed { approximation, ..motion });
    }

    fn add(&mut self, motions: &mut Vec<Programmed>, motion: Programmed) {
        self.flange = self.flange_of(&motion);
        motions.push(motion);
    }

    /// A place of the flange as a target, in single precision.
    fn target_of(&self, flange: &Pose) -> [f32; 6] {
        let tool = self.frames[0][usize::from(self.tool)];
        let base = self.frames[1][usize::from(self.base)];
        let [x, y, z, a, b, c] = base.inverse().then(flange).then(&tool).to_mm_deg();
        let (b, c) = if self.arm.links.axes() == 4 { (0.0, 180.0) } else { (b, c) };
        [x, y, z, a, b, c].map(|coordinate| coordinate as f32)
    }

    /// Where a target brings the flange.
    fn flange_of(&self, motion: &Programmed) -> Pose {
        let coordinates = motion.target.map(f64::from);
        if motion.kind == Kind::PtpJoint {
            return self.arm.links.flange(&joints_of(&coordinates, self.arm.links.axes()));
        }
        let tool = self.frames[0][usize::from(motion.tool)];
        let base = self.frames[1][usize::from(motion.base)];
        base.then(&Pose::from_mm_deg(coordinates)).then(&tool.inverse())
    }
}

/// Gives some motions a deceleration and a jerk of their own.
pub(super) fn soften(dice: &mut Dice, motions: &mut [Programmed], setup: &Setup) {
    let robot = &setup.robot;
    for motion in motions.iter_mut().filter(|motion| !motion.kind.has_force()) {
        let is_point_to_point = motion.kind.is_point_to_point();
        let most = if is_point_to_point { 1e4 } else { robot.path_acceleration_mm_s2.value };
        if dice.chance(0.5) {
            let factor = dice.scale(SOFTEST, 1.0 / SOFTEST);
            motion.deceleration = (f64::from(motion.acceleration) * factor).clamp(1.0, most) as u16;
        }
        if dice.chance(0.5) {
            let most = if is_point_to_point { 1e4 } else { robot.path_jerk_mm_s3.value / 10.0 };
            motion.jerk = (most * dice.scale(SOFTEST, 1.0)).min(f64::from(u16::MAX)) as u16;
        }
    }
}

/// Gives all motions the deceleration and the jerk of the first one.
pub(super) fn soften_as_the_first(motions: &mut [Programmed]) {
    let Some((first, others)) = motions.split_first_mut() else { return };
    for motion in others {
        (motion.deceleration, motion.jerk) = (first.deceleration, first.jerk);
    }
}

/// Makes one motion such that it has to be refused.
pub(super) fn spoil(dice: &mut Dice, motions: &mut [Programmed]) {
    let index = dice.below(motions.len().max(1));
    let Some(motion) = motions.get_mut(index) else { return };
    match dice.below(5) {
        0 => motion.velocity = 0,
        1 => motion.acceleration = u16::MAX,
        2 => motion.tool = 9,
        3 => motion.target[0] = f32::INFINITY,
        _ => motion.target[1] += 5_000.0,
    }
}
