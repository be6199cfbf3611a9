//! The connections of a scanner: which of them a frame, a deadline or a turn to send concerns. Nothing here walks over all
//! connections.

use alloc::vec::Vec;
use core::net::Ipv4Addr;

use machine::{
    Deadlines, Directory, Instant, LinkEvent, Numbers, Pending, StreamId, StreamRequest, Transmit, Turns,
};

use super::TooManyConnections;
use super::connection::Connection;

/// The connections, by number.
#[derive(Default, Debug)]
pub(super) struct Roster {
    slots: Vec<Slot>,
    /// Numbers without a connection, to use again.
    free: Vec<u16>,
    by_target: Directory<u32>,
    /// Open connections, by the adapter's address and the number of its cyclic frames.
    by_frames: Directory<u64>,
    by_stream: Directory<StreamId>,
    /// Open connections whose frames go to a multicast group.
    by_group: Directory<Ipv4Addr>,
    deadlines: Deadlines,
    /// Connections whose deadline is over.
    due: Numbers,
    /// Connections that the owner may have changed.
    touched: Turns,
    /// Connections that may have a cyclic frame to send, a message, a request about TCP connections, an event.
    cyclic: Turns,
    messages: Turns,
    streams: Turns,
    reporting: Turns,
    /// Connections whose cyclic data have arrived since the owner last asked.
    received: Turns,
}

#[derive(Default, Debug)]
struct Slot {
    connection: Option<Connection>,
    keys: Keys,
}

/// The keys by which a connection is found at the moment.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
struct Keys {
    frames: Option<u64>,
    stream: Option<StreamId>,
    group: Option<Ipv4Addr>,
}

impl Roster {
    /// Returns the number for another connection.
    pub(super) fn next_number(&self) -> Result<u16, TooManyConnections> {
        let number = self.free.last().map_or(self.slots.len(), |free| usize::from(*free));
        u16::try_from(number).ok().filter(|number| *number < u16::MAX).ok_or(TooManyConnections)
    }

    /// Adds a connection at the number that [`next_number`](Self::next_number) returned.
    pub(super) fn add(&mut self, number: u16, connection: Connection) {
        self.by_target.insert(connection.target().to_bits(), number);
        let slot = Slot { connection: Some(connection), keys: Keys::default() };
        match self.slots.get_mut(usize::from(number)) {
            Some(place) => {
                self.free.pop();
                *place = slot;
            }
            None => self.slots.push(slot),
        }
        let numbers = self.slots.len();
        self.due.reserve(numbers);
        let Self { touched, cyclic, messages, streams, reporting, received, .. } = self;
        for turns in [touched, cyclic, messages, streams, reporting, received] {
            turns.reserve(numbers);
        }
        self.note(number);
    }

    /// Removes a connection.
    pub(super) fn remove(&mut self, number: u16) -> Option<Connection> {
        let slot = self.slots.get_mut(usize::from(number))?;
        let connection = slot.connection.take()?;
        let keys = core::mem::take(&mut slot.keys);
        self.replace(number, keys, Keys::default());
        self.by_target.remove(connection.target().to_bits(), number);
        self.deadlines.set(number, None);
        self.free.push(number);
        Some(connection)
    }

    fn replace(&mut self, number: u16, before: Keys, after: Keys) {
        self.by_frames.replace(number, before.frames, after.frames);
        self.by_stream.replace(number, before.stream, after.stream);
        self.by_group.replace(number, before.group, after.group);
    }

    pub(super) fn get(&self, number: u16) -> Option<&Connection> {
        self.slots.get(usize::from(number))?.connection.as_ref()
    }

    /// Returns a connection, for its owner.
    pub(super) fn get_mut(&mut self, number: u16) -> Option<&mut Connection> {
        let connection = self.slots.get_mut(usize::from(number))?.connection.as_mut()?;
        self.touched.push(number);
        Some(connection)
    }

