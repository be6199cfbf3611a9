//! Errors of the rig, each with what to do about it.

use std::io;
use std::net::SocketAddr;
use std::process::ExitStatus;
use std::time::Duration;

use node::message::PROTOCOL;
use node::role::NodeRole;
use plc_node::ExecutionType;
use protocol_linux::namespace::NamespaceError;
use protocol_linux::{InterfaceError, PortError, RecorderError};

use super::rig_node::NodeName;
use super::silence::{SilentNode, in_words};
use crate::Unreported;
use crate::under_faults;
use records::exit::{Exit, Failure};
use records::faults::Fault;

/// Why the rig does not run, or stopped.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The host does not let this user create networks.
    #[error("{reason}; `--mode virtual` needs none of this")]
    Namespace {
        /// What the host refused, and what to enable.
        reason: NamespaceError,
    },
    /// The new interfaces cannot be set up.
    #[error(transparent)]
    Interface(#[from] InterfaceError),
    /// The capture cannot be written.
    #[error(transparent)]
    Capture(#[from] RecorderError),
    /// The impaired cable gets no sockets.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A node cannot be started.
    #[error("cannot start the {node}: {reason}")]
    Spawn {
        /// The node.
        node: NodeName,
        /// The system's error.
        reason: io::Error,
    },
    /// A node ended unexpectedly.
    #[error("the {node} ended{}{}", status.map_or_else(String::new, |status| format!(" ({status})")), quoted(last_stderr))]
    NodeEnded {
        /// The node.
        node: NodeName,
        /// Its exit status, if known.
        status: Option<ExitStatus>,
        /// Its last lines on standard error.
        last_stderr: Vec<String>,
    },
    /// A fault of this run killed a node.
    #[error("the {node} was killed by this run's fault `{}`", kill_name(node.role))]
    KilledByFault {
        /// The node.
        node: NodeName,
    },
    /// A node that should already run does not answer.
    #[error(
        "no {node} answers at {address} within {} s: {reason}; is it running with `--control`, on that address and \
         port?",
        waited.as_secs()
    )]
    Unreachable {
        /// The node.
        node: NodeName,
        /// Host and port.
        address: String,
        /// Time of the attempts.
        waited: Duration,
        /// The last error.
        reason: String,
    },
    /// A running node has another controller.
    #[error("the {node} is controlled by {controller} already: end that one first")]
    Busy {
        /// The node.
        node: NodeName,
        /// That controller.
        controller: SocketAddr,
    },
    /// A running node does not follow this bench.
    #[error("the {node} does not follow this bench: {reason}")]
    Denied {
        /// The node.
        node: NodeName,
        /// Why not, in its words.
        reason: String,
    },
    /// The connection to a running node was closed.
    #[error("the {node} at {address} ended or closed the connection; its output says why")]
    Detached {
        /// The node.
        node: NodeName,
        /// Host and port.
        address: String,
    },
    /// Another node or setup runs at the address than the one to be measured.
    #[error("the node at {address} is a {found}, but a {wanted} is needed")]
    Other {
        /// Host and port.
        address: String,
        /// The node and setup found.
        found: String,
        /// The node and setup requested.
        wanted: String,
    },
    /// The node runs a setup or an application that differs from the one to be measured.
    #[error("the {node} at {address} runs another cell: {difference}; start it with the same --setup")]
    OtherCell {
        /// Which node.
        node: NodeName,
        /// Host and port.
        address: String,
        /// The first difference.
        difference: String,
    },
    /// The nodes did not connect.
    #[error("the PLC found no robot that was ready within {} s: {reason}{}", waited.as_secs(), quoted(last_stderr))]
    NotConnected {
        /// Time of the attempts.
        waited: Duration,
        /// The PLC's last reason.
        reason: String,
        /// The last lines of both nodes on standard error.
        last_stderr: Vec<String>,
    },
    /// The connection was up and got lost.
    #[error("the connection between the nodes was lost; the {seen_by} says: {reason}")]
    ConnectionLost {
        /// The node that reported it first.
        seen_by: NodeName,
        /// Its reason.
        reason: String,
    },
    /// The host stalled a node for about as long as its peer's watchdog time.
    #[error(
        "{error}; the host stopped the {node} for {} ms: `bench doctor` measures how it runs programs, and a higher \
         bus.watchdog_cycles in a setup of your own bears more",
        held.as_millis()
    )]
    HeldUp {
        /// The node that was stalled longest.
        node: NodeName,
        /// For how long.
        held: Duration,
        /// The error that followed.
        error: Box<RigError>,
    },
    /// The PLC reports that a run failed.
    #[error("{}{execution_type} failed: {reason}", of_station(station.as_deref()))]
    RunFailed {
        /// The station that is the reason, where there are several.
        station: Option<String>,
        /// The execution type of the run.
        execution_type: ExecutionType,
        /// The PLC's reason.
        reason: String,
    },
    /// The robot node's messages are about another number of motions than the PLC counted.
    #[error("{}{unreported}", of_station(station.as_deref()))]
    Unreported {
        /// The station, where there are several.
        station: Option<String>,
        /// The numbers.
        unreported: Unreported,
    },
    /// A node does not answer.
    #[error("the {node} runs but has not answered for {} s: is the host overloaded, or the node stopped?", waited.as_secs())]
    NoAnswer {
        /// The node.
        node: NodeName,
        /// Time waited.
        waited: Duration,
    },
    /// Nodes send nothing, not even the report that they were asked for.
    #[error("{}: a process or its host is stopped; start it again", in_words(nodes))]
    Silent {
        /// Which, and what they sent last.
        nodes: Vec<SilentNode>,
    },
    /// The PLC is alive and only waits, before a run.
    #[error("{}the PLC has waited {seconds} s for {reason}", of_station(station.as_deref()))]
    NotReady {
        /// The station that it waits for, where there are several.
        station: Option<String>,
        /// Time without progress, in s.
        seconds: u32,
        /// Its reason.
        reason: String,
    },
    /// A node sent a line that is no message.
    #[error("the {node} sent `{line}`, which is not a message: are bench and node from the same build?")]
    UnreadableLine {
        /// The node.
        node: NodeName,
        /// The line.
        line: String,
    },
    /// A node sends messages of a later version.
    #[error(
        "the {node} speaks protocol {protocol} of the control port, this bench {PROTOCOL}: use a bench of the node's version"
    )]
    OtherProtocol {
        /// The node.
        node: NodeName,
        /// Its version.
        protocol: u64,
    },
}

