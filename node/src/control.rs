//! The control port: instructions over TCP instead of standard input, from one controller at a time.
//!
//! It carries the messages of [`crate::message`]. A controller can move the robot, so on any address but the loopback it
//! must send the node's token first, and receives nothing before. What it sends is still not trusted.
//! A controller that sends a line that is no JSON is disconnected; JSON that is no instruction is refused, and the controller
//! stays. This also keeps a web page from controlling a node through its reader's browser, because the first line of HTTP is
//! no JSON. A controller that does not read is disconnected before its unread messages fill the memory; one that sends nothing, after some minutes; and one whose
//! host disappeared, after some seconds. One that sends its line byte by byte has no more time than one that sends nothing. Nothing is encrypted: anyone who can listen to the network can read the token.

mod client;

use std::collections::VecDeque;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags};

use crate::input::Input;
use crate::message::{Instruction, Message};
use crate::token::ControlToken;
use client::{Client, DismissedClient, Unreadable};

/// Time in ms without accepting connections after the host failed to accept one.
const PAUSE: Duration = Duration::from_millis(500);

/// Longest time from a client's connection to its first line.
const FIRST_LINE: Duration = Duration::from_secs(10);

/// Longest time without anything from a controller. A bench sends an empty line each minute.
const SILENCE: Duration = Duration::from_secs(600);

/// Largest number of clients that have not sent the token yet; a further one replaces the oldest.
const MOST_UNAUTHENTICATED: usize = 8;

/// Largest number of clients that have their last message and have not closed the connection; a further one replaces the oldest.
const MOST_DISMISSED: usize = 8;

/// Shortest time between two reports of refused clients.
const REPORT_EVERY: Duration = Duration::from_secs(10);

const NO_TOKEN: &str =
    "the node wants its control token first: --control-token FILE or SKILLBENCH_CONTROL_TOKEN";
const WRONG_TOKEN: &str = "the control token is not the node's";

/// The port cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// The kernel refuses.
    #[error(
        "listening for a controller on {address}: {reason}; choose an address of this host and a free port"
    )]
    Listen {
        /// The requested address.
        address: SocketAddr,
        /// The kernel's error.
        reason: std::io::Error,
    },
    /// Others can reach the address, and there is no token.
    #[error(
        "other hosts reach {0}, and whoever controls a node moves the robot: give the node and the bench one token, by \
         --control-token FILE or SKILLBENCH_CONTROL_TOKEN, or listen on 127.0.0.1"
    )]
    NoToken(SocketAddr),
}

/// Port on which a node listens for its controller.
#[derive(Debug)]
pub struct ControlPort {
    listener: TcpListener,
    token: Option<ControlToken>,
    controller: Option<Client>,
    /// Clients that have not sent the token yet.
    unauthenticated: Vec<Client>,
    /// Clients that were sent a reason, and whose connections end.
    dismissed: VecDeque<DismissedClient>,
    waiting: VecDeque<Input>,
    /// Whether accepting pauses because the host failed to accept a client.
    paused: bool,
    /// When a client was last reported as refused, and how many were since.
    refused: (Option<Instant>, u32),
}

impl ControlPort {
    /// Opens the port. Controllers must have the token, if there is one.
    ///
    /// # Errors
    ///
    /// The address is not one of this host's, the port is taken, or other hosts reach it and there is no token.
    pub fn listen(address: SocketAddr, token: Option<ControlToken>) -> Result<Self, ControlError> {
        Self::check(address, token.as_ref())?;
        let failed = |reason| ControlError::Listen { address, reason };
        // The standard library sets SO_REUSEADDR: a restarted node finds its former connections in TIME_WAIT.
        let listener = TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        Ok(Self {
            listener,
            token,
            controller: None,
            unauthenticated: Vec::new(),
            dismissed: VecDeque::new(),
            waiting: VecDeque::new(),
            paused: false,
            refused: (None, 0),
        })
    }

    /// Checks that there is a token where other hosts reach the address.
    ///
    /// # Errors
    ///
    /// [`ControlError::NoToken`].
    pub fn check(address: SocketAddr, token: Option<&ControlToken>) -> Result<(), ControlError> {
        let is_open = token.is_none() && !address.ip().is_loopback();
        if is_open { Err(ControlError::NoToken(address)) } else { Ok(()) }
    }

    /// Returns the address that it listens on, with the port that the kernel chose if 0 was requested.
    ///
    /// # Errors
    ///
    /// The kernel's error.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Returns whether a controller must have a token.
    pub(crate) const fn wants_token(&self) -> bool {
        self.token.is_some()
    }

    /// Sends the controller a line, if one is connected.
    pub(crate) fn send(&mut self, line: &str) {
        let Some(controller) = &mut self.controller else { return };
        if let Err(reason) = controller.send(line) {
            self.disconnect(reason);
        }
    }

    /// Tells the controller why its line is not followed, and disconnects it.
    pub(crate) fn deny(&mut self, reason: impl Into<String>) {
        let reason = reason.into();
        if let Some(controller) = self.detach(reason.clone()) {
            self.dismiss(controller, &Message::Denied { reason });
        }
    }

    /// Disconnects the controller.
    pub(crate) fn disconnect(&mut self, reason: impl Into<String>) {
        drop(self.detach(reason));
    }

    /// Takes control from the controller.
    fn detach(&mut self, reason: impl Into<String>) -> Option<Client> {
        let controller = self.controller.take()?;
        // Its unread lines must not be carried out any more.
        self.waiting.retain(|input| !matches!(input, Input::Line(_)));
        self.waiting.push_back(Input::Detached { peer: controller.peer, reason: reason.into() });
        Some(controller)
    }

