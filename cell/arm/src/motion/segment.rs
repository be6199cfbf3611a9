//! From a motion as the PLC wrote it to one that the arm can run: checked, with the limits that hold along it.

use protocol::image::{ErrorNumber, Motion, MotionKind, PathForm};

use super::along::{AXIS_RESERVE, AXIS_SPEED_RESERVE, Followed, TOOL_RESERVE, along};
use super::arc::Arc;
use super::chebyshev::POINT_SHARES;
use super::curve::{AxisLine, Curve, Line};
use super::flange::Flange;
use super::node::{Limits, Node, Ratings};
use super::nodes::Nodes;
use super::spline::Spline;
use crate::{AXES, Arm, Frame, Frames, Joints, LEAST_WAY_MM, Violation, distance};

/// The same as [`AXIS_RESERVE`] point to point, where all places are alike.
const STRAIGHT_RESERVE: f64 = 0.985;

/// The programmed limits of a motion. Along a path in mm and seconds; point to point as shares of the axes' rated
/// speeds, accelerations and jerks, 0…1.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Programmed {
    /// Highest speed, in mm/s.
    pub speed: f64,
    /// Highest acceleration, in mm/s².
    pub acceleration: f64,
    /// Highest deceleration, in mm/s²; the acceleration where none is programmed.
    pub deceleration: f64,
    /// Highest jerk, in mm/s³. Where none is programmed: the robot's path jerk, point to point the acceleration's share.
    pub jerk: f64,
}

impl Programmed {
    /// Reads and checks the programmed limits of a motion.
    fn of(motion: &Motion, robot: &Robot<'_>) -> Result<Self, Violation> {
        let is_point_to_point = motion.kind.is_point_to_point();
        let (given, most) = if is_point_to_point {
            let given = (motion.velocity_share(), motion.acceleration_share());
            (given, Self { speed: 1.0, acceleration: 1.0, deceleration: 1.0, jerk: 1.0 })
        } else {
            ((motion.velocity_mm_s(), motion.acceleration_mm_s2()), robot.most)
        };
        let (deceleration, jerk) = if is_point_to_point {
            (motion.deceleration_share(), motion.jerk_share())
        } else {
            (motion.deceleration_mm_s2(), motion.jerk_mm_s3())
        };
        let speed = within(given.0, most.speed, |value, limit| Violation::Velocity { value, limit })?;
        let acceleration =
            within(given.1, most.acceleration, |value, limit| Violation::Acceleration { value, limit })?;
        Ok(Self {
            speed,
            acceleration,
            deceleration: within(deceleration.unwrap_or(acceleration), most.deceleration, |value, limit| {
                Violation::Deceleration { value, limit }
            })?,
            jerk: match jerk {
                Some(jerk) => within(jerk, most.jerk, |value, limit| Violation::Jerk { value, limit })?,
                None if is_point_to_point => acceleration,
                None => most.jerk,
            },
        })
    }
}

/// What of a robot decides whether it can run a motion.
#[derive(Clone, Copy, Debug)]
pub struct Robot<'a> {
    /// Its arm.
    pub arm: &'a Arm,
    /// Tool frames by number, from the flange.
    pub tools: &'a Frames,
    /// Base frames by number, from the root.
    pub bases: &'a Frames,
    /// The highest speed, acceleration, deceleration and jerk along a path, in mm and seconds.
    pub most: Programmed,
    /// Whether it has a force controller.
    pub presses: bool,
}

/// Largest share of a joint's jerk that the bend between two lines driven as one may take.
const UNNOTICED: f64 = 0.01;

/// The same of the tool's programmed jerk. It is across the path, so that with what the path may use along it the whole stays below the limit.
const ACROSS: f64 = 0.2;

/// One motion, ready to run.
#[derive(Clone, PartialEq, Debug)]
pub struct Segment {
    /// Where it goes.
    pub curve: Curve,
    /// The joints at its end.
    pub end: Joints,
    /// Its programmed limits.
    pub programmed: Programmed,
    /// The limits of joints and tool along it.
    pub ratings: Ratings,
    /// The nodes of the curve.
    pub nodes: Nodes,
    /// Largest parts of the curve that the corners at its start and at its end may replace, in the curve's unit.
    pub zones: [f64; 2],
    /// The approximation distance: how far from its end it may leave its curve, in mm.
    pub approximation_mm: f64,
    /// The tool in the flange.
    pub tool: Frame,
    /// The root in the base, to show where the tool is.
    pub base_inverse: Frame,
}

