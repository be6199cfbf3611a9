//! What can go wrong with the rig, and what to do about it.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::process::ExitStatus;
use std::time::Duration;

use plc_node::ExecutionType;
use protocol_linux::namespace::NamespaceError;
use protocol_linux::{InterfaceError, PortError, RecorderError};

use crate::output::exit::{Exit, Failure};

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
    #[error("{reason}; `--mode virtual` needs none of this")]
    Namespace {
        /// What the host refused, and what to enable.
        reason: NamespaceError,
    },
    /// The new interfaces cannot be set up.
    #[error(transparent)]
    Interface(#[from] InterfaceError),
    /// The capture cannot be made.
    #[error(transparent)]
    Capture(#[from] RecorderError),
    /// What does the faults gets no sockets.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A node cannot be started.
    #[error("cannot start the {which}: {reason}")]
    Spawn {
        /// Which node.
        which: Which,
        /// What the system said.
        reason: io::Error,
    },
    /// A node ended that should not have.
    #[error("the {which} ended{}{}", status.map_or_else(String::new, |status| format!(" ({status})")), quoted(last_stderr))]
    NodeEnded {
        /// Which node.
        which: Which,
        /// How it ended, if it could be found out.
        status: Option<ExitStatus>,
        /// What it last wrote on standard error.
        last_stderr: Vec<String>,
    },
    /// A node that somebody else was to start is not there.
    #[error(
        "no {which} answers at {address} within {} s: {reason}; is it running with `--control`, on that address and \
         port?",
        waited.as_secs()
    )]
    Unreachable {
        /// Which node.
        which: Which,
        /// Host and port.
        address: String,
        /// For how long it was tried.
        waited: Duration,
        /// What the system said last.
        reason: String,
    },
    /// A node that runs has another controller.
    #[error("the {which} is controlled by {controller} already: end that one first")]
    Busy {
        /// Which node.
        which: Which,
        /// Who has it.
        controller: SocketAddr,
    },
    /// The connection to a node that runs is gone.
    #[error("the {which} at {address} went away or closed the connection; what it printed says why")]
    Detached {
        /// Which node.
        which: Which,
        /// Host and port.
        address: String,
    },
    /// What runs there is not what the bench was asked to measure.
    #[error("at {address} runs a {found}, but {wanted} is wanted")]
    Other {
        /// Host and port.
        address: String,
        /// Which node, and its setup.
        found: String,
        /// What was asked for.
        wanted: String,
    },
    /// No connection came about.
    #[error("the PLC found no robot that was ready within {} s: {reason}{}", waited.as_secs(), quoted(last_stderr))]
    NotConnected {
        /// For how long it tried.
        waited: Duration,
        /// What the PLC said of it last.
        reason: String,
        /// What both nodes last wrote on standard error.
        last_stderr: Vec<String>,
    },
    /// The connection was there and is gone.
    #[error("the connection between the nodes was lost; the {seen_by} says: {reason}")]
    ConnectionLost {
        /// Who said so first.
        seen_by: Which,
        /// What it said.
        reason: String,
    },
    /// The host did not run a node for about as long as its peer bears no frame.
    #[error(
        "{error}; the host held the {which} up for {} ms: `bench doctor` measures how it runs programs, and a higher \
         bus.watchdog_cycles in a setup of your own bears more",
        held.as_millis()
    )]
    HeldUp {
        /// The node that was held up longest.
        which: Which,
        /// For how long.
        held: Duration,
        /// What came of it.
        error: Box<RigError>,
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
    UnreadableLine {
        /// Which node.
        which: Which,
        /// What it said.
        line: String,
    },
}

// Not `#[from]`: that would make it the source too, and whoever prints the chain would print it twice.
impl From<NamespaceError> for RigError {
    fn from(reason: NamespaceError) -> Self {
        Self::Namespace { reason }
    }
}

impl RigError {
    /// The code with which the bench ends for it.
    #[must_use]
    pub fn exit(&self) -> Exit {
        // Exit code 5 of a node says that the host lacks what it needs.
        let unusable = |status: &ExitStatus| status.code() == Some(Exit::EnvironmentUnusable as i32);
        match self {
            Self::Namespace { .. }
            | Self::Interface(_)
            | Self::Port(_)
            | Self::Spawn { .. }
            | Self::NotConnected { .. }
            | Self::Unreachable { .. }
            | Self::Busy { .. } => Exit::EnvironmentUnusable,
            Self::Other { .. } => Exit::Usage,
            Self::NodeEnded { status, .. } if status.as_ref().is_some_and(unusable) => {
                Exit::EnvironmentUnusable
            }
            Self::Capture(_) => Exit::Internal,
            Self::NodeEnded { .. }
            | Self::Detached { .. }
            | Self::ConnectionLost { .. }
            | Self::HeldUp { .. }
            | Self::RunFailed { .. }
            | Self::NoAnswer { .. }
            | Self::UnreadableLine { .. } => Exit::RunFailed,
        }
    }
}

fn quoted(last_stderr: &[String]) -> String {
    if last_stderr.is_empty() { String::new() } else { format!("; it said: {}", last_stderr.join(" / ")) }
}

impl From<RigError> for Failure {
    fn from(error: RigError) -> Self {
        Self::new(error.exit(), error)
    }
}
