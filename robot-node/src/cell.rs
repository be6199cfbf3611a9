//! The robot in the cell of an application: what stands around it, and whether it can stand where the application starts.

use planning::{Application, ToStart};
use protocol::image::Motion;

use crate::RobotConfig;
use crate::arm::{Frame, Surface, Violation};
use crate::motion::Segment;

/// The arm cannot stand where an application starts.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
#[error(
    "application {application}: start: the arm cannot stand at frame `{frame}`: {found}; change that frame, or base \
     {base} in the setup"
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
    /// The same robot in the cell of an application: with its surfaces around. `to_start` is how the PLC moves the arm to
    /// where the application starts.
    ///
    /// # Errors
    ///
    /// The arm cannot get there from where it stands at power-on.
    pub fn in_cell_of(
        mut self,
        application: &Application,
        to_start: &ToStart<Motion>,
    ) -> Result<Self, StartOutOfReach> {
        let start = to_start.from_anywhere.as_ref();
        start.map_or(Ok(()), |start| Segment::prepare(start, &self.home, &self).map(drop)).map_err(
            |found| StartOutOfReach {
                application: application.name.clone(),
                frame: application.start.0.name.clone(),
                found,
                base: application.base,
            },
        )?;
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
}
