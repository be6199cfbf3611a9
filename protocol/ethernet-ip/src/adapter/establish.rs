//! Checks requests to open a connection, and opens those of class 1 (volume 1, 3-5.5.2 and 3-6; volume 2, 3-3).

use core::net::{Ipv4Addr, SocketAddrV4};

use super::Room;
use super::io::{IoConnection, Kind, Producer};
use super::state::{Context, State};
use crate::IO_PORT;
use crate::cip::{AcceptableIntervals, Application, IntervalLimit, Violation, class};
use crate::class1::{RUN_IDLE_LEN, SEQUENCE_LEN};
use crate::connection::{
    ConnectionType, Inhibit, OpenReply, OpenRequest, Parameters, TimeoutMultiplier, Triad, Trigger, Watchdog,
    sequence,
};
use crate::description::{Assembly, Role};
use crate::objects::MULTICASTS;
use machine::{Cycle, Duration, Instant, Peer};

pub(super) const fn micros(micros: u32) -> Duration {
    Duration::from_micros(micros as u64)
}

/// The assemblies of an I/O connection.
struct IoAssemblies {
    kind: Kind,
    consumed: &'static Assembly,
    produced: &'static Assembly,
    named: [Option<u32>; 3],
}

impl State {
    /// Opens a connection, or returns the violation.
    pub(super) fn open(
        &mut self,
        context: &mut Context,
        request: &OpenRequest<'_>,
    ) -> Result<OpenReply, Violation> {
        let OpenRequest { triad, o_t, t_o, .. } = *request;
        if self.closed || self.address_is_taken {
            return Err(Violation::NotConfigured);
        }
        let null = (o_t.kind == ConnectionType::Null, t_o.kind == ConnectionType::Null);
        let peer = Peer {
            address: Some(*context.peer.ip()),
            mac: None,
            serial_number: Some(triad.originator_serial),
        };
        if !self.originators.allows(peer) {
            return Err(Violation::OriginatorNotListed);
        }
        let host = *context.peer.ip();
        let known = self.io.find_of(host, &triad).is_some() || self.explicit.find_of(host, &triad).is_some();
        if known && null != (true, true) {
            return Err(Violation::DuplicateForwardOpen);
        }
        let application = request.path.application()?;
        if let Some(key) = application.key {
            key.check(&self.device.description.key())?;
        }
        match null {
            (true, true) => return self.open_null(request, &application),
            (true, false) => return Err(Violation::OtType),
            (false, true) => return Err(Violation::ToType),
            (false, false) => {}
        }
        let multiplier = TimeoutMultiplier::new(request.multiplier).ok_or(Violation::TimeoutMultiplier)?;
        if request.transport.trigger() == Trigger::Reserved {
            return Err(Violation::TriggerNotSupported);
        }
        if o_t.redundant_owner {
            return Err(Violation::OtRedundantOwner);
        }
        match request.transport.class() {
            1 => self.open_io(context, request, multiplier, &application),
            3 => self.open_explicit(context, request, multiplier, &application),
            _ => Err(Violation::TransportClassNotSupported),
        }
    }

    /// Answers a null Forward_Open, which opens nothing: it asks whether the target is there, or configures it.
    fn open_null(
        &mut self,
        request: &OpenRequest<'_>,
        application: &Application<'_>,
    ) -> Result<OpenReply, Violation> {
        match (application.class, application.points) {
            // A ping names the Identity (volume 1, table 3-5.13).
            (Some(class::IDENTITY), [Some(1), None, None]) | (Some(class::ASSEMBLY) | None, _) => {}
            _ => return Err(Violation::NullForwardOpen),
        }
        let [configuration, ..] = application.points;
        self.check_configuration(configuration, application.configuration)?;
        self.configure(configuration, application.configuration);
        let description = self.device.description;
        let served = |rpi: u32| rpi.clamp(description.min_rpi_us, description.max_rpi_us);
        Ok(OpenReply {
            o_t_id: request.o_t_id,
            t_o_id: request.t_o_id,
            triad: request.triad,
            o_t_api_us: served(request.o_t_rpi_us),
            t_o_api_us: served(request.t_o_rpi_us),
        })
    }

