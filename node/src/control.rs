//! The control port: instructions over TCP in place of standard input, from one controller at a time.
//!
//! It is the conversation of [`crate::message`], without authentication: whoever reaches the port moves the robot. So
//! it belongs on a network of its own. What comes in is not trusted, though. A controller that says what is no
//! instruction is sent away, which also keeps a web page from driving a node through its reader's browser: the first
//! line of HTTP is none. A controller that does not read is sent away too, before what waits for it fills the memory,
//! and one whose host is gone is missed after seconds.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags};
use socket2::{SockRef, TcpKeepalive};

use crate::input::{Input, Lines};
use crate::message::Message;

/// Longest answer that waits for a controller to read it, in bytes: minutes of what a node has to say.
const OUTPUT_LIMIT: usize = 1024 * 1024;

/// After this time without a sign of life the controller's host is asked for one.
const IDLE: Duration = Duration::from_secs(5);
/// How often it is asked.
const PROBE_EVERY: Duration = Duration::from_secs(1);
/// After how many questions without an answer it is gone.
const PROBES: u32 = 3;

/// How long connections are not accepted after the host could not accept one, in ms.
pub(crate) const REST_MS: i64 = 500;

/// The port cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("listening for a controller on {address}: {reason}; choose an address of this host and a free port")]
pub struct ControlError {
    /// The address that was asked for.
    pub address: SocketAddr,
    /// What the kernel said.
    pub reason: std::io::Error,
}

/// Where a node listens for its controller.
#[derive(Debug)]
pub struct ControlPort {
    listener: TcpListener,
    controller: Option<Controller>,
    waiting: VecDeque<Input>,
    /// The host could not accept a connection: asking again at once would only cost time.
    rests: bool,
}

#[derive(Debug)]
struct Controller {
    stream: TcpStream,
    peer: SocketAddr,
    lines: Lines,
    output: Vec<u8>,
    /// Until it has said something it yields to the next one: it may be a port scanner, or somebody's forgotten shell.
    spoke: bool,
}

impl ControlPort {
    /// Opens the port.
    ///
    /// # Errors
    ///
    /// The address is not this host's, or the port is taken.
    pub fn listen(address: SocketAddr) -> Result<Self, ControlError> {
        let failed = |reason| ControlError { address, reason };
        // The standard library sets SO_REUSEADDR: a node that is started again finds its last connections in TIME_WAIT.
        let listener = TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        Ok(Self { listener, controller: None, waiting: VecDeque::new(), rests: false })
    }

    /// Where it listens; the port that the kernel chose, if 0 was asked for.
    ///
    /// # Errors
    ///
    /// The kernel does not say.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Sends the controller a line, if there is one.
    pub(crate) fn tell(&mut self, line: &str) {
        let Some(controller) = &mut self.controller else { return };
        let outcome = controller.tell(line);
        self.settle(outcome);
    }

    /// Sends the controller away.
    pub(crate) fn dismiss(&mut self, reason: impl Into<String>) {
        if let Some(controller) = self.controller.take() {
            // What it still had to say is of nobody any more.
            self.waiting.retain(|input| !matches!(input, Input::Line(_)));
            self.waiting.push_back(Input::Detached { peer: controller.peer, reason: reason.into() });
        }
    }

    /// What happened, the oldest first.
    pub(crate) fn next(&mut self) -> Option<Input> {
        self.waiting.pop_front()
    }

    /// What to poll for: the listener, unless it rests, and the controller.
    pub(crate) fn awaits(&self) -> [Option<PollFd<'_>>; 2] {
        let listener = (!self.rests).then(|| PollFd::new(&self.listener, PollFlags::IN));
        let controller = self.controller.as_ref().map(|controller| {
            let to_send = if controller.output.is_empty() { PollFlags::empty() } else { PollFlags::OUT };
            PollFd::new(&controller.stream, PollFlags::IN | to_send)
        });
        [listener, controller]
    }

    pub(crate) const fn rests(&self) -> bool {
        self.rests
    }

    /// Sees to whatever is ready. Nothing here waits, so that it may be called for nothing.
    pub(crate) fn attend(&mut self) {
        self.rests = false;
        // The controller first: one that has just gone makes room for the next.
        if let Some(controller) = &mut self.controller {
            let outcome = controller.attend(&mut self.waiting);
            self.settle(outcome);
        }
        match self.listener.accept() {
            Ok((stream, peer)) => self.receive(stream, peer),
            Err(error) => {
                let harmless = [ErrorKind::WouldBlock, ErrorKind::Interrupted, ErrorKind::ConnectionAborted];
                self.rests = !harmless.contains(&error.kind());
            }
        }
    }

    fn receive(&mut self, stream: TcpStream, peer: SocketAddr) {
        if let Some(controller) = &self.controller {
            if controller.spoke {
                let busy = Message::<()>::Busy { controller: controller.peer };
                let line = busy.to_json() + "\n";
                // It fits a new connection's buffer; a visitor that is gone already does not matter.
                let _ = (&stream).write_all(line.as_bytes());
                return;
            }
            self.dismiss("it said nothing, and another one came");
        }
        // One that is gone already fails here.
        if prepare(&stream).is_ok() {
            self.controller = Some(Controller::new(stream, peer));
            self.waiting.push_back(Input::Attached(peer));
        }
    }

