//! TCP connections and the sessions on them. A session lives and dies with its connection.

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use core::net::SocketAddrV4;

use super::encapsulated::{Answer, answer};
use super::session::Session;
use super::state::State;
use crate::encapsulation::Reassembly;
use machine::{Duration, Instant, StreamId};

#[derive(Debug, Default)]
struct Slot {
    session: Option<Session>,
    reassembly: Reassembly,
    /// There may be whole messages in the stream.
    pending: bool,
}

/// All TCP connections. What comes out of them is answered in turns, one message each.
#[derive(Debug)]
pub(super) struct Sessions {
    slots: Box<[Slot]>,
    closing: VecDeque<StreamId>,
    next_handle: u32,
    turn: usize,
    /// Some slot is pending.
    pending: bool,
    /// When the connection that is silent longest was heard last.
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

    /// A client connected. Where all places are taken, it gets that of the one that has been silent longest
    /// without registering a session, or none.
    pub(super) fn open(&mut self, now: Instant, stream: StreamId, peer: SocketAddrV4) {
        let idle = |slot: &&mut Slot| {
            slot.session
                .as_ref()
                .map_or(Some(Instant::ZERO), |session| (session.handle == 0).then_some(session.last_heard))
        };
        let free = self.slots.iter().any(|slot| slot.session.is_none());
        let place = self
            .slots
            .iter_mut()
            .filter(|slot| slot.session.is_none() || !free && idle(slot).is_some())
            .min_by_key(|slot| idle(slot));
        let Some(slot) = place else {
            self.closing.push_back(stream);
            return;
        };
        if let Some(evicted) = slot.session.replace(Session { stream, peer, handle: 0, last_heard: now }) {
            self.closing.push_back(evicted.stream);
        }
        slot.reassembly.clear();
        slot.pending = false;
        self.find_oldest();
    }

    /// A connection is gone.
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

    pub(super) fn poll_close(&mut self) -> Option<StreamId> {
        self.closing.pop_front()
    }

    pub(super) fn receive(&mut self, now: Instant, stream: StreamId, bytes: &[u8]) {
        let Some(slot) = self.slot(stream) else { return };
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
