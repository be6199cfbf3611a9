//! The arm, and the cell that it stands in.

use planning::Application;
use robot_node::RobotConfig;
use robot_node::arm::Frame;
use serde::Serialize;
use setup::Setup;

use super::cell::Cell;
use super::chain::Chain;

/// What a page draws besides the recordings.
#[derive(Serialize, Debug)]
pub(crate) struct Scene {
    pub(super) arm: Chain,
    pub(super) cell: Cell,
    #[serde(skip)]
    axes: usize,
}

impl Scene {
    /// Returns the arm of a setup and what stands around it; the error is a sentence.
    pub(crate) fn of(setup: &Setup, application: &Application) -> Result<Self, String> {
        let robot =
            RobotConfig::from_setup(setup).map_err(|error| format!("The setup describes no arm: {error}"))?;
        let plan = planning::plan(application, setup)
            .map_err(|error| format!("The application cannot be planned on this setup: {error}"))?;
        let motions = plan.wire_motions(setup);
        let frame = |frames: &[Option<Frame>; 16], number: Option<u8>| {
            number.and_then(|number| *frames.get(usize::from(number))?).unwrap_or(Frame::IDENTITY)
        };
        let tool = frame(&robot.tools, motions.first().map(|motion| motion.tool));
        let base = frame(&robot.bases, Some(application.base));
        Ok(Self {
            arm: Chain::of(setup, &tool),
            cell: Cell::of(application, &base, &motions),
            axes: robot.arm.axes(),
        })
    }

    /// Returns the number of the arm's joints.
    pub(crate) const fn axes(&self) -> usize {
        self.axes
    }
}
