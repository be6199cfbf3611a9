//! A node that was started elsewhere, reached over its control port: in a container, on another computer, or the one
//! node whose peer is real hardware.

use std::sync::Arc;
use std::time::Duration;

use ::node::message::Instruction;
use ::node::token::ControlToken;
use serde::Serialize;
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tokio::net::tcp::OwnedWriteHalf;
use tokio::sync::{Mutex, mpsc};
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::RigError;
use super::node_process::{NodeEvent, listen};
use super::rig_node::{NodeName, RigNode};

/// Longest wait for a node that is started together with the bench.
const PATIENCE: Duration = Duration::from_secs(10);

/// Longest wait for an address to answer before the next attempt: one that does not exist yet never answers.
const ATTEMPT: Duration = Duration::from_secs(2);

/// Time between two signs of life.
const ALIVE_EVERY: Duration = Duration::from_secs(60);

/// Time between a refused attempt and the next one.
const RETRY: Duration = Duration::from_millis(200);

/// The connection to such a node.
#[derive(Debug)]
pub(super) struct AttachedNode {
    name: NodeName,
    address: String,
    stream: Arc<Mutex<OwnedWriteHalf>>,
    alive: JoinHandle<()>,
    ended: bool,
}

/// Sends an empty line each minute: a node ends the connection of a controller that sends nothing for ten.
async fn stay_alive(stream: Arc<Mutex<OwnedWriteHalf>>) {
    loop {
        sleep(ALIVE_EVERY).await;
        if stream.lock().await.write_all(b"\n").await.is_err() {
            return;
        }
    }
}

impl Drop for AttachedNode {
    fn drop(&mut self) {
        self.alive.abort();
    }
}

impl AttachedNode {
    /// Connects, with repeated attempts until the node answers, and shows it the token.
    pub(super) async fn reach(
        (node, name): (RigNode, NodeName),
        address: &str,
        token: Option<&ControlToken>,
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
        let unreachable = |reason| RigError::Unreachable {
            node: name.clone(),
            address: address.to_owned(),
            waited: PATIENCE,
            reason,
        };
        let stream = reached.map_err(|_| unreachable(reason))?;
        stream.set_nodelay(true).map_err(|error| unreachable(error.to_string()))?;
        let (from, stream) = stream.into_split();
        listen(node, from, events);
        let stream = Arc::new(Mutex::new(stream));
        let alive = tokio::spawn(stay_alive(Arc::clone(&stream)));
        let mut node = Self { name, address: address.to_owned(), stream, alive, ended: false };
        if let Some(token) = token {
            node.send(&Instruction::<()>::Token(token.text().to_owned())).await;
        }
        Ok(node)
    }

    /// Sends the node an instruction. If that fails, the node has gone, and [`NodeEvent::Ended`] reports it.
    pub(super) async fn send<O: Serialize>(&mut self, instruction: &Instruction<O>) {
        let mut line = serde_json::to_vec(instruction).unwrap_or_default();
        line.push(b'\n');
        let _ = self.stream.lock().await.write_all(&line).await;
    }

    pub(super) const fn has_ended(&self) -> bool {
        self.ended
    }

    pub(super) fn end_error(&mut self) -> RigError {
        self.ended = true;
        RigError::Detached { node: self.name.clone(), address: self.address.clone() }
    }

    pub(super) fn address(&self) -> &str {
        &self.address
    }
}
