//! The adapter: the target of connections, which scanners open.
//!
//! Requests are taken out of their TCP streams one at a time, when the driver asks for the next frame to send: a
//! flood of requests needs no queue, and cyclic frames always go before replies.

mod datagrams;
mod delayed;
mod diagnosis;
mod encapsulated;
mod establish;
mod establish_explicit;
mod explicit;
mod io;
mod open_report;
mod router;
mod session;
mod sessions;
mod state;

use alloc::boxed::Box;
use alloc::vec;
use core::fmt;
use core::net::{Ipv4Addr, SocketAddrV4};

use self::datagrams::AnswerLimit;
use self::delayed::Delayed;
use self::encapsulated::{Answer, answer_datagram, is_request_datagram, list_identity};
use self::session::Carried;
use self::sessions::Sessions;
use self::state::State;
use super::data::DataError;
use super::description::Description;
use super::encapsulation::{Command, Header, MAX_MESSAGE_LEN};
use super::objects::{Device, Network};
use super::own_address::{Change, OwnAddress};
use super::{ENCAPSULATION_PORT, IO_PORT};
use machine::arp::ArpPacket;
use machine::ethernet::Mac;
use machine::{Allowed, Counters, DownCause, LinkEvent, LinkStatus, Peer, Requested};
use machine::{
    Instant, Machine, Pending, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest, Transmit,
};

/// Configuration of an adapter.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct AdapterConfig {
    /// What the device is.
    pub description: &'static Description,
    /// Its serial number, which no other device of the vendor has.
    pub serial_number: u32,
    /// Its own address.
    pub address: Ipv4Addr,
    /// Its subnet mask.
    pub mask: Ipv4Addr,
    /// Its gateway at the start, [`Ipv4Addr::UNSPECIFIED`] where there is none.
    pub gateway: Ipv4Addr,
    /// Its hardware address.
    pub mac: [u8; 6],
    /// First connection number and session handle. Choose another one at each start, so that frames of an old connection
    /// are not accepted for a new one.
    pub first_id: u32,
    /// Originators that may connect: the address is that of the host, the serial number that of the Forward_Open. Others get
    /// no TCP connection or no connection.
    pub originators: Allowed,
}

/// An EtherNet/IP adapter.
#[derive(Debug)]
pub struct Adapter {
    state: State,
    sessions: Sessions,
    datagram: Box<[u8]>,
    /// A UDP request that waits for its answer: who sent it, and its length.
    waiting: Option<(SocketAddrV4, usize)>,
    /// ListIdentity requests that went to every device.
    delayed: Delayed,
    /// Limit of answers over UDP.
    answers: AnswerLimit,
    /// Its claim to its address, where conflicts are detected.
    own: Option<OwnAddress>,
}

impl Adapter {
    /// Creates an adapter that waits for scanners.
    #[must_use]
    pub fn new(config: AdapterConfig) -> Self {
        let AdapterConfig { description, serial_number, address, mask, gateway, mac, first_id, originators } =
            config;
        let device = Device::new(description, serial_number, Network::new(address, mask, gateway, mac));
        Self {
            state: State::new(device, first_id, originators),
            sessions: Sessions::new(description.sessions.into(), first_id),
            datagram: vec![0; MAX_MESSAGE_LEN].into_boxed_slice(),
            waiting: None,
            answers: AnswerLimit::default(),
            delayed: Delayed::new(u64::from(serial_number) << 32 | u64::from(first_id)),
            own: None,
        }
    }

    /// Detects address conflicts (RFC 5227), by attribute 10 of the TCP/IP Interface object. It needs raw Ethernet. While another
    /// station has the address, the adapter takes no connections.
    #[must_use]
    pub fn with_conflict_detection(mut self, start: Instant) -> Self {
        let network = &mut self.state.device.network;
        network.detects_conflicts = true;
        self.own = Some(OwnAddress::new(Mac(network.mac), network.address, start));
        self
    }

