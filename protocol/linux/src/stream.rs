//! TCP connections: those that clients make to a machine, and those that it makes itself.
//!
//! Every connection has one of a fixed number of places, each with its own room for bytes that the kernel does not
//! take at once. A peer that does not read fills its room, and its connection ends; nobody waits for it. A connection
//! that the machine ends lingers until the peer has seen the end, so that what was said last arrives.

use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, Shutdown, SocketAddr, SocketAddrV4};
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

use protocol::wire::FRAME_CAPACITY;
use protocol::{Instant, StreamChange, StreamId};
use rustix::event::PollFlags;
use rustix::io::Errno;
use rustix::net::{RecvFlags, SendFlags, recv, send};
use socket2::{Domain, Protocol, Socket, Type};

use crate::dscp::Marking;
use crate::wait::WaitSet;
use crate::{Interface, PortError};

/// Connections at a time. Clients beyond that are accepted and sent away at once.
pub(crate) const CONNECTIONS: usize = 32;

/// Bytes that wait for a peer at most, besides those that the kernel took.
const ROOM: usize = 4 * FRAME_CAPACITY;

/// Bytes that the kernel takes for a peer that does not read; it doubles the figure for its own needs.
const KERNEL_ROOM: usize = 32 << 10;

/// Bytes that are given to the machine at once: few enough for one to be answered well within a bus cycle.
const PIECE: usize = 1024;

/// Clients that are accepted in one wake.
const ACCEPTS: usize = 4;

/// Clients that wait in the kernel to be accepted.
const BACKLOG: i32 = 64;

/// How long an ended connection waits for its peer to have seen everything.
const LINGER: Duration = Duration::from_secs(1);

/// How long no clients are accepted after the kernel could not: it has no more sockets.
const REST: Duration = Duration::from_millis(100);

/// What became of a connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum News {
    /// It opened or closed.
    Change(StreamId, StreamChange),
    /// So many bytes came, at the start of the buffer.
    Piece(StreamId, usize),
}

/// What happened to connections since the start.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct StreamStatistics {
    /// Clients that were accepted.
    pub accepted: u64,
    /// Clients that were sent away, since all places were taken.
    pub turned_away: u64,
    /// Connections that were ended since their peer did not read.
    pub overflowed: u64,
    /// Clients that the kernel could not hand over.
    pub accept_errors: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum State {
    /// The peer has not answered yet.
    Connecting,
    Open,
    /// Lost while sending; the machine does not know yet.
    Lost,
    /// Ended. What waits is still sent, up to this instant; and then the peer's end is waited for, unless it was seen.
    Ending {
        until: Instant,
        peer_ended: bool,
    },
}

#[derive(Debug)]
struct Connection {
    id: StreamId,
    socket: Socket,
    peer: SocketAddrV4,
    state: State,
    marking: Marking,
}

/// A place for a connection.
#[derive(Debug)]
struct Place {
    connection: Option<Connection>,
    /// What the last wait brought, until it is seen to.
    ready: PollFlags,
    /// Bytes that wait are at the start.
    room: Box<[u8; ROOM]>,
    waiting: usize,
}

/// All connections of a machine.
#[derive(Debug)]
pub(crate) struct Streams {
    interface: Interface,
    listener: Option<Socket>,
    /// No clients are accepted until then.
    rests_until: Option<Instant>,
    places: Box<[Place]>,
    /// The place that was seen to last.
    turn: usize,
    /// Clients that may still be accepted in this wake.
    accepts: usize,
    next_id: u32,
    /// Connections that could not even be begun; the machine does not know yet.
    failed: VecDeque<(StreamId, SocketAddrV4)>,
    statistics: StreamStatistics,
}

impl Streams {
    /// No connections yet; clients are let in at `port`, if there is one.
    pub(crate) fn open(interface: &Interface, port: Option<u16>) -> Result<Self, PortError> {
        let listener = port
            .map(|port| {
                listen(interface, port).map_err(|reason| PortError::tcp(interface.name(), port, reason))
            })
            .transpose()?;
        Ok(Self {
            interface: interface.clone(),
            listener,
            rests_until: None,
            places: std::iter::repeat_with(Place::vacant).take(CONNECTIONS).collect(),
            turn: 0,
            accepts: 0,
            next_id: 1,
            failed: VecDeque::with_capacity(CONNECTIONS),
            statistics: StreamStatistics::default(),
        })
    }

    /// Places in the [`WaitSet`] that the connections and the listener take.
    pub(crate) const WAITS: usize = 1 + CONNECTIONS;

    pub(crate) const fn statistics(&self) -> StreamStatistics {
        self.statistics
    }

    /// Writes what is to be waited for into the set, from `first` on.
    pub(crate) fn await_in(&self, waits: &mut WaitSet, first: usize) {
        let listener = self.listener.as_ref().filter(|_| self.rests_until.is_none());
        waits.set(first, listener.map(|listener| (listener.as_fd(), PollFlags::IN)));
        for (index, place) in self.places.iter().enumerate() {
            waits.set(first + 1 + index, place.awaits());
        }
    }

