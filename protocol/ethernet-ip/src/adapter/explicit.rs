//! Class 3 connections: explicit messages with a sequence count, so that a repeated request is not executed twice.

use alloc::boxed::Box;
use alloc::vec;
use core::net::Ipv4Addr;

use super::Room;
use crate::connection::{ConnectionData, Triad, Watchdog};
use machine::{Instant, StreamId};

/// Length of the longest message of a connection in either direction, with its sequence count, in bytes: what controllers
/// ask for with a Large_Forward_Open. With its envelope it fits into an encapsulation message.
pub(super) const MAX_SIZE: u16 = 4_002;

/// A class 3 connection.
#[derive(Debug)]
pub(super) struct ExplicitConnection {
    pub(super) data: ConnectionData,
    pub(super) triad: Triad,
    /// The host that opened it.
    pub(super) host: Ipv4Addr,
    /// The TCP connection over which it was opened, and which carries it.
    pub(super) stream: StreamId,
    pub(super) o_t_id: u32,
    pub(super) t_o_id: u32,
    pub(super) o_t_size: u16,
    pub(super) t_o_size: u16,
    pub(super) watchdog: Watchdog,
}

/// A place for a connection and for its last reply, which is sent again if the request is repeated.
#[derive(Debug)]
struct Slot {
    connection: Option<ExplicitConnection>,
    /// Sequence count and length of the last reply.
    last: Option<(u16, usize)>,
    reply: Box<[u8]>,
}

/// All class 3 connections.
#[derive(Debug)]
pub(super) struct ExplicitConnections {
    slots: Box<[Slot]>,
    /// Number of open connections: usually none.
    open: usize,
}

impl ExplicitConnections {
    pub(super) fn new(room: usize) -> Self {
        let slot = || Slot {
            connection: None,
            last: None,
            reply: vec![0; usize::from(MAX_SIZE)].into_boxed_slice(),
        };
        Self { slots: core::iter::repeat_with(slot).take(room).collect(), open: 0 }
    }

    fn open(&self) -> impl Iterator<Item = &ExplicitConnection> {
        self.slots.iter().filter_map(|slot| slot.connection.as_ref())
    }

    pub(super) const fn len(&self) -> usize {
        self.open
    }

    /// Returns the data of each connection.
    pub(super) fn data(&self) -> impl Iterator<Item = &ConnectionData> {
        self.open().map(|connection| &connection.data)
    }

    /// Returns whether a host gets a further connection.
    pub(super) fn room(&self, host: Ipv4Addr) -> Room {
        let own = self.open().filter(|connection| connection.host == host).count();
        Room::of(own, self.len(), self.slots.len())
    }

    /// Ends the connection of another host that has been silent longest, of those that may give way. Returns its TCP
    /// connection.
    pub(super) fn give_way(
        &mut self,
        host: Ipv4Addr,
        is_preferred: impl Fn(Ipv4Addr) -> bool,
    ) -> Option<StreamId> {
        let gives_way =
            |connection: &&ExplicitConnection| connection.host != host && !is_preferred(connection.host);
        let least = self.open().filter(gives_way).min_by_key(|connection| connection.watchdog.fed_at())?;
        let (id, stream) = (least.o_t_id, least.stream);
        self.remove_unless(|connection| connection.o_t_id != id);
        Some(stream)
    }

    /// Returns whether a connection is carried by this TCP connection.
    pub(super) fn carries(&self, stream: StreamId) -> bool {
        self.open().any(|connection| connection.stream == stream)
    }

    pub(super) fn find(&self, triad: &Triad) -> Option<&ExplicitConnection> {
        self.open().find(|connection| connection.triad == *triad)
    }

    /// Returns the connection of a host by its triad.
    pub(super) fn find_of(&self, host: Ipv4Addr, triad: &Triad) -> Option<&ExplicitConnection> {
        self.open().find(|connection| connection.host == host && connection.triad == *triad)
    }

    pub(super) fn uses_id(&self, id: u32) -> bool {
        self.open().any(|connection| connection.o_t_id == id)
    }

    pub(super) fn add(&mut self, connection: ExplicitConnection) {
        if let Some(slot) = self.slots.iter_mut().find(|slot| slot.connection.is_none()) {
            slot.connection = Some(connection);
            slot.last = None;
            self.open += 1;
        }
    }

    /// Ends the connection of a host by its triad. Returns whether there was one.
    pub(super) fn remove_of(&mut self, host: Ipv4Addr, triad: &Triad) -> bool {
        self.remove_unless(|connection| connection.triad != *triad || connection.host != host) > 0
    }

    pub(super) fn retain(&mut self, alive: impl Fn(StreamId) -> bool) {
        self.remove_unless(|connection| alive(connection.stream));
    }

    pub(super) fn clear(&mut self) {
        self.remove_unless(|_| false);
    }

    /// Ends a connection that expired and returns its TCP connection.
    pub(super) fn remove_expired(&mut self, now: Instant) -> Option<StreamId> {
        let expired = |connection: &ExplicitConnection| connection.watchdog.expired(now);
        let mut slots = self.slots.iter_mut().map(|slot| &mut slot.connection);
        let place = slots.find(|place| place.as_ref().is_some_and(expired))?;
        let stream = place.take()?.stream;
        self.open -= 1;
        Some(stream)
    }

    fn remove_unless(&mut self, wanted: impl Fn(&ExplicitConnection) -> bool) -> usize {
        if self.open == 0 {
            return 0;
        }
        let mut removed = 0;
        for slot in &mut self.slots {
            if slot.connection.as_ref().is_some_and(|connection| !wanted(connection)) {
                slot.connection = None;
                removed += 1;
            }
        }
        self.open -= removed;
        removed
    }

    pub(super) fn next_timeout(&self) -> Option<Instant> {
        if self.open == 0 {
            return None;
        }
        self.open().map(|connection| connection.watchdog.deadline()).min()
    }

    /// Restarts the timeout of the connection of this number on this TCP connection, and returns the connection.
    pub(super) fn receive(
        &mut self,
        now: Instant,
        stream: StreamId,
        o_t_id: u32,
    ) -> Option<&ExplicitConnection> {
        let mut open = self.slots.iter_mut().filter_map(|slot| slot.connection.as_mut());
        let connection =
            open.find(|connection| connection.o_t_id == o_t_id && connection.stream == stream)?;
        connection.watchdog.feed(now);
        Some(connection)
    }

    /// Returns the reply if the request is a repetition.
    pub(super) fn stored_reply(&self, o_t_id: u32, count: u16) -> Option<&[u8]> {
        let slot = self.slots.iter().find(|slot| slot.has_id(o_t_id))?;
        let (_, len) = slot.last.filter(|(last, _)| *last == count)?;
        slot.reply.get(..len)
    }

    /// Stores a reply, in case its request is repeated.
    pub(super) fn store_reply(&mut self, o_t_id: u32, count: u16, reply: &[u8]) {
        if let Some(slot) = self.slots.iter_mut().find(|slot| slot.has_id(o_t_id))
            && let Some(place) = slot.reply.get_mut(..reply.len())
        {
            place.copy_from_slice(reply);
            slot.last = Some((count, reply.len()));
        }
    }
}

impl Slot {
    fn has_id(&self, o_t_id: u32) -> bool {
        self.connection.as_ref().is_some_and(|connection| connection.o_t_id == o_t_id)
    }
}
