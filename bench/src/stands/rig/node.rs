//! One node's process: its pipes, its last words, its end.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::path::Path;
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use protocol_linux::message::Instruction;
use protocol_linux::namespace::NetworkNamespace;
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::io::{AsyncBufReadExt as _, AsyncRead, AsyncWriteExt as _, BufReader};
use tokio::process::{Child, ChildStdin, Command};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::{PlcSaying, RigError, RobotSaying, Which};

/// Lines of standard error that are kept for the day that the node dies.
const LAST_WORDS: usize = 8;

/// How long an ended node's exit status and last words are waited for.
const OBITUARY: Duration = Duration::from_millis(500);

/// What a node said, or what can be said of it.
#[derive(Debug)]
pub(super) enum Said {
    Plc(PlcSaying),
    Robot(RobotSaying),
    Gibberish { which: Which, line: String },
    Ended(Which),
}

#[derive(Debug)]
pub(super) struct NodeProcess {
    which: Which,
    child: Child,
    stdin: Option<ChildStdin>,
    last_words: Arc<Mutex<VecDeque<String>>>,
    /// None once the obituary is written.
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
        sayings: mpsc::Sender<Said>,
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
        listen(which, stdout, sayings);
        let last_words = Arc::default();
        let listener = tokio::spawn(remember(stderr, Arc::clone(&last_words)));
        Ok(Self { which, child, stdin, last_words, listener: Some(listener) })
    }

    pub(super) fn id(&self) -> Option<u32> {
        self.child.id()
    }

    /// Kills it, by SIGKILL. One that has ended already stays as it is.
    pub(super) fn kill(&mut self) {
        let _ = self.child.start_kill();
    }

    /// Tells the node something. If it cannot hear, it has ended, and that is told by [`Said::Ended`].
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
    pub(super) fn last_words(&self) -> Vec<String> {
        self.last_words.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }

    /// How it ended and what it said last.
    pub(super) async fn obituary(&mut self) -> RigError {
        // Its standard output is closed; what it still has to say on the other one comes within moments.
        let status = timeout(OBITUARY, self.child.wait()).await;
        if let Some(listener) = self.listener.take() {
            let _ = timeout(OBITUARY, listener).await;
        }
        RigError::NodeEnded {
            which: self.which,
            status: status.ok().and_then(Result::ok),
            last_words: self.last_words(),
        }
    }
}

/// Passes on what a node says, and that it ended.
pub(super) fn listen(which: Which, to: impl AsyncRead + Send + Unpin + 'static, sayings: mpsc::Sender<Said>) {
    match which {
        Which::Plc => drop(tokio::spawn(hear(which, to, sayings, Said::Plc))),
        Which::Robot => drop(tokio::spawn(hear(which, to, sayings, Said::Robot))),
    }
}

async fn hear<M: DeserializeOwned>(
    which: Which,
    to: impl AsyncRead + Unpin,
    sayings: mpsc::Sender<Said>,
    saying: fn(M) -> Said,
) {
    let mut lines = BufReader::new(to).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        let said = serde_json::from_str(&line).map_or_else(|_| Said::Gibberish { which, line }, saying);
        if sayings.send(said).await.is_err() {
            return;
        }
    }
    let _ = sayings.send(Said::Ended(which)).await;
}

async fn remember(stderr: impl AsyncRead + Unpin, last_words: Arc<Mutex<VecDeque<String>>>) {
    let mut lines = BufReader::new(stderr).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        let mut last_words = last_words.lock().unwrap_or_else(PoisonError::into_inner);
        if last_words.len() == LAST_WORDS {
            last_words.pop_front();
        }
        last_words.push_back(line);
    }
}
