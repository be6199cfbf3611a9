//! A node as the rig speaks with it, whoever started it.

use ::node::message::Instruction;
use serde::Serialize;

use super::RigError;
use super::attached_node::AttachedNode;
use super::node_process::NodeProcess;

#[derive(Debug)]
pub(super) enum Node {
    /// Started by the rig.
    Process(NodeProcess),
    /// Found running.
    Attached(AttachedNode),
}

impl Node {
    /// Tells the node something. If it cannot hear, that is told by [`super::node_process::NodeEvent::Ended`].
    pub(super) async fn tell<O: Serialize>(&mut self, instruction: &Instruction<O>) {
        match self {
            Self::Process(node) => node.tell(instruction).await,
            Self::Attached(node) => node.tell(instruction).await,
        }
    }

    pub(super) const fn has_ended(&self) -> bool {
        match self {
            Self::Process(node) => node.has_ended(),
            Self::Attached(node) => node.has_ended(),
        }
    }

    /// What the node last wrote on standard error, where the rig hears that.
    pub(super) fn last_stderr(&self) -> Vec<String> {
        match self {
            Self::Process(node) => node.last_stderr(),
            Self::Attached(_) => Vec::new(),
        }
    }

    /// How it ended.
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

    /// The process number, while it runs, of one that the rig started.
    pub(super) fn id(&self) -> Option<u32> {
        match self {
            Self::Process(node) => node.id(),
            Self::Attached(_) => None,
        }
    }
}