    /// Sends a client its last message, and ends its connection once it has closed it, too.
    fn dismiss(&mut self, client: Client, last: &Message<()>) {
        if self.dismissed.len() == MOST_DISMISSED {
            self.dismissed.pop_front();
        }
        self.dismissed.extend(client.dismiss(&last.to_json()));
    }

    /// Returns the oldest input not yet returned.
    pub(crate) fn next(&mut self) -> Option<Input> {
        self.waiting.pop_front()
    }

    /// Returns what to poll: the listener, unless it pauses, and all clients.
    pub(crate) fn poll_fds(&self) -> Vec<PollFd<'_>> {
        let listener = (!self.paused).then(|| PollFd::new(&self.listener, PollFlags::IN));
        listener
            .into_iter()
            .chain(self.controller.iter().chain(&self.unauthenticated).map(Client::poll_fd))
            .chain(self.dismissed.iter().map(DismissedClient::poll_fd))
            .collect()
    }

    /// Returns how long to wait at most before [`Self::handle`] is called although nothing is ready.
    pub(crate) fn time_left(&self) -> Option<Duration> {
        let now = Instant::now();
        let silent = self.controller.iter().chain(&self.unauthenticated);
        let silent = silent.map(|client| (client.heard + limit(client)).saturating_duration_since(now));
        let dismissed = self.dismissed.iter().map(|client| client.until.saturating_duration_since(now));
        silent.chain(dismissed).chain(self.paused.then_some(PAUSE)).min()
    }

    /// Handles whatever is ready. Nothing here blocks, so it may also be called when nothing is ready.
    pub(crate) fn handle(&mut self) {
        self.paused = false;
        // The controller first: if it just left, the next one can be accepted.
        self.read_controller();
        self.read_unauthenticated();
        self.dismissed.retain_mut(DismissedClient::remains);
        match self.listener.accept() {
            Ok((stream, peer)) => self.receive(stream, peer),
            Err(error) => {
                use std::io::ErrorKind::{ConnectionAborted, Interrupted, WouldBlock};
                self.paused = ![WouldBlock, Interrupted, ConnectionAborted].contains(&error.kind());
            }
        }
    }

    fn read_controller(&mut self) {
        let Some(controller) = &mut self.controller else { return };
        match controller.read() {
            Ok(_) if controller.heard.elapsed() >= limit(controller) => {
                let limit = limit(controller).as_secs();
                self.disconnect(format!("it sent no whole line for {limit} s"));
            }
            Ok(lines) => self.waiting.extend(lines.into_iter().map(Input::Line)),
            Err(Unreadable::Gone(reason)) => self.disconnect(reason),
            Err(reason) => self.deny(reason.to_string()),
        }
    }

    /// Admits the clients that send the token, and disconnects those that send something else, or nothing in time.
    fn read_unauthenticated(&mut self) {
        for mut client in std::mem::take(&mut self.unauthenticated) {
            let mut lines = match client.read() {
                Ok(lines) if lines.is_empty() && client.heard.elapsed() < limit(&client) => {
                    self.unauthenticated.push(client);
                    continue;
                }
                Ok(lines) => lines.into_iter(),
                Err(Unreadable::Gone(reason)) => {
                    self.refuse(client.peer, &reason);
                    continue;
                }
                Err(reason) => {
                    self.turn_away(client, &reason.to_string());
                    continue;
                }
            };
            let given = lines.next().map(|line| serde_json::from_str(&line));
            let problem = match (&self.token, given) {
                (Some(token), Some(Ok(Instruction::<()>::Token(given)))) if token.is(&given) => None,
                (_, Some(Ok(Instruction::Token(_)))) => Some(WRONG_TOKEN),
                _ => Some(NO_TOKEN),
            };
            match problem {
                None => self.admit(client, lines),
                Some(reason) => self.turn_away(client, reason),
            }
        }
    }

    /// Tells a client why it does not become the controller.
    fn turn_away(&mut self, client: Client, reason: &str) {
        self.refuse(client.peer, reason);
        self.dismiss(client, &Message::Denied { reason: reason.to_owned() });
    }

    fn receive(&mut self, stream: TcpStream, peer: SocketAddr) {
        let Some(client) = Client::new(stream, peer) else { return };
        if self.token.is_none() {
            return self.admit(client, Vec::new().into_iter());
        }
        if self.unauthenticated.len() == MOST_UNAUTHENTICATED {
            let oldest = self.unauthenticated.remove(0);
            self.refuse(oldest.peer, "others connected before it sent the control token");
        }
        self.unauthenticated.push(client);
    }

    /// Makes a client the controller, if there is none, or one that has not sent a line.
    fn admit(&mut self, client: Client, lines: std::vec::IntoIter<String>) {
        if let Some(controller) = &self.controller {
            if controller.has_sent_line {
                let busy = Message::Busy { controller: controller.peer };
                self.refuse(client.peer, "the node has a controller");
                return self.dismiss(client, &busy);
            }
            self.disconnect("it sent no line before another controller connected");
        }
        self.waiting.push_back(Input::Attached(client.peer));
        self.waiting.extend(lines.map(Input::Line));
        self.controller = Some(client);
    }

    /// Reports a client that did not become the controller, if none was reported within some seconds.
    fn refuse(&mut self, peer: SocketAddr, reason: &str) {
        let (last, more) = &mut self.refused;
        if last.is_some_and(|last| last.elapsed() < REPORT_EVERY) {
            *more = more.saturating_add(1);
            return;
        }
        *last = Some(Instant::now());
        let more = std::mem::take(more);
        self.waiting.push_back(Input::Refused { peer, reason: reason.to_owned(), more });
    }
}

/// Returns the longest time without anything from a client.
const fn limit(client: &Client) -> Duration {
    if client.has_sent_line { SILENCE } else { FIRST_LINE }
}

#[cfg(test)]
mod tests;
