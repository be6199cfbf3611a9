//! From a motion as the PLC wrote it to one that the arm can run: checked, with the limits that hold along it.

use protocol::image::{ErrorNumber, Motion, MotionKind};

use super::curve::{AxisLine, Curve, Flange, Line};
use super::profile::Limits;
use crate::RobotConfig;
use crate::arm::{Arm, Frame, Joints, Violation};

/// Points at which a line is checked for reach, joint ranges, speeds and accelerations.
const CHECKS: usize = 32;

/// What joint limits keep in reserve for what lies between the checked points.
const RESERVE: f64 = 0.97;

/// A line on which a joint leaves less than this of the programmed velocity counts as singular.
const SINGULAR_SHARE: f64 = 0.01;

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
            MotionKind::Circular | MotionKind::Spline | MotionKind::LinForceCartesian => {
                return Err(ErrorNumber::MotionKindNotSupported.into());
            }
            MotionKind::None | MotionKind::Unknown(_) => return Err(ErrorNumber::UnknownMotionKind.into()),
        }
        if let Some(index) = motion.target.iter().position(|coordinate| !coordinate.is_finite()) {
            return Err(Violation::NotFinite(index as u8 + 1));
        }
        let frame =
            |frames: &[Option<Frame>; 16], number: u8| frames.get(usize::from(number)).copied().flatten();
        let tool = frame(&config.tools, motion.tool).ok_or(ErrorNumber::UnknownTool)?;
        let base = frame(&config.bases, motion.base).ok_or(ErrorNumber::UnknownBase)?;
        let target = motion.target.map(f64::from);
        let to = base * Frame::from_mm_deg(target);
        let (flange, base_inverse) = (Flange::of_tool(&tool), base.inverse());
        let arm = &config.arm;
        let approximation_mm = motion.approximation_mm();
        if motion.kind == MotionKind::LinCartesian {
            let programmed = Limits {
                speed: within(motion.velocity_mm_s(), config.path_velocity_mm_s, velocity)?,
                acceleration: within(
                    motion.acceleration_mm_s2(),
                    config.path_acceleration_mm_s2,
                    acceleration,
                )?,
            };
            let curve = Curve::Line(Line::new(arm.forward(from) * tool, to, flange));
            let (end, limits) = along_line(&curve, from, programmed, arm)?;
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
/// With joints q(s), a joint's speed is q'·v and its acceleration q'·a + q''·v². Where that is too much the whole
/// line is driven slower: stretching time by k divides v by k and both terms of the acceleration by k².
fn along_line(
    curve: &Curve,
    from: &Joints,
    programmed: Limits,
    arm: &Arm,
) -> Result<(Joints, Limits), Violation> {
    let length = curve.length();
    if length == 0.0 {
        return Ok((curve.joints(0.0, arm, from)?, programmed));
    }
    let rated = arm.limits();
    let step = length / CHECKS as f64;
    let (mut joints, mut slope) = (*from, None::<Joints>);
    let (mut stretch, mut slowest_axis) = (1.0_f64, 1);
    for check in 1..=CHECKS {
        let next = curve.joints(step * check as f64, arm, &joints)?;
        let next_slope: Joints = core::array::from_fn(|axis| (next[axis] - joints[axis]) / step);
        let before = slope.unwrap_or(next_slope);
        let acceleration = core::array::from_fn(|axis| {
            let bend = (next_slope[axis] - before[axis]).abs() / step;
            let steepest = next_slope[axis].abs().max(before[axis].abs());
            steepest * programmed.acceleration + bend * programmed.speed * programmed.speed
        });
        let speed = next_slope.map(|slope| slope * programmed.speed);
        let (of_speed, of_acceleration) = (rated.speed_load(&speed), rated.acceleration_load(&acceleration));
        let needs = [
            (of_speed.share / RESERVE, of_speed.axis),
            ((of_acceleration.share / RESERVE).sqrt(), of_acceleration.axis),
        ];
        for (need, axis) in needs {
            if need > stretch {
                (stretch, slowest_axis) = (need, axis);
            }
        }
        (joints, slope) = (next, Some(next_slope));
    }
    if stretch > 1.0 / SINGULAR_SHARE {
        return Err(Violation::Singular { axis: slowest_axis, share: 1.0 / stretch });
    }
    let limits = Limits {
        speed: programmed.speed / stretch,
        acceleration: programmed.acceleration / (stretch * stretch),
    };
    Ok((joints, limits))
}
