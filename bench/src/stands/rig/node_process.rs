//! One node's process: its pipes, its last words, its end.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::path::Path;
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use ::node::message::Instruction;
use protocol_linux::namespace::NetworkNamespace;
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::io::{AsyncBufReadExt as _, AsyncRead, AsyncWriteExt as _, BufReader};
use tokio::process::{Child, ChildStdin, Command};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::{FromPlc, FromRobot, RigError, Which};

/// Lines of standard error that are kept for the day that the node dies.
const KEPT_STDERR_LINES: usize = 8;

/// How long an ended node's exit status and last words are waited for.
const EXIT_WAIT: Duration = Duration::from_millis(500);

/// What a node said, or what can be said of it.
#[derive(Debug)]
pub(super) enum NodeEvent {
    Plc(FromPlc),
    Robot(FromRobot),
    UnreadableLine { which: Which, line: String },
    Ended(Which),
}

#[derive(Debug)]
pub(super) struct NodeProcess {
    which: Which,
    child: Child,
    stdin: Option<ChildStdin>,
    last_stderr: Arc<Mutex<VecDeque<String>>>,
    /// None once the end_error is written.
    listener: Option<JoinHandle<()>>,
}

impl NodeProcess {
    /// Starts `program` as the node that `name` says, inside `network`.
    ///
    /// The node dies with the thread that calls this, so that has to be the one that stays: the bench's runtime runs
    /// on its main thread.
    pub(super) fn spawn(
        which: Which,
        program: &Path,
        name: &str,
        args: Vec<OsString>,
        network: &NetworkNamespace,
        events: mpsc::Sender<NodeEvent>,
    ) -> Result<Self, RigError> {
        let mut command = Command::new(program);
        command.arg(name).args(args);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command.process_group(0).kill_on_drop(true);
        network.confine(command.as_std_mut())?;
        let failed = |reason| RigError::Spawn { which, reason };
        let mut child = command.spawn().map_err(failed)?;
        let missing = || failed(std::io::Error::other("a pipe is missing"));
        let stdin = child.stdin.take();
        let stdout = child.stdout.take().ok_or_else(missing)?;
        let stderr = child.stderr.take().ok_or_else(missing)?;
        listen(which, stdout, events);
        let last_stderr = Arc::default();
        let listener = tokio::spawn(remember(stderr, Arc::clone(&last_stderr)));
        Ok(Self { which, child, stdin, last_stderr, listener: Some(listener) })
    }

    pub(super) fn id(&self) -> Option<u32> {
        self.child.id()
    }

    /// Kills it, by SIGKILL. One that has ended already stays as it is.
    pub(super) fn kill(&mut self) {
        let _ = self.child.start_kill();
    }

    /// Tells the node something. If it cannot hear, it has ended, and that is told by [`NodeEvent::Ended`].
    pub(super) async fn tell<O: Serialize>(&mut self, instruction: &Instruction<O>) {
        let Some(stdin) = &mut self.stdin else {
            return;
        };
        let mut line = serde_json::to_vec(instruction).unwrap_or_default();
        line.push(b'\n');
        let _ = stdin.write_all(&line).await;
    }

    /// Whether its end has been noticed.
    pub(super) const fn has_ended(&self) -> bool {
        self.listener.is_none()
    }

    /// What the node last wrote on standard error.
    pub(super) fn last_stderr(&self) -> Vec<String> {
        self.last_stderr.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }

    /// How it ended and what it said last.
    pub(super) async fn end_error(&mut self) -> RigError {
        // Its standard output is closed; what it still has to say on the other one comes within moments.
        let status = timeout(EXIT_WAIT, self.child.wait()).await;
        if let Some(listener) = self.listener.take() {
            let _ = timeout(EXIT_WAIT, listener).await;
        }
        RigError::NodeEnded {
            which: self.which,
            status: status.ok().and_then(Result::ok),
            last_stderr: self.last_stderr(),
        }
    }
}

/// Passes on what a node says, and that it ended.
pub(super) fn listen(
    which: Which,
    to: impl AsyncRead + Send + Unpin + 'static,
    events: mpsc::Sender<NodeEvent>,
) {
    match which {
        Which::Plc => drop(tokio::spawn(hear(which, to, events, NodeEvent::Plc))),
        Which::Robot => drop(tokio::spawn(hear(which, to, events, NodeEvent::Robot))),
    }
}

async fn hear<M: DeserializeOwned>(
    which: Which,
    to: impl AsyncRead + Unpin,
    events: mpsc::Sender<NodeEvent>,
    saying: fn(M) -> NodeEvent,
) {
    let mut lines = BufReader::new(to).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        let said =
            serde_json::from_str(&line).map_or_else(|_| NodeEvent::UnreadableLine { which, line }, saying);
        if events.send(said).await.is_err() {
            return;
        }
    }
    let _ = events.send(NodeEvent::Ended(which)).await;
}

async fn remember(stderr: impl AsyncRead + Unpin, last_stderr: Arc<Mutex<VecDeque<String>>>) {
    let mut lines = BufReader::new(stderr).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        let mut last_stderr = last_stderr.lock().unwrap_or_else(PoisonError::into_inner);
        if last_stderr.len() == KEPT_STDERR_LINES {
            last_stderr.pop_front();
        }
        last_stderr.push_back(line);
    }
}
