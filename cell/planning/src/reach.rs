//! Whether the arm of a setup reaches a plan: the start, each target, and every place along each path.
//!
//! Each motion is checked by the code by which the robot node checks it before it runs ([`Segment`]), in the units of the
//! wire and from the joints in which the one before ends. So planning refuses what the robot would refuse, by the same
//! error. Where on a path that is, only planning says, and follows the refused path again.

use arm::motion::{Curve, Programmed, Robot, Segment};
use arm::{Arm, Frame, Frames, Installation, Joints, Violation};
use protocol::image::{self, PathForm};
use setup::Setup;

use crate::application::Application;
use crate::motion::Motion;
use crate::out_of_reach::{OutOfReach, motion_in_words};
use crate::plan::Plan;
use crate::source::Source;
use crate::stopped::{Course, Stopped, Unfit};

/// Length in mm of the steps in which a refused path is followed, and the least and the most of them.
const STEP_MM: f64 = 1.0;
const STEPS: [f64; 2] = [64.0, 2_000.0];

/// How far joints may take the tool from their frame, in mm and in degrees: files round both.
const SAME_PLACE: [f64; 2] = [1.0, 1.0];

/// How often a step is halved to find where the arm cannot follow.
const HALVINGS: u32 = 10;

/// Where the arm stands in a plan that it reaches.
#[derive(Clone, Debug)]
pub struct Reached {
    /// Number of the arm's joints.
    pub axes: usize,
    /// Joints at the start of the application, in degrees (mm).
    pub start: Joints,
    /// Joints at the end of each motion, in degrees (mm).
    pub targets: Vec<Joints>,
    /// Joints at the end of each motion that leads from there to the start, in degrees (mm).
    pub back: Vec<Joints>,
    /// Where the arm stops although the plan passes.
    pub stopped: Vec<Stopped>,
}

impl Plan {
    /// Follows the plan of an application with the arm of a setup.
    ///
    /// # Errors
    ///
    /// The first motion that the robot would refuse, and where on it.
    pub fn reach(&self, application: &Application, setup: &Setup) -> Result<Reached, OutOfReach> {
        let installation = Installation::from_setup(setup).map_err(OutOfReach::Arm)?;
        let walk = Walk::new(application, setup, &installation);
        let start = walk.start(self)?;
        let mut here = start;
        let (mut targets, mut stopped) = (Vec::with_capacity(self.motions.len()), Vec::new());
        for continuous in &self.continuous {
            let mut course = Course::new(f64::from(setup.robot.cycle_us.value) / 1e6);
            for index in continuous.motions.clone() {
                let Some(motion) = self.motions.get(index) else { continue };
                let from = here;
                let wire = motion.wire(setup);
                let (alone, on_path) = walk.motion((index + 1, motion), &wire, course.last(), &from)?;
                // A LIN force begins and ends at rest.
                let stands = motion.kind.has_force();
                let ends = stands || wire.approximation == 0 || index + 1 == continuous.motions.end;
                course.append((on_path, from), [stands, ends], walk.arm(), |back, unfit| {
                    stopped.extend(self.stop(index - back, unfit));
                });
                here = alone;
                targets.push(here);
            }
        }
        let mut back = Vec::with_capacity(self.to_start.from_end.len());
        for motion in &self.to_start.from_end {
            (here, _) = walk.motion((0, motion), &motion.wire(setup), None, &here)?;
            back.push(here);
        }
        Ok(Reached { axes: installation.arm.axes(), start, targets, back, stopped })
    }

    /// Returns the stop after motion `index` and what does not fit there.
    fn stop(&self, index: usize, unfit: Unfit) -> Option<Stopped> {
        let (one, other) = (self.motions.get(index)?, self.motions.get(index + 1)?);
        let names = [&one.name, &other.name].map(String::clone);
        Some(Stopped { number: index + 1, names, zone_mm: one.zone_mm, unfit })
    }
}

/// Returns the robot of a setup in its cell, with the limits of its paths.
pub(crate) fn robot_of<'a>(setup: &Setup, installation: &'a Installation) -> Robot<'a> {
    let Installation { arm, tools, bases, .. } = installation;
    let robot = &setup.robot;
    let most = Programmed {
        speed: robot.path_velocity_mm_s.value,
        acceleration: robot.path_acceleration_mm_s2.value,
        deceleration: robot.path_acceleration_mm_s2.value,
        jerk: robot.path_jerk_mm_s3.value,
    };
    Robot { arm, tools, bases, most, presses: robot.force.is_some() }
}

/// The state of following a plan with an arm.
struct Walk<'a> {
    application: &'a Application,
    setup: &'a Setup,
    installation: &'a Installation,
    robot: Robot<'a>,
}

