//! TCP connections and the sessions on them. A session ends with its TCP connection.

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use core::net::{Ipv4Addr, SocketAddrV4};

use super::encapsulated::{Answer, answer};
use super::session::{Carried, Session};
use super::state::State;
use crate::encapsulation::{Command, Message, Reassembly};
use machine::{Duration, Instant, StreamId};

/// Time in which a client registers a session, or is the first to give way. Assumed: many round trips.
const REGISTERED_WITHIN: Duration = Duration::from_secs(1);

#[derive(Debug, Default)]
struct Slot {
    session: Option<Session>,
    reassembly: Reassembly,
    /// Whether there may be whole messages in the stream.
    pending: bool,
}

/// All TCP connections. One message of each is answered in turn.
#[derive(Debug)]
pub(super) struct Sessions {
    slots: Box<[Slot]>,
    closing: VecDeque<StreamId>,
    next_handle: u32,
    turn: usize,
    /// Whether some slot is pending.
    pending: bool,
    /// When the connection that has been silent longest last sent something.
    oldest: Option<Instant>,
}

impl Sessions {
    pub(super) fn new(room: usize, first_handle: u32) -> Self {
        Self {
            slots: core::iter::repeat_with(Slot::default).take(room).collect(),
            closing: VecDeque::with_capacity(2 * room + 1),
            next_handle: first_handle,
            turn: 0,
            pending: false,
            oldest: None,
        }
    }

    fn open_sessions(&self) -> impl Iterator<Item = &Session> {
        self.slots.iter().filter_map(|slot| slot.session.as_ref())
    }

    pub(super) fn len(&self) -> usize {
        self.open_sessions().count()
    }

    pub(super) fn has(&self, stream: StreamId) -> bool {
        self.open_sessions().any(|session| session.stream == stream)
    }

    /// Handles a client that connected: gives it a free place or the place of another client ([`Self::place_for`]), or
    /// closes its connection.
    pub(super) fn open(
        &mut self,
        now: Instant,
        stream: StreamId,
        peer: SocketAddrV4,
        is_preferred: impl Fn(Ipv4Addr) -> bool,
        carried: impl Fn(StreamId) -> Carried,
    ) {
        let place = self.place_for(now, *peer.ip(), is_preferred, carried);
        let Some(slot) = place.and_then(|index| self.slots.get_mut(index)) else {
            return self.refuse(stream);
        };
        let session = Session { stream, peer, handle: 0, since: now, last_heard: now, last_request: now };
        if let Some(evicted) = slot.session.replace(session) {
            self.closing.push_back(evicted.stream);
        }
        slot.reassembly.clear();
        slot.pending = false;
        self.find_oldest();
    }

    /// Ends a TCP connection that gets no place.
    pub(super) fn refuse(&mut self, stream: StreamId) {
        self.closing.push_back(stream);
    }

    /// Returns the place for a client of a host.
    ///
    /// If all places are taken, a client gets the place of another one, so that nobody can lock others out by holding sessions.
    /// Clients without an open connection give way first, then those with connections of class 1 alone, which go on
    /// without it. A client that carries a class 3 connection gives way only to a preferred host: an owner of outputs, or one that
    /// was the last owner of outputs ([`IoConnections::is_preferred`](super::io::IoConnections::is_preferred)). A client of a
    /// preferred host gives way to no other host.
    ///
    /// Of clients that are equal in this, those that did not register in time give way first, then those of the host with the
    /// most connections, then the one whose last request is oldest.
    fn place_for(
        &self,
        now: Instant,
        host: Ipv4Addr,
        is_preferred: impl Fn(Ipv4Addr) -> bool,
        carried: impl Fn(StreamId) -> Carried,
    ) -> Option<usize> {
        if let Some(free) = self.slots.iter().position(|slot| slot.session.is_none()) {
            return Some(free);
        }
        let sessions_of = |other: Ipv4Addr| {
            let open = self.open_sessions().filter(|session| *session.peer.ip() == other).count();
            // The new one counts, too.
            open + usize::from(other == host)
        };
        let most = if is_preferred(host) { Carried::Explicit } else { Carried::Cyclic };
        let key = |session: &Session| {
            let other = *session.peer.ip();
            let carried = carried(session.stream);
            let most = if other == host { Carried::Nothing } else { most };
            let gives_way = carried <= most && (other == host || !is_preferred(other));
            let is_registered = session.handle != 0 || now.since(session.since) < REGISTERED_WITHIN;
            gives_way.then(|| (carried, is_registered, usize::MAX - sessions_of(other), session.last_request))
        };
        let numbered = self.slots.iter().enumerate();
        let keys = numbered.filter_map(|(index, slot)| Some((key(slot.session.as_ref()?)?, index)));
        keys.min().map(|(_, index)| index)
    }

