//! TCP connections of a machine: those that clients open and those that the machine opens, at all of its interfaces.
//!
//! There is a fixed number of places for clients; a machine that opens more connections itself gets more places. Each
//! connection takes one, with its own buffer for bytes that the kernel does not take at once. If a peer does not read, its buffer fills and the connection is closed; no other connection
//! waits for it. A connection that the machine closes stays until the peer has seen the end, so that the last bytes
//! arrive.

mod place;

use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::os::fd::AsFd;
use std::time::Duration;

use machine::{Attempt, Instant, InterfaceId, Multihomed, Port, StreamChange, StreamId};
use rustix::event::PollFlags;
use rustix::io::Errno;
use socket2::{Domain, Protocol, Socket, Type};

pub(crate) use place::StreamEvent;
use place::{Connection, Overflow, Place, State};

use crate::dscp::Marking;
use crate::interfaces::Interfaces;
use crate::port_holders::Transport;
use crate::wait::{Awaited, SocketSet};
use crate::{Interface, PortError};

/// Number of places from the start. Clients that find none free are accepted and disconnected at once.
const PLACES: usize = 32;

/// Largest number of places: a connection to each of many stations, within what the kernel allows a process by default.
const MOST_PLACES: usize = 512;

/// Send buffer of the kernel in bytes, for a peer that does not read; the kernel doubles the figure for its own
/// needs.
const KERNEL_ROOM: usize = 32 << 10;

/// Bytes given to the machine at once: few enough that the machine answers them well within a bus cycle.
const PIECE: usize = 1024;

/// Clients accepted in one wake.
const ACCEPTS: usize = 4;

/// Clients that the kernel queues until they are accepted.
const BACKLOG: i32 = 64;

/// Time without accepting clients after the kernel failed to: it has no sockets left.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Counters of TCP connections since the start.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct StreamStatistics {
    /// Clients accepted.
    pub accepted: u64,
    /// Clients disconnected because all places were taken.
    pub turned_away: u64,
    /// Connections closed because the peer did not read.
    pub overflowed: u64,
    /// Failed attempts to accept a client.
    pub accept_errors: u64,
}

/// An interface of the machine, as a way to make and accept connections.
#[derive(Debug)]
struct StreamInterface {
    on: InterfaceId,
    interface: Interface,
    listener: Option<Socket>,
    /// DSCP of the answers to clients before they are accepted, and of their connections at first.
    marking: Marking,
    /// Clients that may still be accepted in this wake.
    accepts: usize,
}

/// All connections of a machine.
#[derive(Debug)]
pub(crate) struct Streams {
    /// The machine's interfaces. The index is the [`InterfaceId`].
    interfaces: Box<[StreamInterface]>,
    /// Until when no clients are accepted.
    accept_again_at: Option<Instant>,
    places: Vec<Place>,
    /// Index of the place that was handled last.
    turn: usize,
    next_id: u32,
    /// Connections that could not be started; the machine is not informed yet.
    failed: VecDeque<(InterfaceId, StreamId, Attempt)>,
    statistics: StreamStatistics,
}

impl Streams {
    /// Starts without connections; accepts clients at each interface at the TCP port that the machine has there.
    pub(crate) fn open<M: Multihomed>(machine: &M, interfaces: &Interfaces) -> Result<Self, PortError> {
        let mut opened: Vec<StreamInterface> = Vec::new();
        for (on, interface) in (0..=u8::MAX).map(InterfaceId).zip(interfaces.iter()) {
            let port = machine.listen_port(on);
            let is_same = |other: &&StreamInterface| other.interface.index() == interface.index();
            if let Some(port) = port
                && opened.iter().filter(is_same).any(|other| machine.listen_port(other.on) == Some(port))
            {
                let interface = interface.name().to_owned();
                return Err(PortError::Shared { transport: Transport::Tcp, port, interface });
            }
            let listener = port
                .map(|port| {
                    listen(interface, port).map_err(|reason| PortError::tcp(interface.name(), port, reason))
                })
                .transpose()?;
            let interface = interface.clone();
            opened.push(StreamInterface { on, interface, listener, marking: Marking::default(), accepts: 0 });
        }
        Ok(Self {
            interfaces: opened.into(),
            accept_again_at: None,
            places: std::iter::repeat_with(Place::vacant).take(PLACES).collect(),
            turn: 0,
            next_id: 1,
            failed: VecDeque::with_capacity(PLACES),
            statistics: StreamStatistics::default(),
        })
    }

