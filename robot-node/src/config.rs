//! What the robot node takes from a setup.

use core::time::Duration;
use std::sync::Arc;

use setup::{Kinematics, Setup};

use crate::arm::{AXES, Arm, AxisLimits, Frame, Joints, Opw, OpwParameters, Scara, Surface};

/// Frames by number; the field in a motion has four bits.
pub(crate) type Frames = [Option<Frame>; 16];

/// Everything that the robot node is told before it starts.
#[derive(Clone, Debug)]
pub struct RobotConfig {
    /// The arm.
    pub arm: Arm,
    /// Where it stands at power-on.
    pub home: Joints,
    /// Tool frames by number, from the flange; number 0 is the flange.
    pub tools: Frames,
    /// Base frames by number, from the root; number 0 is the root.
    pub bases: Frames,
    /// Highest path velocity, in mm/s.
    pub path_velocity_mm_s: f64,
    /// Highest path acceleration, in mm/s².
    pub path_acceleration_mm_s2: f64,
    /// Highest path jerk, in mm/s³.
    pub path_jerk_mm_s3: f64,
    /// How it presses; none without a force controller.
    pub force: Option<ForceControl>,
    /// What the tool can press against, in the root.
    pub surfaces: Vec<Surface>,
    /// Interpolation cycle.
    pub cycle: Duration,
    /// The interpreter notices a command after a time evenly spread between 0 and this.
    pub interpreter_quantum: Duration,
    /// What else passes, evenly spread between 0 and this, before it notices a program or a MoveContinuousSkill.
    pub start_quantum: Duration,
    /// Cycles that pass before the first motion of a MoveContinuousSkill, and not before that of a program.
    pub continuous_start_cycles: u32,
    /// What a skill call costs besides its motion.
    pub skill_overhead: Duration,
}

/// How the arm presses.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct ForceControl {
    /// The highest contact force that may be asked for, in N.
    pub max_n: f64,
    /// The stiffest surface that the controller is set for, in N/mm.
    pub stiffest_n_per_mm: f64,
    /// How far from the force asked for, in N, counts as reached.
    pub tolerance_n: f64,
    /// How long it must stay reached.
    pub settling: Duration,
    /// The highest jerk of the tool, in mm/s³.
    pub jerk_mm_s3: f64,
}

/// Why a setup does not describe a robot.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
#[error("robot.{key}: {problem}")]
pub struct ConfigError {
    /// The key below `robot`.
    pub key: String,
    /// What is wrong, and what would be right.
    pub problem: String,
}

fn error<T>(key: impl Into<String>, problem: impl Into<String>) -> Result<T, ConfigError> {
    Err(ConfigError { key: key.into(), problem: problem.into() })
}

impl RobotConfig {
    /// Reads the robot's part of a setup and checks that it makes sense.
    ///
    /// # Errors
    ///
    /// The key, what is wrong with it and what would be right.
    pub fn from_setup(setup: &Setup) -> Result<Self, ConfigError> {
        let robot = &setup.robot;
        let (kinematics, axes): (Arc<dyn crate::arm::Kinematics>, usize) = match &robot.kinematics {
            Kinematics::Scara(scara) => {
                let [link_1_mm, link_2_mm, height_mm] =
                    [&scara.link_1_mm, &scara.link_2_mm, &scara.height_mm].map(|length| length.value);
                if !(link_1_mm > 0.0 && link_2_mm > 0.0 && height_mm.is_finite()) {
                    return error(
                        "kinematics",
                        "both links must be longer than 0 mm and the height a number",
                    );
                }
                (Arc::new(Scara { link_1_mm, link_2_mm, height_mm }), 4)
            }
            Kinematics::Opw(opw) => (Arc::new(six_axes(opw)?), 6),
        };
        let mut limits = AxisLimits::NONE;
        limits.lower = joints("axes.lower_deg", &robot.axes.lower_deg.value, axes, limits.lower)?;
        limits.upper = joints("axes.upper_deg", &robot.axes.upper_deg.value, axes, limits.upper)?;
        limits.speed = positive("axes.speed_deg_s", &robot.axes.speed_deg_s.value, axes)?;
        limits.acceleration =
            positive("axes.acceleration_deg_s2", &robot.axes.acceleration_deg_s2.value, axes)?;
        limits.jerk = positive("axes.jerk_deg_s3", &robot.axes.jerk_deg_s3.value, axes)?;
        for (axis, (lower, upper)) in limits.lower.iter().zip(&limits.upper).enumerate() {
            if lower >= upper {
                let problem =
                    format!("joint {} has a lowest value {lower} that is not below {upper}", axis + 1);
                return error("axes.lower_deg", problem);
            }
        }
        let arm = Arm::new(kinematics, limits);
        let home = joints("axes.home_deg", &robot.axes.home_deg.value, axes, [0.0; AXES])?;
        if let Err(violation) = arm.within_range(&home) {
            return error("axes.home_deg", violation.to_string());
        }
        let (velocity, acceleration) = (robot.path_velocity_mm_s.value, robot.path_acceleration_mm_s2.value);
        if !(velocity > 0.0 && velocity.is_finite()) {
            return error("path_velocity_mm_s", format!("{velocity} is not a velocity above 0"));
        }
        if !(acceleration > 0.0 && acceleration.is_finite()) {
            return error(
                "path_acceleration_mm_s2",
                format!("{acceleration} is not an acceleration above 0"),
            );
        }
        let jerk = robot.path_jerk_mm_s3.value;
        if !(jerk > 0.0 && jerk.is_finite()) {
            return error("path_jerk_mm_s3", format!("{jerk} is not a jerk above 0"));
        }
        if robot.cycle_us.value == 0 {
            return error("cycle_us", "0 is no cycle; a controller interpolates every 1000 to 12000 µs");
        }
        let micros = |value: u32| Duration::from_micros(u64::from(value));
        Ok(Self {
            arm,
            home,
            tools: frames("tools", &robot.tools)?,
            bases: frames("bases", &robot.bases)?,
            path_velocity_mm_s: velocity,
            path_acceleration_mm_s2: acceleration,
            path_jerk_mm_s3: jerk,
            force: robot.force.as_ref().map(|force| ForceControl {
                max_n: force.max_n.value,
                stiffest_n_per_mm: force.stiffest_n_per_mm.value,
                tolerance_n: force.tolerance_n.value,
                settling: Duration::from_millis(force.settling_ms.value.into()),
                jerk_mm_s3: force.jerk_mm_s3.value,
            }),
            surfaces: Vec::new(),
            cycle: micros(robot.cycle_us.value),
            interpreter_quantum: micros(robot.interpreter_quantum_us.value),
            start_quantum: micros(robot.start_quantum_us.as_ref().map_or(0, |quantum| quantum.value)),
            continuous_start_cycles: robot.continuous_start_cycles.as_ref().map_or(0, |cycles| cycles.value),
            skill_overhead: micros(robot.skill_overhead_us.value),
        })
    }
}

