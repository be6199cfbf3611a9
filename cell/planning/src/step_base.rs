//! The base of a step: frames are given in it, and planned in the application's base, in which obstacles and blends are.

use arm::Frame;
use setup::Setup;

use crate::application::{Application, Place, Step};
use crate::geometry::Pose;

/// Where a step's base is in the application's; nothing where both are the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepBase(Option<Frame>);

impl StepBase {
    /// Finds the base of a step on a robot. One that the robot does not have is refused while planning.
    pub(crate) fn of(step: &Step, application: &Application, setup: &Setup) -> Self {
        let Some(number) = step.base.filter(|number| *number != application.base) else { return Self(None) };
        let frame = |number| match number {
            0 => Some(Frame::from_mm_deg([0.0; 6])),
            _ => {
                let listed = setup.robot.bases.iter().find(|base| base.number == number);
                listed.map(|base| Frame::from_mm_deg(base.mm_deg.value))
            }
        };
        let common = frame(application.base);
        Self(common.zip(frame(number)).map(|(common, own)| common.inverse() * own))
    }

    /// Returns the pose of a place of the step in the application's base, in a cell of the grids.
    pub(crate) fn pose(self, application: &Application, place: &Place, cell: usize) -> Pose {
        let pose = application.pose(place, cell);
        match self.0 {
            None => pose,
            Some(base) => Pose::new((base * Frame::from_mm_deg(pose.mm_deg())).to_mm_deg()),
        }
    }

    /// Returns a direction of the step along the axes of the application's base.
    pub(crate) fn direction(self, direction: [f64; 3]) -> [f64; 3] {
        self.0.map_or(direction, |base| base.rotation.rotate(direction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{APPLICATIONS, Plan, plan};

    /// Setup A with a fixture as base 2: 300 mm along the table's x axis, turned by 90° about its z axis.
    fn with_fixture() -> Setup {
        let mut setup = setup::setup("A").unwrap();
        let mut fixture = setup.robot.bases[0].clone();
        fixture.number = 2;
        fixture.mm_deg.value = [300.0, 150.0, 25.0, 180.0, 0.0, 0.0];
        setup.robot.bases.push(fixture);
        setup
    }

    fn planned(text: &str) -> Plan {
        plan(&Application::parse("my.toml", text).unwrap(), &with_fixture()).unwrap()
    }

    /// Returns pick and place with its assembly in the base of the fixture.
    fn in_fixture() -> String {
        let text = APPLICATIONS[0].1.replace("table = 1", "table = 1\nfixture = 2");
        let text = text.replace("[300.0, 0.0, 0.0, 0.0, 0.0, 180.0]", "[0.0, 0.0, 0.0, -90.0, 0.0, 180.0]");
        ["C", "D"].iter().fold(text, |text, step| {
            text.replace(&format!("name = \"{step}\""), &format!("name = \"{step}\"\nbase = \"fixture\""))
        })
    }

    #[test]
    fn a_step_in_a_base_of_its_own_moves_as_one_whose_frames_were_converted_by_hand() {
        let (wanted, found) = (planned(APPLICATIONS[0].1), planned(&in_fixture()));
        assert!(found.unused.is_empty(), "{:?}", found.unused);
        assert_eq!(found.motions.len(), wanted.motions.len());
        for (found, wanted) in found.motions.iter().zip(&wanted.motions) {
            assert_eq!((&found.name, found.base, found.zone_mm), (&wanted.name, wanted.base, wanted.zone_mm));
            let off = (found.target.point - wanted.target.point).length();
            assert!(off < 1e-9 && found.target.turn_deg(wanted.target) < 1e-3, "{found:?}, {wanted:?}");
        }
    }

    #[test]
    fn a_force_is_along_the_axes_of_the_steps_base() {
        let setup = with_fixture();
        let application = Application::parse("my.toml", &in_fixture()).unwrap();
        let step = application.steps.iter().find(|step| step.name == "C").unwrap();
        let [x, y, z] = StepBase::of(step, &application, &setup).direction([10.0, 0.0, -25.0]);
        assert!(x.abs() < 1e-9 && (y - 10.0).abs() < 1e-9 && (z + 25.0).abs() < 1e-9, "{x} {y} {z}");
    }

    #[test]
    fn a_base_of_a_step_that_does_not_exist_is_refused_by_its_name_and_one_that_the_robot_lacks_by_its_number()
     {
        let unknown = APPLICATIONS[0].1.replace("name = \"C\"", "name = \"C\"\nbase = \"tabel\"");
        insta::assert_snapshot!(Application::parse("my.toml", &unknown).unwrap_err(), @"");
        let application = Application::parse("my.toml", &in_fixture()).unwrap();
        insta::assert_snapshot!(plan(&application, &setup::setup("A").unwrap()).unwrap_err(), @"");
    }
}
