//! The arm as a setup describes it: geometry, limits, numbered frames and where it stands at power-on.

use std::sync::Arc;

use setup::{Kinematics as Geometry, Setup};

use crate::{
    AXES, Arm, AxisLimits, Frame, Joints, Kinematics, Opw, OpwParameters, Scara, ThreeParallel,
    ThreeParallelParameters,
};

/// Frames by number; the field in a motion has four bits.
pub type Frames = [Option<Frame>; 16];

/// The arm as the robot's part of a setup describes it.
#[derive(Clone, Debug)]
pub struct Installation {
    /// The arm.
    pub arm: Arm,
    /// Joints at power-on; `None` if the setup leaves them out: then the arm stands where its application starts.
    pub home: Option<Joints>,
    /// Tool frames by number, from the flange; number 0 is the flange.
    pub tools: Frames,
    /// Base frames by number, from the root; number 0 is the root.
    pub bases: Frames,
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

impl Installation {
    /// Reads the arm of a setup and checks its values.
    ///
    /// # Errors
    ///
    /// The key, what is wrong with it and what would be right.
    pub fn from_setup(setup: &Setup) -> Result<Self, ConfigError> {
        let robot = &setup.robot;
        let (kinematics, axes) = kinematics(&robot.kinematics)?;
        let arm = Arm::new(kinematics, limits(&robot.axes, axes)?);
        let home = robot.axes.home_deg.as_ref();
        let home = home.map(|home| joints("axes.home_deg", &home.value, axes, [0.0; AXES])).transpose()?;
        if let Some(Err(violation)) = home.map(|home| arm.within_range(&home)) {
            return error("axes.home_deg", violation.to_string());
        }
        Ok(Self { arm, home, tools: frames("tools", &robot.tools)?, bases: frames("bases", &robot.bases)? })
    }

    /// Returns the joints at power-on; where the setup leaves them out, those in the middle of the ranges.
    #[must_use]
    pub fn home_or_middle(&self) -> Joints {
        self.home.unwrap_or_else(|| self.arm.middle())
    }
}

fn kinematics(geometry: &Geometry) -> Result<(Arc<dyn Kinematics>, usize), ConfigError> {
    Ok(match geometry {
        Geometry::Scara(scara) => {
            let [link_1_mm, link_2_mm, height_mm] =
                [&scara.link_1_mm, &scara.link_2_mm, &scara.height_mm].map(|length| length.value);
            if !(link_1_mm > 0.0 && link_2_mm > 0.0 && height_mm.is_finite()) {
                return error("kinematics", "both links must be longer than 0 mm and the height a number");
            }
            (Arc::new(Scara { link_1_mm, link_2_mm, height_mm }), 4)
        }
        Geometry::Opw(opw) => (Arc::new(spherical_wrist(opw)?), 6),
        Geometry::ThreeParallel(arm) => (Arc::new(three_parallel(arm)?), 6),
    })
}

fn spherical_wrist(opw: &setup::Opw) -> Result<Opw, ConfigError> {
    let [a1, a2, b, c1, c2, c3, c4] =
        [&opw.a1_mm, &opw.a2_mm, &opw.b_mm, &opw.c1_mm, &opw.c2_mm, &opw.c3_mm, &opw.c4_mm]
            .map(|length| length.value);
    let (offsets, signs) = (opw.offsets_deg.value, opw.signs.value);
    let are_lengths = [a1, a2, b, c1, c4].iter().all(|length| length.is_finite()) && c2 > 0.0 && c3 > 0.0;
    if !are_lengths {
        return error("kinematics", "every length must be a number, and c2 and c3 above 0 mm");
    }
    offsets_and_signs(&offsets, &signs)?;
    Ok(Opw::new(OpwParameters { a1, a2, b, c1, c2, c3, c4, offsets, signs }))
}

fn three_parallel(arm: &setup::ThreeParallel) -> Result<ThreeParallel, ConfigError> {
    let [d1, a2, a3, d4, d5, d6] =
        [&arm.d1_mm, &arm.a2_mm, &arm.a3_mm, &arm.d4_mm, &arm.d5_mm, &arm.d6_mm].map(|length| length.value);
    let (offsets, signs) = (arm.offsets_deg.value, arm.signs.value);
    if ![d1, a2, a3, d4, d5, d6].iter().all(|length| length.is_finite()) || a2 * a3 <= 0.0 {
        return error("kinematics", "every length must be a number, and a2 and a3 not 0 and of one sign");
    }
    offsets_and_signs(&offsets, &signs)?;
    Ok(ThreeParallel::new(ThreeParallelParameters { d1, a2, a3, d4, d5, d6, offsets, signs }))
}

fn offsets_and_signs(offsets: &Joints, signs: &[i8; AXES]) -> Result<(), ConfigError> {
    if !offsets.iter().all(|offset| offset.abs() <= 360.0) || !signs.iter().all(|sign| sign.abs() == 1) {
        return error("kinematics", "offsets must be within ±360° and signs 1 or -1");
    }
    Ok(())
}

fn limits(listed: &setup::Axes, axes: usize) -> Result<AxisLimits, ConfigError> {
    let mut limits = AxisLimits::NONE;
    limits.lower = joints("axes.lower_deg", &listed.lower_deg.value, axes, limits.lower)?;
    limits.upper = joints("axes.upper_deg", &listed.upper_deg.value, axes, limits.upper)?;
    limits.speed = positive("axes.speed_deg_s", &listed.speed_deg_s.value, axes)?;
    limits.acceleration = positive("axes.acceleration_deg_s2", &listed.acceleration_deg_s2.value, axes)?;
    limits.jerk = positive("axes.jerk_deg_s3", &listed.jerk_deg_s3.value, axes)?;
    for (axis, (lower, upper)) in limits.lower.iter().zip(&limits.upper).enumerate() {
        if lower >= upper {
            let problem = format!("joint {} has a lowest value {lower} that is not below {upper}", axis + 1);
            return error("axes.lower_deg", problem);
        }
    }
    Ok(limits)
}

/// Reads one value for each joint that the arm has; the other joints keep `rest`.
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
    fn a_setup_that_makes_no_sense_is_refused_with_key_and_reason() {
        let mut setup = setup::setup("A").unwrap();
        setup.robot.axes.home_deg.as_mut().unwrap().value[0] = 140.0;
        let error = Installation::from_setup(&setup).unwrap_err();
        insta::assert_snapshot!(error, @"robot.axes.home_deg: joint 1 would be at 140.000°, its range is -132.000 to 132.000°");
        setup.robot.axes.speed_deg_s.value.pop();
        let error = Installation::from_setup(&setup).unwrap_err();
        insta::assert_snapshot!(error, @"robot.axes.speed_deg_s: 3 values, but this arm has 4 joints");
    }

    #[test]
    fn frames_are_found_by_their_numbers() {
        let installation = Installation::from_setup(&setup::setup("A").unwrap()).unwrap();
        assert_eq!(installation.arm.axes(), 4);
        assert!(installation.bases[1].is_some() && installation.bases[2].is_none());
    }
}
