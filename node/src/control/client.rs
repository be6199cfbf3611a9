//! A client of the control port: its TCP connection, the lines that it sends, and those that wait for it.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags};
use socket2::{SockRef, TcpKeepalive};

use crate::input::{LINE_LIMIT, LineTooLong, Lines};

/// Most bytes that wait for a client to read them: the messages of minutes.
const OUTPUT_LIMIT: usize = 1024 * 1024;

/// Time without data after which the client's host is probed (TCP keep-alive).
const IDLE: Duration = Duration::from_secs(5);
/// Interval between the probes.
const PROBE_EVERY: Duration = Duration::from_secs(1);
/// Unanswered probes after which the connection is closed.
const PROBES: u32 = 3;

/// Longest time for which a dismissed client's bytes are read and dropped until it has read its last message and closed.
const DISMISSED_FOR: Duration = Duration::from_secs(2);
/// Most bytes of it that are dropped so.
const MOST_DROPPED: usize = 1024 * 1024;

/// Reason why nothing more can be read of a client.
#[derive(Debug, thiserror::Error)]
pub(super) enum Unreadable {
    /// The connection is gone.
    #[error("{0}")]
    Gone(String),
    /// It is there, and its line is too long.
    #[error("its line has more than {LINE_LIMIT} bytes; end each instruction with a line feed")]
    Line(#[from] LineTooLong),
}

impl Unreadable {
    fn gone(error: &std::io::Error) -> Self {
        Self::Gone(error.to_string())
    }
}

/// A client.
#[derive(Debug)]
pub(super) struct Client {
    stream: TcpStream,
    pub(super) peer: SocketAddr,
    lines: Lines,
    output: Vec<u8>,
    /// Whether it has sent a line. Until then the next controller replaces it: it may be a port scanner or a
    /// forgotten shell.
    pub(super) has_sent_line: bool,
    /// When it last ended a line, or connected. Before its first instruction only the connection counts, so neither single
    /// bytes nor empty lines keep a place.
    pub(super) heard: Instant,
}

impl Client {
    /// Takes a connection over; `None` if the client is gone already.
    pub(super) fn new(stream: TcpStream, peer: SocketAddr) -> Option<Self> {
        prepare(&stream).ok()?;
        Some(Self {
            stream,
            peer,
            lines: Lines::default(),
            output: Vec::new(),
            has_sent_line: false,
            heard: Instant::now(),
        })
    }

    pub(super) fn poll_fd(&self) -> PollFd<'_> {
        let to_send = if self.output.is_empty() { PollFlags::empty() } else { PollFlags::OUT };
        PollFd::new(&self.stream, PollFlags::IN | to_send)
    }

    pub(super) fn send(&mut self, line: &str) -> Result<(), String> {
        if self.output.len() + line.len() > OUTPUT_LIMIT {
            return Err("it does not read the messages".to_owned());
        }
        self.output.extend_from_slice(line.as_bytes());
        self.output.push(b'\n');
        self.flush()
    }

    fn flush(&mut self) -> Result<(), String> {
        while !self.output.is_empty() {
            match self.stream.write(&self.output) {
                Ok(len) => drop(self.output.drain(..len)),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) => return Err(error.to_string()),
            }
        }
        Ok(())
    }

    /// Reads once and returns the whole lines. If more is there, the next poll reports it, after the other inputs had
    /// their turn. Empty lines show that the client is alive, and are left out.
    pub(super) fn read(&mut self) -> Result<Vec<String>, Unreadable> {
        self.flush().map_err(Unreadable::Gone)?;
        let mut bytes = [0; 4096];
        match self.stream.read(&mut bytes) {
            Ok(0) => Err(Unreadable::Gone("it closed the connection".to_owned())),
            Ok(len) => {
                let mut lines = self.lines.take(bytes.get(..len).unwrap_or_default())?;
                let has_ended_line = !lines.is_empty();
                lines.retain(|line| !line.trim().is_empty());
                self.has_sent_line |= !lines.is_empty();
                if has_ended_line && self.has_sent_line {
                    self.heard = Instant::now();
                }
                Ok(lines)
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                Ok(Vec::new())
            }
            Err(error) => Err(Unreadable::gone(&error)),
        }
    }

    /// Sends a last message. The connection stays until the client closes it: closed here with bytes of the client unread, it
    /// would be reset, and the message lost with it.
    pub(super) fn dismiss(mut self, last: &str) -> Option<DismissedClient> {
        self.send(last).ok()?;
        let until = Instant::now() + DISMISSED_FOR;
        let mut dismissed = DismissedClient { client: self, until, dropped: 0, has_ended: false };
        dismissed.remains().then_some(dismissed)
    }
}

/// A client that has its last message: nothing of it is followed any more.
#[derive(Debug)]
pub(super) struct DismissedClient {
    client: Client,
    pub(super) until: Instant,
    dropped: usize,
    /// True once our end of the connection is closed.
    has_ended: bool,
}

impl DismissedClient {
    pub(super) fn poll_fd(&self) -> PollFd<'_> {
        self.client.poll_fd()
    }

    /// Sends what is left, then drops what the client sends; returns whether the connection is still needed.
    pub(super) fn remains(&mut self) -> bool {
        if self.client.flush().is_err() || Instant::now() >= self.until {
            return false;
        }
        if self.client.output.is_empty() && !self.has_ended {
            self.has_ended = true;
            if self.client.stream.shutdown(Shutdown::Write).is_err() {
                return false;
            }
        }
        match self.client.stream.read(&mut [0; 4096]) {
            Ok(0) => false,
            Ok(len) => {
                self.dropped += len;
                self.dropped < MOST_DROPPED
            }
            Err(error) => matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
        }
    }
}

fn prepare(stream: &TcpStream) -> std::io::Result<()> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    let socket = SockRef::from(stream);
    socket.set_tcp_user_timeout(Some(IDLE))?;
    let keepalive = TcpKeepalive::new().with_time(IDLE).with_interval(PROBE_EVERY).with_retries(PROBES);
    socket.set_tcp_keepalive(&keepalive)
}