    fn settle(&mut self, outcome: Result<(), String>) {
        if let Err(reason) = outcome {
            self.dismiss(reason);
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

impl Controller {
    fn new(stream: TcpStream, peer: SocketAddr) -> Self {
        Self { stream, peer, lines: Lines::default(), output: Vec::new(), spoke: false }
    }

    fn tell(&mut self, line: &str) -> Result<(), String> {
        if self.output.len() + line.len() > OUTPUT_LIMIT {
            return Err("it does not read what it is told".to_owned());
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

    /// Reads once: what is still there is told by the next poll, after everybody else had a turn.
    fn attend(&mut self, waiting: &mut VecDeque<Input>) -> Result<(), String> {
        self.flush()?;
        let mut bytes = [0; 4096];
        match self.stream.read(&mut bytes) {
            Ok(0) => Err("it closed the connection".to_owned()),
            Ok(len) => {
                let whole = self.lines.take(bytes.get(..len).unwrap_or_default());
                let lines = whole.map_err(|_| "its line has no end".to_owned())?;
                self.spoke |= !lines.is_empty();
                waiting.extend(lines.into_iter().map(Input::Line));
                Ok(())
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(()),
            Err(error) => Err(error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::event::poll;
    use std::io::{BufRead as _, BufReader};

    fn port() -> (ControlPort, SocketAddr) {
        let port = ControlPort::listen(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap();
        let address = port.address().unwrap();
        (port, address)
    }

    /// What happens next on the port, however long that takes.
    fn next(port: &mut ControlPort) -> Input {
        loop {
            if let Some(input) = port.next() {
                return input;
            }
            let mut waits: Vec<_> = port.awaits().into_iter().flatten().collect();
            poll(&mut waits, None).unwrap();
            port.attend();
        }
    }

    /// A visitor whom the port has noticed.
    fn visit(port: &mut ControlPort, address: SocketAddr) -> TcpStream {
        let stream = TcpStream::connect(address).unwrap();
        assert_eq!(next(port), Input::Attached(stream.local_addr().unwrap()));
        stream
    }

    fn detached(input: Input) -> String {
        match input {
            Input::Detached { reason, .. } => reason,
            other => panic!("{other:?} instead of a controller that left"),
        }
    }

    #[test]
    fn a_controller_speaks_and_is_spoken_to_in_lines() {
        let (mut port, address) = port();
        let mut controller = visit(&mut port, address);
        controller.write_all(b"\"rep").unwrap();
        controller.write_all(b"ort\"\n\"stop\"\n").unwrap();
        assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));
        assert_eq!(next(&mut port), Input::Line("\"stop\"".to_owned()));
        port.tell("\"link_up\"");
        let mut line = String::new();
        BufReader::new(&controller).read_line(&mut line).unwrap();
        assert_eq!(line, "\"link_up\"\n");
    }

    #[test]
    fn a_second_controller_is_told_of_the_first_and_the_next_one_may_follow_it() {
        let (mut port, address) = port();
        let mut first = visit(&mut port, address);
        first.write_all(b"\"report\"\n").unwrap();
        assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));

        let second = TcpStream::connect(address).unwrap();
        port.attend();
        let mut lines = BufReader::new(second).lines();
        let peer = first.local_addr().unwrap();
        assert_eq!(lines.next().unwrap().unwrap(), format!(r#"{{"busy":{{"controller":"{peer}"}}}}"#));
        assert!(lines.next().is_none(), "nothing more comes");

        drop(first);
        assert_eq!(detached(next(&mut port)), "it closed the connection");
        visit(&mut port, address);
    }

    #[test]
    fn who_says_nothing_yields_to_the_next() {
        let (mut port, address) = port();
        let silent = visit(&mut port, address);
        let second = TcpStream::connect(address).unwrap();
        assert_eq!(detached(next(&mut port)), "it said nothing, and another one came");
        assert_eq!(next(&mut port), Input::Attached(second.local_addr().unwrap()));
        assert_eq!((&silent).read(&mut [0]).unwrap(), 0);
    }

    #[test]
    fn a_line_without_an_end_ends_the_conversation() {
        let (mut port, address) = port();
        let mut controller = visit(&mut port, address);
        let flood = std::thread::spawn(move || while controller.write_all(&[0xff; 4096]).is_ok() {});
        assert_eq!(detached(next(&mut port)), "its line has no end");
        flood.join().unwrap();
        visit(&mut port, address);
    }

    #[test]
    fn a_controller_that_does_not_read_is_sent_away_before_it_costs_memory() {
        let (mut port, address) = port();
        let _deaf = visit(&mut port, address);
        let line = "x".repeat(64 * 1024);
        while port.waiting.is_empty() {
            port.tell(&line);
        }
        assert_eq!(detached(next(&mut port)), "it does not read what it is told");
    }

    #[test]
    fn what_a_dismissed_controller_had_still_to_say_is_forgotten() {
        let (mut port, address) = port();
        let mut controller = visit(&mut port, address);
        controller.write_all(b"POST / HTTP/1.1\n\"stop\"\n").unwrap();
        assert_eq!(next(&mut port), Input::Line("POST / HTTP/1.1".to_owned()));
        port.dismiss("what it said is no instruction");
        assert_eq!(detached(next(&mut port)), "what it said is no instruction");
        assert_eq!(port.next(), None);
    }
}
