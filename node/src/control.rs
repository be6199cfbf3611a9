//! The control port: instructions over TCP instead of standard input, from one controller at a time.
//!
//! It carries the messages of [`crate::message`] without authentication: whoever reaches the port can move the robot.
//! So it belongs on a network of its own. What arrives is still not trusted. A controller that sends anything but an
//! instruction is disconnected. This also keeps a web page from controlling a node through its reader's browser,
//! because the first line of HTTP is no instruction. A controller that does not read is disconnected before its
//! unread messages fill the memory, and one whose host disappeared is disconnected after some seconds.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags};
use socket2::{SockRef, TcpKeepalive};

use crate::input::{Input, Lines};
use crate::message::Message;

/// Most bytes that wait for a controller to read them: the messages of minutes.
const OUTPUT_LIMIT: usize = 1024 * 1024;

/// Time without data after which the controller's host is probed (TCP keep-alive).
const IDLE: Duration = Duration::from_secs(5);
/// Interval between the probes.
const PROBE_EVERY: Duration = Duration::from_secs(1);
/// Unanswered probes after which the connection is closed.
const PROBES: u32 = 3;

/// Time in ms without accepting connections after the host failed to accept one.
pub(crate) const PAUSE_MS: i64 = 500;

/// The port cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("listening for a controller on {address}: {reason}; choose an address of this host and a free port")]
pub struct ControlError {
    /// The requested address.
    pub address: SocketAddr,
    /// The kernel's error.
    pub reason: std::io::Error,
}

/// Port on which a node listens for its controller.
#[derive(Debug)]
pub struct ControlPort {
    listener: TcpListener,
    controller: Option<Controller>,
    waiting: VecDeque<Input>,
    /// Accepting failed on the host; trying again at once would only cost time.
    paused: bool,
}

#[derive(Debug)]
struct Controller {
    stream: TcpStream,
    peer: SocketAddr,
    lines: Lines,
    output: Vec<u8>,
    /// Whether it has sent a line. Until then the next controller replaces it: it may be a port scanner or a
    /// forgotten shell.
    has_sent_line: bool,
}

impl ControlPort {
    /// Opens the port.
    ///
    /// # Errors
    ///
    /// The address is not one of this host's, or the port is taken.
    pub fn listen(address: SocketAddr) -> Result<Self, ControlError> {
        let failed = |reason| ControlError { address, reason };
        // The standard library sets SO_REUSEADDR: a restarted node finds its former connections in TIME_WAIT.
        let listener = TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        Ok(Self { listener, controller: None, waiting: VecDeque::new(), paused: false })
    }

    /// Returns the address that it listens on, with the port that the kernel chose if 0 was requested.
    ///
    /// # Errors
    ///
    /// The kernel's error.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Sends the controller a line, if one is connected.
    pub(crate) fn send(&mut self, line: &str) {
        let Some(controller) = &mut self.controller else { return };
        let outcome = controller.send(line);
        self.settle(outcome);
    }

    /// Disconnects the controller.
    pub(crate) fn disconnect(&mut self, reason: impl Into<String>) {
        if let Some(controller) = self.controller.take() {
            // Its unread lines must not be carried out any more.
            self.waiting.retain(|input| !matches!(input, Input::Line(_)));
            self.waiting.push_back(Input::Detached { peer: controller.peer, reason: reason.into() });
        }
    }

    /// Returns the oldest input not yet returned.
    pub(crate) fn next(&mut self) -> Option<Input> {
        self.waiting.pop_front()
    }

    /// Returns what to poll: the listener, unless it pauses, and the controller.
    pub(crate) fn poll_fds(&self) -> [Option<PollFd<'_>>; 2] {
        let listener = (!self.paused).then(|| PollFd::new(&self.listener, PollFlags::IN));
        let controller = self.controller.as_ref().map(|controller| {
            let to_send = if controller.output.is_empty() { PollFlags::empty() } else { PollFlags::OUT };
            PollFd::new(&controller.stream, PollFlags::IN | to_send)
        });
        [listener, controller]
    }

    pub(crate) const fn paused(&self) -> bool {
        self.paused
    }

    /// Handles whatever is ready. Nothing here blocks, so it may also be called when nothing is ready.
    pub(crate) fn handle(&mut self) {
        self.paused = false;
        // The controller first: if it just left, the next one can be accepted.
        if let Some(controller) = &mut self.controller {
            let outcome = controller.handle(&mut self.waiting);
            self.settle(outcome);
        }
        match self.listener.accept() {
            Ok((stream, peer)) => self.receive(stream, peer),
            Err(error) => {
                let harmless = [ErrorKind::WouldBlock, ErrorKind::Interrupted, ErrorKind::ConnectionAborted];
                self.paused = !harmless.contains(&error.kind());
            }
        }
    }

