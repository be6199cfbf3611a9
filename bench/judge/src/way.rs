//! The programmed way of one motion: its ends, and the line or circle of the tool.

use crate::case::{Kind, Programmed};
use crate::kinematics::{Joints, Links, Pose, Vector, cross, difference, distance, dot, length};

/// Nearer than this to a line through start and target, in mm, the intermediate point tells no plane of a circle.
const LEAST_OFFSET_MM: f64 = 1e-3;

/// The way of one motion.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    pub(crate) kind: Kind,
    /// The tool in the flange.
    pub(crate) tool: Pose,
    /// The root in the base.
    pub(crate) root_in_base: Pose,
    /// The tool in the root at the start.
    start: Pose,
    /// The tool in the root at the end.
    pub(crate) target: Pose,
    /// The flange in the root at the end.
    pub(crate) end: Pose,
    /// The intermediate point of a circle, in the root.
    through: Vector,
    shape: Shape,
    /// How the tool turns from start to target: a rotation vector, in degrees.
    turn: Vector,
    /// The programmed approximation distance, in mm.
    pub(crate) approximation_mm: f64,
    /// How far from its target it may leave the way for the next motion, in mm.
    pub(crate) zone_mm: f64,
    /// In mm/s; point to point a share of the rated speeds.
    pub(crate) velocity: f64,
    /// In mm/s²; point to point a share of the rated accelerations.
    pub(crate) acceleration: f64,
    /// The same for slowing down.
    pub(crate) deceleration: f64,
    /// In mm/s³, point to point a share of the rated jerks; none where it is not programmed.
    pub(crate) jerk: Option<f64>,
    /// The force to be reached, in N.
    pub(crate) force_n: f64,
}

/// What is known of the tool's course.
#[derive(Clone, Copy, Debug)]
enum Shape {
    Line {
        along: Vector,
    },
    Circle {
        centre: Vector,
        outward: Vector,
        forward: Vector,
        radius: f64,
        opening: f64,
    },
    /// Nothing but both ends.
    Free,
}

impl Shape {
    fn between(kind: Kind, start: Vector, through: Vector, target: Vector) -> Self {
        match kind {
            _ if !target.iter().all(|part| part.is_finite()) => Self::Free,
            Kind::Lin | Kind::LinForce => Self::Line { along: difference(start, target) },
            Kind::Circ => circle(start, through, target),
            Kind::Ptp | Kind::PtpJoint | Kind::Spline => Self::Free,
        }
    }
}

/// Where the tool is beside its way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Off {
    /// How far it is off, in mm.
    pub(crate) mm: f64,
    /// How far it is turned otherwise than there, in degrees.
    pub(crate) turned_deg: f64,
}

impl Way {
    /// Of a motion that starts with the flange at `flange`. Tools are in the flange, bases in the root; a number that
    /// they lack is the flange or the root itself: the robot refuses the motion.
    pub(crate) fn new(
        motion: &Programmed,
        flange: &Pose,
        links: &Links,
        tools: &[Pose; 16],
        bases: &[Pose; 16],
    ) -> Self {
        let tool = tools[usize::from(motion.tool & 15)];
        let base = bases[usize::from(motion.base & 15)];
        let start = flange.then(&tool);
        let coordinates = motion.target.map(f64::from);
        let (target, end) = if motion.kind == Kind::PtpJoint {
            let end = links.flange(&joints_of(&coordinates, links.axes()));
            (end.then(&tool), end)
        } else {
            let target = base.then(&Pose::from_mm_deg(coordinates));
            (target, target.then(&tool.inverse()))
        };
        let through = base.point(motion.auxiliary.map(f64::from));
        let per_unit = if motion.kind.is_point_to_point() { [1e-4, 1e-4, 1e-4] } else { [0.1, 1.0, 10.0] };
        let deceleration = if motion.deceleration == 0 { motion.acceleration } else { motion.deceleration };
        let is_force = motion.kind.has_force();
        Self {
            kind: motion.kind,
            tool,
            root_in_base: base.inverse(),
            start,
            target,
            end,
            through,
            shape: Shape::between(motion.kind, start.at, through, target.at),
            turn: start.turn_to(&target),
            approximation_mm: f64::from(motion.approximation) / 100.0,
            zone_mm: 0.0,
            velocity: f64::from(motion.velocity) * per_unit[0],
            acceleration: f64::from(motion.acceleration) * per_unit[1],
            deceleration: f64::from(deceleration) * per_unit[1],
            jerk: (motion.jerk > 0).then(|| f64::from(motion.jerk) * per_unit[2]),
            force_n: if is_force { length(motion.auxiliary.map(f64::from)) } else { 0.0 },
        }
    }