    /// Returns the number of entries in the [`SocketSet`] for the listeners and the connections, at first.
    pub(crate) const fn waits(&self) -> usize {
        self.interfaces.len() + PLACES
    }

    pub(crate) const fn statistics(&self) -> StreamStatistics {
        self.statistics
    }

    /// Writes the sockets to wait for into the set, from entry `first` on.
    pub(crate) fn await_in(&self, waits: &mut SocketSet, first: usize) -> Result<(), Errno> {
        let events = if self.accept_again_at.is_none() { PollFlags::IN } else { PollFlags::empty() };
        for (index, interface) in self.interfaces.iter().enumerate() {
            let listener = interface.listener.as_ref();
            let awaited = listener.map(|listener| Awaited { socket: listener.as_fd(), events, id: 0 });
            waits.set(first + index, awaited)?;
        }
        for (index, place) in self.places.iter().enumerate() {
            waits.set(first + self.interfaces.len() + index, place.wait_for())?;
        }
        Ok(())
    }

    /// Port that stands for connections without a number; no connection has this number.
    pub(crate) const UNNUMBERED: Port = Port::Stream(StreamId(0));

    /// Sets the DSCP that `dscp` returns for an interface on the answers to clients there from now on.
    pub(crate) fn follow(&self, dscp: impl Fn(InterfaceId) -> u8) {
        for interface in &self.interfaces {
            if let Some(listener) = &interface.listener {
                interface.marking.follow(listener.as_fd(), dscp(interface.on));
            }
        }
    }

