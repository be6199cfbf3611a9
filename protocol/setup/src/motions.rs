//! An application on a setup: the motions in the units of the wire.

use protocol::image;

use crate::{Application, MotionKind, Setup};

/// Number under which the robot's program store holds the application, and which the PLC starts for RC.
pub const PROGRAM: u16 = 1;

/// The application's motions as this setup programs them: the same for the PLC, which sends them, and for the robot's
/// program store.
///
/// Velocity and acceleration are the setup's shares of the rated values; see [`image::Motion`] for the units.
#[must_use]
pub fn motions(setup: &Setup, application: &Application) -> Vec<image::Motion> {
    let programmed = &setup.motions;
    let acceleration_share = programmed.acceleration_percent.value / 100.0;
    let approximation = wire(programmed.approximation_mm.value * 100.0);
    let motion = |motion: &crate::Motion| {
        let velocity_share = programmed.velocity_percent.value / 100.0 * motion.velocity_percent / 100.0;
        let (kind, velocity, acceleration) = match motion.kind {
            MotionKind::Lin => (
                image::MotionKind::LinCartesian,
                velocity_share * setup.robot.path_velocity_mm_s.value * 10.0,
                acceleration_share * setup.robot.path_acceleration_mm_s2.value,
            ),
            MotionKind::Ptp => {
                (image::MotionKind::PtpCartesian, velocity_share * 10_000.0, acceleration_share * 10_000.0)
            }
        };
        image::Motion {
            kind,
            target: motion.target_mm_deg.map(|coordinate| coordinate as f32),
            auxiliary: [0.0; 3],
            velocity: wire(velocity),
            acceleration: wire(acceleration),
            approximation: if motion.blend { approximation } else { 0 },
            tool: application.tool,
            base: application.base,
        }
    };
    application.motion.iter().map(motion).collect()
}

/// The nearest number that the wire can carry.
fn wire(value: f64) -> u16 {
    value.round().clamp(0.0, f64::from(u16::MAX)) as u16
}