    /// When there is something to do without any socket being ready.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        if !self.failed.is_empty() {
            return Some(Instant::ZERO);
        }
        self.places.iter().filter_map(Place::deadline).chain(self.rests_until).min()
    }

    /// Takes over what a wait brought. Each connection then has one turn.
    pub(crate) fn begin_round(&mut self, now: Instant, waits: &WaitSet, first: usize) {
        self.rests_until = self.rests_until.filter(|until| *until > now);
        self.accepts = if waits.ready(first).is_empty() { 0 } else { ACCEPTS };
        for (index, place) in self.places.iter_mut().enumerate() {
            place.ready = waits.ready(first + 1 + index);
        }
    }

    /// The next news of this round, with bytes in `buf` if there are some.
    pub(crate) fn next_news(&mut self, now: Instant, buf: &mut [u8]) -> Option<News> {
        if let Some((id, _)) = self.failed.pop_front() {
            return Some(News::Change(id, StreamChange::Closed));
        }
        let buf = match buf.len() {
            0..=PIECE => buf,
            _ => buf.get_mut(..PIECE).unwrap_or_default(),
        };
        for _ in 0..self.places.len() {
            self.turn = (self.turn + 1) % self.places.len().max(1);
            let place = self.places.get_mut(self.turn);
            if let Some(news) = place.and_then(|place| place.attend(now, buf)) {
                return Some(news);
            }
        }
        self.accept(now)
    }

    /// Begins to connect, in place of an attempt that is still under way. `dscp` tells what its packets carry.
    pub(crate) fn connect(&mut self, to: SocketAddrV4, dscp: impl FnOnce(StreamId) -> u8) {
        let under_way =
            |connection: &Connection| connection.peer == to && connection.state == State::Connecting;
        for place in self.places.iter_mut().filter(|place| place.connection.as_ref().is_some_and(under_way)) {
            place.vacate();
        }
        self.failed.retain(|(_, peer)| *peer != to);
        let id = self.fresh_id();
        let begun = self.vacant_place().is_some_and(|index| {
            let marking = Marking::default();
            let begin = || -> io::Result<Socket> {
                let socket =
                    Socket::new(Domain::IPV4, Type::STREAM.nonblocking().cloexec(), Some(Protocol::TCP))?;
                socket.bind_device(Some(self.interface.name().as_bytes()))?;
                prepare(&socket)?;
                marking.follow(socket.as_fd(), dscp(id));
                match socket.connect(&SocketAddr::from(to).into()) {
                    Err(error) if error.raw_os_error() != Some(libc::EINPROGRESS) => Err(error),
                    _ => Ok(socket),
                }
            };
            let socket = begin();
            let Some((place, socket)) = self.places.get_mut(index).zip(socket.ok()) else { return false };
            place.occupy(Connection { id, socket, peer: to, state: State::Connecting, marking });
            true
        });
        if !begun && self.failed.len() < CONNECTIONS {
            self.failed.push_back((id, to));
        }
    }

    /// Ends a connection once what waits is sent.
    pub(crate) fn close(&mut self, now: Instant, id: StreamId) {
        if let Some(place) = self.place(id) {
            place.close(now);
        }
    }

    /// Sends as much as goes, and keeps the rest. What is said to a connection that is gone goes nowhere.
    pub(crate) fn send(&mut self, id: StreamId, dscp: u8, bytes: &[u8]) {
        if let Some(place) = self.place(id)
            && place.send(dscp, bytes) == Err(Overflow)
        {
            self.statistics.overflowed += 1;
        }
    }

    fn place(&mut self, id: StreamId) -> Option<&mut Place> {
        self.places.iter_mut().find(|place| place.connection.as_ref().is_some_and(|c| c.id == id))
    }

    /// Four billion connections make a full turn; a number that is still in use is passed over.
    fn fresh_id(&mut self) -> StreamId {
        loop {
            let id = StreamId(self.next_id);
            self.next_id = self.next_id.wrapping_add(1);
            if self.place(id).is_none() {
                return id;
            }
        }
    }

    /// A place for a new connection: a free one, or that of the connection that has been ending for longest.
    fn vacant_place(&mut self) -> Option<usize> {
        if let Some(free) = self.places.iter().position(|place| place.connection.is_none()) {
            return Some(free);
        }
        let ending = |(index, place): (usize, &Place)| Some((place.ending_until()?, index));
        let (_, index) = self.places.iter().enumerate().filter_map(ending).min()?;
        self.places.get_mut(index)?.vacate();
        Some(index)
    }

    fn accept(&mut self, now: Instant) -> Option<News> {
        while self.accepts > 0 {
            self.accepts -= 1;
            let flags = libc::SOCK_NONBLOCK | libc::SOCK_CLOEXEC;
            let (socket, peer) = match self.listener.as_ref()?.accept4(flags) {
                Ok((socket, peer)) => (socket, peer.as_socket_ipv4()),
                Err(error) => {
                    let harmless = [libc::EAGAIN, libc::EINTR, libc::ECONNABORTED];
                    if !error.raw_os_error().is_some_and(|code| harmless.contains(&code)) {
                        self.statistics.accept_errors += 1;
                        self.rests_until = Some(now + REST);
                    }
                    return None;
                }
            };
            let Some(index) = self.vacant_place() else {
                self.statistics.turned_away += 1;
                continue;
            };
            // A client that is gone already fails here.
            let Some(peer) = peer.filter(|_| prepare(&socket).is_ok()) else { continue };
            let id = self.fresh_id();
            let marking = Marking::default();
            self.places.get_mut(index)?.occupy(Connection { id, socket, peer, state: State::Open, marking });
            self.statistics.accepted += 1;
            return Some(News::Change(id, StreamChange::Opened(peer)));
        }
        None
    }
}