impl Segment {
    /// Checks a motion that starts at the joints `from`.
    ///
    /// # Errors
    ///
    /// The quantity that is wrong, and its limit.
    pub fn prepare<'a>(
        motion: &Motion,
        from: &Joints,
        robot: impl Into<Robot<'a>>,
    ) -> Result<Self, Violation> {
        Self::prepare_after(None, motion, from, robot)
    }

    /// As [`prepare`](Self::prepare), after a motion with which this one is one curve if both are motions of a spline.
    ///
    /// # Errors
    ///
    /// As [`prepare`](Self::prepare).
    pub fn prepare_after<'a>(
        before: Option<&Self>,
        motion: &Motion,
        from: &Joints,
        robot: impl Into<Robot<'a>>,
    ) -> Result<Self, Violation> {
        Self::prepare_to(motion.target.map(f64::from), before, motion, from, robot)
    }

    /// As [`prepare_after`](Self::prepare_after), to a target in double precision: that of the motion is its rounding.
    ///
    /// # Errors
    ///
    /// As [`prepare`](Self::prepare).
    pub fn prepare_to<'a>(
        target: [f64; 6],
        before: Option<&Self>,
        motion: &Motion,
        from: &Joints,
        robot: impl Into<Robot<'a>>,
    ) -> Result<Self, Violation> {
        let robot = robot.into();
        check(motion, &robot)?;
        let asked = Asked { target, ..Asked::of(motion, from, &robot)? };
        if motion.kind.is_point_to_point() { asked.point_to_point() } else { asked.along_a_path(before) }
    }

    /// Returns the curve of a motion along a path that starts at the joints `from`, without the motion before it and
    /// without asking whether the arm can follow it; none point to point.
    ///
    /// # Errors
    ///
    /// There is no such curve.
    pub fn curve_of<'a>(
        motion: &Motion,
        from: &Joints,
        robot: impl Into<Robot<'a>>,
    ) -> Result<Option<Curve>, Violation> {
        let asked = Asked::of(motion, from, &robot.into())?;
        if motion.kind.is_point_to_point() { Ok(None) } else { asked.curve().map(Some) }
    }

    /// Returns the same motion of a spline in the shape that its neighbours give it, from the joints `from`. None where
    /// the arm cannot follow that shape to the same joints, or where it bends too tightly for its nodes to describe it.
    #[must_use]
    pub fn reshaped(&self, spline: Spline, from: &Joints, arm: &Arm) -> Option<Self> {
        let curve = Curve::Spline(spline);
        let Programmed { speed, acceleration, jerk, .. } = self.programmed;
        let Followed { end, nodes, is_resolved, zones } =
            along(&curve, from, speed, [acceleration, jerk], &self.ratings, arm).ok()?;
        let same_turns = end.iter().zip(&self.end).all(|(one, other)| (one - other).abs() < 1e-3);
        let Self { programmed, ratings, approximation_mm, tool, base_inverse, .. } = *self;
        (same_turns && is_resolved).then_some(Self {
            curve,
            end,
            programmed,
            ratings,
            nodes,
            zones,
            approximation_mm,
            tool,
            base_inverse,
        })
    }

    /// Returns whether both are lines and the next one continues this one, so that the arm drives them as one: at the
    /// highest speed that is programmed, no joint and no tool notices in a robot cycle of `cycle_s` seconds what rounding on
    /// the wire leaves of a bend.
    #[must_use]
    pub fn goes_straight_on_to(&self, next: &Self, arm: &Arm, cycle_s: f64) -> bool {
        let (Curve::Line(first), Curve::Line(second)) = (&self.curve, &next.curve) else { return false };
        if !first.goes_on_to(second) {
            return false;
        }
        let speed = self.programmed_speed().max(next.programmed_speed());
        let way = (speed * cycle_s).min(self.curve.length()).min(next.curve.length());
        let cubed = cycle_s * cycle_s * cycle_s;
        first.beyond(second, way, arm, &self.end).is_ok_and(|[straight, on]| {
            let mut joints = straight.iter().zip(&on).zip(&arm.limits().jerk);
            let off_mm = distance(self.tool_at(&straight, arm), self.tool_at(&on, arm));
            let jerk_mm_s3 = self.programmed.jerk.min(next.programmed.jerk);
            joints.all(|((straight, on), jerk)| (straight - on).abs() <= UNNOTICED * jerk * cubed)
                && off_mm <= ACROSS * jerk_mm_s3 * cubed
        })
    }

    /// Returns limits that may all be used at once everywhere along it.
    #[must_use]
    pub fn steady_limits(&self) -> Limits {
        let Programmed { speed, acceleration, jerk, .. } = self.programmed;
        self.nodes
            .iter()
            .fold(Limits { speed, acceleration, jerk }, |limits, node| node.steady(limits, &self.ratings))
    }

    /// The highest speed that is programmed, in its curve's unit.
    #[must_use]
    #[inline]
    pub fn programmed_speed(&self) -> f64 {
        self.nodes.first().map_or(0.0, |node| node.programmed)
    }

    /// The share of their rated speeds that joints are programmed to have at most.
    pub(super) fn programmed_share(&self) -> f64 {
        if matches!(self.curve, Curve::Axes(_)) { self.programmed.speed } else { 1.0 }
    }

    /// The tool in the root when the joints are these.
    #[must_use]
    #[inline]
    pub fn tool_at(&self, joints: &Joints, arm: &Arm) -> [f64; 3] {
        arm.forward(joints).origin_of(&self.tool)
    }
}

