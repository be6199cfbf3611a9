//! A node that somebody else started, reached over its control port: a container, another machine, or the one node of
//! which the peer is real hardware.

use std::time::Duration;

use ::node::message::Instruction;
use serde::Serialize;
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tokio::net::tcp::OwnedWriteHalf;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::node_process::{NodeEvent, listen};
use super::{RigError, Which};

/// How long a node may take to come up that is started together with the bench.
const PATIENCE: Duration = Duration::from_secs(10);

/// How long an address may take to answer before it is tried again: one that is not there yet never does.
const ATTEMPT: Duration = Duration::from_secs(2);

/// From an attempt that was refused to the next.
const RETRY: Duration = Duration::from_millis(200);

/// The conversation with one of them.
#[derive(Debug)]
pub(super) struct AttachedNode {
    which: Which,
    address: String,
    stream: OwnedWriteHalf,
    ended: bool,
}

impl AttachedNode {
    /// Connects, again and again until the node is there.
    pub(super) async fn reach(
        which: Which,
        address: &str,
        events: mpsc::Sender<NodeEvent>,
    ) -> Result<Self, RigError> {
        let until = Instant::now() + PATIENCE;
        let mut reason = "no answer".to_owned();
        let reached = async {
            loop {
                match timeout(ATTEMPT, TcpStream::connect(address)).await {
                    Ok(Ok(stream)) => return stream,
                    Ok(Err(error)) => reason = error.to_string(),
                    Err(_) => {}
                }
                sleep(RETRY).await;
            }
        };
        let reached = timeout_at(until, reached).await;
        let unreachable =
            |reason| RigError::Unreachable { which, address: address.to_owned(), waited: PATIENCE, reason };
        let stream = reached.map_err(|_| unreachable(reason))?;
        stream.set_nodelay(true).map_err(|error| unreachable(error.to_string()))?;
        let (from, stream) = stream.into_split();
        listen(which, from, events);
        Ok(Self { which, address: address.to_owned(), stream, ended: false })
    }

    /// Tells the node something. If it cannot hear, it has gone, and that is told by [`NodeEvent::Ended`].
    pub(super) async fn tell<O: Serialize>(&mut self, instruction: &Instruction<O>) {
        let mut line = serde_json::to_vec(instruction).unwrap_or_default();
        line.push(b'\n');
        let _ = self.stream.write_all(&line).await;
    }

    pub(super) const fn has_ended(&self) -> bool {
        self.ended
    }

    pub(super) fn end_error(&mut self) -> RigError {
        self.ended = true;
        RigError::Detached { which: self.which, address: self.address.clone() }
    }

    pub(super) fn address(&self) -> &str {
        &self.address
    }
}