    /// The motion starts with the flange elsewhere.
    pub(crate) fn start_at(&mut self, flange: &Pose) {
        self.start = flange.then(&self.tool);
        self.turn = self.start.turn_to(&self.target);
        self.shape = Shape::between(self.kind, self.start.at, self.through, self.target.at);
    }

    /// How far the middle of the way is from its start and from its target at most, in mm, where the course is known.
    pub(crate) fn half_mm(&self) -> f64 {
        match self.shape {
            Shape::Line { along } => length(along) / 2.0,
            Shape::Circle { radius, opening, .. } => 2.0 * radius * libm::sin(opening / 4.0),
            Shape::Free => f64::INFINITY,
        }
    }

    /// How far the tool is off its way; none where its course is not known.
    pub(crate) fn off(&self, tool: &Pose) -> Option<Off> {
        let (mm, share) = match self.shape {
            Shape::Free => return None,
            Shape::Line { along } => {
                let square = dot(along, along);
                let share = (dot(difference(self.start.at, tool.at), along) / square).clamp(0.0, 1.0);
                let share_of_way = if square > 0.0 { share } else { 1.0 };
                let foot: Vector = core::array::from_fn(|i| self.start.at[i] + share_of_way * along[i]);
                // For a pure rotation the position does not give the progress.
                let share = if square > 1e-6 { share } else { f64::NAN };
                (distance(foot, tool.at), share)
            }
            Shape::Circle { centre, outward, forward, radius, opening } => {
                let from_centre = difference(centre, tool.at);
                let (out, ahead) = (dot(from_centre, outward), dot(from_centre, forward));
                let turned = libm::atan2(ahead, out).rem_euclid(core::f64::consts::TAU);
                // What is missing to a full turn lies before the start or after the end, whichever is nearer.
                let rest = core::f64::consts::TAU - opening;
                let angle = if turned <= opening {
                    turned
                } else if turned - opening < rest / 2.0 {
                    opening
                } else {
                    0.0
                };
                let (sin, cos) = libm::sincos(angle);
                let foot =
                    core::array::from_fn(|i| centre[i] + radius * (cos * outward[i] + sin * forward[i]));
                (distance(foot, tool.at), angle / opening)
            }
        };
        // Half a turn goes either way round.
        let turned_deg = if share.is_nan() || length(self.turn) > 179.9 {
            0.0
        } else {
            self.start.turned_by(self.turn.map(|part| part * share)).angle_to(tool)
        };
        Some(Off { mm, turned_deg })
    }
}

/// The joints of a target; those that the arm lacks are 0.
pub(crate) fn joints_of(target: &[f64; 6], axes: usize) -> Joints {
    core::array::from_fn(|axis| if axis < axes { target[axis] } else { 0.0 })
}

/// The circle through three points: its centre is as far from each of them.
fn circle(start: Vector, through: Vector, target: Vector) -> Shape {
    let (first, second) = (difference(start, through), difference(start, target));
    let normal = cross(first, second);
    let square = dot(normal, normal);
    if square.is_nan() || square.sqrt() < LEAST_OFFSET_MM * length(second) {
        return Shape::Free;
    }
    // From the start: (|f|²·(s × n) + |s|²·(n × f)) / 2|n|² with f, s and their normal n.
    let (one, other) = (cross(second, normal), cross(normal, first));
    let (first_square, second_square) = (dot(first, first), dot(second, second));
    let to_centre: Vector =
        core::array::from_fn(|i| (first_square * one[i] + second_square * other[i]) / (2.0 * square));
    let radius = length(to_centre);
    let centre = core::array::from_fn(|i| start[i] + to_centre[i]);
    let outward = to_centre.map(|part| -part / radius);
    let forward = cross(normal.map(|part| part / square.sqrt()), outward);
    let end = difference(centre, target);
    let opening = libm::atan2(dot(end, forward), dot(end, outward)).rem_euclid(core::f64::consts::TAU);
    Shape::Circle { centre, outward, forward, radius, opening }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_passes_its_three_points_in_order() {
        let (start, through, target) = ([1.0, 2.0, 3.0], [40.0, 30.0, -5.0], [-20.0, 60.0, 8.0]);
        let Shape::Circle { centre, outward, forward, radius, opening } = circle(start, through, target)
        else {
            panic!("three points that are on no line");
        };
        let at = |angle: f64| -> Vector {
            let (sin, cos) = libm::sincos(angle);
            core::array::from_fn(|i| centre[i] + radius * (cos * outward[i] + sin * forward[i]))
        };
        assert!(distance(at(0.0), start) < 1e-9 && distance(at(opening), target) < 1e-9);
        let nearest = (0..=100_000).map(|step| distance(at(opening * f64::from(step) / 1e5), through));
        assert!(nearest.fold(f64::INFINITY, f64::min) < 1e-2);
    }
}
