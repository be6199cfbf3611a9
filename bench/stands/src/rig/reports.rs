//! The reports of all nodes.

use ::node::report::NodeReport;

use super::rig_node::RigNode;
use records::conditions::Counts;

/// The last reports of all nodes.
#[derive(Clone, PartialEq, Default, Debug)]
pub struct Reports {
    /// The PLC's.
    pub plc: NodeReport,
    /// The robots', in the order of their stations; empty for a robot that is not one of our nodes.
    pub robots: Vec<NodeReport>,
}

/// The first reports of a run.
#[derive(Clone, Default, Debug)]
pub(super) struct FirstReports {
    pub(super) with: Reports,
    /// For each node, true until its report has come.
    pub(super) is_awaited: Vec<bool>,
    /// Reports of each node that were asked for earlier, and come before those.
    pub(super) earlier: Vec<u32>,
}

impl Reports {
    /// Returns empty reports of so many robots.
    pub(super) fn of_robots(robots: usize) -> Self {
        Self { plc: NodeReport::default(), robots: vec![NodeReport::default(); robots] }
    }

    pub(super) fn since(&self, before: &Self) -> Self {
        let robots = self.robots.iter().zip(&before.robots);
        Self {
            plc: self.plc.since(&before.plc),
            robots: robots.map(|(now, before)| now.since(before)).collect(),
        }
    }

    /// Returns the report of the first robot.
    #[must_use]
    pub fn robot(&self) -> NodeReport {
        self.robots.first().cloned().unwrap_or_default()
    }

    /// Takes the report of a node.
    pub(super) fn take(&mut self, node: RigNode, report: &NodeReport) {
        let place = match node {
            RigNode::Plc => Some(&mut self.plc),
            RigNode::Robot(station) => self.robots.get_mut(station),
        };
        place.into_iter().for_each(|place| report.clone_into(place));
    }

    /// Returns the counts of the PLC and of a robot.
    pub(super) fn counts(&self, station: usize) -> Counts {
        let (plc, none) = (&self.plc, NodeReport::default());
        let robot = self.robots.get(station).unwrap_or(&none);
        Counts {
            missed: [plc.cycle.missed, robot.cycle.missed],
            runs: [plc.cycle.runs, robot.cycle.runs],
            bus: [plc.bus, robot.bus],
            images: [plc.images, robot.images],
        }
    }
}
