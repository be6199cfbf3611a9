//! Reports that the rig asks its nodes for.

use ::node::message::Instruction;
use ::node::report::NodeReport;
use robot_node::process::RobotInstruction;
use tokio::time::timeout;

use super::messages::ANSWER;
use super::rig_node::RigNode;
use super::{Rig, RigError};

impl Rig {
    /// Asks all nodes for a report and waits for it.
    pub(super) async fn ask_for_reports(&mut self) -> Result<(), RigError> {
        self.request_reports().await;
        let all = async {
            while self.awaited.iter().any(|awaited| *awaited > 0) {
                self.next_event().await?;
            }
            Ok(())
        };
        let answered = timeout(ANSWER, all).await;
        answered.unwrap_or_else(|_| {
            let silent = self.nodes().find(|node| self.awaited.get(node.index()).is_some_and(|it| *it > 0));
            Err(RigError::NoAnswer { node: self.name(silent.unwrap_or(RigNode::Plc)), waited: ANSWER })
        })
    }

    /// Asks all nodes for a report without waiting for it.
    pub(super) async fn request_reports(&mut self) {
        for id in self.nodes() {
            if let Some(node) = self.node(id).filter(|node| !node.has_ended()) {
                node.send(&Instruction::<RobotInstruction>::Report).await;
                self.await_report(id);
            }
        }
    }

    /// Notes that a node was asked for its report.
    pub(super) fn await_report(&mut self, id: RigNode) {
        self.awaited.get_mut(id.index()).into_iter().for_each(|awaited| *awaited += 1);
    }

    /// Takes the report of a node.
    pub(super) fn take_report(&mut self, id: RigNode, report: &NodeReport) {
        let index = id.index();
        self.awaited.get_mut(index).into_iter().for_each(|awaited| *awaited = awaited.saturating_sub(1));
        let first = &mut self.first_reports;
        if let Some(earlier) = first.earlier.get_mut(index).filter(|earlier| **earlier > 0) {
            *earlier -= 1;
        } else if first.is_awaited.get_mut(index).is_some_and(std::mem::take) {
            first.with.take(id, report);
        }
        self.reports.take(id, report);
    }
}