/// Checks that the robot knows the motion's kind, and that its coordinates are numbers.
fn check(motion: &Motion, robot: &Robot<'_>) -> Result<(), Violation> {
    match motion.kind {
        MotionKind::LinCartesian | MotionKind::PtpCartesian | MotionKind::PtpJoint => {}
        MotionKind::Circular | MotionKind::Spline => {}
        // Its line; the force is the force controller's task.
        MotionKind::LinForceCartesian if robot.presses => {}
        MotionKind::LinForceCartesian => return Err(ErrorNumber::MotionKindNotSupported.into()),
        MotionKind::None | MotionKind::Unknown(_) => return Err(Violation::Kind(motion.kind.into())),
    }
    let used = if motion.kind.has_auxiliary() { 9 } else { 6 };
    let mut coordinates = motion.target.iter().chain(&motion.auxiliary).take(used);
    match coordinates.position(|coordinate| !coordinate.is_finite()) {
        Some(index) => Err(Violation::NotFinite(index as u8 + 1)),
        None => Ok(()),
    }
}

/// A motion from the joints `from`, with the frames that it names.
struct Asked<'a> {
    motion: &'a Motion,
    /// Target of the motion.
    target: [f64; 6],
    from: &'a Joints,
    arm: &'a Arm,
    tool: Frame,
    base: Frame,
    programmed: Programmed,
}

impl<'a> Asked<'a> {
    fn of(motion: &'a Motion, from: &'a Joints, robot: &Robot<'a>) -> Result<Self, Violation> {
        let frame =
            |frames: &[Option<Frame>; 16], number: u8| frames.get(usize::from(number)).copied().flatten();
        let tool = frame(robot.tools, motion.tool).ok_or(Violation::Tool(motion.tool))?;
        let base = frame(robot.bases, motion.base).ok_or(Violation::Base(motion.base))?;
        let programmed = Programmed::of(motion, robot)?;
        Ok(Self {
            motion,
            target: motion.target.map(f64::from),
            from,
            arm: robot.arm,
            tool,
            base,
            programmed,
        })
    }

    /// The target of a motion that is not given in joints: the tool in the root.
    fn to(&self) -> Frame {
        self.base * Frame::from_mm_deg(self.target)
    }

    fn along_a_path(self, before: Option<&Segment>) -> Result<Segment, Violation> {
        let Self { motion, from, arm, tool, base, programmed, .. } = self;
        let ratings = path_ratings(&programmed, arm);
        let curve = self.curve()?;
        let most = [programmed.acceleration, programmed.jerk];
        let follow = |curve: &Curve| along(curve, from, programmed.speed, most, &ratings, arm);
        // Where the arm cannot follow the bend, the motion is a line that begins at a stop.
        let bent = going_on(before, &curve).and_then(|bent| Some((bent, follow(&bent).ok()?)));
        let (curve, Followed { end, nodes, zones, .. }) = match bent.filter(|(_, found)| found.is_resolved) {
            Some(bent) => bent,
            None => (curve, follow(&curve)?),
        };
        if let Some(configuration) = motion.configuration {
            arm.ends_in(&end, configuration)?;
        }
        let (approximation_mm, base_inverse) = (motion.approximation_mm(), base.inverse());
        Ok(Segment { curve, end, programmed, ratings, nodes, zones, approximation_mm, tool, base_inverse })
    }

