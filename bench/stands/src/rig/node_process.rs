//! The process of one node: its pipes, its last lines, its end.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::path::Path;
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use ::node::message::{Instruction, PROTOCOL, protocol_of};
use ::node::station_message::StationMessage;
use protocol_linux::namespace::NetworkNamespace;
use serde::Serialize;
use tokio::io::{AsyncRead, AsyncWriteExt as _, BufReader};
use tokio::process::{Child, ChildStdin, Command};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::bounded_lines::{BoundedLine, beginning, next_line};
use super::rig_node::{NodeName, RigNode};
use super::{FromPlc, FromRobot, RigError};

/// Lines of standard error that are kept for the error message if the node ends.
const KEPT_STDERR_LINES: usize = 8;

/// Longest wait for an ended node's exit status and last lines.
const EXIT_WAIT: Duration = Duration::from_millis(500);

/// A message of a node, or what the rig observed of it.
#[derive(Debug)]
pub(super) enum NodeEvent {
    /// A message of the PLC, and the station that it is about.
    Plc(Option<String>, FromPlc),
    /// A message of the robot of a station.
    Robot(usize, FromRobot),
    UnreadableLine {
        node: RigNode,
        line: String,
    },
    /// It sends messages of another version.
    OtherProtocol {
        node: RigNode,
        protocol: u64,
    },
    Ended(RigNode),
}

impl NodeEvent {
    /// Returns whether the process of a robot has ended.
    pub(super) const fn is_end_of_robot(&self) -> bool {
        matches!(self, Self::Ended(RigNode::Robot(_)))
    }
}

#[derive(Debug)]
pub(super) struct NodeProcess {
    name: NodeName,
    child: Child,
    stdin: Option<ChildStdin>,
    last_stderr: Arc<Mutex<VecDeque<String>>>,
    /// `None` once the error for its end has been built.
    listener: Option<JoinHandle<()>>,
}

impl NodeProcess {
    /// Starts `program` as the node that its `first` argument gives, inside `network`.
    ///
    /// The node dies with the thread that calls this, so that must be a thread that stays: the bench's runtime runs
    /// on its main thread.
    pub(super) fn spawn(
        (node, name): (RigNode, NodeName),
        program: &Path,
        first: &str,
        args: Vec<OsString>,
        network: &NetworkNamespace,
        events: mpsc::Sender<NodeEvent>,
    ) -> Result<Self, RigError> {
        let mut command = Command::new(program);
        command.arg(first).args(args);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command.process_group(0).kill_on_drop(true);
        network.confine(command.as_std_mut())?;
        let failed = |reason| RigError::Spawn { node: name.clone(), reason };
        let mut child = command.spawn().map_err(failed)?;
        let missing = || failed(std::io::Error::other("a pipe is missing"));
        let stdin = child.stdin.take();
        let stdout = child.stdout.take().ok_or_else(missing)?;
        let stderr = child.stderr.take().ok_or_else(missing)?;
        listen(node, stdout, events);
        let last_stderr = Arc::default();
        let listener = tokio::spawn(remember(stderr, Arc::clone(&last_stderr)));
        Ok(Self { name, child, stdin, last_stderr, listener: Some(listener) })
    }

    /// Kills it by SIGKILL. A node that has already ended stays as it is.
    pub(super) fn kill(&mut self) {
        let _ = self.child.start_kill();
    }

    /// Sends the node an instruction. If that fails, the node has ended, and [`NodeEvent::Ended`] reports it.
    pub(super) async fn send<O: Serialize>(&mut self, instruction: &Instruction<O>) {
        let Some(stdin) = &mut self.stdin else {
            return;
        };
        let mut line = serde_json::to_vec(instruction).unwrap_or_default();
        line.push(b'\n');
        let _ = stdin.write_all(&line).await;
    }

    /// Returns whether its end has been noticed.
    pub(super) const fn has_ended(&self) -> bool {
        self.listener.is_none()
    }

    /// Returns the node's last lines on standard error.
    pub(super) fn last_stderr(&self) -> Vec<String> {
        self.last_stderr.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }

    /// Returns the error that describes how it ended, with its last lines.
    pub(super) async fn end_error(&mut self) -> RigError {
        // Its standard output is closed; its last lines on standard error arrive within moments.
        let status = timeout(EXIT_WAIT, self.child.wait()).await;
        if let Some(listener) = self.listener.take() {
            let _ = timeout(EXIT_WAIT, listener).await;
        }
        RigError::NodeEnded {
            node: self.name.clone(),
            status: status.ok().and_then(Result::ok),
            last_stderr: self.last_stderr(),
        }
    }
}

/// Passes on a node's messages, and that it ended.
pub(super) fn listen(
    node: RigNode,
    to: impl AsyncRead + Send + Unpin + 'static,
    events: mpsc::Sender<NodeEvent>,
) {
    drop(tokio::spawn(forward(node, to, events)));
}

async fn forward(node: RigNode, to: impl AsyncRead + Unpin, events: mpsc::Sender<NodeEvent>) {
    let mut from = BufReader::new(to);
    while let Some(line) = next_line(&mut from).await {
        let line = match line {
            BoundedLine::Whole(line) => line,
            // What follows cannot be read: the connection ends with the receiver's error.
            BoundedLine::TooLong(line) => {
                let _ = events.send(NodeEvent::UnreadableLine { node, line }).await;
                break;
            }
        };
        if let Some(protocol) = protocol_of(&line).filter(|protocol| *protocol > u64::from(PROTOCOL)) {
            let _ = events.send(NodeEvent::OtherProtocol { node, protocol }).await;
            break;
        }
        let event = match node {
            RigNode::Plc => StationMessage::from_json(&line)
                .map(|StationMessage { station, message }| NodeEvent::Plc(station, message)),
            RigNode::Robot(station) => {
                serde_json::from_str(&line).map(|message| NodeEvent::Robot(station, message))
            }
        };
        let unreadable = || NodeEvent::UnreadableLine { node, line: beginning(&line) };
        if events.send(event.unwrap_or_else(|_| unreadable())).await.is_err() {
            return;
        }
    }
    let _ = events.send(NodeEvent::Ended(node)).await;
}

async fn remember(stderr: impl AsyncRead + Unpin, last_stderr: Arc<Mutex<VecDeque<String>>>) {
    let mut from = BufReader::new(stderr);
    while let Some(BoundedLine::Whole(line) | BoundedLine::TooLong(line)) = next_line(&mut from).await {
        let mut last_stderr = last_stderr.lock().unwrap_or_else(PoisonError::into_inner);
        if last_stderr.len() == KEPT_STDERR_LINES {
            last_stderr.pop_front();
        }
        last_stderr.push_back(line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_first_message_of_a_later_version_is_named_by_its_version_whatever_else_is_in_it() {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let event_of = |line: &str| {
            let (sender, mut events) = mpsc::channel(4);
            runtime.block_on(forward(RigNode::Plc, line.as_bytes(), sender));
            runtime.block_on(events.recv()).unwrap()
        };
        let later = "{\"hello\":{\"protocol\":2,\"node\":{\"kind\":\"plc\"}}}\n\"link_up\"\n";
        let event = event_of(later);
        assert!(matches!(event, NodeEvent::OtherProtocol { protocol: 2, .. }), "{event:?}");
        let event = event_of("{\"hello\":{\"protocol\":1}}\n");
        assert!(matches!(event, NodeEvent::UnreadableLine { .. }), "{event:?}");
    }
}