    /// Handles the end of a connection.
    pub(super) fn closed(&mut self, stream: StreamId) {
        if let Some(slot) = self.slot(stream) {
            slot.session = None;
            self.find_oldest();
        }
    }

    /// Ends a connection.
    pub(super) fn end(&mut self, stream: StreamId) {
        self.closed(stream);
        self.closing.push_back(stream);
    }

    /// Ends all connections.
    pub(super) fn end_all(&mut self) {
        let sessions = self.slots.iter_mut().filter_map(|slot| slot.session.take());
        self.closing.extend(sessions.map(|session| session.stream));
        self.find_oldest();
    }

    /// Returns whether a connection is to be closed.
    pub(super) fn has_ended(&self) -> bool {
        !self.closing.is_empty()
    }

    /// Returns whether messages may wait for their answers.
    pub(super) const fn has_messages(&self) -> bool {
        self.pending
    }

    pub(super) fn poll_close(&mut self) -> Option<StreamId> {
        self.closing.pop_front()
    }

    /// Takes bytes of a client. Returns whether its TCP connection was ended, because more bytes wait than there is room for.
    pub(super) fn receive(&mut self, now: Instant, stream: StreamId, bytes: &[u8]) -> bool {
        let Some(slot) = self.slot(stream) else { return false };
        let taken = slot.reassembly.push(bytes).is_ok();
        slot.pending = true;
        if let Some(session) = &mut slot.session {
            session.last_heard = now;
        }
        self.pending = true;
        self.find_oldest();
        if !taken {
            self.end(stream);
        }
        !taken
    }

    /// Answers the next whole message, if there is one.
    pub(super) fn answer_next(
        &mut self,
        now: Instant,
        state: &mut State,
        buf: &mut [u8],
    ) -> Option<(StreamId, Answer)> {
        if !self.pending {
            return None;
        }
        let room = self.slots.len();
        for step in 0..room {
            let index = (self.turn + step) % room;
            let Some(slot) = self.slots.get_mut(index) else { continue };
            let Slot { session: Some(session), reassembly, pending: pending @ true } = slot else { continue };
            match reassembly.next_message() {
                Some(message) => {
                    self.turn = index + 1;
                    let (Message::Whole(header, _) | Message::TooLong(header)) = &message;
                    if header.command != Command::Nop {
                        session.last_request = now;
                    }
                    let answer = answer(state, now, session, &mut self.next_handle, message, buf);
                    return Some((session.stream, answer));
                }
                None => *pending = false,
            }
        }
        self.pending = false;
        None
    }

    /// Ends connections that have been silent for too long (volume 2, 5-4.3.13).
    pub(super) fn check_inactivity(&mut self, now: Instant, limit: Option<Duration>) {
        let (Some(limit), Some(oldest)) = (limit, self.oldest) else { return };
        if now.since(oldest) < limit {
            return;
        }
        for slot in &mut self.slots {
            if slot.session.as_ref().is_some_and(|session| now.since(session.last_heard) >= limit)
                && let Some(session) = slot.session.take()
            {
                self.closing.push_back(session.stream);
            }
        }
        self.find_oldest();
    }

    pub(super) fn next_inactivity(&self, limit: Option<Duration>) -> Option<Instant> {
        Some(self.oldest? + limit?)
    }

    fn find_oldest(&mut self) {
        self.oldest = self.open_sessions().map(|session| session.last_heard).min();
    }

    fn slot(&mut self, stream: StreamId) -> Option<&mut Slot> {
        self.slots.iter_mut().find(|slot| slot.session.as_ref().is_some_and(|s| s.stream == stream))
    }
}