    fn open_io(
        &mut self,
        context: &mut Context,
        request: &OpenRequest<'_>,
        multiplier: TimeoutMultiplier,
        application: &Application<'_>,
    ) -> Result<OpenReply, Violation> {
        let OpenRequest { o_t_rpi_us, o_t, t_o_rpi_us, t_o, .. } = *request;
        let points = self.find_assemblies(application)?;
        check_io_parameters(&points, o_t, t_o)?;
        let inhibit = self.check_intervals(request, application)?;
        let least_wanted = self.check_room(context.now, *context.peer.ip(), &points)?;
        let [configuration, ..] = points.named;
        self.check_configuration(configuration, application.configuration)?;

        // The originator sends its first frame when it has the reply. Half an interval away from it, neither end receives a
        // frame at the moment in which it must send one.
        let interval = micros(t_o_rpi_us);
        let mut producer = Producer {
            id: request.t_o_id,
            to: SocketAddrV4::new(
                *context.peer.ip(),
                context.socket_t_o.map(|socket| socket.port()).filter(|port| *port != 0).unwrap_or(IO_PORT),
            ),
            parameters: t_o,
            dscp: self.device.qos.cyclic(t_o.priority),
            assembly: points.produced.instance,
            has_header: points.produced.role == Role::ProducedWithHeader,
            cycle: Cycle::new(context.now + interval / 2, interval),
            trigger: request.transport.trigger(),
            inhibit: Inhibit::new(inhibit, context.now),
            sequence: 0,
            count: 0,
            changed: false,
            sends: true,
        };
        let is_multicast = t_o.kind == ConnectionType::Multicast;
        if is_multicast {
            self.find_multicast(*context.peer.ip(), points.kind, &producer)?;
        }
        if let Some(least_wanted) = least_wanted {
            self.end_least_wanted(context.now, least_wanted);
        }
        if is_multicast {
            self.share_multicast(context, points.kind, &mut producer)?;
        }
        self.configure(configuration, application.configuration);
        let o_t_id = self.fresh_id();
        let (t_o_id, t_o_api) = (producer.id, producer.cycle.period());
        let t_o_api_us = u32::try_from(t_o_api.as_micros()).unwrap_or(u32::MAX);
        let data = request.data(self.fresh_number(), multiplier, (o_t_id, t_o_id), t_o_api_us);
        let connection = IoConnection {
            data,
            triad: request.triad,
            kind: points.kind,
            points: points.named,
            originator: *context.peer.ip(),
            stream: Some(context.stream),
            o_t_id,
            has_header: points.consumed.role == Role::Consumed,
            o_t_len: usize::from(o_t.size.saturating_sub(SEQUENCE_LEN)),
            watchdog: Watchdog::start(context.now, multiplier.timeout(micros(o_t_rpi_us))),
            sequence: sequence(micros(o_t_rpi_us)),
            count: None,
            run: false,
            producer,
        };
        if points.kind == Kind::ExclusiveOwner {
            self.report_owner(context.now, connection.owner_report());
        }
        self.io.add(connection);
        self.follow_owner(None);
        Ok(OpenReply { o_t_id, t_o_id, triad: request.triad, o_t_api_us: o_t_rpi_us, t_o_api_us })
    }

    /// Checks the packet intervals, and returns the inhibit time of the producer.
    fn check_intervals(
        &self,
        request: &OpenRequest<'_>,
        application: &Application<'_>,
    ) -> Result<Duration, Violation> {
        let OpenRequest { o_t_rpi_us, t_o_rpi_us, .. } = *request;
        let description = self.device.description;
        let served = description.min_rpi_us..=description.max_rpi_us;
        if !served.contains(&o_t_rpi_us) || !served.contains(&t_o_rpi_us) {
            let [o_t, t_o] = [o_t_rpi_us, t_o_rpi_us].map(|rpi| IntervalLimit::of(rpi, &served));
            return Err(Violation::RpiNotAcceptable(AcceptableIntervals { o_t, t_o }));
        }
        // Without a segment, a producer that follows changes keeps a quarter of its interval (volume 1, 3-4.4.18).
        let is_cyclic = request.transport.trigger() == Trigger::Cyclic;
        let default = if is_cyclic { Duration::ZERO } else { micros(t_o_rpi_us) / 4 };
        let inhibit = application.inhibit.filter(|time| !time.is_zero()).unwrap_or(default);
        if inhibit > micros(t_o_rpi_us) {
            return Err(Violation::RpiBelowInhibitTime);
        }
        Ok(inhibit)
    }

