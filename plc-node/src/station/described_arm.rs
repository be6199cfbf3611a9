//! The arm that the setup describes, and how a robot shows that it is that arm: the setup knows where joints bring the tool. A name and
//! an address do not tell, since any robot can have them, and those of one maker share an identity.

use arm::{Arm, Frame, Frames, Installation, Joints};
use protocol::image::Feedback;
use setup::Setup;

use crate::function_blocks::{is_at_rest, is_ready};

/// Distance that a robot's own figures may be from those of a setup, in mm. Assumed: lengths of datasheets are rounded, and tools are
/// measured anew on each robot.
const ALLOWED_MM: f64 = 10.0;

/// Angle that a robot's own figures may be from those of a setup, in degrees. Assumed, for the same reasons.
const ALLOWED_DEG: f64 = 2.0;

/// The arm of a setup, with the tools and bases in which it may report its pose.
#[derive(Clone, Debug)]
pub struct DescribedArm {
    arm: Arm,
    tools: Frames,
    bases: Frames,
}

/// Distance and angle between a robot's pose and the one to which its joints would bring the arm of the setup.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct PoseDifference {
    /// Distance of the positions in mm.
    pub mm: f64,
    /// Angle between the orientations in degrees.
    pub deg: f64,
}

impl DescribedArm {
    /// Returns the arm of a setup; `None` if the setup does not describe one.
    #[must_use]
    pub fn from_setup(setup: &Setup) -> Option<Self> {
        let Installation { arm, tools, bases, .. } = Installation::from_setup(setup).ok()?;
        Some(Self { arm, tools, bases })
    }

    /// Returns the difference to a robot that is another arm, with the tool and base for which it is least. `None` if the robot fits,
    /// or does not report joints or a pose.
    fn difference(&self, feedback: &Feedback) -> Option<PoseDifference> {
        let Feedback { joints, pose, .. } = feedback;
        if [joints, pose].into_iter().any(|values| values.iter().all(|value| *value == 0.0)) {
            return None;
        }
        let joints: Joints = joints.map(f64::from);
        let reported = Frame::from_mm_deg(pose.map(f64::from));
        let flange = self.arm.forward(&joints);
        let mut nearest: Option<PoseDifference> = None;
        for base in self.bases.iter().flatten() {
            for tool in self.tools.iter().flatten() {
                let [mm, deg] = reported.offset_to(&(base.inverse() * (flange * *tool)));
                let difference = PoseDifference { mm, deg };
                if difference.is_allowed() {
                    return None;
                }
                if nearest.is_none_or(|nearest| difference.mm < nearest.mm) {
                    nearest = Some(difference);
                }
            }
        }
        nearest
    }
}

impl PoseDifference {
    /// Returns whether the figures of one arm may differ so far. What is not a number may not.
    fn is_allowed(self) -> bool {
        self.mm <= ALLOWED_MM && self.deg <= ALLOWED_DEG
    }
}

/// The check of a station's robot against the arm of the setup.
#[derive(Debug)]
pub(super) struct ArmCheck {
    /// The arm that the robot should be; `None` if that is not known.
    described: Option<DescribedArm>,
    found: FoundArm,
}

/// Result of the check on this connection.
#[derive(Clone, Copy, PartialEq, Debug)]
enum FoundArm {
    Nothing,
    /// It is the arm of the setup.
    Described,
    /// It is another one.
    Other(PoseDifference),
}

impl ArmCheck {
    pub(super) const fn new(described: Option<DescribedArm>) -> Self {
        Self { described, found: FoundArm::Nothing }
    }

    /// Begins anew: the next robot may be another one.
    pub(super) const fn forget(&mut self) {
        self.found = FoundArm::Nothing;
    }

    /// Returns whether the robot has shown that it is the arm of the setup, or nobody knows that arm.
    pub(super) fn is_passed(&self) -> bool {
        self.described.is_none() || matches!(self.found, FoundArm::Described)
    }

    /// Returns the difference to a robot that is another arm.
    pub(super) const fn other(&self) -> Option<PoseDifference> {
        match self.found {
            FoundArm::Other(difference) => Some(difference),
            FoundArm::Nothing | FoundArm::Described => None,
        }
    }

    /// Looks at a robot that stands, until it is the arm of the setup: while one moves, joints and pose may be of different instants.
    pub(super) fn look(&mut self, feedback: Option<&Feedback>) {
        if self.is_passed() {
            return;
        }
        let resting = feedback.filter(|feedback| is_at_rest(feedback) || is_ready(feedback));
        if let (Some(described), Some(feedback)) = (&self.described, resting) {
            self.found = described.difference(feedback).map_or(FoundArm::Described, FoundArm::Other);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn described(setup: &str) -> DescribedArm {
        DescribedArm::from_setup(&setup::setup(setup).unwrap()).unwrap()
    }

    /// Returns what a robot of a setup reports with these joints and its last tool in its last base.
    fn report(arm: &DescribedArm, joints: Joints) -> Feedback {
        let last = |frames: &Frames| frames.iter().flatten().next_back().copied().unwrap();
        let pose = last(&arm.bases).inverse() * (arm.arm.forward(&joints) * last(&arm.tools));
        Feedback {
            joints: joints.map(|joint| joint as f32),
            pose: pose.to_mm_deg().map(|value| value as f32),
            ..Feedback::default()
        }
    }

    #[test]
    fn each_arm_fits_its_own_setup_in_any_joints_and_no_other_arm_does() {
        let arms = ["A", "B", "C", "D"].map(described);
        for joints in [[10.0, -70.0, 60.0, 20.0, 40.0, -30.0], [-50.0, -100.0, 100.0, 0.0, 90.0, 0.0]] {
            let joints_of = |arm: &DescribedArm| {
                let mut joints = joints;
                joints.iter_mut().skip(arm.arm.axes()).for_each(|joint| *joint = 0.0);
                joints
            };
            for (index, arm) in arms.iter().enumerate() {
                let report = report(arm, joints_of(arm));
                for (other_index, other) in arms.iter().enumerate() {
                    // Setups A and C have the same arm.
                    let is_same = index % 2 == 0 && other_index % 2 == 0 || index == other_index;
                    assert_eq!(other.difference(&report).is_none(), is_same, "{index} {other_index}");
                }
            }
        }
    }

    #[test]
    fn a_robot_that_does_not_report_joints_or_a_pose_is_not_compared() {
        let [arm, other] = ["A", "B"].map(described);
        let report = report(&arm, [10.0, 20.0, 30.0, 40.0, 0.0, 0.0]);
        assert!(other.difference(&report).is_some());
        assert_eq!(other.difference(&Feedback { joints: [0.0; 6], ..report }), None);
        assert_eq!(other.difference(&Feedback { pose: [0.0; 6], ..report }), None);
    }

    #[test]
    fn a_pose_that_is_no_number_fits_no_arm() {
        let arm = described("B");
        let mut report = report(&arm, [10.0; 6]);
        report.pose[2] = f32::NAN;
        assert!(arm.difference(&report).is_some());
    }
}
