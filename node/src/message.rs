//! Messages between a node's process and the process that controls it: one JSON value a line, over pipes or over the
//! control port; and the same messages as text for a person.

use std::fmt;
use std::net::{Ipv4Addr, SocketAddr};

use serde::{Deserialize, Serialize};

use crate::report::NodeReport;
use crate::role::NodeRole;

/// Version of these messages, in the first one of a node. It counts up where a reader of the former version would fail.
///
/// `node/schemas/control.schema.json` has them all; a test of `stands` keeps both the same.
pub const PROTOCOL: u32 = 1;

/// What a node sends. `M` are the messages of only this kind of node.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Message<M> {
    /// First message: the node runs and looks for its peer.
    Hello(Hello),
    /// The connection is up: images are exchanged in both directions.
    LinkUp,
    /// The connection is down, or could not be established. The node tries again.
    LinkDown {
        /// Reason, as text.
        reason: String,
    },
    /// The peer set this node's IP address.
    Address {
        /// The address.
        address: Ipv4Addr,
        /// Why the interface refused the address, if it did.
        problem: Option<String>,
    },
    /// The node has waited for this long without any progress. The message comes again every ten seconds.
    Waiting {
        /// Time without progress, in s.
        seconds: u32,
        /// What it waits for, as text.
        reason: String,
        /// Whether somebody owes progress. Without this, it may last as long as it likes, as at an override of 0 %.
        is_owed: bool,
    },
    /// Identity that the device at the other end reports: name, vendor, device, version, as its bus has them.
    Identity {
        /// The identity, as text.
        text: String,
    },
    /// Something is remarkable about the connection: it is slower than asked, or a station holds it and sends nothing.
    Remark {
        /// What, as text.
        text: String,
    },
    /// Somebody else requested what only the owner of the connection may, and was refused.
    Foreign {
        /// Who requested what, as text.
        request: String,
    },
    /// Somebody opened the connection to this node; whether it sends data is not known yet.
    Owner {
        /// Its address, serial number, interval and timeout, as text.
        owner: String,
    },
    /// Another station has a name or an IP address that only one may have.
    Conflict {
        /// Which one, as text.
        conflict: String,
    },
    /// The node's report so far, on request.
    Report(NodeReport),
    /// Last message: the node ends.
    Farewell {
        /// The final report, unless the node broke down.
        report: Option<NodeReport>,
        /// Error that ended the node, if it did not end on request.
        problem: Option<String>,
    },
    /// Another controller has the control port; nothing follows.
    Busy {
        /// That controller.
        controller: SocketAddr,
    },
    /// The controller's line is not followed, and the connection ends.
    Denied {
        /// Why not, as text.
        reason: String,
    },
    /// A message of only this kind of node.
    Node(M),
}

/// Returns the version that a node's first message names; `None` for any other line. The rest of the line may have the form of a later
/// version.
#[must_use]
pub fn protocol_of(line: &str) -> Option<u64> {
    #[derive(Deserialize)]
    struct FirstMessage {
        hello: Version,
    }
    #[derive(Deserialize)]
    struct Version {
        protocol: u64,
    }
    serde_json::from_str::<FirstMessage>(line).ok().map(|first| first.hello.protocol)
}

/// A node's first message.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Hello {
    /// Version of the messages: [`PROTOCOL`]; 0 from a node of an older version.
    #[serde(default)]
    pub protocol: u32,
    /// Which node.
    pub node: NodeRole,
    /// The setup's name.
    pub setup: String,
    /// The bus and its mode.
    pub bus: String,
    /// The interface that it is on; several, with commas between them, on several buses.
    pub interface: String,
    /// That interface's MAC address.
    pub mac: String,
    /// What the host refused the cyclic thread, and how to allow it.
    pub warning: Option<String>,
    /// What it runs; `None` from a node of an older version.
    #[serde(default)]
    pub cell: Option<CellText>,
    /// Where it runs; `None` from a node of an older version.
    #[serde(default)]
    pub host: Option<NodeHost>,
}

/// The program of a node and the computer that it runs on.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct NodeHost {
    /// The node's version.
    pub version: String,
    /// The computer's name in its network.
    pub name: String,
    /// Its kernel and release.
    pub kernel: String,
}

