//! Class 1 connections: sending, receiving and timeouts.

use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use super::Room;
use crate::class1::{Frame, RUN_IDLE_LEN};
use crate::connection::{ConnectionData, Inhibit, Parameters, Triad, Trigger, Watchdog};
use crate::description::Description;
use crate::objects::AssemblyData;
use machine::wire::Truncated;
use machine::{Cycle, Duration, Instant, OwnerReport, Sender, Sequence, StreamId};

/// What a connection may do with the outputs (volume 1, 3-6.4).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Kind {
    /// Sets the outputs; each assembly of outputs has one.
    ExclusiveOwner,
    /// Receives the inputs.
    InputOnly,
    /// Receives the inputs that another connection gets, and ends with the last such connection.
    ListenOnly,
}

/// A class 1 connection.
#[derive(Debug)]
pub(super) struct IoConnection {
    pub(super) data: ConnectionData,
    pub(super) triad: Triad,
    pub(super) kind: Kind,
    /// Assemblies that it was opened to: configuration, consumed, produced.
    pub(super) points: [Option<u32>; 3],
    pub(super) originator: Ipv4Addr,
    /// The TCP connection over which it was opened, while that is there.
    pub(super) stream: Option<StreamId>,
    pub(super) o_t_id: u32,
    /// Bytes behind the sequence count of an O→T frame.
    pub(super) o_t_len: usize,
    /// True if the owner's frames have a run/idle header. Without one, the owner always runs.
    pub(super) has_header: bool,
    pub(super) watchdog: Watchdog,
    pub(super) sequence: Sequence,
    /// Sequence count of the last data taken over.
    pub(super) count: Option<u16>,
    /// Whether the last run/idle header was run.
    pub(super) run: bool,
    pub(super) producer: Producer,
}

/// Producer of T→O frames. Connections that share a multicast have equal producers, and only one of them sends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Producer {
    pub(super) id: u32,
    pub(super) to: SocketAddrV4,
    pub(super) parameters: Parameters,
    /// The DSCP that the QoS object had for this priority when the connection was opened.
    pub(super) dscp: u8,
    /// The assembly that it sends.
    pub(super) assembly: u32,
    /// True if its frames have a run/idle header.
    pub(super) has_header: bool,
    pub(super) cycle: Cycle,
    pub(super) trigger: Trigger,
    pub(super) inhibit: Inhibit,
    /// Number of the last frame.
    pub(super) sequence: u32,
    /// Sequence count of the last data.
    pub(super) count: u16,
    /// The data changed since the last frame.
    pub(super) changed: bool,
    pub(super) sends: bool,
}

/// A frame that is to be sent now.
#[derive(Clone, Copy, Debug)]
pub(super) struct Due {
    pub(super) id: u32,
    pub(super) to: SocketAddrV4,
    pub(super) sequence: u32,
    pub(super) count: u16,
    pub(super) assembly: u32,
    pub(super) has_header: bool,
    pub(super) dscp: u8,
}

/// Result of receiving a frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum ReceivedFrame {
    Foreign,
    WrongSize,
    Late,
    Fresh { missing: u32 },
}

impl IoConnection {
    /// Returns who opened it, and when it ends.
    pub(super) fn owner_report(&self) -> OwnerReport {
        OwnerReport {
            from: Sender::Ip(self.originator),
            serial_number: Some(self.triad.originator_serial),
            interval: Duration::from_micros(self.data.o_t.api_us.into()),
            timeout: self.watchdog.timeout(),
        }
    }

    /// Returns whether its owner runs by this frame, and the data.
    fn run_and_data<'f>(&self, frame: &Frame<'f>) -> Result<(bool, &'f [u8]), Truncated> {
        if self.has_header { frame.run_and_data() } else { Ok((true, frame.payload)) }
    }

    /// Returns whether it owns the outputs of this assembly.
    fn owns(&self, consumed: u32) -> bool {
        let [_, point, _] = self.points;
        self.kind == Kind::ExclusiveOwner && point == Some(consumed)
    }

    /// Returns whether a frame with so many bytes behind its sequence count may belong to this connection. A heartbeat
    /// has a run/idle header or none, whatever was agreed.
    const fn accepts_len(&self, len: usize) -> bool {
        match self.kind {
            Kind::ExclusiveOwner => len == self.o_t_len,
            Kind::InputOnly | Kind::ListenOnly => len == 0 || len == RUN_IDLE_LEN as usize,
        }
    }
}

