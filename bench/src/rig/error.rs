//! What can go wrong with the rig, and what to do about it.

use std::fmt;
use std::io;
use std::process::ExitStatus;
use std::time::Duration;

use plc_node::ExecutionType;
use protocol_linux::namespace::NamespaceError;
use protocol_linux::{InterfaceError, RecorderError};

use crate::exit::Exit;

/// One of the two nodes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Which {
    /// The PLC's.
    Plc,
    /// The robot's.
    Robot,
}

impl fmt::Display for Which {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Plc => "plc-node",
            Self::Robot => "robot-node",
        })
    }
}

/// Why the rig does not run, or no longer.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The host does not let this user make networks.
    #[error("{0}; `--mode virtual` needs none of this")]
    Namespace(#[from] NamespaceError),
    /// The new interfaces cannot be set up.
    #[error("setting up the cable between the nodes: {0}")]
    Interface(#[from] InterfaceError),
    /// The capture cannot be made.
    #[error(transparent)]
    Capture(#[from] RecorderError),
    /// A node cannot be started.
    #[error("cannot start the {which}: {source}")]
    Spawn {
        /// Which node.
        which: Which,
        /// What the system said.
        source: io::Error,
    },
    /// A node ended that should not have.
    #[error("the {which} ended{}{}", status.map_or_else(String::new, |status| format!(" ({status})")), quoted(last_words))]
    NodeEnded {
        /// Which node.
        which: Which,
        /// How it ended, if it could be found out.
        status: Option<ExitStatus>,
        /// What it last wrote on standard error.
        last_words: Vec<String>,
    },
    /// No connection came about.
    #[error("the PLC found no robot that was ready within {} s: {reason}{}", waited.as_secs(), quoted(last_words))]
    NotConnected {
        /// For how long it tried.
        waited: Duration,
        /// What the PLC said of it last.
        reason: String,
        /// What both nodes last wrote on standard error.
        last_words: Vec<String>,
    },
    /// The connection was there and is gone.
    #[error("the connection between the nodes was lost; the {seen_by} says: {reason}")]
    ConnectionLost {
        /// Who said so first.
        seen_by: Which,
        /// What it said.
        reason: String,
    },
    /// The PLC says that a run failed.
    #[error("{execution_type} failed: {reason}")]
    RunFailed {
        /// How the sequence was to be run.
        execution_type: ExecutionType,
        /// What the PLC said.
        reason: String,
    },
    /// A node hangs.
    #[error("the {which} runs but has not answered for {} s: is the host overloaded, or the node stopped?", waited.as_secs())]
    NoAnswer {
        /// Which node.
        which: Which,
        /// For how long it was waited.
        waited: Duration,
    },
    /// A node says what no node says.
    #[error("the {which} said `{line}`, which is no message: are bench and node of one build?")]
    Gibberish {
        /// Which node.
        which: Which,
        /// What it said.
        line: String,
    },
}

impl RigError {
    /// The code with which the bench ends for it.
    #[must_use]
    pub fn exit(&self) -> Exit {
        // Exit code 5 of a node says that the host lacks what it needs.
        let unusable = |status: &ExitStatus| status.code() == Some(Exit::EnvironmentUnusable as i32);
        match self {
            Self::Namespace(_) | Self::Interface(_) | Self::Spawn { .. } | Self::NotConnected { .. } => {
                Exit::EnvironmentUnusable
            }
            Self::NodeEnded { status, .. } if status.as_ref().is_some_and(unusable) => {
                Exit::EnvironmentUnusable
            }
            Self::Capture(_) => Exit::Internal,
            Self::NodeEnded { .. }
            | Self::ConnectionLost { .. }
            | Self::RunFailed { .. }
            | Self::NoAnswer { .. }
            | Self::Gibberish { .. } => Exit::RunFailed,
        }
    }
}

fn quoted(last_words: &[String]) -> String {
    if last_words.is_empty() { String::new() } else { format!("; it said: {}", last_words.join(" / ")) }
}
