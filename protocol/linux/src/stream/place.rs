//! One connection and its place: received bytes, bytes waiting to be sent, and how it is closed.

use std::net::Shutdown;
use std::os::fd::AsFd;
use std::time::Duration;

use machine::wire::FRAME_CAPACITY;
use machine::{Attempt, Instant, InterfaceId, StreamChange, StreamId};
use rustix::event::PollFlags;
use rustix::io::Errno;
use rustix::net::{RecvFlags, SendFlags, recv, send};
use socket2::Socket;

use crate::dscp::Marking;
use crate::wait::Awaited;

/// Largest number of bytes that wait for a peer, besides those in the kernel's buffer.
const ROOM: usize = 4 * FRAME_CAPACITY;

/// Longest time that a closed connection waits for its peer to have seen everything.
const LINGER: Duration = Duration::from_secs(1);

/// What happened to a connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum StreamEvent {
    /// It opened or closed.
    Change(InterfaceId, StreamId, StreamChange),
    /// This many bytes were received, at the start of the buffer.
    Piece(InterfaceId, StreamId, usize),
}

/// State of a connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum State {
    /// The peer has not answered yet.
    Connecting(Attempt),
    Open,
    /// Failed while sending; the machine is not informed yet.
    Lost,
    /// Closing. Until `until`, waiting bytes are still sent; then the peer's end is waited for, unless it was seen.
    Ending {
        until: Instant,
        peer_ended: bool,
    },
}

/// A connection.
#[derive(Debug)]
pub(super) struct Connection {
    pub(super) on: InterfaceId,
    pub(super) id: StreamId,
    pub(super) socket: Socket,
    pub(super) state: State,
    pub(super) marking: Marking,
}

/// A place for a connection.
#[derive(Debug)]
pub(super) struct Place {
    pub(super) connection: Option<Connection>,
    /// Result of the last wait, until it is handled.
    pub(super) ready: PollFlags,
    /// Waiting bytes, at the start.
    room: Box<[u8; ROOM]>,
    waiting: usize,
}

/// More bytes wait for a peer than there is room for.
#[derive(PartialEq, Eq)]
pub(super) struct Overflow;

impl Place {
    pub(super) fn vacant() -> Self {
        Self { connection: None, ready: PollFlags::empty(), room: Box::new([0; ROOM]), waiting: 0 }
    }

    pub(super) fn occupy(&mut self, connection: Connection) {
        self.vacate();
        self.connection = Some(connection);
    }

    pub(super) fn vacate(&mut self) {
        self.connection = None;
        self.ready = PollFlags::empty();
        self.waiting = 0;
    }