    /// Returns when there is something to do even if no socket is ready.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        if !self.failed.is_empty() {
            return Some(Instant::ZERO);
        }
        self.places.iter().filter_map(Place::deadline).chain(self.accept_again_at).min()
    }

    /// Takes the result of a wait. Each connection then has one turn.
    pub(crate) fn begin_round(&mut self, now: Instant, waits: &SocketSet, first: usize) {
        self.accept_again_at = self.accept_again_at.filter(|until| *until > now);
        for (index, interface) in self.interfaces.iter_mut().enumerate() {
            interface.accepts = if waits.ready(first + index).is_empty() { 0 } else { ACCEPTS };
        }
        for (index, place) in self.places.iter_mut().enumerate() {
            place.ready = waits.ready(first + self.interfaces.len() + index);
        }
    }

    /// Returns the next event of this round; received bytes are in `buf`.
    pub(crate) fn next_event(&mut self, now: Instant, buf: &mut [u8]) -> Option<StreamEvent> {
        if let Some((on, id, attempt)) = self.failed.pop_front() {
            return Some(StreamEvent::Change(on, id, StreamChange::NotConnected(attempt)));
        }
        let buf = match buf.len() {
            0..=PIECE => buf,
            _ => buf.get_mut(..PIECE).unwrap_or_default(),
        };
        for _ in 0..self.places.len() {
            self.turn = (self.turn + 1) % self.places.len().max(1);
            let place = self.places.get_mut(self.turn);
            if let Some(event) = place.and_then(|place| place.handle(now, buf)) {
                return Some(event);
            }
        }
        self.accept(now)
    }

    /// Starts to connect from an interface, in place of the same attempt there if it is still under way. `dscp` returns the
    /// DSCP of its packets.
    pub(crate) fn connect(
        &mut self,
        on: InterfaceId,
        to: SocketAddrV4,
        attempt: Attempt,
        dscp: impl FnOnce(StreamId) -> u8,
    ) {
        let under_way =
            |connection: &Connection| connection.on == on && connection.state == State::Connecting(attempt);
        for place in self.places.iter_mut().filter(|place| place.connection.as_ref().is_some_and(under_way)) {
            place.vacate();
        }
        self.failed.retain(|(there, _, other)| (*there, *other) != (on, attempt));
        let id = self.fresh_id();
        let begun = self.place_to_connect().is_some_and(|index| {
            let marking = Marking::default();
            let interface = self.interfaces.get(usize::from(on.0));
            let begin = || -> io::Result<Socket> {
                let interface = &interface.ok_or(io::ErrorKind::NotFound)?.interface;
                let socket =
                    Socket::new(Domain::IPV4, Type::STREAM.nonblocking().cloexec(), Some(Protocol::TCP))?;
                socket.bind_device(Some(interface.name().as_bytes()))?;
                prepare(&socket)?;
                marking.follow(socket.as_fd(), dscp(id));
                match socket.connect(&SocketAddr::from(to).into()) {
                    Err(error) if error.raw_os_error() != Some(libc::EINPROGRESS) => Err(error),
                    _ => Ok(socket),
                }
            };
            let socket = begin();
            let Some((place, socket)) = self.places.get_mut(index).zip(socket.ok()) else { return false };
            place.occupy(Connection { on, id, socket, state: State::Connecting(attempt), marking });
            true
        });
        if !begun && self.failed.len() < MOST_PLACES {
            self.failed.push_back((on, id, attempt));
        }
    }

    /// Closes a connection once its waiting bytes are sent.
    pub(crate) fn close(&mut self, now: Instant, id: StreamId) {
        if let Some(place) = self.place(id) {
            place.close(now);
        }
    }

    /// Sends as much as the kernel takes and keeps the rest. Bytes for a closed connection are dropped.
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

    /// Returns an unused number. It wraps after four billion connections, so a number that is still in use is
    /// skipped.
    fn fresh_id(&mut self) -> StreamId {
        loop {
            let id = StreamId(self.next_id);
            self.next_id = self.next_id.wrapping_add(1).max(1);
            if self.place(id).is_none() {
                return id;
            }
        }
    }

    /// Returns a place for a new connection: a free one, or that of the connection that has been closing longest.
    fn vacant_place(&mut self) -> Option<usize> {
        if let Some(free) = self.places.iter().position(|place| place.connection.is_none()) {
            return Some(free);
        }
        let ending = |(index, place): (usize, &Place)| Some((place.ending_until()?, index));
        let (_, index) = self.places.iter().enumerate().filter_map(ending).min()?;
        self.places.get_mut(index)?.vacate();
        Some(index)
    }

    /// Returns a place for a connection that the machine opens: a new one where none is free.
    fn place_to_connect(&mut self) -> Option<usize> {
        let is_free = self.places.iter().any(|place| place.connection.is_none());
        if !is_free && self.places.len() < MOST_PLACES {
            self.places.push(Place::vacant());
        }
        self.vacant_place()
    }

    fn accept(&mut self, now: Instant) -> Option<StreamEvent> {
        let flags = libc::SOCK_NONBLOCK | libc::SOCK_CLOEXEC;
        while let Some(interface) = self.interfaces.iter_mut().find(|interface| interface.accepts > 0) {
            interface.accepts -= 1;
            let (on, marking) = (interface.on, interface.marking.clone());
            let (socket, peer) = match interface.listener.as_ref()?.accept4(flags) {
                Ok((socket, peer)) => (socket, peer.as_socket_ipv4()),
                Err(error) => {
                    let harmless = [libc::EAGAIN, libc::EINTR, libc::ECONNABORTED];
                    if !error.raw_os_error().is_some_and(|code| harmless.contains(&code)) {
                        self.statistics.accept_errors += 1;
                        self.accept_again_at = Some(now + ACCEPT_PAUSE);
                        return None;
                    }
                    interface.accepts = 0;
                    continue;
                }
            };
            let Some(index) = self.vacant_place() else {
                self.statistics.turned_away += 1;
                continue;
            };
            // This fails if the client is gone already.
            let Some(peer) = peer.filter(|_| prepare(&socket).is_ok()) else { continue };
            let id = self.fresh_id();
            self.places.get_mut(index)?.occupy(Connection { on, id, socket, state: State::Open, marking });
            self.statistics.accepted += 1;
            return Some(StreamEvent::Change(on, id, StreamChange::Accepted(peer)));
        }
        None
    }
}

fn listen(interface: &Interface, port: u16) -> io::Result<Socket> {
    let socket = Socket::new(Domain::IPV4, Type::STREAM.nonblocking().cloexec(), Some(Protocol::TCP))?;
    socket.bind_device(Some(interface.name().as_bytes()))?;
    // A restarted node finds its predecessor's connections still in TIME_WAIT.
    socket.set_reuse_address(true)?;
    socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, port)).into())?;
    socket.listen(BACKLOG)?;
    Ok(socket)
}

fn prepare(socket: &Socket) -> io::Result<()> {
    socket.set_tcp_nodelay(true)?;
    socket.set_send_buffer_size(KERNEL_ROOM)
}