#[cfg(all(feature = "real", target_os = "linux"))]
impl NodeHost {
    /// Returns this program's version and this computer.
    #[must_use]
    pub fn this() -> Self {
        let system = rustix::system::uname();
        let text = |text: &std::ffi::CStr| text.to_string_lossy().into_owned();
        Self {
            version: crate::version::version_as_built(),
            name: text(system.nodename()),
            kernel: format!("{} {}", text(system.sysname()), text(system.release())),
        }
    }
}

/// The whole setup and application of a node, so that its controller can compare them with its own.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct CellText {
    /// The setup in TOML, with the node's options in it.
    pub setup: String,
    /// The application's file as it was read.
    pub application: String,
}

/// What a node receives. `O` are the instructions of only this kind of node.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Instruction<O> {
    /// Show the token of the control port, before anything else.
    Token(String),
    /// Send a report.
    Report,
    /// Close the connection in order, then end the process.
    Stop,
    /// Start or stop recording each cycle, if the node was started with a file for it.
    Record(bool),
    /// An instruction of only this kind of node.
    Node(O),
}

impl<M: Serialize> Message<M> {
    /// Returns the message as one line of JSON, without line end.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }
}

impl<M: fmt::Display> fmt::Display for Message<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hello(Hello { node, setup, bus, interface, mac, warning, .. }) => {
                write!(f, "{node}: setup {setup} on {interface} ({mac}), {bus}")?;
                warning.as_ref().map_or(Ok(()), |warning| write!(f, "\nwarning: {warning}"))
            }
            Self::LinkUp => f.write_str("connected"),
            Self::LinkDown { reason } => write!(f, "not connected: {reason}"),
            Self::Address { address, problem: None } => write!(f, "address {address} set by the peer"),
            Self::Address { address, problem: Some(problem) } => {
                write!(f, "the peer wants the address {address}, but: {problem}")
            }
            Self::Waiting { seconds, reason, .. } => write!(f, "waited {seconds} s so far for {reason}"),
            Self::Identity { text } => write!(f, "the device at the other end: {text}"),
            Self::Remark { text } => write!(f, "warning: {text}"),
            Self::Report(report) => report.fmt(f),
            Self::Farewell { report, problem } => {
                if let Some(report) = report {
                    report.fmt(f)?;
                }
                problem.as_ref().map_or(Ok(()), |problem| write!(f, "\nerror: {problem}"))
            }
            Self::Foreign { request } => write!(f, "warning: {request}"),
            Self::Owner { owner } => f.write_str(owner),
            Self::Conflict { conflict } => write!(f, "warning: {conflict}"),
            Self::Busy { controller } => write!(f, "controlled by {controller}"),
            Self::Denied { reason } => write!(f, "denied: {reason}"),
            Self::Node(message) => message.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_and_messages_are_one_line_of_json_each() {
        let json = |message: &Message<String>| serde_json::to_string(message).unwrap();
        assert_eq!(json(&Message::LinkUp), r#""link_up""#);
        assert_eq!(
            json(&Message::LinkDown { reason: "no answer\nat all".to_owned() }),
            r#"{"link_down":{"reason":"no answer\nat all"}}"#
        );
        assert_eq!(json(&Message::Node("ready".to_owned())), r#"{"node":"ready"}"#);
        assert_eq!(serde_json::from_str::<Instruction<u8>>(r#""stop""#).unwrap(), Instruction::Stop);
        assert_eq!(serde_json::from_str::<Instruction<u8>>(r#"{"node":7}"#).unwrap(), Instruction::Node(7));
    }

    #[test]
    fn the_version_of_a_first_message_is_read_whatever_else_is_in_it() {
        let later = r#"{"station":"left","hello":{"protocol":2,"node":{"kind":"plc"},"more":[1]}}"#;
        assert_eq!(protocol_of(later), Some(2));
        assert_eq!(protocol_of(r#"{"hello":{"protocol":5000000000}}"#), Some(5_000_000_000));
        for other in
            ["\"link_up\"", r#"{"hello":{}}"#, r#"{"hello":{"protocol":"2"}}"#, r#"{"protocol":2}"#, "{"]
        {
            assert_eq!(protocol_of(other), None, "{other}");
        }
    }

    #[test]
    fn a_report_survives_the_pipe() {
        let message = Message::<String>::Farewell { report: Some(NodeReport::default()), problem: None };
        let line = serde_json::to_string(&message).unwrap();
        assert_eq!(serde_json::from_str::<Message<String>>(&line).unwrap(), message);
    }
}
