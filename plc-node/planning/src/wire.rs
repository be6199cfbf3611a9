//! A plan in the units of the wire, which are the same for the PLC, which sends it, and the robot's program store.

use protocol::image;
use setup::Setup;

use crate::motion::Motion;
use crate::plan::Plan;

/// Number under which the robot's program store holds the application, and which the PLC starts for RC.
pub const PROGRAM: u16 = 1;

impl Plan {
    /// The motions as this setup programs them.
    #[must_use]
    pub fn wire_motions(&self, setup: &Setup) -> Vec<image::Motion> {
        self.motions.iter().map(|motion| motion.wire(setup)).collect()
    }
}

impl Motion {
    /// The motion as this setup programs it; see [`image::Motion`] for the units.
    ///
    /// Velocity and acceleration are the setup's shares of the rated values, a path's speed at most what its step
    /// allows.
    #[must_use]
    pub fn wire(&self, setup: &Setup) -> image::Motion {
        let programmed = &setup.motions;
        let velocity_share = programmed.velocity_percent.value / 100.0 * self.speed_percent / 100.0;
        let acceleration_share = programmed.acceleration_percent.value / 100.0;
        let (velocity, acceleration) = if self.kind.is_point_to_point() {
            (velocity_share * 10_000.0, acceleration_share * 10_000.0)
        } else {
            let speed_mm_s = velocity_share * setup.robot.path_velocity_mm_s.value;
            let speed_mm_s = self.speed_mm_s.map_or(speed_mm_s, |highest| speed_mm_s.min(highest));
            (speed_mm_s * 10.0, acceleration_share * setup.robot.path_acceleration_mm_s2.value)
        };
        image::Motion {
            kind: self.kind,
            target: self.joints_deg.unwrap_or(self.target.mm_deg()).map(|coordinate| coordinate as f32),
            auxiliary: self.auxiliary.map(|coordinate| coordinate as f32),
            velocity: wire(velocity),
            acceleration: wire(acceleration),
            approximation: wire(self.zone_mm * 100.0),
            tool: self.tool,
            base: self.base,
        }
    }
}

/// The nearest number that the wire can carry.
fn wire(value: f64) -> u16 {
    value.round().clamp(0.0, f64::from(u16::MAX)) as u16
}