fn listen(interface: &Interface, port: u16) -> io::Result<Socket> {
    let socket = Socket::new(Domain::IPV4, Type::STREAM.nonblocking().cloexec(), Some(Protocol::TCP))?;
    socket.bind_device(Some(interface.name().as_bytes()))?;
    // A node that is started again finds the last one's connections still in TIME_WAIT.
    socket.set_reuse_address(true)?;
    socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, port)).into())?;
    socket.listen(BACKLOG)?;
    Ok(socket)
}

fn prepare(socket: &Socket) -> io::Result<()> {
    socket.set_tcp_nodelay(true)?;
    socket.set_send_buffer_size(KERNEL_ROOM)
}

/// A peer has more to read than there is room for.
#[derive(PartialEq, Eq)]
struct Overflow;

impl Place {
    fn vacant() -> Self {
        Self { connection: None, ready: PollFlags::empty(), room: Box::new([0; ROOM]), waiting: 0 }
    }

    fn occupy(&mut self, connection: Connection) {
        self.vacate();
        self.connection = Some(connection);
    }

    fn vacate(&mut self) {
        self.connection = None;
        self.ready = PollFlags::empty();
        self.waiting = 0;
    }

    fn awaits(&self) -> Option<(BorrowedFd<'_>, PollFlags)> {
        let connection = self.connection.as_ref()?;
        let to_send = if self.waiting > 0 { PollFlags::OUT } else { PollFlags::empty() };
        let events = match connection.state {
            State::Connecting => PollFlags::OUT,
            State::Open | State::Ending { peer_ended: false, .. } => PollFlags::IN | to_send,
            State::Ending { peer_ended: true, .. } => to_send,
            State::Lost => return None,
        };
        Some((connection.socket.as_fd(), events))
    }

    fn ending_until(&self) -> Option<Instant> {
        match self.connection.as_ref()?.state {
            State::Ending { until, .. } => Some(until),
            _ => None,
        }
    }

    fn deadline(&self) -> Option<Instant> {
        match self.connection.as_ref()?.state {
            State::Lost => Some(Instant::ZERO),
            State::Ending { until, .. } => Some(until),
            State::Connecting | State::Open => None,
        }
    }

    /// Sees to this connection once.
    fn attend(&mut self, now: Instant, buf: &mut [u8]) -> Option<News> {
        let ready = std::mem::replace(&mut self.ready, PollFlags::empty());
        let Connection { id, state, .. } = *self.connection.as_ref()?;
        let gone = Some(News::Change(id, StreamChange::Closed));
        match state {
            State::Lost => {
                self.vacate();
                gone
            }
            State::Connecting => (!ready.is_empty()).then(|| News::Change(id, self.connected())),
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
                        // The peer says no more, but may still read what it asked for before.
                        self.end(now, true);
                        gone
                    }
                    Ok(len) => Some(News::Piece(id, len)),
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

    /// What came of connecting.
    fn connected(&mut self) -> StreamChange {
        match &mut self.connection {
            Some(connection) if matches!(connection.socket.take_error(), Ok(None)) => {
                connection.state = State::Open;
                StreamChange::Opened(connection.peer)
            }
            _ => {
                self.vacate();
                StreamChange::Closed
            }
        }
    }

    fn close(&mut self, now: Instant) {
        match self.connection.as_ref().map(|connection| connection.state) {
            Some(State::Open) => self.end(now, false),
            Some(State::Connecting | State::Lost) => self.vacate(),
            Some(State::Ending { .. }) | None => {}
        }
    }

    /// Says to the peer that nothing more comes, behind what waits.
    fn end(&mut self, now: Instant, peer_ended: bool) {
        if let Some(connection) = &mut self.connection {
            connection.state = State::Ending { until: now + LINGER, peer_ended };
        }
        if self.flush().is_err() {
            self.vacate();
        }
    }

    /// Sends what waits of an ended connection and passes over what the peer still says.
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

    /// Sends what waits; an ended connection of which everything is sent goes on to its end.
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

    fn send(&mut self, dscp: u8, bytes: &[u8]) -> Result<(), Overflow> {
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
            // The kernel is to forget it as well, and not to hold what nobody reads.
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