    fn receive(&mut self, stream: TcpStream, peer: SocketAddr) {
        if let Some(controller) = &self.controller {
            if controller.has_sent_line {
                let busy = Message::<()>::Busy { controller: controller.peer };
                let line = busy.to_json() + "\n";
                // The line fits a new connection's buffer; if the client is gone already, it does not matter.
                let _ = (&stream).write_all(line.as_bytes());
                return;
            }
            self.disconnect("it sent no line before another controller connected");
        }
        // This fails if the client is gone already.
        if prepare(&stream).is_ok() {
            self.controller = Some(Controller::new(stream, peer));
            self.waiting.push_back(Input::Attached(peer));
        }
    }

    fn settle(&mut self, outcome: Result<(), String>) {
        if let Err(reason) = outcome {
            self.disconnect(reason);
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
        Self { stream, peer, lines: Lines::default(), output: Vec::new(), has_sent_line: false }
    }

    fn send(&mut self, line: &str) -> Result<(), String> {
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

    /// Reads once. If more is there, the next poll reports it, after the other inputs had their turn.
    fn handle(&mut self, waiting: &mut VecDeque<Input>) -> Result<(), String> {
        self.flush()?;
        let mut bytes = [0; 4096];
        match self.stream.read(&mut bytes) {
            Ok(0) => Err("it closed the connection".to_owned()),
            Ok(len) => {
                let whole = self.lines.take(bytes.get(..len).unwrap_or_default());
                let lines = whole.map_err(|_| "its line has no end".to_owned())?;
                self.has_sent_line |= !lines.is_empty();
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

    /// Waits for the next input of the port.
    fn next(port: &mut ControlPort) -> Input {
        loop {
            if let Some(input) = port.next() {
                return input;
            }
            let mut waits: Vec<_> = port.poll_fds().into_iter().flatten().collect();
            poll(&mut waits, None).unwrap();
            port.handle();
        }
    }

    /// Connects a client and waits until the port noticed it.
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
    fn a_controller_sends_and_receives_lines() {
        let (mut port, address) = port();
        let mut controller = visit(&mut port, address);
        controller.write_all(b"\"rep").unwrap();
        controller.write_all(b"ort\"\n\"stop\"\n").unwrap();
        assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));
        assert_eq!(next(&mut port), Input::Line("\"stop\"".to_owned()));
        port.send("\"link_up\"");
        let mut line = String::new();
        BufReader::new(&controller).read_line(&mut line).unwrap();
        assert_eq!(line, "\"link_up\"\n");
    }

    #[test]
    fn a_second_controller_is_told_who_has_the_port_and_the_next_one_gets_it_once_it_is_free() {
        let (mut port, address) = port();
        let mut first = visit(&mut port, address);
        first.write_all(b"\"report\"\n").unwrap();
        assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));

        let second = TcpStream::connect(address).unwrap();
        port.handle();
        let mut lines = BufReader::new(second).lines();
        let peer = first.local_addr().unwrap();
        assert_eq!(lines.next().unwrap().unwrap(), format!(r#"{{"busy":{{"controller":"{peer}"}}}}"#));
        assert!(lines.next().is_none(), "nothing more comes");

        drop(first);
        assert_eq!(detached(next(&mut port)), "it closed the connection");
        visit(&mut port, address);
    }

    #[test]
    fn a_controller_that_sends_nothing_is_replaced_by_the_next() {
        let (mut port, address) = port();
        let silent = visit(&mut port, address);
        let second = TcpStream::connect(address).unwrap();
        assert_eq!(detached(next(&mut port)), "it sent no line before another controller connected");
        assert_eq!(next(&mut port), Input::Attached(second.local_addr().unwrap()));
        assert_eq!((&silent).read(&mut [0]).unwrap(), 0);
    }

    #[test]
    fn a_line_without_an_end_ends_the_connection() {
        let (mut port, address) = port();
        let mut controller = visit(&mut port, address);
        let flood = std::thread::spawn(move || while controller.write_all(&[0xff; 4096]).is_ok() {});
        assert_eq!(detached(next(&mut port)), "its line has no end");
        flood.join().unwrap();
        visit(&mut port, address);
    }

    #[test]
    fn a_controller_that_does_not_read_is_disconnected_before_it_fills_the_memory() {
        let (mut port, address) = port();
        let _deaf = visit(&mut port, address);
        let line = "x".repeat(64 * 1024);
        while port.waiting.is_empty() {
            port.send(&line);
        }
        assert_eq!(detached(next(&mut port)), "it does not read the messages");
    }

    #[test]
    fn unread_lines_of_a_disconnected_controller_are_dropped() {
        let (mut port, address) = port();
        let mut controller = visit(&mut port, address);
        controller.write_all(b"POST / HTTP/1.1\n\"stop\"\n").unwrap();
        assert_eq!(next(&mut port), Input::Line("POST / HTTP/1.1".to_owned()));
        port.disconnect("it sent a line that is no instruction");
        assert_eq!(detached(next(&mut port)), "it sent a line that is no instruction");
        assert_eq!(port.next(), None);
    }
}