impl<'a> Walk<'a> {
    fn new(application: &'a Application, setup: &'a Setup, installation: &'a Installation) -> Self {
        let robot = robot_of(setup, installation);
        Self { application, setup, installation, robot }
    }

    fn source(&self, motion: &Motion) -> Option<Box<Source>> {
        Source::of(motion, self.application).map(Box::new)
    }

    const fn arm(&self) -> &'a Arm {
        self.robot.arm
    }

    /// Returns the joints at the start: as near as possible to home, if the setup has a home.
    fn start(&self, plan: &Plan) -> Result<Joints, OutOfReach> {
        let near = self.installation.home_or_middle();
        let Some(start) = &plan.to_start.from_anywhere else { return Ok(near) };
        let wire = start.wire(self.setup);
        let is_open =
            self.installation.home.is_none() && start.joints_deg.is_none() && start.configuration.is_none();
        let near = if is_open { self.stand_at(&wire) } else { Ok(near) };
        let found = near.and_then(|near| Segment::prepare(&wire, &near, self.robot));
        let found = found.map(|segment| segment.end);
        let joints = found.map_err(|violation| OutOfReach::Start {
            violation,
            source: self.source(start),
            base: start.base,
        })?;
        self.agrees("the start", start, &wire, &joints)?;
        Ok(joints)
    }

    /// Refuses joints of a frame that do not take the tool there.
    fn agrees(
        &self,
        what: &str,
        motion: &Motion,
        wire: &image::Motion,
        joints: &Joints,
    ) -> Result<(), OutOfReach> {
        let Some((tool, base)) = motion.joints_deg.and_then(|_| self.frames(wire).ok()) else {
            return Ok(());
        };
        let is = base.inverse() * self.arm().forward(joints) * tool;
        let wanted = Frame::from_mm_deg(motion.target.mm_deg());
        let off = wanted.offset_to(&is);
        if off[0] <= SAME_PLACE[0] && off[1] <= SAME_PLACE[1] {
            return Ok(());
        }
        Err(OutOfReach::Joints { what: what.to_owned(), is: is.to_mm_deg(), off })
    }

    /// Returns the joints in which the arm stands best at the target of a motion.
    fn stand_at(&self, motion: &image::Motion) -> Result<Joints, Violation> {
        let (tool, base) = self.frames(motion)?;
        self.arm().stand_at(&(base * Frame::from_mm_deg(motion.target.map(f64::from)) * tool.inverse()))
    }

    /// Returns the tool of a motion, in the flange, and its base, in the root.
    fn frames(&self, motion: &image::Motion) -> Result<(Frame, Frame), Violation> {
        let tool = frame_of(self.robot.tools, motion.tool).ok_or(Violation::Tool(motion.tool))?;
        let base = frame_of(self.robot.bases, motion.base).ok_or(Violation::Base(motion.base))?;
        Ok((tool, base))
    }

    /// Follows a motion from these joints. Returns the joints at its end, and the motion as the robot drives it after the
    /// one before in a path.
    fn motion(
        &self,
        (number, motion): (usize, &Motion),
        wire: &image::Motion,
        before: Option<&Segment>,
        from: &Joints,
    ) -> Result<(Joints, Segment), OutOfReach> {
        let refused = |violation| self.refused(number, motion, wire, from, violation);
        // The robot checks each motion as a skill of its own, before it takes it into a path.
        let alone = Segment::prepare(wire, from, self.robot).map_err(refused)?;
        let end = alone.end;
        self.agrees(&motion_in_words(number, &motion.name), motion, wire, &end)?;
        let is_bent = wire.kind.path() == Some(PathForm::Spline) && before.is_some();
        let on_path = if is_bent {
            Segment::prepare_after(before, wire, from, self.robot).map_err(refused)?
        } else {
            alone
        };
        Ok((end, on_path))
    }

    /// Returns the error of a motion that the robot would refuse, with the place on its path.
    fn refused(
        &self,
        number: usize,
        motion: &Motion,
        wire: &image::Motion,
        from: &Joints,
        violation: Violation,
    ) -> OutOfReach {
        let curve = Segment::curve_of(wire, from, self.robot).ok().flatten();
        let found = curve.map(|curve| self.place(&curve, from, violation));
        let (violation, share) = found.unwrap_or((violation, None));
        let way_mm = share.map(|share| (share * motion.length_mm, motion.length_mm));
        let (name, source) = (motion.name.clone(), self.source(motion));
        OutOfReach::Motion { number, name, way_mm, violation, source, base: motion.base }
    }

    /// Returns the share of a curve that the arm can follow before this violation, if it is one of a place. Of a violation
    /// that something is missing, returns the one of which most is missing: where the path leaves the arm's reach
    /// nothing is missing yet.
    fn place(&self, curve: &Curve, from: &Joints, violation: Violation) -> (Violation, Option<f64>) {
        let length = curve.length();
        match violation {
            Violation::Configuration { way, .. } => return (violation, Some(way / length)),
            Violation::Singular { .. } => {}
            Violation::TurnTooFast { .. } => return (violation, Some(0.0)),
            _ if violation.missing().is_none() && !matches!(violation, Violation::Tilt { .. }) => {
                return (violation, None);
            }
            _ => {}
        }
        let steps = (length / STEP_MM).ceil().clamp(STEPS[0], STEPS[1]);
        let (mut here, mut near, mut steepest) = (0.0, *from, (0.0, 0.0));
        for step in 1..=steps as u32 {
            let next = f64::from(step) / steps;
            match curve.joints(next * length, self.arm(), &near) {
                Ok(joints) => {
                    let turning: Joints = core::array::from_fn(|axis| (joints[axis] - near[axis]) * steps);
                    let load = self.arm().limits().speed_load(&turning).share;
                    if load > steepest.1 {
                        steepest = (f64::midpoint(here, next), load);
                    }
                    (here, near) = (next, joints);
                }
                Err(first) if first.number() == violation.number() => {
                    let share = self.last_followed(curve, (here, near), next);
                    return (self.worst(curve, share, first, &near), Some(share));
                }
                Err(_) => break,
            }
        }
        // A singular position is where the joints turn most; what lies between two steps is beside the last one.
        let share = if matches!(violation, Violation::Singular { .. }) { steepest.0 } else { here };
        (violation, Some(share))
    }

    /// Returns the share of a curve up to which the arm can follow it, between one that it can and one that it cannot.
    fn last_followed(&self, curve: &Curve, (mut can, mut near): (f64, Joints), mut cannot: f64) -> f64 {
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(can, cannot);
            match curve.joints(middle * curve.length(), self.arm(), &near) {
                Ok(joints) => (can, near) = (middle, joints),
                Err(_) => cannot = middle,
            }
        }
        can
    }

    /// Returns the violation of this kind of which most is missing on the rest of the curve.
    fn worst(&self, curve: &Curve, from: f64, first: Violation, near: &Joints) -> Violation {
        let missing = |violation: &Violation| violation.missing().map_or(f64::NEG_INFINITY, |it| it.0);
        let rest = (1..=100_u32).map(|step| from + (1.0 - from) * f64::from(step) / 100.0);
        let follow = |share: f64| curve.joints(share * curve.length(), self.arm(), near);
        let alike = rest.filter_map(|share| follow(share).err()).filter(|it| it.number() == first.number());
        alike.fold(first, |worst, next| if missing(&next) > missing(&worst) { next } else { worst })
    }
}

