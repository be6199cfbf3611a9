//! Whether the arm of a setup reaches a plan: the start, each target, and every place along each path.
//!
//! The arm is followed from its start through all motions, as the robot node does it before it moves: point to point to
//! each target, along a path by steps that are halved wherever a joint turns far. The corners that replace the ends of
//! blended motions are not checked here: they lie within the zones, and the robot node checks them.

use arm::{Arm, Frame, Installation, Joints, Rotation, SINGULAR_SHARE, TURNED_OVER_DEG, Violation};
use setup::Setup;

use crate::error::OutOfReach;
use crate::geometry::{Point, Pose};
use crate::motion::Motion;
use crate::plan::Plan;

/// Length of a step along a path, in mm, and turn of the tool in one, in degrees.
const STEP_MM: f64 = 5.0;
const STEP_DEG: f64 = 2.0;

/// Turn of a joint in degrees above which a step is halved.
const HALVED_DEG: f64 = 10.0;

/// Largest number of times that a step is halved.
const HALVINGS: u32 = 10;

/// How near to a singular position a step is halved, as a share of what is refused, and how often.
const NEARLY_SINGULAR: f64 = 0.5;
const HALVINGS_NEARLY_SINGULAR: u32 = 6;

/// Where the arm stands in a plan that it reaches.
#[derive(Clone, Debug)]
pub struct Reached {
    /// Number of the arm's joints.
    pub axes: usize,
    /// Joints at the start of the application, in degrees (mm).
    pub start: Joints,
    /// Joints at the end of each motion, in degrees (mm).
    pub targets: Vec<Joints>,
}

impl Plan {
    /// Follows the plan with the arm of a setup.
    ///
    /// # Errors
    ///
    /// The first motion that the arm cannot follow, and where on it.
    pub fn reach(&self, setup: &Setup) -> Result<Reached, OutOfReach> {
        let installation = Installation::from_setup(setup).map_err(OutOfReach::Arm)?;
        let walk = Walk { setup, installation: &installation };
        let start = walk.start(self)?;
        let mut here = start;
        let mut targets = Vec::with_capacity(self.motions.len());
        for (index, motion) in self.motions.iter().enumerate() {
            here = walk.motion(index + 1, motion, &here)?;
            targets.push(here);
        }
        self.to_start.from_end.iter().try_fold(here, |here, motion| walk.motion(0, motion, &here))?;
        Ok(Reached { axes: installation.arm.axes(), start, targets })
    }
}

/// The state of following a plan with an arm.
struct Walk<'a> {
    setup: &'a Setup,
    installation: &'a Installation,
}