// Not `#[from]`, which would also make it the source: then it would be printed twice.
impl From<NamespaceError> for RigError {
    fn from(reason: NamespaceError) -> Self {
        Self::Namespace { reason }
    }
}

impl RigError {
    /// Returns the bench's exit code for this error.
    #[must_use]
    pub fn exit(&self) -> Exit {
        // A node's exit code 5 means that the host lacks what the node needs.
        let unusable = |status: &ExitStatus| status.code() == Some(Exit::EnvironmentUnusable as i32);
        match self {
            Self::Namespace { .. }
            | Self::Interface(_)
            | Self::Port(_)
            | Self::Spawn { .. }
            | Self::NotConnected { .. }
            | Self::Unreachable { .. }
            | Self::Busy { .. } => Exit::EnvironmentUnusable,
            Self::Other { .. }
            | Self::OtherCell { .. }
            | Self::OtherProtocol { .. }
            | Self::Denied { .. } => Exit::Usage,
            Self::NodeEnded { status, .. } if status.as_ref().is_some_and(unusable) => {
                Exit::EnvironmentUnusable
            }
            Self::Capture(_) => Exit::Internal,
            Self::NodeEnded { .. }
            | Self::KilledByFault { .. }
            | Self::Detached { .. }
            | Self::ConnectionLost { .. }
            | Self::HeldUp { .. }
            | Self::RunFailed { .. }
            | Self::Unreported { .. }
            | Self::NoAnswer { .. }
            | Self::Silent { .. }
            | Self::NotReady { .. }
            | Self::UnreadableLine { .. } => Exit::RunFailed,
        }
    }

    /// Returns the bench's exit code for this error before the first repetition: nodes that cannot be used are part of the
    /// environment.
    #[must_use]
    pub fn exit_at_start(&self) -> Exit {
        match self {
            Self::KilledByFault { .. } => Exit::RunFailed,
            _ if self.exit() == Exit::RunFailed => Exit::EnvironmentUnusable,
            _ => self.exit(),
        }
    }
}

/// Returns the failure of a run that did not begin, so that no repetition has failed, with these faults.
pub(super) fn at_start(error: RigError, faults: &[Fault]) -> Failure {
    let is_of_cable = matches!(error, RigError::NotConnected { .. } | RigError::ConnectionLost { .. });
    if is_of_cable && !faults.is_empty() {
        return under_faults(error.into(), faults);
    }
    Failure::new(error.exit_at_start(), error)
}

/// Returns the beginning of a message about a station, where there are several.
fn of_station(station: Option<&str>) -> String {
    station.map_or_else(String::new, |station| format!("station {station}: "))
}

/// Returns the name of the fault that kills a node.
const fn kill_name(role: NodeRole) -> &'static str {
    match role {
        NodeRole::Plc => "kill-plc-at",
        NodeRole::Robot => "kill-robot-at",
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_node_makes_the_environment_unusable_until_a_repetition_runs() {
        let node = || NodeName::from(NodeRole::Plc);
        let unreadable = || RigError::UnreadableLine { node: node(), line: "HTTP/1.0 400".to_owned() };
        let closed = || RigError::Detached { node: node(), address: "127.0.0.1:80".to_owned() };
        for error in [unreadable(), closed()] {
            assert_eq!(error.exit(), Exit::RunFailed);
            assert_eq!(at_start(error, &[]).exit, Exit::EnvironmentUnusable);
        }
        assert_eq!(at_start(RigError::KilledByFault { node: node() }, &[]).exit, Exit::RunFailed);
        let other = RigError::Denied { node: node(), reason: "a wrong token".to_owned() };
        assert_eq!(at_start(other, &[]).exit, Exit::Usage);
        let later = RigError::OtherProtocol { node: node(), protocol: 2 };
        assert_eq!(
            later.to_string(),
            "the plc-node speaks protocol 2 of the control port, this bench 1: use a bench of the node's version"
        );
        assert_eq!(at_start(later, &[]).exit, Exit::Usage);
    }

    #[test]
    fn a_connection_that_the_runs_own_faults_prevent_is_a_failed_run_and_names_them() {
        let not_connected = || RigError::NotConnected {
            waited: Duration::from_secs(10),
            reason: "no answer".to_owned(),
            last_stderr: Vec::new(),
        };
        assert_eq!(at_start(not_connected(), &[]).exit, Exit::EnvironmentUnusable);
        let faults = ["loss=1", "jitter=50us"].map(|fault| fault.parse().unwrap());
        let Failure { exit, error } = at_start(not_connected(), &faults);
        assert_eq!(exit, Exit::RunFailed);
        insta::assert_snapshot!(format!("{error:#}"), @"the run did not begin with its faults (loss=1, jitter=50us): the PLC found no robot that was ready within 10 s: no answer");
    }
}