fn six_axes(opw: &setup::Opw) -> Result<Opw, ConfigError> {
    let [a1, a2, b, c1, c2, c3, c4] =
        [&opw.a1_mm, &opw.a2_mm, &opw.b_mm, &opw.c1_mm, &opw.c2_mm, &opw.c3_mm, &opw.c4_mm]
            .map(|length| length.value);
    let (offsets, signs) = (opw.offsets_deg.value, opw.signs.value);
    let are_lengths = [a1, a2, b, c1, c4].iter().all(|length| length.is_finite()) && c2 > 0.0 && c3 > 0.0;
    if !are_lengths {
        return error("kinematics", "every length must be a number, and c2 and c3 above 0 mm");
    }
    if !offsets.iter().all(|offset| offset.abs() <= 360.0) || !signs.iter().all(|sign| sign.abs() == 1) {
        return error("kinematics", "offsets must be within ±360° and signs 1 or -1");
    }
    Ok(Opw::new(OpwParameters { a1, a2, b, c1, c2, c3, c4, offsets, signs }))
}

/// One value for each joint that the arm has; the others keep `rest`.
fn joints(key: &str, values: &[f64], axes: usize, rest: Joints) -> Result<Joints, ConfigError> {
    if values.len() != axes {
        return error(key, format!("{} values, but this arm has {axes} joints", values.len()));
    }
    if let Some(value) = values.iter().find(|value| !value.is_finite()) {
        return error(key, format!("{value} is not a finite number"));
    }
    let mut joints = rest;
    for (joint, value) in joints.iter_mut().zip(values) {
        *joint = *value;
    }
    Ok(joints)
}

fn positive(key: &str, values: &[f64], axes: usize) -> Result<Joints, ConfigError> {
    match values.iter().find(|value| **value <= 0.0) {
        Some(value) => error(key, format!("{value} is not above 0")),
        None => joints(key, values, axes, [f64::INFINITY; AXES]),
    }
}

fn frames(key: &str, listed: &[setup::Frame]) -> Result<Frames, ConfigError> {
    let mut frames = Frames::default();
    frames[0] = Some(Frame::IDENTITY);
    for setup::Frame { number, mm_deg } in listed {
        if !mm_deg.value.iter().all(|value| value.is_finite()) {
            return error(key, format!("frame {number} has a coordinate that is not a finite number"));
        }
        match frames.get_mut(usize::from(*number)) {
            Some(frame @ None) => *frame = Some(Frame::from_mm_deg(mm_deg.value)),
            Some(Some(_)) => return error(key, format!("number {number} is taken; 0 is built in")),
            None => return error(key, format!("number {number} does not fit the wire's four bits: 1 to 15")),
        }
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn setup_a_describes_a_robot() {
        let config = RobotConfig::from_setup(&setup::setup("A").unwrap()).unwrap();
        assert_eq!(config.arm.axes(), 4);
        assert_eq!(config.cycle, Duration::from_millis(4));
        assert!(config.bases[1].is_some() && config.bases[2].is_none());
    }

    #[test]
    fn a_setup_that_makes_no_sense_is_refused_with_key_and_reason() {
        let mut setup = setup::setup("A").unwrap();
        setup.robot.axes.home_deg.value[0] = 140.0;
        let error = RobotConfig::from_setup(&setup).unwrap_err();
        insta::assert_snapshot!(error, @"robot.axes.home_deg: joint 1 would be at 140.000, its range is -132.000 to 132.000");
        setup.robot.axes.speed_deg_s.value.pop();
        let error = RobotConfig::from_setup(&setup).unwrap_err();
        insta::assert_snapshot!(error, @"robot.axes.speed_deg_s: 3 values, but this arm has 4 joints");
    }
}