impl Walk<'_> {
    const fn arm(&self) -> &Arm {
        &self.installation.arm
    }

    /// Returns the joints at the start: as near as possible to home, if the setup has a home.
    fn start(&self, plan: &Plan) -> Result<Joints, OutOfReach> {
        let Some(start) = &plan.to_start.from_anywhere else {
            return Ok(self.installation.home_or_middle());
        };
        let open =
            self.installation.home.is_none() && start.joints_deg.is_none() && start.configuration.is_none();
        let near = self.installation.home_or_middle();
        let found = if open {
            self.flange(start, start.target).and_then(|flange| self.arm().stand_at(&flange))
        } else {
            self.target(start, &near)
        };
        found.map_err(|violation| OutOfReach::Start { violation, base: start.base })
    }

    /// Follows a motion from these joints; returns the joints at its end.
    fn motion(&self, number: usize, motion: &Motion, from: &Joints) -> Result<Joints, OutOfReach> {
        let refused = |(violation, way_mm)| OutOfReach::Motion {
            number,
            name: motion.name.clone(),
            way_mm,
            violation,
            base: motion.base,
        };
        if motion.kind.is_point_to_point() {
            return self.target(motion, from).map_err(|violation| refused((violation, None)));
        }
        if motion.spline_neighbours.iter().any(Option::is_some) {
            // As a single skill, a piece of a spline is straight.
            self.path(motion, &[motion.start.point, motion.target.point], from).map_err(refused)?;
        }
        self.path(motion, &motion.course(), from).map_err(refused)
    }

    /// Returns the joints at the target of a point-to-point motion.
    fn target(&self, motion: &Motion, near: &Joints) -> Result<Joints, Violation> {
        let arm = self.arm();
        if let Some(joints) = motion.joints_deg {
            let axes = arm.axes();
            let joints =
                std::array::from_fn(|axis| joints.get(axis).copied().filter(|_| axis < axes).unwrap_or(0.0));
            arm.within_range(&joints)?;
            return Ok(joints);
        }
        let flange = self.flange(motion, motion.target)?;
        match motion.configuration {
            Some(configuration) => arm.inverse_in(&flange, configuration, near),
            None => arm.inverse(&flange, near),
        }
    }

    /// Follows a path through these points; returns the joints at its end, or the reason why not and the length in mm
    /// that was followed.
    fn path(
        &self,
        motion: &Motion,
        points: &[Point],
        from: &Joints,
    ) -> Result<Joints, (Violation, Option<(f64, f64)>)> {
        let track = Track::new(points, motion);
        let speed = motion.speed_mm_s.unwrap_or(f64::INFINITY).min(self.programmed_mm_s(motion));
        let steps = (track.length_mm / STEP_MM).max(motion.turn_deg / STEP_DEG).ceil().clamp(2.0, 10_000.0);
        let mut here = (0.0, *from);
        for step in 1..=steps as u32 {
            let to = f64::from(step) / steps;
            here = self.step(motion, &track, here, to, speed, HALVINGS).map_err(|(violation, share)| {
                let worst = self.worst(motion, &track, share, violation, &here.1);
                (worst, Some((share * track.length_mm, track.length_mm)))
            })?;
        }
        match motion.configuration {
            Some(configuration) => {
                self.arm().ends_in(&here.1, configuration).map_err(|violation| (violation, None))?;
                Ok(here.1)
            }
            None => Ok(here.1),
        }
    }

    /// Follows a path up to the share `to`.
    fn step(
        &self,
        motion: &Motion,
        track: &Track,
        (from, joints): (f64, Joints),
        to: f64,
        speed_mm_s: f64,
        halvings: u32,
    ) -> Result<(f64, Joints), (Violation, f64)> {
        let arm = self.arm();
        let next = self.flange(motion, track.tool(to)).and_then(|flange| arm.follow(&flange, &joints));
        let turn = next.as_ref().map_or((1, f64::INFINITY), |next| arm.largest_turn(&joints, next));
        // If the arm cannot follow within the step, its halves show where.
        let in_halves = || {
            let middle = f64::midpoint(from, to);
            let half = self.step(motion, track, (from, joints), middle, speed_mm_s, halvings - 1)?;
            self.step(motion, track, half, to, speed_mm_s, halvings - 1)
        };
        if turn.1 > HALVED_DEG && halvings > 0 {
            return in_halves();
        }
        let next = next.map_err(|violation| (violation, from))?;
        let (axis, turn_deg) = turn;
        if turn_deg > TURNED_OVER_DEG {
            let (way, length) = (from * track.length_mm, track.length_mm);
            return Err((Violation::Configuration { axis, turn_deg, way, length }, from));
        }
        let way_mm = (to - from) * track.length_mm;
        let turning: Joints = std::array::from_fn(|axis| match (next.get(axis), joints.get(axis)) {
            (Some(next), Some(before)) => (next - before) * speed_mm_s / way_mm,
            _ => 0.0,
        });
        let load = arm.limits().speed_load(&turning);
        let singular = if way_mm > 0.0 { load.share * SINGULAR_SHARE } else { 0.0 };
        // Within the step the joint turns faster than on average.
        if singular > NEARLY_SINGULAR && singular <= 1.0 && halvings > HALVINGS - HALVINGS_NEARLY_SINGULAR {
            return in_halves();
        }
        if singular > 1.0 {
            return Err((Violation::Singular { axis: load.axis, share: 1.0 / load.share }, from));
        }
        Ok((to, next))
    }

    /// Returns the violation of this kind of which most is missing on the rest of the path: at the place where the path
    /// leaves the arm's reach nothing is missing yet.
    fn worst(&self, motion: &Motion, track: &Track, from: f64, first: Violation, near: &Joints) -> Violation {
        let missing = |violation: &Violation| violation.missing().map_or(f64::NEG_INFINITY, |it| it.0);
        let rest = (1..=100_u32).map(|step| from + (1.0 - from) * f64::from(step) / 100.0);
        let follow =
            |share| self.flange(motion, track.tool(share)).and_then(|it| self.arm().inverse(&it, near));
        let alike = rest.filter_map(|share| follow(share).err()).filter(|it| it.number() == first.number());
        alike.fold(first, |worst, next| if missing(&next) > missing(&worst) { next } else { worst })
    }

    fn programmed_mm_s(&self, motion: &Motion) -> f64 {
        let share = self.setup.motions.velocity_percent.value / 100.0 * motion.speed_percent / 100.0;
        share * self.setup.robot.path_velocity_mm_s.value
    }

    /// Returns the pose of the flange while the tool of a motion is at this pose in its base.
    fn flange(&self, motion: &Motion, tool: Pose) -> Result<Frame, Violation> {
        let frame = |frames: &arm::Frames, number: u8| frames.get(usize::from(number)).copied().flatten();
        let Installation { tools, bases, .. } = self.installation;
        let in_flange = frame(tools, motion.tool).ok_or(Violation::Tool(motion.tool))?;
        let base = frame(bases, motion.base).ok_or(Violation::Base(motion.base))?;
        Ok(base * Frame::from_mm_deg(tool.mm_deg()) * in_flange.inverse())
    }
}