    /// Detects no address conflicts, as an adapter without raw Ethernet. Call it before the adapter runs.
    pub fn stop_conflict_detection(&mut self) {
        self.own = None;
        self.state.device.network.detects_conflicts = false;
    }

    fn handle_arp(&mut self, now: Instant, frame: &[u8]) {
        let Some(Ok(packet)) = ArpPacket::from_frame(frame) else {
            self.state.counters.malformed += 1;
            return;
        };
        let Some(own) = &mut self.own else { return };
        let is_probing = own.is_probing();
        let change = own.handle(now, &packet);
        if matches!(change, Some(Change::Taken(_) | Change::Conflict(_))) {
            self.state.device.network.conflict(&packet, is_probing);
        }
        self.follow(change);
    }

    fn follow(&mut self, change: Option<Change>) {
        match change {
            Some(Change::Free) => self.state.address_is_taken = false,
            Some(Change::Taken(conflict)) => self.state.take_address_away(conflict),
            Some(Change::Conflict(conflict)) => self.state.report_conflict(conflict),
            None => {}
        }
    }

    /// Returns the numbers of open connections: of class 1, and of class 3.
    #[must_use]
    pub fn connections(&self) -> (usize, usize) {
        (self.state.io.len(), self.state.explicit.len())
    }

    /// Writes who owns the outputs and sends no data for them, and how long that may last; nothing while data come or nobody
    /// owns them.
    pub fn remark(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        let Some(owner) = self.state.io.silent_owner().filter(|_| !self.state.is_up()) else { return Ok(()) };
        let does = if owner.count.is_some() { "sends that it is idle" } else { "has sent no frame yet" };
        let seconds = owner.watchdog.timeout().as_secs_f64();
        words.write_str("the scanner ")?;
        owner.owner_report().write_name(words)?;
        write!(words, " owns the outputs and {does}; its connection ends {seconds:.1} s after its last frame")
    }

    /// Writes why the link went down last, and whose connection it was; nothing while it is up, or where nobody had it.
    pub fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        let Some((down, owner)) = self.state.last_down.filter(|_| !self.state.is_up()) else { return Ok(()) };
        write!(words, "{down}; the owner was ")?;
        owner.write_name(words)
    }

    /// Writes who asked last for a connection with cyclic data, what was asked for, and why it was refused; nothing before the
    /// first request.
    pub fn write_request(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.state.last_open.map_or(Ok(()), |report| report.write(words))
    }

    /// Returns the number of open TCP connections.
    #[must_use]
    pub fn sessions(&self) -> usize {
        self.sessions.len()
    }
}

