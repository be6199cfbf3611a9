//! The reports of both nodes.

use ::node::report::NodeReport;
use ::node::role::NodeRole;

use records::conditions::Counts;

/// The last reports of both nodes.
#[derive(Clone, PartialEq, Default, Debug)]
pub struct Reports {
    /// The PLC's.
    pub plc: NodeReport,
    /// The robot's; empty if the robot is not one of our nodes.
    pub robot: NodeReport,
}

/// The first reports of a run.
#[derive(Clone, Default, Debug)]
pub(super) struct FirstReports {
    pub(super) with: Reports,
    /// Whether those of PLC and robot are still to come.
    pub(super) is_awaited: [bool; 2],
    /// Reports of PLC and robot that were asked for earlier, and come before those.
    pub(super) earlier: [u32; 2],
}

impl Reports {
    pub(super) fn since(&self, before: &Self) -> Self {
        Self { plc: self.plc.since(&before.plc), robot: self.robot.since(&before.robot) }
    }

    pub(super) const fn of(&mut self, role: NodeRole) -> &mut NodeReport {
        match role {
            NodeRole::Plc => &mut self.plc,
            NodeRole::Robot => &mut self.robot,
        }
    }

    pub(super) const fn counts(&self) -> Counts {
        let Self { plc, robot } = self;
        Counts {
            missed: [plc.cycle.missed, robot.cycle.missed],
            runs: [plc.cycle.runs, robot.cycle.runs],
            bus: [plc.bus, robot.bus],
            images: [plc.images, robot.images],
        }
    }
}
