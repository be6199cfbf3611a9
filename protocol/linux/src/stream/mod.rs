//! TCP connections: those that clients make to a machine, and those that it makes itself.
//!
//! Every connection has one of a fixed number of places, each with its own room for bytes that the kernel does not
//! take at once. A peer that does not read fills its room, and its connection ends; nobody waits for it. A connection
//! that the machine ends lingers until the peer has seen the end, so that what was said last arrives.

mod place;

use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::os::fd::AsFd;
use std::time::Duration;

use machine::{Instant, Port, StreamChange, StreamId};
use rustix::event::PollFlags;
use socket2::{Domain, Protocol, Socket, Type};

pub(crate) use place::News;
use place::{Connection, Overflow, Place, State};

use crate::dscp::Marking;
use crate::wait::WaitSet;
use crate::{Interface, PortError};

/// Connections at a time. Clients beyond that are accepted and sent away at once.
pub(crate) const CONNECTIONS: usize = 32;

/// Bytes that the kernel takes for a peer that does not read; it doubles the figure for its own needs.
const KERNEL_ROOM: usize = 32 << 10;

/// Bytes that are given to the machine at once: few enough for one to be answered well within a bus cycle.
const PIECE: usize = 1024;

/// Clients that are accepted in one wake.
const ACCEPTS: usize = 4;

/// Clients that wait in the kernel to be accepted.
const BACKLOG: i32 = 64;

/// How long no clients are accepted after the kernel could not: it has no more sockets.
const REST: Duration = Duration::from_millis(100);

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

/// All connections of a machine.
#[derive(Debug)]
pub(crate) struct Streams {
    interface: Interface,
    listener: Option<Socket>,
    /// What the answers to clients carry before they are accepted, and their connections at first.
    marking: Marking,
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
            marking: Marking::default(),
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

    /// The port of connections that have no number yet: no connection ever has this one.
    pub(crate) const UNNUMBERED: Port = Port::Stream(StreamId(0));

    /// Makes the answers to clients carry this DSCP from now on.
    pub(crate) fn follow(&self, dscp: u8) {
        if let Some(listener) = &self.listener {
            self.marking.follow(listener.as_fd(), dscp);
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
            self.next_id = self.next_id.wrapping_add(1).max(1);
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
            let marking = self.marking.clone();
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
