//! A cell whose application is planned: what a virtual run executes, and what its repetitions are compared with.

use planning::{Application, CompactPath, Plan, Stop, ToStart};
use protocol::image::Motion;
use robot_node::RobotConfig;
use setup::Setup;

/// The robot in its cell and the motions of an application.
#[derive(Clone, Debug)]
pub struct PlannedCell {
    /// The application's name.
    pub name: String,
    /// The robot in its cell.
    pub robot: RobotConfig,
    /// The motions of all types.
    pub motions: Vec<Motion>,
    /// The same as compact points, where CM sends these.
    pub points: Option<CompactPath>,
    /// Where their continuous motions end.
    pub stops: Vec<Stop>,
    /// How the arm gets to their start.
    pub to_start: ToStart<Motion>,
}

impl PlannedCell {
    /// Plans an application on a setup.
    ///
    /// # Errors
    ///
    /// The application cannot be planned, the setup describes no robot, or the arm does not reach the start.
    pub fn of(setup: &Setup, application: &Application) -> anyhow::Result<Self> {
        Self::of_plan(setup, application, &planning::plan(application, setup)?)
    }

    /// Takes a plan of an application, which may have other motions than [`planning::plan`] gives.
    ///
    /// # Errors
    ///
    /// The setup describes no robot, or the arm does not reach the start.
    pub fn of_plan(setup: &Setup, application: &Application, plan: &Plan) -> anyhow::Result<Self> {
        let to_start = plan.wire_to_start(setup);
        Ok(Self {
            name: plan.name.clone(),
            robot: RobotConfig::from_setup(setup)?.in_cell_of(application, &to_start)?,
            motions: plan.wire_motions(setup),
            points: plan.wire_points(setup)?,
            stops: plan.stops(),
            to_start,
        })
    }
}