    /// Returns the O→T data of a connection, for its owner: they change neither its deadline nor what it has to send or to report.
    pub(super) fn output_mut(&mut self, number: u16) -> Option<&mut [u8]> {
        Some(self.slots.get_mut(usize::from(number))?.connection.as_mut()?.output_mut())
    }

    /// Returns all connections with their numbers.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u16, &Connection)> {
        self.slots.iter().zip(0..).filter_map(|(slot, number)| Some((number, slot.connection.as_ref()?)))
    }

    /// Returns the first connection.
    pub(super) fn first(&self) -> Option<u16> {
        self.iter().next().map(|(number, _)| number)
    }

    /// Takes note of what the owner changed.
    pub(super) fn settle(&mut self) {
        while let Some(number) = self.touched.pop() {
            let is_more = |connection: &Connection| {
                connection.has_message() || connection.has_stream_request() || connection.has_event()
            };
            if self.get(number).is_some_and(is_more) {
                self.note(number);
            } else {
                // At most its deadline has changed.
                self.serve_io(number, |_| ());
            }
        }
    }

    /// Calls a connection and takes note of what that changed.
    pub(super) fn serve<R>(&mut self, number: u16, call: impl FnOnce(&mut Connection) -> R) -> Option<R> {
        let result = call(self.slots.get_mut(usize::from(number))?.connection.as_mut()?);
        self.note(number);
        Some(result)
    }

    /// Calls a connection for cyclic data, which change at most its deadline and add events.
    fn serve_io<R>(&mut self, number: u16, call: impl FnOnce(&mut Connection) -> R) -> Option<R> {
        let connection = self.slots.get_mut(usize::from(number))?.connection.as_mut()?;
        let result = call(connection);
        if connection.has_event() {
            self.reporting.push(number);
        }
        self.deadlines.set(number, connection.poll_timeout());
        Some(result)
    }

    /// Calls every connection, for what concerns them all.
    pub(super) fn serve_all(&mut self, mut call: impl FnMut(&mut Connection)) {
        for number in 0..self.slots.len() as u16 {
            self.serve(number, &mut call);
        }
    }

    fn note(&mut self, number: u16) {
        self.note_all_but_deadline(number);
        if let Some(deadline) = self.get(number).map(Connection::poll_timeout) {
            self.deadlines.set(number, deadline);
        }
    }

    fn note_all_but_deadline(&mut self, number: u16) {
        let Some(Slot { connection: Some(connection), keys }) = self.slots.get_mut(usize::from(number))
        else {
            return;
        };
        let now = Keys {
            frames: connection.consumed().map(key),
            stream: connection.stream(),
            group: connection.group(),
        };
        if connection.has_message() {
            self.messages.push(number);
        }
        if connection.has_stream_request() {
            self.streams.push(number);
        }
        if connection.has_event() {
            self.reporting.push(number);
        }
        let before = core::mem::replace(keys, now);
        if before != now {
            self.replace(number, before, now);
        }
    }

    /// Calls the connections that take cyclic frames with this number from this station. Returns whether there is one.
    pub(super) fn serve_frames(
        &mut self,
        peer: Ipv4Addr,
        id: u32,
        mut call: impl FnMut(&mut Connection),
    ) -> bool {
        let mut last = None;
        // Several connections to one adapter may take part in one multicast: they have one connection number.
        while let Some(number) = self.by_frames.next(key((peer, id)), last) {
            let has_arrived = self.serve_io(number, |connection| {
                let before = connection.counters().received;
                call(connection);
                connection.counters().received != before
            });
            if has_arrived == Some(true) {
                self.received.push(number);
            }
            last = Some(number);
        }
        last.is_some()
    }

    /// Calls the connections to this address.
    pub(super) fn serve_target(&mut self, address: Ipv4Addr, mut call: impl FnMut(&mut Connection)) {
        let mut last = None;
        while let Some(number) = self.by_target.next(address.to_bits(), last) {
            self.serve(number, &mut call);
            last = Some(number);
        }
    }

    /// Returns the connections to this address.
    pub(super) fn with_target(&self, address: Ipv4Addr) -> impl Iterator<Item = (u16, &Connection)> {
        self.by_target.of(address.to_bits()).filter_map(|number| Some((number, self.get(number)?)))
    }

    /// Returns the connection that has this TCP connection.
    pub(super) fn with_stream(&self, stream: StreamId) -> Option<u16> {
        self.by_stream.next(stream, None)
    }

    /// Returns a multicast group that frames go to.
    pub(super) fn group(&self, index: usize) -> Option<Ipv4Addr> {
        self.by_group.key(index)
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        // Those whose frame was not taken since the last time have no deadline.
        while let Some(number) = self.cyclic.pop() {
            self.due.insert(number);
        }
        while let Some(number) = self.deadlines.take_due(now) {
            self.due.insert(number);
        }
        while let Some(number) = self.due.take_first() {
            let slot = self.slots.get_mut(usize::from(number));
            if let Some(connection) = slot.and_then(|slot| slot.connection.as_mut()) {
                connection.handle_timeout(now);
                // It gets its next deadline once its cyclic frame is sent.
                self.note_all_but_deadline(number);
                self.cyclic.push(number);
            }
        }
    }

    /// Writes the next cyclic frame that is due.
    pub(super) fn poll_cyclic(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        while let Some(number) = self.deadlines.take_due(now) {
            self.cyclic.push(number);
        }
        while let Some(number) = self.cyclic.pop() {
            if let Some(Some(transmit)) = self.serve_io(number, |connection| connection.poll_io(now, buf)) {
                return Some(transmit);
            }
        }
        None
    }

    /// Returns what the connections may have. Those that the owner may have changed may have anything.
    pub(super) fn pending(&self, now: Instant) -> Pending {
        if !self.touched.is_empty() {
            return Pending::ANYTHING;
        }
        let is_due = self.deadlines.first().is_some_and(|due| due <= now);
        Pending {
            frame: is_due || !(self.cyclic.is_empty() && self.messages.is_empty()),
            request: !self.streams.is_empty(),
            event: !self.reporting.is_empty(),
        }
    }

    /// Writes the next other frame.
    pub(super) fn poll_message(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        while let Some(number) = self.messages.first() {
            if let Some(Some(transmit)) = self.serve(number, |connection| connection.poll_message(now, buf)) {
                return Some(transmit);
            }
            self.messages.pop();
        }
        None
    }

    pub(super) fn poll_stream(&mut self) -> Option<StreamRequest> {
        while let Some(number) = self.streams.first() {
            if let Some(Some(request)) = self.serve(number, Connection::poll_stream) {
                return Some(request);
            }
            self.streams.pop();
        }
        None
    }

    pub(super) fn poll_event(&mut self) -> Option<(u16, LinkEvent)> {
        while let Some(number) = self.reporting.first() {
            let connection =
                self.slots.get_mut(usize::from(number)).and_then(|slot| slot.connection.as_mut());
            if let Some(event) = connection.and_then(Connection::poll_event) {
                return Some((number, event));
            }
            self.reporting.pop();
        }
        None
    }

    /// Returns the next connection whose cyclic data have arrived.
    pub(super) fn poll_received(&mut self) -> Option<u16> {
        self.received.pop()
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        if self.touched.is_empty() && self.cyclic.is_empty() {
            return self.deadlines.first();
        }
        // The owner changed connections, or did not poll the scanner until it had nothing to send.
        let settled = self.deadlines.iter().filter(|(number, _)| !self.touched.contains(*number));
        let others = self.touched.iter().chain(self.cyclic.iter());
        let others = others.filter_map(|number| self.get(number)?.poll_timeout());
        settled.map(|(_, at)| at).chain(others).min()
    }
}

/// Returns an address and a connection number as one number, which is compared at once.
fn key((address, id): (Ipv4Addr, u32)) -> u64 {
    u64::from(address.to_bits()) << 32 | u64::from(id)
}