    /// The curve of the tool, without the motion before.
    fn curve(&self) -> Result<Curve, Violation> {
        let start = self.arm.forward(self.from) * self.tool;
        let (to, flange) = (self.to(), Flange::of_tool(&self.tool));
        let kind = self.motion.kind;
        let is_spline = match kind.path() {
            // The target is read as a pose below.
            Some(_) if kind.has_joint_target() => return Err(Violation::Kind(kind.into())),
            Some(PathForm::Circle) => {
                let through = self.base.point(self.motion.auxiliary.map(f64::from));
                return Ok(Curve::Arc(Arc::new(start, through, to, flange)?));
            }
            Some(PathForm::Spline) => true,
            Some(PathForm::Line) => false,
            Some(PathForm::Axes) | None => return Err(Violation::Kind(kind.into())),
        };
        let way_mm = distance(start.position, to.position);
        let line = Line::new(start, to, flange);
        if line.is_a_point() || (is_spline && way_mm < LEAST_WAY_MM) {
            return Err(Violation::ZeroLength { way_mm });
        }
        Ok(if is_spline { Curve::Spline(Spline::new(start, to, flange)) } else { Curve::Line(line) })
    }

    fn point_to_point(self) -> Result<Segment, Violation> {
        let Self { motion, from, arm, tool, base, programmed, .. } = self;
        let end = self.joints_at_the_end()?;
        let axes = AxisLine::new(*from, end);
        let (ratings, nodes) = axes_ratings_and_nodes(&axes.way(), &programmed, arm);
        let curve = Curve::Axes(axes);
        let zones = [curve.length() / 2.0; 2];
        let (approximation_mm, base_inverse) = (motion.approximation_mm(), base.inverse());
        Ok(Segment { curve, end, programmed, ratings, nodes, zones, approximation_mm, tool, base_inverse })
    }

    /// Where a point-to-point motion ends.
    fn joints_at_the_end(&self) -> Result<Joints, Violation> {
        let Self { motion, target, arm, .. } = self;
        if motion.kind.has_joint_target() {
            let joints = core::array::from_fn(|axis| if axis < arm.axes() { target[axis] } else { 0.0 });
            if let Some(configuration) = motion.configuration {
                return Err(Violation::NotCartesian(configuration));
            }
            arm.within_range(&joints)?;
            return Ok(joints);
        }
        let flange = Flange::of_tool(&self.tool).when_tool_at(self.to());
        match motion.configuration {
            Some(configuration) => arm.inverse_in(&flange, configuration, self.from),
            None => arm.inverse(&flange, self.from),
        }
    }
}

/// The shape that a curve takes from the motion before it, if both are motions of one spline.
fn going_on(before: Option<&Segment>, curve: &Curve) -> Option<Curve> {
    let (Curve::Spline(before), Curve::Spline(spline)) = (&before?.curve, curve) else { return None };
    let bent = || Curve::Spline(spline.with_neighbours(Some(*before.from()), None));
    before.goes_on_to(spline).then(bent)
}

fn within(value: f64, limit: f64, violation: fn(f64, f64) -> Violation) -> Result<f64, Violation> {
    if value > 0.0 && value <= limit { Ok(value) } else { Err(violation(value, limit)) }
}

/// Returns the limits of joints and tool along a path.
fn path_ratings(programmed: &Programmed, arm: &Arm) -> Ratings {
    let Programmed { acceleration, deceleration, jerk, .. } = *programmed;
    let ratings =
        Ratings::of_axes(arm.limits(), 1.0, AXIS_RESERVE).with_tool(acceleration, jerk, TOOL_RESERVE);
    let speed = arm.limits().speed.map(|speed| AXIS_SPEED_RESERVE * speed);
    Ratings { speed, tool_deceleration: deceleration / acceleration, ..ratings }
}

/// Returns the limits of the joints point to point, and the nodes: the slowest axis determines the speed of all.
fn axes_ratings_and_nodes(way: &Joints, programmed: &Programmed, arm: &Arm) -> (Ratings, Nodes) {
    let rated = arm.limits();
    let ratings = Ratings::of_axes(rated, programmed.acceleration, STRAIGHT_RESERVE);
    let ratings = Ratings {
        // The programmed shares are at most those that the joints have.
        speed: [f64::INFINITY; AXES],
        ramp_s: ratings.ramp_s.map(|ramp_s| ramp_s * programmed.acceleration / programmed.jerk),
        deceleration: programmed.deceleration / programmed.acceleration,
        ..ratings
    };
    let moving = way.iter().zip(&rated.speed).filter(|(way, _)| **way != 0.0);
    let speed =
        programmed.speed * moving.fold(f64::INFINITY, |least, (way, limit)| least.min(limit / way.abs()));
    let nodes = POINT_SHARES.iter().map(|share| Node::of_axes(*share, speed, way, &ratings)).collect();
    (ratings, nodes)
}

#[cfg(test)]
mod tests;
