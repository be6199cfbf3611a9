//! The arm of a case: that of a setup, or a random one.

use serde::{Deserialize, Serialize};
use setup::Setup;

use crate::kinematics::{AXES, Joints, Links};

/// The arm's links and limits, and its joints at the start.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Its links.
    pub links: Links,
    /// Lowest values of the joints, in degrees (mm).
    pub lower_deg: Vec<f64>,
    /// Highest values, in degrees (mm).
    pub upper_deg: Vec<f64>,
    /// Rated speeds, in degrees (mm) per second.
    pub speed_deg_s: Vec<f64>,
    /// Rated accelerations, in degrees (mm) per second².
    pub acceleration_deg_s2: Vec<f64>,
    /// Rated jerks, in degrees (mm) per second³.
    pub jerk_deg_s3: Vec<f64>,
    /// Joints at the start, in degrees (mm).
    pub home_deg: Vec<f64>,
}

impl Arm {
    /// That of a setup.
    #[must_use]
    pub fn of(setup: &Setup) -> Self {
        let axes = &setup.robot.axes;
        let links = match &setup.robot.kinematics {
            setup::Kinematics::Scara(scara) => Links::Scara {
                link_1_mm: scara.link_1_mm.value,
                link_2_mm: scara.link_2_mm.value,
                height_mm: scara.height_mm.value,
            },
            setup::Kinematics::Opw(opw) => Links::SixAxes {
                a1_mm: opw.a1_mm.value,
                a2_mm: opw.a2_mm.value,
                b_mm: opw.b_mm.value,
                c1_mm: opw.c1_mm.value,
                c2_mm: opw.c2_mm.value,
                c3_mm: opw.c3_mm.value,
                c4_mm: opw.c4_mm.value,
                offsets_deg: opw.offsets_deg.value,
                signs: opw.signs.value,
            },
            setup::Kinematics::ThreeParallel(arm) => Links::ThreeParallel {
                d_mm: [&arm.d1_mm, &arm.d4_mm, &arm.d5_mm, &arm.d6_mm].map(|length| length.value),
                a_mm: [&arm.a2_mm, &arm.a3_mm].map(|length| length.value),
                offsets_deg: arm.offsets_deg.value,
                signs: arm.signs.value,
            },
        };
        let middles = || {
            let ranges = axes.lower_deg.value.iter().zip(&axes.upper_deg.value);
            ranges.map(|(lower, upper)| f64::midpoint(*lower, *upper)).collect()
        };
        Self {
            links,
            lower_deg: axes.lower_deg.value.clone(),
            upper_deg: axes.upper_deg.value.clone(),
            speed_deg_s: axes.speed_deg_s.value.clone(),
            acceleration_deg_s2: axes.acceleration_deg_s2.value.clone(),
            jerk_deg_s3: axes.jerk_deg_s3.value.clone(),
            home_deg: axes.home_deg.as_ref().map_or_else(middles, |home| home.value.clone()),
        }
    }

    /// Returns the lists that have a number for each joint, with their keys.
    pub(super) fn lists(&self) -> [(&'static str, &[f64]); 6] {
        [
            ("lower_deg", &self.lower_deg),
            ("upper_deg", &self.upper_deg),
            ("speed_deg_s", &self.speed_deg_s),
            ("acceleration_deg_s2", &self.acceleration_deg_s2),
            ("jerk_deg_s3", &self.jerk_deg_s3),
            ("home_deg", &self.home_deg),
        ]
    }

    /// Returns the joints at the start; joints that it lacks are 0.
    #[must_use]
    pub fn home(&self) -> Joints {
        by_joint(&self.home_deg, 0.0)
    }
}

/// One value a joint; those that a list lacks are `rest`.
#[must_use]
pub fn by_joint(values: &[f64], rest: f64) -> Joints {
    let mut joints = [rest; AXES];
    for (joint, value) in joints.iter_mut().zip(values) {
        *joint = *value;
    }
    joints
}