impl Machine for Adapter {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        if self.own.is_some() { super::PORTS_WITH_ARP } else { super::PORTS }
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match (from.port, from.peer) {
            (Port::Ethernet, _) => self.handle_arp(now, frame),
            (Port::Udp(IO_PORT), Some(peer)) => self.state.consume(now, *peer.ip(), frame),
            (Port::Udp(ENCAPSULATION_PORT), Some(peer)) => match self.datagram.get_mut(..frame.len()) {
                Some(place) => {
                    place.copy_from_slice(frame);
                    self.waiting = Some((peer, frame.len()));
                }
                None => self.state.counters.malformed += 1,
            },
            (Port::Stream(stream), _) => {
                if self.sessions.receive(now, stream, frame) {
                    self.drop_orphans();
                }
            }
            _ => self.state.counters.foreign += 1,
        }
    }

    /// Handles a broadcast. A request to one client is answered at once; a request to all devices is answered after a
    /// random delay.
    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match (from, Header::parse(frame)) {
            (Source { port: Port::Udp(ENCAPSULATION_PORT), peer: Some(peer) }, Ok(header))
                if header.command == Command::ListIdentity && is_request_datagram(&header, frame.len()) =>
            {
                self.delayed.add(now, peer, header);
            }
            _ => self.handle_frame(now, from, frame),
        }
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        match change {
            StreamChange::Accepted(peer) => self.accept(now, stream, peer),
            StreamChange::Closed => self.sessions.closed(stream),
            StreamChange::Connected(_) | StreamChange::NotConnected(_) => {}
        }
        self.drop_orphans();
    }

    fn listen_port(&self) -> Option<u16> {
        Some(ENCAPSULATION_PORT)
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        self.sessions.poll_close().map(StreamRequest::Close)
    }

    /// Returns the DSCP: for cyclic frames what the QoS object contained when the connection was opened, for explicit
    /// messages what it contains now.
    fn dscp(&self, port: Port) -> u8 {
        match port {
            Port::Udp(IO_PORT) => self.state.cyclic_dscp,
            _ => self.state.device.qos.explicit(),
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        let change = self.own.as_mut().and_then(|own| own.handle_timeout(now));
        self.follow(change);
        self.state.check_watchdogs(now);
        self.end_unused();
        self.sessions.check_inactivity(now, self.state.device.network.inactivity());
        self.drop_orphans();
    }

    fn pending(&self, now: Instant) -> Pending {
        let is_due = |at: Option<Instant>| at.is_some_and(|at| at <= now);
        Pending {
            frame: is_due(self.state.io.next_frame())
                || self.own.as_ref().is_some_and(OwnAddress::may_send)
                || self.waiting.is_some()
                || is_due(self.delayed.next_timeout())
                || self.sessions.has_messages(),
            request: self.sessions.has_ended(),
            event: !self.state.events.is_empty(),
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if let Some(transmit) = self.state.produce(now, buf) {
            return Some(transmit);
        }
        if let Some(len) = self.own.as_mut().and_then(|own| own.poll_frame(now, buf)) {
            return Some(Transmit { port: Port::Ethernet, to: None, len });
        }
        if let Some((peer, len)) = self.waiting.take().filter(|(peer, _)| self.may_answer(now, *peer.ip())) {
            let request = self.datagram.get(..len).unwrap_or_default();
            if let Some(len) = answer_datagram(&mut self.state, request, buf) {
                return Some(Transmit { port: Port::Udp(ENCAPSULATION_PORT), to: Some(peer), len });
            }
        }
        while let Some((peer, header)) = self.delayed.next_due(now) {
            if self.may_answer(now, *peer.ip())
                && let Some(len) = list_identity(&self.state, &header, buf)
            {
                return Some(Transmit { port: Port::Udp(ENCAPSULATION_PORT), to: Some(peer), len });
            }
        }
        while let Some((stream, answer)) = self.sessions.answer_next(now, &mut self.state, buf) {
            self.end_unused();
            if core::mem::take(&mut self.state.device.restarts) {
                self.sessions.end_all();
                self.drop_orphans();
            }
            match answer {
                Answer::Reply(len) => return Some(Transmit { port: Port::Stream(stream), to: None, len }),
                Answer::None => {}
                Answer::Close => {
                    self.sessions.end(stream);
                    self.drop_orphans();
                }
            }
        }
        None
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.state.events.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let sessions = self.sessions.next_inactivity(self.state.device.network.inactivity());
        let claim = self.own.as_ref().and_then(OwnAddress::poll_timeout);
        let delayed = Instant::earlier(self.delayed.next_timeout(), claim);
        Instant::earlier(Instant::earlier(self.state.next_timeout(), sessions), delayed)
    }
}

impl Adapter {
    /// Gives a client a place, if it may have one.
    fn accept(&mut self, now: Instant, stream: StreamId, peer: SocketAddrV4) {
        let address = *peer.ip();
        if !self.state.originators.allows(Peer { address: Some(address), ..Peer::default() }) {
            self.state.refuse_foreign(now, address, Requested::Connection, None);
            return self.sessions.refuse(stream);
        }
        let Self { state, sessions, .. } = self;
        let is_preferred = |host| state.io.is_preferred(now, host);
        let carried = |stream| match (state.explicit.carries(stream), state.io.was_opened_over(stream)) {
            (true, _) => Carried::Explicit,
            (false, true) => Carried::Cyclic,
            (false, false) => Carried::Nothing,
        };
        sessions.open(now, stream, peer, is_preferred, carried);
    }

    /// Returns whether a datagram of a host is answered. Those above the limit are counted.
    fn may_answer(&mut self, now: Instant, host: Ipv4Addr) -> bool {
        let is_allowed = self.answers.allow(now, host);
        self.state.counters.foreign += u64::from(!is_allowed);
        is_allowed
    }

    /// Ends the TCP connections whose connections have timed out or given way.
    fn end_unused(&mut self) {
        while let Some(stream) = self.state.unused.pop_front() {
            self.sessions.end(stream);
        }
    }

    /// Closes the class 3 connections whose TCP connection has ended. Class 1 connections go on without theirs.
    fn drop_orphans(&mut self) {
        let sessions = &self.sessions;
        self.state.explicit.retain(|stream| sessions.has(stream));
        self.state.io.retain_streams(|stream| sessions.has(stream));
    }
}

impl Adapter {
    /// Sets the data of an assembly of the role [`Role::Produced`](super::description::Role::Produced), for the next
    /// cyclic frame and every one after it. Until then they are zeros.
    pub fn set_produced(&mut self, instance: u32, data: &[u8]) -> Result<(), DataError> {
        if self.state.device.assemblies.set(instance, data)? {
            self.state.io.data_changed(instance);
        }
        Ok(())
    }

    /// Sets the first data of such an assembly, which may be longer; the rest keeps its value, at first zeros.
    ///
    /// # Errors
    ///
    /// No assembly of this instance is sent, or it is shorter.
    pub fn set_produced_start(&mut self, instance: u32, data: &[u8]) -> Result<(), DataError> {
        if self.state.device.assemblies.set_start(instance, data)? {
            self.state.io.data_changed(instance);
        }
        Ok(())
    }

    /// Returns what the adapter is.
    #[must_use]
    pub const fn description(&self) -> &'static Description {
        self.state.device.description
    }

    /// Returns the newest data of an assembly of the role [`Role::Consumed`](super::description::Role::Consumed); `None`
    /// while its owner does not send data or does not report that it runs. Each such assembly has its own owner; the link is
    /// up while at least one owner runs.
    #[must_use]
    pub fn consumed(&self, instance: u32) -> Option<&[u8]> {
        self.state.io.is_run(instance).then(|| self.state.device.assemblies.get(instance))
    }

    /// Returns the data of an assembly of the role [`Role::Configuration`](super::description::Role::Configuration): zeros
    /// until a scanner sends some with its Forward_Open or a message sets them.
    #[must_use]
    pub fn configuration(&self, instance: u32) -> Option<&[u8]> {
        self.state.device.assemblies.configuration(instance)
    }

    /// Sets what the Ethernet Link object reports, state and counters of the interface, and the gateway that the TCP/IP Interface
    /// object reports. Call it about once a second; until the first call, the Ethernet Link object has neither speed nor
    /// counters, and the gateway is that of the configuration.
    pub const fn set_link(&mut self, status: LinkStatus) {
        self.state.device.network.gateway = match status.gateway {
            Some(gateway) => gateway,
            None => Ipv4Addr::UNSPECIFIED,
        };
        self.state.device.link.status = Some(status);
    }

    /// Drops every connection and accepts no new ones. A target has no message that ends a connection.
    pub fn disconnect(&mut self, _now: Instant) {
        self.state.close_all(DownCause::ClosedHere);
    }

    /// Returns the numbers of frames that were sent, received and refused since the start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.state.counters
    }
}

/// Room for a further connection of a kind for a host.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Room {
    /// A place is free.
    Free,
    /// All places are taken; a preferred host gets that of another host.
    Taken,
    /// The host has all places but the last one, which is for other hosts.
    Used,
}

impl Room {
    /// Returns whether a host that has `own` of the `taken` connections gets a further one.
    const fn of(own: usize, taken: usize, places: usize) -> Self {
        if places > 1 && own + 1 >= places || places == 1 && own == 1 {
            Self::Used
        } else if taken >= places {
            Self::Taken
        } else {
            Self::Free
        }
    }
}