/// A path of the tool as points, and how the tool turns along it: evenly, about one axis.
struct Track {
    /// Points, each with the way up to it in mm.
    points: Vec<(f64, Point)>,
    length_mm: f64,
    from: Rotation,
    axis: [f64; 3],
    angle_deg: f64,
}

impl Track {
    fn new(points: &[Point], motion: &Motion) -> Self {
        let mut length_mm = 0.0;
        let mut before = None;
        let points = points.iter().map(|point| {
            length_mm += before.map_or(0.0, |before: Point| (*point - before).length());
            before = Some(*point);
            (length_mm, *point)
        });
        let points = points.collect();
        let [from, to] = [motion.start, motion.target].map(|pose| Frame::from_mm_deg(pose.mm_deg()).rotation);
        let (axis, angle_deg) = (from.inverse() * to).axis_angle();
        Self { points, length_mm, from, axis, angle_deg }
    }

    /// Returns the pose of the tool at a share of the path.
    fn tool(&self, share: f64) -> Pose {
        let way = share * self.length_mm;
        let next = self.points.partition_point(|(at, _)| *at < way).max(1);
        let point = match (self.points.get(next - 1), self.points.get(next)) {
            (Some((from, one)), Some((to, other))) if to > from => {
                one.toward(*other, (way - from) / (to - from))
            }
            (Some((_, point)), _) => *point,
            _ => Point::default(),
        };
        let rotation = self.from * Rotation::about(self.axis, share * self.angle_deg);
        let ([x, y, z], [a, b, c]) = (point.coordinates(), rotation.angles());
        Pose::new([x, y, z, a, b, c])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Role;
    use protocol::image::MotionKind;

    #[test]
    fn a_line_right_beside_axis_1_that_would_turn_the_arm_at_once_is_refused_where_it_would() {
        let mut setup = setup::setup("B").unwrap();
        (setup.robot.axes.lower_deg.value[4], setup.robot.axes.upper_deg.value[4]) = (-180.0, 180.0);
        let installation = Installation::from_setup(&setup).unwrap();
        let walk = Walk { setup: &setup, installation: &installation };
        let [start, target] = [150.0, -150.0].map(|x| Pose::new([x, 0.05, 500.0, 0.0, 0.0, 180.0]));
        let ptp = Motion::straight(Role::Way, MotionKind::PtpCartesian, start, start);
        let line = Motion::straight(Role::Path, MotionKind::LinCartesian, start, target);
        let near = [0.0, 10.0, 10.0, 0.0, 60.0, 0.0];
        let from = walk.motion(1, &ptp, &near).unwrap();
        let refused = walk.motion(2, &Motion { name: "LIN".to_owned(), ..line }, &from).unwrap_err();
        insta::assert_snapshot!(refused, @"motion 2 `LIN`, after 149.9 of its 300.0 mm: the path passes a singular position: joint 1 would limit it to 0.0077 of the programmed velocity; change its frame, or base 0 in the setup");
    }
}
