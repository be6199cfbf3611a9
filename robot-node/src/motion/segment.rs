//! From a motion as the PLC wrote it to one that the arm can run: checked, with the limits that hold along it.

use protocol::image::{ErrorNumber, Motion, MotionKind};

use super::arc::Arc;
use super::curve::{AxisLine, Curve, Flange, Line};
use super::curved;
use super::profile::Limits;
use super::spline::Spline;
use crate::RobotConfig;
use crate::arm::{Arm, Frame, Joints, SINGULAR_SHARE, TURNED_OVER_DEG, Violation, distance};

/// Points at which a line is checked for reach, joint ranges, speeds and accelerations.
const CHECKS: usize = 32;

/// What joint limits keep in reserve for what lies between the checked points.
const RESERVE: f64 = 0.97;

/// One motion, ready to run.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Segment {
    /// Where it goes.
    pub curve: Curve,
    /// The joints at its end.
    pub end: Joints,
    /// Highest speed and acceleration along the curve, in the curve's unit.
    pub limits: Limits,
    /// How far from its end it may leave its curve, in mm.
    pub approximation_mm: f64,
    /// The share of the axes' rated accelerations that it may use, 0…1.
    pub axis_share: f64,
    /// The tool's highest acceleration in mm/s²; infinite point to point.
    pub tool_acceleration: f64,
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
    pub fn prepare(motion: &Motion, from: &Joints, config: &RobotConfig) -> Result<Self, Violation> {
        match motion.kind {
            MotionKind::LinCartesian | MotionKind::PtpCartesian | MotionKind::PtpJoint => {}
            MotionKind::Circular | MotionKind::Spline => {}
            // Its line; what it presses with is the force controller's affair.
            MotionKind::LinForceCartesian if config.force.is_some() => {}
            MotionKind::LinForceCartesian => return Err(ErrorNumber::MotionKindNotSupported.into()),
            MotionKind::None | MotionKind::Unknown(_) => return Err(Violation::Kind(motion.kind.into())),
        }
        let used =
            if matches!(motion.kind, MotionKind::Circular | MotionKind::LinForceCartesian) { 9 } else { 6 };
        let mut coordinates = motion.target.iter().chain(&motion.auxiliary).take(used);
        if let Some(index) = coordinates.position(|coordinate| !coordinate.is_finite()) {
            return Err(Violation::NotFinite(index as u8 + 1));
        }
        let frame =
            |frames: &[Option<Frame>; 16], number: u8| frames.get(usize::from(number)).copied().flatten();
        let tool = frame(&config.tools, motion.tool).ok_or(Violation::Tool(motion.tool))?;
        let base = frame(&config.bases, motion.base).ok_or(Violation::Base(motion.base))?;
        let target = motion.target.map(f64::from);
        let to = base * Frame::from_mm_deg(target);
        let (flange, base_inverse) = (Flange::of_tool(&tool), base.inverse());
        let arm = &config.arm;
        let approximation_mm = motion.approximation_mm();
        if !motion.kind.is_point_to_point() {
            let programmed = Limits {
                speed: within(motion.velocity_mm_s(), config.path_velocity_mm_s, velocity)?,
                acceleration: within(
                    motion.acceleration_mm_s2(),
                    config.path_acceleration_mm_s2,
                    acceleration,
                )?,
            };
            let start = arm.forward(from) * tool;
            let (curve, end, limits) = if motion.kind == MotionKind::Circular {
                let through = base.point(motion.auxiliary.map(f64::from));
                let arc = Arc::new(start, through, to, flange)?;
                let wanted = curved::on_bend(programmed, 1.0 / arc.radius());
                let (end, limits) = curved::followed(&Curve::Arc(arc), from, wanted, arm)?;
                (Curve::Arc(arc), end, limits)
            } else if motion.kind == MotionKind::Spline {
                let way_mm = distance(start.position, to.position);
                if way_mm < 1e-3 {
                    return Err(Violation::ZeroLength { way_mm });
                }
                let curve = Curve::Spline(Spline::new(start, to, flange, programmed));
                let (end, limits) = curved::followed(&curve, from, programmed, arm)?;
                (curve, end, limits)
            } else {
                let curve = Curve::Line(Line::new(start, to, flange));
                if curve.length() == 0.0 {
                    return Err(Violation::ZeroLength { way_mm: distance(start.position, to.position) });
                }
                let (end, limits) = along_line(&curve, from, programmed, arm)?;
                (curve, end, limits)
            };
            let tool_acceleration = programmed.acceleration;
            Ok(Self {
                curve,
                end,
                limits,
                approximation_mm,
                axis_share: 1.0,
                tool_acceleration,
                tool,
                base_inverse,
            })
        } else {
            let speed_share = within(motion.velocity_share(), 1.0, velocity)?;
            let axis_share = within(motion.acceleration_share(), 1.0, acceleration)?;
            let end = if motion.kind == MotionKind::PtpJoint {
                let joints = core::array::from_fn(|axis| if axis < arm.axes() { target[axis] } else { 0.0 });
                arm.within_range(&joints)?;
                joints
            } else {
                arm.inverse(&flange.when_tool_at(to), from)?
            };
            let axes = AxisLine::new(*from, end);
            let limits = point_to_point(&axes.way(), speed_share, axis_share, arm);
            let (curve, tool_acceleration) = (Curve::Axes(axes), f64::INFINITY);
            Ok(Self {
                curve,
                end,
                limits,
                approximation_mm,
                axis_share,
                tool_acceleration,
                tool,
                base_inverse,
            })
        }
    }

    /// The tool in the root when the joints are these.
    #[must_use]
    pub fn tool_at(&self, joints: &Joints, arm: &Arm) -> [f64; 3] {
        let flange = arm.forward(joints);
        if self.tool == Frame::IDENTITY { flange.position } else { (flange * self.tool).position }
    }
}

