//! A robot of a rig: its node, its connection, and what was reported of it in the current run.

use ::node::role::NodeRole;
use machine::Instant;
use plc_node::{Execution, MarkPassage};
use protocol::fieldbus::Counters;
use records::conditions::ReportedSkills;

use super::node::Node;
use super::rig_node::NodeName;

/// A robot of a rig.
#[derive(Debug, Default)]
pub(super) struct RigRobot {
    /// Its station; `None` for the only robot.
    pub(super) station: Option<String>,
    /// `None` if the robot is not one of our nodes, or is not there yet.
    pub(super) node: Option<Node>,
    /// The connection is up by the PLC.
    pub(super) is_up_by_plc: bool,
    /// The connection is up by the robot.
    pub(super) is_up: bool,
    /// Identity that the robot reported, by the PLC.
    pub(super) identity: Option<String>,
    /// The robot node's reports on its skills in the current run, or in the last one.
    pub(super) skills: ReportedSkills,
    /// Marks that the arm passed in it.
    pub(super) passages: Vec<MarkPassage>,
    /// The PLC's report of it.
    pub(super) finished: Option<Execution>,
    /// Its cyclic frames in all runs so far, by the PLC's count.
    pub(super) frames: Counters,
}

impl RigRobot {
    /// Returns a robot without a node.
    pub(super) fn of(station: Option<String>) -> Self {
        Self { station, ..Self::default() }
    }

    /// Returns its name in messages.
    pub(super) fn name(&self) -> NodeName {
        NodeName { role: NodeRole::Robot, station: self.station.clone() }
    }

    /// Returns whether the connection is up, by each of our nodes.
    pub(super) const fn is_connected(&self) -> bool {
        self.is_up_by_plc && (self.is_up || self.node.is_none())
    }

    /// Forgets the last run.
    pub(super) fn begin_run(&mut self) {
        (self.skills, self.finished) = (ReportedSkills::default(), None);
        self.passages.clear();
    }

    /// Takes the PLC's report of the run.
    pub(super) fn finish(&mut self, run: Execution) {
        if let Some(after) = run.after {
            self.skills.begin_after(after);
        }
        self.frames = self.frames + run.frames;
        self.finished = Some(run);
    }

    /// Notes that the arm has passed a mark.
    pub(super) fn pass(&mut self, mark: u32, came_ns: u64, passed_ns: u64) {
        let [came, passed] = [came_ns, passed_ns].map(Instant::from_nanos);
        self.passages.push(MarkPassage { mark, came, passed: Some(passed) });
    }
}
