//! What a node's process and whoever started it tell each other: one JSON value a line, over pipes or over
//! the control port; and the same as lines that a person reads.

use std::fmt;
use std::net::{Ipv4Addr, SocketAddr};

use serde::{Deserialize, Serialize};

use crate::output::to_stdout;
use crate::report::NodeReport;

/// What a node says. `M` is what only this kind of node says.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Message<M> {
    /// The node runs and looks for its peer.
    Hello(Hello),
    /// Images are exchanged, both ways.
    LinkUp,
    /// No images are exchanged any more, or no connection came about. The node tries again.
    LinkDown {
        /// Why, in words.
        reason: String,
    },
    /// The peer gave this node an address.
    Address {
        /// The address.
        address: Ipv4Addr,
        /// Why the interface did not take it, if it did not.
        problem: Option<String>,
    },
    /// How it goes, on request.
    Report(NodeReport),
    /// The node ends; its last message.
    Farewell {
        /// How it went, unless it broke down.
        report: Option<NodeReport>,
        /// What ended it, where that was not a request.
        problem: Option<String>,
    },
    /// Somebody else has the control port; nothing more comes.
    Busy {
        /// Who.
        controller: SocketAddr,
    },
    /// What only this kind of node says.
    Node(M),
}

/// A node's first message.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Hello {
    /// Which node, such as `plc-node`.
    pub node: String,
    /// The setup's name.
    pub setup: String,
    /// Which bus, and how.
    pub bus: String,
    /// The interface that it is on.
    pub interface: String,
    /// That interface's MAC address.
    pub mac: String,
    /// What the host did not grant the cyclic thread, in words.
    pub warning: Option<String>,
}

/// What a node is told. `O` is what only this kind of node is told.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Instruction<O> {
    /// Say how it goes.
    Report,
    /// End the connection in order, then the process.
    Stop,
    /// Record each tick from now on, or no more, where the node was started with a file for that.
    Record(bool),
    /// What only this kind of node is told.
    Node(O),
}

impl<M: Serialize> Message<M> {
    /// The message as one line of JSON, without its end.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }
}

impl<M: fmt::Display> fmt::Display for Message<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hello(Hello { node, setup, bus, interface, mac, warning }) => {
                write!(f, "{node}: setup {setup} on {interface} ({mac}), {bus}")?;
                warning.as_ref().map_or(Ok(()), |warning| write!(f, "\nwarning: {warning}"))
            }
            Self::LinkUp => f.write_str("connected"),
            Self::LinkDown { reason } => write!(f, "not connected: {reason}"),
            Self::Address { address, problem: None } => write!(f, "address {address} set by the peer"),
            Self::Address { address, problem: Some(problem) } => {
                write!(f, "the peer wants the address {address}, but: {problem}")
            }
            Self::Report(report) => report.fmt(f),
            Self::Farewell { report, problem } => {
                if let Some(report) = report {
                    report.fmt(f)?;
                }
                problem.as_ref().map_or(Ok(()), |problem| write!(f, "\nerror: {problem}"))
            }
            Self::Busy { controller } => write!(f, "controlled by {controller}"),
            Self::Node(message) => message.fmt(f),
        }
    }
}

/// Where messages go.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Console {
    /// Lines for a person.
    ShortText,
    /// One JSON value a line, for a program.
    Json,
}

impl Console {
    /// Prints a message on standard output.
    ///
    /// Nobody is left to tell if that fails; the end of standard input then says so too.
    pub fn tell<M: Serialize + fmt::Display>(self, message: &Message<M>) {
        let line = match self {
            Self::ShortText => message.to_string(),
            Self::Json => message.to_json(),
        };
        let _ = to_stdout(format_args!("{line}\n"));
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
    fn a_report_survives_the_pipe() {
        let message = Message::<String>::Farewell { report: Some(NodeReport::default()), problem: None };
        let line = serde_json::to_string(&message).unwrap();
        assert_eq!(serde_json::from_str::<Message<String>>(&line).unwrap(), message);
    }
}