fn velocity(value: f64, limit: f64) -> Violation {
    Violation::Velocity { value, limit }
}

fn acceleration(value: f64, limit: f64) -> Violation {
    Violation::Acceleration { value, limit }
}

fn within(value: f64, limit: f64, violation: fn(f64, f64) -> Violation) -> Result<f64, Violation> {
    if value > 0.0 && value <= limit { Ok(value) } else { Err(violation(value, limit)) }
}

/// The slowest axis sets the pace of all.
fn point_to_point(way: &Joints, speed_share: f64, axis_share: f64, arm: &Arm) -> Limits {
    let rated = arm.limits();
    let mut limits = Limits { speed: f64::INFINITY, acceleration: f64::INFINITY };
    for (way, (speed, acceleration)) in way.iter().zip(rated.speed.iter().zip(&rated.acceleration)) {
        if *way != 0.0 {
            limits.speed = limits.speed.min(speed_share * speed / way.abs());
            limits.acceleration = limits.acceleration.min(axis_share * acceleration / way.abs());
        }
    }
    if limits.speed.is_finite() { limits } else { Limits { speed: 1.0, acceleration: 1.0 } }
}

/// The joints at a line's end, and the programmed limits, reduced to what the joints can follow along all of it.
///
/// With joints q(s), a joint's speed is q'·v and its acceleration q'·a + q''·v². The path acceleration gets at most
/// half of what an axis has, whatever the speed; the speed then gets all that is left. So a higher programmed speed
/// never makes a line slower.
fn along_line(
    curve: &Curve,
    from: &Joints,
    programmed: Limits,
    arm: &Arm,
) -> Result<(Joints, Limits), Violation> {
    let (end, steps) = difference(curve, from, arm)?;
    let rated = arm.limits();
    let half = steps.iter().fold(0.0_f64, |load, step| load.max(rated.acceleration_load(&step.slope).share));
    let mut limits = programmed;
    limits.acceleration = limits.acceleration.min(RESERVE / (2.0 * half));
    let mut slowest_axis = 1;
    for step in &steps {
        for axis in 0..arm.axes() {
            let (slope, bend) = (step.slope[axis].abs(), step.bend[axis].abs());
            let left = RESERVE * rated.acceleration[axis] - slope * limits.acceleration;
            let speed = (RESERVE * rated.speed[axis] / slope).min((left / bend).sqrt());
            if speed < limits.speed {
                (limits.speed, slowest_axis) = (speed, axis as u8 + 1);
            }
        }
    }
    if limits.speed < programmed.speed * SINGULAR_SHARE {
        return Err(Violation::Singular { axis: slowest_axis, share: limits.speed / programmed.speed });
    }
    Ok((end, limits))
}

/// How the joints change along a part of a curve, per unit of the way.
#[derive(Clone, Copy)]
struct Difference {
    /// The steeper one of the slopes on both sides.
    slope: Joints,
    /// How much the slope changes.
    bend: Joints,
}

/// The joints at a curve's end, and how they change along it.
fn difference(curve: &Curve, from: &Joints, arm: &Arm) -> Result<(Joints, [Difference; CHECKS]), Violation> {
    let step = curve.length() / CHECKS as f64;
    let (mut joints, mut before) = (*from, None::<Joints>);
    let mut differences = [Difference { slope: [0.0; 6], bend: [0.0; 6] }; CHECKS];
    for (check, difference) in differences.iter_mut().enumerate() {
        let next = curve.joints(step * (check + 1) as f64, arm, &joints)?;
        arm.stays_in_configuration(&joints, &next, TURNED_OVER_DEG).map_err(|(axis, turn_deg)| {
            Violation::Configuration { axis, turn_deg, way: step * check as f64, length: curve.length() }
        })?;
        let slope: Joints = core::array::from_fn(|axis| (next[axis] - joints[axis]) / step);
        let last = before.unwrap_or(slope);
        *difference = Difference {
            slope: core::array::from_fn(|axis| slope[axis].abs().max(last[axis].abs())),
            bend: core::array::from_fn(|axis| (slope[axis] - last[axis]) / step),
        };
        (joints, before) = (next, Some(slope));
    }
    Ok((joints, differences))
}
