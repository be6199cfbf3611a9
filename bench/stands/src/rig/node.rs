//! A node from the rig's point of view, no matter who started it.

use ::node::message::Instruction;
use serde::Serialize;

use super::RigError;
use super::attached_node::AttachedNode;
use super::node_process::NodeProcess;

#[derive(Debug)]
pub(super) enum Node {
    /// Started by the rig.
    Process(NodeProcess),
    /// Already running.
    Attached(AttachedNode),
}

impl Node {
    /// Sends the node an instruction. If that fails, [`super::node_process::NodeEvent::Ended`] reports it.
    pub(super) async fn send<O: Serialize>(&mut self, instruction: &Instruction<O>) {
        match self {
            Self::Process(node) => node.send(instruction).await,
            Self::Attached(node) => node.send(instruction).await,
        }
    }

    pub(super) const fn has_ended(&self) -> bool {
        match self {
            Self::Process(node) => node.has_ended(),
            Self::Attached(node) => node.has_ended(),
        }
    }

    /// Returns the node's last lines on standard error, if the rig reads it.
    pub(super) fn last_stderr(&self) -> Vec<String> {
        match self {
            Self::Process(node) => node.last_stderr(),
            Self::Attached(_) => Vec::new(),
        }
    }

    /// Returns the error that describes how it ended.
    pub(super) async fn end_error(&mut self) -> RigError {
        match self {
            Self::Process(node) => node.end_error().await,
            Self::Attached(node) => node.end_error(),
        }
    }

    /// Kills a node that the rig started.
    pub(super) fn kill(&mut self) {
        if let Self::Process(node) = self {
            node.kill();
        }
    }
}