    fn find_assemblies(&self, application: &Application<'_>) -> Result<IoAssemblies, Violation> {
        if application.class != Some(class::ASSEMBLY) {
            return Err(Violation::ApplicationPath);
        }
        let named = match application.points {
            [Some(_), Some(_), _] => in_their_places(application.points),
            [None, ..] => return Err(Violation::ConsumingPath),
            _ => return Err(Violation::ProducingPath),
        };
        let [configuration, consumed, produced] = named;
        let description = self.device.description;
        let find = |instance: Option<u32>, missing| {
            instance.and_then(|instance| description.assembly(instance)).ok_or(missing)
        };
        if configuration.is_some()
            && find(configuration, Violation::ConfigurationPath)?.role != Role::Configuration
        {
            return Err(Violation::InconsistentPathCombination);
        }
        let consumed = find(consumed, Violation::ConsumingPath)?;
        let produced = find(produced, Violation::ProducingPath)?;
        let kind = match (consumed.role, produced.role.is_produced()) {
            (Role::Consumed | Role::ConsumedModeless, true) => Kind::ExclusiveOwner,
            (Role::InputOnlyHeartbeat, true) => Kind::InputOnly,
            (Role::ListenOnlyHeartbeat, true) => Kind::ListenOnly,
            _ => return Err(Violation::InconsistentPathCombination),
        };
        Ok(IoAssemblies { kind, consumed, produced, named })
    }

    /// Checks configuration data, which fill whole words: they have the assembly's size, and while other connections are
    /// open they are those that these depend on.
    fn check_configuration(&self, named: Option<u32>, data: &[u8]) -> Result<(), Violation> {
        if data.is_empty() {
            return Ok(());
        }
        let there = named.and_then(|instance| self.device.assemblies.configuration(instance));
        let there = there.unwrap_or_default();
        let words = there.len().div_ceil(2);
        match data.get(..there.len()) {
            Some(wanted) if data.len() == 2 * words => {
                let is_free = self.io.len() == 0;
                if is_free || wanted == there { Ok(()) } else { Err(Violation::OutputsOwned) }
            }
            _ => Err(Violation::ConfigurationSize(u16::try_from(words).unwrap_or(u16::MAX))),
        }
    }

    /// Takes over configuration data that were checked.
    fn configure(&mut self, named: Option<u32>, data: &[u8]) {
        let Some(instance) = named else { return };
        let len = self.device.assemblies.configuration(instance).map_or(0, <[u8]>::len);
        if let Some(data) = data.get(..len).filter(|data| !data.is_empty()) {
            self.device.assemblies.consume(instance, data);
        }
    }

    /// Checks that a host may open one more connection of this kind to these assemblies. Returns the connection that gives way to
    /// it, if all places are taken.
    fn check_room(
        &self,
        now: Instant,
        host: Ipv4Addr,
        points: &IoAssemblies,
    ) -> Result<Option<(Ipv4Addr, Triad)>, Violation> {
        let description = self.device.description;
        let places = match points.kind {
            Kind::ExclusiveOwner if self.io.is_owned(points.consumed.instance) => {
                return Err(Violation::OutputsOwned);
            }
            Kind::ListenOnly if !self.io.may_listen_to(points.produced.instance) => {
                return Err(Violation::NothingToListenTo);
            }
            // One scanner may own all outputs.
            Kind::ExclusiveOwner if self.io.count(points.kind) < description.exclusive_owners.into() => {
                return Ok(None);
            }
            Kind::ExclusiveOwner => return Err(Violation::TargetOutOfConnections),
            Kind::InputOnly => description.input_only,
            Kind::ListenOnly => description.listen_only,
        };
        match self.io.room(host, points.kind, places.into()) {
            Room::Free => Ok(None),
            Room::Taken if self.io.is_preferred(now, host) => {
                let least = self.io.least_wanted(now, host, points.kind);
                least.map(Some).ok_or(Violation::TargetOutOfConnections)
            }
            Room::Taken | Room::Used => Err(Violation::TargetOutOfConnections),
        }
    }

    /// Ends the connection of another host, which gives way to that of a preferred one.
    fn end_least_wanted(&mut self, now: Instant, (host, triad): (Ipv4Addr, Triad)) {
        let stream = self.io.find_of(host, &triad).and_then(|connection| connection.stream);
        self.io.remove(now, host, &triad);
        self.end_unused(stream);
    }

