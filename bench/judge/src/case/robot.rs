//! From a case to the robot that runs it: the setup's robot with the arm and the frames of the case.

use robot_node::{ConfigError, RobotConfig};
use setup::{Provenance, Setup, Sourced};

use super::{Case, Frame, OtherController};
use crate::kinematics::Links;

impl Case {
    /// The robot of this case; `setup` is [its own](Self::its_setup).
    ///
    /// # Errors
    ///
    /// Which number makes no sense.
    pub fn robot(&self, setup: &Setup) -> Result<RobotConfig, ConfigError> {
        let mut config = RobotConfig::from_setup(setup)?;
        config.surfaces = self
            .surfaces
            .iter()
            .map(|surface| robot_node::arm::Surface {
                point: surface.point_mm,
                normal: surface.normal,
                radius_mm: f64::INFINITY,
                stiffness_n_per_mm: surface.stiffness_n_per_mm,
            })
            .collect();
        Ok(config)
    }

    /// The setup that it names, with what the case says.
    #[must_use]
    pub fn its_setup(&self, setup: &Setup) -> Setup {
        let mut setup = self.controller.map_or_else(|| setup.clone(), |other| other.of(setup));
        let robot = &mut setup.robot;
        robot.kinematics = kinematics(&self.arm.links);
        robot.axes.lower_deg.value.clone_from(&self.arm.lower_deg);
        robot.axes.upper_deg.value.clone_from(&self.arm.upper_deg);
        robot.axes.speed_deg_s.value.clone_from(&self.arm.speed_deg_s);
        robot.axes.acceleration_deg_s2.value.clone_from(&self.arm.acceleration_deg_s2);
        robot.axes.jerk_deg_s3.value.clone_from(&self.arm.jerk_deg_s3);
        robot.axes.home_deg = Some(drawn(self.arm.home_deg.clone()));
        robot.tools = frames(&self.tools);
        robot.bases = frames(&self.bases);
        robot.interpreter_quantum_us.value = 0;
        robot.start_quantum_us = None;
        robot.skill_overhead_us.value = self.skill_overhead_ms.saturating_mul(1_000);
        setup
    }
}

impl OtherController {
    /// The same setup with this controller.
    #[must_use]
    pub fn of(&self, setup: &Setup) -> Setup {
        let mut setup = setup.clone();
        let robot = &mut setup.robot;
        robot.cycle_us.value = self.cycle_us;
        robot.path_velocity_mm_s.value = self.path_velocity_mm_s;
        robot.path_acceleration_mm_s2.value = self.path_acceleration_mm_s2;
        robot.path_jerk_mm_s3.value = self.path_jerk_mm_s3;
        if let Some(force) = &mut robot.force {
            force.jerk_mm_s3.value = self.force_jerk_mm_s3;
        }
        setup
    }
}

const fn drawn<T>(value: T) -> Sourced<T> {
    Sourced { value, from: Provenance::Assumed, note: String::new() }
}

fn kinematics(links: &Links) -> setup::Kinematics {
    match *links {
        Links::Scara { link_1_mm, link_2_mm, height_mm } => setup::Kinematics::Scara(setup::Scara {
            link_1_mm: drawn(link_1_mm),
            link_2_mm: drawn(link_2_mm),
            height_mm: drawn(height_mm),
        }),
        Links::SixAxes { a1_mm, a2_mm, b_mm, c1_mm, c2_mm, c3_mm, c4_mm, offsets_deg, signs } => {
            setup::Kinematics::Opw(Box::new(setup::Opw {
                a1_mm: drawn(a1_mm),
                a2_mm: drawn(a2_mm),
                b_mm: drawn(b_mm),
                c1_mm: drawn(c1_mm),
                c2_mm: drawn(c2_mm),
                c3_mm: drawn(c3_mm),
                c4_mm: drawn(c4_mm),
                offsets_deg: drawn(offsets_deg),
                signs: drawn(signs),
            }))
        }
        Links::ThreeParallel { d_mm: [d1, d4, d5, d6], a_mm: [a2, a3], offsets_deg, signs } => {
            setup::Kinematics::ThreeParallel(Box::new(setup::ThreeParallel {
                d1_mm: drawn(d1),
                a2_mm: drawn(a2),
                a3_mm: drawn(a3),
                d4_mm: drawn(d4),
                d5_mm: drawn(d5),
                d6_mm: drawn(d6),
                offsets_deg: drawn(offsets_deg),
                signs: drawn(signs),
            }))
        }
    }
}

fn frames(frames: &[Frame]) -> Vec<setup::Frame> {
    frames.iter().map(|frame| setup::Frame { number: frame.number, mm_deg: drawn(frame.mm_deg) }).collect()
}