impl Producer {
    /// Returns whether a change of the data sends a frame, in addition to time.
    const fn sends_on_change(&self) -> bool {
        matches!(self.trigger, Trigger::ChangeOfState | Trigger::Application)
    }

    fn next(&self) -> Option<Instant> {
        let change = (self.changed && self.sends_on_change()).then(|| self.inhibit.free_at());
        self.sends.then(|| change.map_or(self.cycle.next(), |change| change.min(self.cycle.next())))
    }

    fn produce(&mut self, now: Instant) -> Option<Due> {
        if self.next().is_none_or(|next| now < next) {
            return None;
        }
        if self.cycle.tick(now).is_none() {
            // A change restarts the interval.
            let period = self.cycle.period();
            self.cycle = Cycle::new(now + period, period);
        }
        // Where changes trigger frames, one that only time triggers repeats the data, and therefore their count (volume 1,
        // 3-4.1); the number of the frame counts each frame (volume 2, 3-2.2.1).
        let is_new = self.changed || !self.sends_on_change() || self.sequence == 0;
        self.changed = false;
        self.inhibit.produced(now);
        self.sequence = self.sequence.wrapping_add(1);
        self.count = self.count.wrapping_add(is_new.into());
        let Self { id, to, sequence, count, assembly, has_header, dscp, .. } = *self;
        Some(Due { id, to, sequence, count, assembly, has_header, dscp })
    }
}

/// Time for which the last owner of outputs that nobody owns is preferred to other hosts: as long as a silent TCP connection
/// lasts by default (volume 2, 5-4.3.13). Assumed.
const PREFERRED_FOR: Duration = Duration::from_secs(120);

/// The last owner of outputs.
#[derive(Clone, Copy, Debug)]
struct LastOwner {
    consumed: u32,
    host: Ipv4Addr,
    until: Instant,
    report: OwnerReport,
}

/// All class 1 connections. Their memory is allocated at the start.
#[derive(Debug)]
pub(super) struct IoConnections {
    open: Vec<IoConnection>,
    /// The last owner of each consumed assembly that had one.
    last_owners: Vec<LastOwner>,
}

impl IoConnections {
    pub(super) fn new(description: &Description) -> Self {
        let Description { exclusive_owners, input_only, listen_only, .. } = *description;
        let room = [exclusive_owners, input_only, listen_only].into_iter().map(usize::from).sum();
        let consumed = description.assemblies.iter().filter(|assembly| assembly.role.is_consumed());
        Self { open: Vec::with_capacity(room), last_owners: Vec::with_capacity(consumed.count()) }
    }

    pub(super) const fn len(&self) -> usize {
        self.open.len()
    }

    pub(super) fn count(&self, kind: Kind) -> usize {
        self.open.iter().filter(|connection| connection.kind == kind).count()
    }

    /// Returns whether a host gets a further connection of this kind.
    pub(super) fn room(&self, host: Ipv4Addr, kind: Kind, places: usize) -> Room {
        let own =
            self.open.iter().filter(|connection| connection.kind == kind && connection.originator == host);
        Room::of(own.count(), self.count(kind), places)
    }

    pub(super) fn find(&self, triad: &Triad) -> Option<&IoConnection> {
        self.open.iter().find(|connection| connection.triad == *triad)
    }

    /// Returns the connection of a host with this triad. Two hosts may use the same triad, so a host that overhears one
    /// cannot take the connection.
    pub(super) fn find_of(&self, host: Ipv4Addr, triad: &Triad) -> Option<&IoConnection> {
        self.open.iter().find(|connection| connection.originator == host && connection.triad == *triad)
    }

    /// Returns the data of each connection.
    pub(super) fn data(&self) -> impl Iterator<Item = &ConnectionData> {
        self.open.iter().map(|connection| &connection.data)
    }

    /// Returns the owner of outputs that ended last.
    pub(super) fn last_owner(&self) -> Option<OwnerReport> {
        self.last_owners.last().map(|last| last.report)
    }

    /// Returns an owner of outputs that is not this host.
    pub(super) fn owner_besides(&self, host: Ipv4Addr) -> Option<Ipv4Addr> {
        self.owners().map(|owner| owner.originator).find(|owner| *owner != host)
    }

    fn owners(&self) -> impl Iterator<Item = &IoConnection> {
        self.open.iter().filter(|connection| connection.kind == Kind::ExclusiveOwner)
    }

    /// Returns the owner of the outputs of this assembly.
    pub(super) fn owner_of(&self, consumed: u32) -> Option<&IoConnection> {
        self.open.iter().find(|connection| connection.owns(consumed))
    }