    /// Returns the multicast that runs and in which a connection can take part; none if it gets one of its own. That is so for
    /// the owner of the outputs where none fits it: an earlier listener must not choose its parameters.
    fn find_multicast(
        &self,
        host: Ipv4Addr,
        kind: Kind,
        producer: &Producer,
    ) -> Result<Option<Producer>, Violation> {
        if !self.device.network.is_local(host) {
            return Err(Violation::OffSubnetMulticast);
        }
        let of_assembly = || self.io.multicasts().filter(|running| running.assembly == producer.assembly);
        let fitting = of_assembly().find(|running| check_multicast(producer, running).is_ok()).copied();
        let refused = of_assembly().find_map(|running| check_multicast(producer, running).err());
        match (fitting, refused) {
            (None, Some(violation)) if kind != Kind::ExclusiveOwner => Err(violation),
            _ => Ok(fitting),
        }
    }

    /// Lets a connection take part in a multicast that runs, or gives it one of its own.
    fn share_multicast(
        &mut self,
        context: &mut Context,
        kind: Kind,
        producer: &mut Producer,
    ) -> Result<(), Violation> {
        if let Some(running) = self.find_multicast(*context.peer.ip(), kind, producer)? {
            *producer = Producer { sends: false, ..running };
        } else {
            producer.id = self.fresh_id();
            producer.to = SocketAddrV4::new(self.free_group(), IO_PORT);
        }
        context.reply_socket_t_o = Some(producer.to);
        Ok(())
    }

    /// Returns the device's first multicast address that no running multicast has.
    fn free_group(&self) -> Ipv4Addr {
        let address = |index| self.device.network.multicast(index);
        let is_free = |group: &Ipv4Addr| self.io.multicasts().all(|running| running.to.ip() != group);
        (0..MULTICASTS.into()).map(address).find(is_free).unwrap_or_else(|| address(0))
    }
}

/// Returns the assemblies of a path as configuration, consumed, produced; the first may be left out (volume 1, 3-5.5.1.10).
pub(super) const fn in_their_places(points: [Option<u32>; 3]) -> [Option<u32>; 3] {
    match points {
        [consumed, produced, None] => [None, consumed, produced],
        points => points,
    }
}

/// Checks that a connection can take part in a multicast of its assembly that runs.
fn check_multicast(wanted: &Producer, running: &Producer) -> Result<(), Violation> {
    if running.parameters.size != wanted.parameters.size {
        return Err(Violation::MulticastSize);
    }
    if running.parameters.priority != wanted.parameters.priority {
        return Err(Violation::MulticastPriority);
    }
    if running.trigger != wanted.trigger {
        return Err(Violation::MulticastTrigger);
    }
    if running.inhibit.time() != wanted.inhibit.time() {
        return Err(Violation::MulticastInhibit);
    }
    // A shorter interval than the multicast's cannot be served. For a longer one, the multicast comes more often than asked.
    let period = running.cycle.period();
    if period > wanted.cycle.period() {
        let period_us = u32::try_from(period.as_micros()).unwrap_or(u32::MAX);
        let t_o = IntervalLimit::AtLeast(period_us);
        return Err(Violation::RpiNotAcceptable(AcceptableIntervals { o_t: IntervalLimit::Acceptable, t_o }));
    }
    Ok(())
}

fn check_io_parameters(points: &IoAssemblies, o_t: Parameters, t_o: Parameters) -> Result<(), Violation> {
    let heartbeat = points.kind != Kind::ExclusiveOwner;
    if o_t.kind != ConnectionType::PointToPoint {
        return Err(Violation::OtType);
    }
    if t_o.kind == ConnectionType::Reserved {
        return Err(Violation::ToType);
    }
    if o_t.variable && !heartbeat {
        return Err(Violation::OtVariable);
    }
    if t_o.variable {
        return Err(Violation::ToVariable);
    }
    let size = points.consumed.connection_size();
    // Some scanners send a run/idle header with a heartbeat.
    if o_t.size != size && !(heartbeat && o_t.size == size + RUN_IDLE_LEN) {
        return Err(Violation::OtSize(size));
    }
    let size = points.produced.connection_size();
    if t_o.size != size {
        return Err(Violation::ToSize(size));
    }
    Ok(())
}