    pub(super) fn wait_for(&self) -> Option<Awaited<'_>> {
        let Connection { id, socket, state, .. } = self.connection.as_ref()?;
        let to_send = if self.waiting > 0 { PollFlags::OUT } else { PollFlags::empty() };
        let events = match state {
            State::Connecting(_) => PollFlags::OUT,
            State::Open | State::Ending { peer_ended: false, .. } => PollFlags::IN | to_send,
            State::Ending { peer_ended: true, .. } => to_send,
            State::Lost => PollFlags::empty(),
        };
        Some(Awaited { socket: socket.as_fd(), events, id: id.0 })
    }

    pub(super) fn ending_until(&self) -> Option<Instant> {
        match self.connection.as_ref()?.state {
            State::Ending { until, .. } => Some(until),
            _ => None,
        }
    }

    pub(super) fn deadline(&self) -> Option<Instant> {
        match self.connection.as_ref()?.state {
            State::Lost => Some(Instant::ZERO),
            State::Ending { until, .. } => Some(until),
            State::Connecting(_) | State::Open => None,
        }
    }

    /// Handles this connection once.
    pub(super) fn handle(&mut self, now: Instant, buf: &mut [u8]) -> Option<StreamEvent> {
        let ready = std::mem::replace(&mut self.ready, PollFlags::empty());
        let Connection { on, id, state, .. } = *self.connection.as_ref()?;
        let gone = Some(StreamEvent::Change(on, id, StreamChange::Closed));
        match state {
            State::Lost => {
                self.vacate();
                gone
            }
            State::Connecting(attempt) => {
                (!ready.is_empty()).then(|| StreamEvent::Change(on, id, self.connected(attempt)))
            }
            State::Open => {
                if ready.contains(PollFlags::OUT) && self.flush().is_err() {
                    self.vacate();
                    return gone;
                }
                if !ready.intersects(PollFlags::IN | PollFlags::HUP | PollFlags::ERR) {
                    return None;
                }
                match self.receive(buf) {
                    Ok(0) => {
                        // The peer sends no more, but may still read the answers to its earlier requests.
                        self.end(now, true);
                        gone
                    }
                    Ok(len) => Some(StreamEvent::Piece(on, id, len)),
                    Err(Errno::AGAIN | Errno::INTR) => None,
                    Err(_) => {
                        self.vacate();
                        gone
                    }
                }
            }
            State::Ending { until, .. } => {
                let broken = now >= until || ready.contains(PollFlags::ERR);
                if broken || !ready.is_empty() && self.linger(ready, buf).is_err() {
                    self.vacate();
                }
                None
            }
        }
    }

    /// Completes an attempt to connect.
    fn connected(&mut self, attempt: Attempt) -> StreamChange {
        match &mut self.connection {
            Some(connection) if matches!(connection.socket.take_error(), Ok(None)) => {
                connection.state = State::Open;
                StreamChange::Connected(attempt)
            }
            _ => {
                self.vacate();
                StreamChange::NotConnected(attempt)
            }
        }
    }

    pub(super) fn close(&mut self, now: Instant) {
        match self.connection.as_ref().map(|connection| connection.state) {
            Some(State::Open) => self.end(now, false),
            Some(State::Connecting(_) | State::Lost) => self.vacate(),
            Some(State::Ending { .. }) | None => {}
        }
    }

    /// Sends the peer the end of the stream, behind the waiting bytes.
    fn end(&mut self, now: Instant, peer_ended: bool) {
        if let Some(connection) = &mut self.connection {
            connection.state = State::Ending { until: now + LINGER, peer_ended };
        }
        if self.flush().is_err() {
            self.vacate();
        }
    }

    /// Sends the waiting bytes of a closing connection and ignores what the peer still sends.
    fn linger(&mut self, ready: PollFlags, buf: &mut [u8]) -> Result<(), Errno> {
        if ready.contains(PollFlags::OUT) {
            self.flush()?;
        }
        if !ready.intersects(PollFlags::IN | PollFlags::HUP) {
            return Ok(());
        }
        match self.receive(buf) {
            Ok(0) => {
                if let Some(Connection { state: State::Ending { peer_ended, .. }, .. }) = &mut self.connection
                {
                    *peer_ended = true;
                }
                self.flush()
            }
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => Ok(()),
            Err(error) => Err(error),
        }
    }

    fn receive(&self, buf: &mut [u8]) -> Result<usize, Errno> {
        let connection = self.connection.as_ref().ok_or(Errno::NOTCONN)?;
        let (len, _) = recv(&connection.socket, buf, RecvFlags::DONTWAIT)?;
        Ok(len)
    }

    /// Sends the waiting bytes. When a closing connection has sent all of them, it takes its next step.
    fn flush(&mut self) -> Result<(), Errno> {
        let Some(connection) = &self.connection else { return Ok(()) };
        if self.waiting > 0 {
            let sent = some_of(&connection.socket, self.room.get(..self.waiting).unwrap_or_default())?;
            self.room.copy_within(sent..self.waiting, 0);
            self.waiting -= sent;
        }
        if let State::Ending { peer_ended, .. } = connection.state
            && self.waiting == 0
        {
            if peer_ended {
                self.vacate();
            } else {
                connection.socket.shutdown(Shutdown::Write).map_err(|_| Errno::NOTCONN)?;
            }
        }
        Ok(())
    }

    pub(super) fn send(&mut self, dscp: u8, bytes: &[u8]) -> Result<(), Overflow> {
        let Some(connection) = self.connection.as_mut().filter(|connection| connection.state == State::Open)
        else {
            return Ok(());
        };
        connection.marking.follow(connection.socket.as_fd(), dscp);
        let sent = if self.waiting == 0 { some_of(&connection.socket, bytes) } else { Ok(0) };
        let Ok(sent) = sent else {
            connection.state = State::Lost;
            return Ok(());
        };
        let rest = bytes.get(sent..).unwrap_or_default();
        let Some(room) = self.room.get_mut(self.waiting..self.waiting + rest.len()) else {
            connection.state = State::Lost;
            // Make the kernel drop its buffer, too: the peer will not read it.
            let _ = connection.socket.set_linger(Some(Duration::ZERO));
            return Err(Overflow);
        };
        room.copy_from_slice(rest);
        self.waiting += rest.len();
        Ok(())
    }
}

/// Sends as much as the kernel takes now.
fn some_of(socket: &Socket, bytes: &[u8]) -> Result<usize, Errno> {
    match send(socket, bytes, SendFlags::DONTWAIT | SendFlags::NOSIGNAL) {
        Err(Errno::AGAIN | Errno::INTR) => Ok(0),
        result => result,
    }
}