    /// Returns an owner of outputs that sends no data that may be used, if there is one.
    pub(super) fn silent_owner(&self) -> Option<&IoConnection> {
        self.owners().find(|owner| !owner.run)
    }

    /// Returns whether a host owns outputs.
    pub(super) fn is_owner(&self, host: Ipv4Addr) -> bool {
        self.owners().any(|owner| owner.originator == host)
    }

    /// Returns whether a host is preferred where places are scarce: it owns outputs, or was the last to own outputs that nobody
    /// owns now, not long ago. So an owner that was cut off for a moment gets in again.
    pub(super) fn is_preferred(&self, now: Instant, host: Ipv4Addr) -> bool {
        let was_owner =
            |last: &LastOwner| last.host == host && now < last.until && !self.is_owned(last.consumed);
        self.is_owner(host) || self.last_owners.iter().any(was_owner)
    }

    /// Returns the connection of this kind that gives way to a preferred host: of those of other hosts that are not preferred the
    /// one that has been silent longest.
    pub(super) fn least_wanted(&self, now: Instant, host: Ipv4Addr, kind: Kind) -> Option<(Ipv4Addr, Triad)> {
        let gives_way = |connection: &&IoConnection| {
            let other = connection.originator;
            connection.kind == kind && other != host && !self.is_preferred(now, other)
        };
        let least =
            self.open.iter().filter(gives_way).min_by_key(|connection| connection.watchdog.fed_at())?;
        Some((least.originator, least.triad))
    }

    /// Remembers the owner of outputs that is about to end.
    fn remember_owner(&mut self, now: Instant, index: usize) {
        let Some(owner) = self.open.get(index).filter(|open| open.kind == Kind::ExclusiveOwner) else {
            return;
        };
        let [_, Some(consumed), _] = owner.points else { return };
        let until = now + PREFERRED_FOR;
        let last = LastOwner { consumed, host: owner.originator, until, report: owner.owner_report() };
        self.last_owners.retain(|former| former.consumed != last.consumed);
        self.last_owners.push(last);
    }

    /// Returns whether only other hosts own outputs.
    pub(super) fn is_foreign(&self, host: Ipv4Addr) -> bool {
        self.owners().next().is_some() && !self.is_owner(host)
    }

    /// Returns whether the outputs of this assembly have an owner.
    pub(super) fn is_owned(&self, consumed: u32) -> bool {
        self.open.iter().any(|connection| connection.owns(consumed))
    }

    /// Returns whether the outputs of this assembly have an owner that is in run.
    pub(super) fn is_run(&self, consumed: u32) -> bool {
        self.open.iter().any(|connection| connection.run && connection.owns(consumed))
    }

    /// Returns whether a connection that is not listen-only gets the inputs of this assembly.
    pub(super) fn may_listen_to(&self, produced: u32) -> bool {
        let gets = |connection: &IoConnection| {
            connection.kind != Kind::ListenOnly && connection.producer.assembly == produced
        };
        self.open.iter().any(gets)
    }

    pub(super) fn uses_id(&self, id: u32) -> bool {
        self.open.iter().any(|connection| connection.o_t_id == id || connection.producer.id == id)
    }

    /// Returns the producers of the multicasts that are running.
    pub(super) fn multicasts(&self) -> impl Iterator<Item = &Producer> {
        let producers = self.open.iter().map(|connection| &connection.producer);
        producers.filter(|producer| producer.to.ip().is_multicast() && producer.sends)
    }

    pub(super) fn add(&mut self, connection: IoConnection) {
        self.open.push(connection);
    }

    pub(super) fn clear(&mut self) {
        self.open.clear();
        self.last_owners.clear();
    }

    pub(super) fn data_changed(&mut self, assembly: u32) {
        let producers = self.open.iter_mut().map(|connection| &mut connection.producer);
        producers
            .filter(|producer| producer.assembly == assembly)
            .for_each(|producer| producer.changed = true);
    }

    /// Returns whether an owner of outputs is in run; `None` without an owner.
    pub(super) fn is_owner_running(&self) -> Option<bool> {
        self.owners().map(|owner| owner.run).reduce(|one, other| one || other)
    }

