//! The robot in the cell of an application: the surfaces around it, and whether the arm reaches the start of the
//! application.

use planning::{Application, OrBase, ToStart};
use protocol::image::Motion;

use crate::RobotConfig;
use crate::arm::{Frame, Frames, Joints, Surface, Violation};
use crate::motion::Segment;

/// The arm cannot stand where an application starts.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
#[error(
    "application {application}: start: the arm cannot stand at frame `{frame}`: {found}; change that frame{}",
    OrBase(*base)
)]
pub struct StartOutOfReach {
    /// The application's name.
    pub application: String,
    /// The name of the frame at which it starts.
    pub frame: String,
    /// Which quantity is beyond which limit.
    pub found: Violation,
    /// The number of the base in which the frame stands.
    pub base: u8,
}

impl RobotConfig {
    /// Places the robot in the cell of an application, with the surfaces there. `to_start` is how the PLC moves the arm
    /// to where the application starts.
    ///
    /// # Errors
    ///
    /// The arm cannot get there from where it stands at power-on.
    pub fn in_cell_of(
        mut self,
        application: &Application,
        to_start: &ToStart<Motion>,
    ) -> Result<Self, StartOutOfReach> {
        let out_of_reach = |found| StartOutOfReach {
            application: application.name.clone(),
            frame: application.start.0.name.clone(),
            found,
            base: application.base,
        };
        if let Some(start) = &to_start.from_anywhere {
            if self.home_is_open {
                self.home = self.at_start(start).map_err(out_of_reach)?;
            }
            Segment::prepare(start, &self.home, &self).map_err(out_of_reach)?;
        }
        let base = self.bases.get(usize::from(application.base)).copied().flatten();
        let base = base.unwrap_or(Frame::IDENTITY);
        self.surfaces = application
            .surfaces
            .iter()
            .map(|surface| Surface {
                point: base.point(surface.middle.coordinates()),
                normal: base.rotation.rotate(surface.normal.coordinates()),
                radius_mm: surface.radius_mm.unwrap_or(f64::INFINITY),
                stiffness_n_per_mm: surface.stiffness_n_per_mm,
            })
            .collect();
        Ok(self)
    }

    /// Returns the joints in which the arm stands at the target of a point-to-point motion.
    fn at_start(&self, start: &Motion) -> Result<Joints, Violation> {
        let target = start.target.map(f64::from);
        if start.kind.has_joint_target() {
            let axes = self.arm.axes();
            return Ok(core::array::from_fn(|axis| if axis < axes { target[axis] } else { 0.0 }));
        }
        let frame = |frames: &Frames, number: u8| frames.get(usize::from(number)).copied().flatten();
        let tool = frame(&self.tools, start.tool).ok_or(Violation::Tool(start.tool))?;
        let base = frame(&self.bases, start.base).ok_or(Violation::Base(start.base))?;
        let flange = base * Frame::from_mm_deg(target) * tool.inverse();
        match start.configuration {
            Some(configuration) => self.arm.inverse_in(&flange, configuration, &self.arm.middle()),
            None => self.arm.stand_at(&flange),
        }
    }
}