/// Returns the tool or base of a number, if the setup has it.
pub(crate) fn frame_of(frames: &Frames, number: u8) -> Option<Frame> {
    frames.get(usize::from(number)).copied().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::motion::Role;
    use protocol::image::MotionKind;

    #[test]
    fn a_line_right_beside_axis_1_that_would_turn_the_arm_at_once_is_refused_where_it_would() {
        let mut setup = setup::setup("B").unwrap();
        (setup.robot.axes.lower_deg.value[4], setup.robot.axes.upper_deg.value[4]) = (-180.0, 180.0);
        let installation = Installation::from_setup(&setup).unwrap();
        let text = include_str!("../../applications/pick-and-place.toml");
        let application = Application::parse("pick-and-place", text).unwrap();
        let walk = Walk::new(&application, &setup, &installation);
        let [start, target] = [150.0, -150.0].map(|x| Pose::new([x, 0.05, 500.0, 0.0, 0.0, 180.0]));
        let ptp = Motion::straight(Role::Way, MotionKind::PtpCartesian, start, start);
        let line = Motion::straight(Role::Path, MotionKind::LinCartesian, start, target);
        let near = [0.0, 10.0, 10.0, 0.0, 60.0, 0.0];
        let from = walk.motion((1, &ptp), &ptp.wire(&setup), None, &near).unwrap().0;
        let line = Motion { name: "LIN".to_owned(), ..line };
        let refused = walk.motion((2, &line), &line.wire(&setup), None, &from).unwrap_err();
        insta::assert_snapshot!(refused, @"motion 2 `LIN`, after 149.5 of its 300.0 mm: the path passes a singular position: joint 1 would limit it to 0.0075 of the programmed velocity; change its frame");
    }
}