    /// Takes a frame; the owner's data go into the assembly that it consumes.
    pub(super) fn receive(
        &mut self,
        now: Instant,
        peer: Ipv4Addr,
        frame: &Frame<'_>,
        assemblies: &mut AssemblyData,
    ) -> ReceivedFrame {
        let is_its = |connection: &&mut IoConnection| {
            connection.o_t_id == frame.connection && connection.originator == peer
        };
        let Some(connection) = self.open.iter_mut().find(is_its) else { return ReceivedFrame::Foreign };
        if !connection.accepts_len(frame.payload.len()) {
            return ReceivedFrame::WrongSize;
        }
        let Some(ahead) = connection.sequence.accept(now, frame.sequence) else { return ReceivedFrame::Late };
        connection.watchdog.feed(now);
        if connection.kind == Kind::ExclusiveOwner
            && let Ok((run, data)) = connection.run_and_data(frame)
        {
            connection.run = run;
            // The same count is the same data.
            if connection.count.replace(frame.count) != Some(frame.count)
                && let [_, Some(consumed), _] = connection.points
            {
                assemblies.consume(consumed, data);
            }
        }
        ReceivedFrame::Fresh { missing: ahead.saturating_sub(1) }
    }

    pub(super) fn next_due(&mut self, now: Instant) -> Option<Due> {
        self.open.iter_mut().find_map(|connection| connection.producer.produce(now))
    }

    /// Returns when the next frame is due.
    pub(super) fn next_frame(&self) -> Option<Instant> {
        self.open.iter().filter_map(|connection| connection.producer.next()).min()
    }

    /// Returns whether a connection was opened over this TCP connection.
    pub(super) fn was_opened_over(&self, stream: StreamId) -> bool {
        self.open.iter().any(|connection| connection.stream == Some(stream))
    }

    /// Forgets TCP connections that are gone.
    pub(super) fn retain_streams(&mut self, alive: impl Fn(StreamId) -> bool) {
        for connection in &mut self.open {
            connection.stream = connection.stream.filter(|stream| alive(*stream));
        }
    }

    /// Ends a connection that expired, and the connections that depend on it. Returns its kind, and its TCP connection.
    ///
    /// With an owner, its multicast ends for all that take part, also for input-only connections: if the data went on, the
    /// owner could not notice that its own frames do not arrive any more (volume 1, 3-6.4). What is sent to one host alone
    /// goes on.
    pub(super) fn remove_expired(&mut self, now: Instant) -> Option<(Kind, Option<StreamId>)> {
        let index = self.open.iter().position(|connection| connection.watchdog.expired(now))?;
        let IoConnection { stream, producer, .. } = *self.open.get(index)?;
        let kind = self.remove_at(now, index);
        if kind == Kind::ExclusiveOwner && producer.to.ip().is_multicast() {
            for index in 0..self.open.len() {
                if self.open.get(index).is_some_and(|connection| connection.producer.id == producer.id) {
                    self.remember_owner(now, index);
                }
            }
            self.open.retain(|connection| connection.producer.id != producer.id);
            self.end_listeners();
        }
        Some((kind, stream))
    }

    /// Ends a connection of a host, and the connections that depend on it. Returns its kind.
    pub(super) fn remove(&mut self, now: Instant, host: Ipv4Addr, triad: &Triad) -> Option<Kind> {
        let is_it = |connection: &IoConnection| connection.originator == host && connection.triad == *triad;
        let index = self.open.iter().position(is_it)?;
        Some(self.remove_at(now, index))
    }

    fn remove_at(&mut self, now: Instant, index: usize) -> Kind {
        self.remember_owner(now, index);
        let IoConnection { kind, producer, .. } = self.open.swap_remove(index);
        self.end_listeners();
        if producer.sends && producer.to.ip().is_multicast() {
            // The multicast goes on for the others, without a gap in its numbers.
            let heir = self.open.iter_mut().find(|connection| connection.producer.id == producer.id);
            if let Some(heir) = heir {
                heir.producer = producer;
            }
        }
        kind
    }

    /// Ends the listen-only connections to inputs that no other connection gets any more.
    fn end_listeners(&mut self) {
        let is_left = |listener: &IoConnection| {
            listener.kind == Kind::ListenOnly && !self.may_listen_to(listener.producer.assembly)
        };
        if let Some(index) = self.open.iter().position(is_left) {
            self.open.swap_remove(index);
            self.end_listeners();
        }
    }

    pub(super) fn next_timeout(&self) -> Option<Instant> {
        let each = |connection: &IoConnection| {
            let watchdog = connection.watchdog.deadline();
            connection.producer.next().map_or(watchdog, |next| next.min(watchdog))
        };
        self.open.iter().map(each).min()
    }
}
