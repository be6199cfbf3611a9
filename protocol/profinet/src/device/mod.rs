//! The IO-Device: a station that DCP finds and names, an RPC server that a controller connects to, and one AR with
//! cyclic data both ways.
//!
//! ```text
//! Ethernet 0x8892 ─┬─ FrameID 0xFEFC..=0xFEFF ── station: DCP
//!                  ├─ 0xFC01, 0xFE01 ─────────── alarms
//!                  └─ the output IOCR's ──────── relation: cyclic data        (RT_CLASS_1)
//! Ethernet 0x88CC ─── LLDP ───────────────────── station
//! Ethernet 0x0806 ─── ARP ────────────────────── address
//! UDP 34962 ───────── the same two ───────────── alarms, relation             (RT_CLASS_UDP)
//! UDP 34964 ───────── RPC ────────────────────── dispatch, server, mapper, answers, records, admission
//! ```
//!
//! One controller at a time. The device refuses a second one. The same controller, with the same IP and MAC address, may
//! connect again: its new AR replaces the old one. While there is an AR, no other station can end or change it, and the
//! station's name and address cannot be changed.

mod address;
mod admission;
mod alarms;
mod answers;
mod connect_report;
mod dispatch;
mod mapper;
mod outgoing;
mod owner;
mod process_data;
mod records;
mod relation;
mod server;

pub use self::outgoing::AlarmError;

use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use alarms::{AlarmReceived, FinalError};
use answers::Answers;
use connect_report::ConnectReport;
use dispatch::Reply;
use relation::Relation;

use super::RPC_PORT;
use super::alarm::{FRAME_ID_HIGH, FRAME_ID_LOW, Priority};
use super::dcp::{self, IpSuite};
use super::description::Description;
use super::provided::Provided;
use super::record::{Diagnosis, LogBook, LogEntry};
use super::requests::Requests;
use super::rpc::Message;
use super::rt::{Received, Transport, UDP_PORT};
use super::station::{Effect, Permanent, SetPermission, Station};
use super::status::{Service, Status, Violation};
use crate::ETHER_TYPE;
use crate::lldp::Naming;
use machine::arp::{self, AddressClaim};
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Allowed, Counters, Down, DownCause, ForeignRequests, LinkEvent, Peer, Requested, Sender};
use machine::{Instant, Machine, Pending, Port, PortRequest, Source, Transmit};

/// Largest number of events that wait. The owner polls after every call, and no call makes as many.
const MOST_EVENTS: usize = 8;

/// Configuration of an IO-Device.
#[derive(Clone, Debug)]
pub struct DeviceConfig {
    /// MAC address of the interface.
    pub mac: Mac,
    /// Station name of the factory: until DCP sets another one, and after a reset; empty for none.
    /// [`super::is_station_name`] checks whether it is allowed.
    pub station_name: Vec<u8>,
    /// What DCP set permanently before the start, if the owner can store it; `None` if it cannot: then the device refuses to
    /// set anything permanently.
    pub permanent: Option<Permanent>,
    /// IP address of the interface, if it already has one.
    pub address: Option<Ipv4Addr>,
    /// Subnet mask that goes with it.
    pub mask: Ipv4Addr,
    /// Description of the device.
    pub description: Description,
    /// Controllers that may connect and, by DCP, set name and address.
    pub controllers: Allowed,
}

/// An IO-Device.
#[derive(Debug)]
pub struct Device {
    requests: Requests,
    core: Core,
}

/// The device without the memory in which requests are reassembled, so that a request can be read while the device changes.
#[derive(Debug)]
struct Core {
    mac: Mac,
    start: Instant,
    description: Description,
    controllers: Allowed,
    station: Station,
    /// The claim to its IP address.
    claim: AddressClaim,
    /// The station that claimed the controller's IP address and was reported last.
    impostor: Option<Mac>,
    /// The address that is being probed before the owner sets it.
    probed: Option<IpSuite>,
    answers: Answers,
    reply: Option<Reply>,
    call: Message,
    call_to: Option<SocketAddrV4>,
    calls: u32,
    relation: Option<Relation>,
    final_error: Option<FinalError>,
    inputs: Provided,
    events: VecDeque<LinkEvent>,
    foreign: ForeignRequests,
    log_book: LogBook,
    /// Diagnosis of the device.
    diagnosis: Vec<Diagnosis>,
    /// The last Connect of a controller that could have the AR.
    last_connect: Option<ConnectReport>,
    /// Counters, without the cyclic frames of the present AR.
    counters: Counters,
    /// Whether there may be frames to send that are not cyclic. Set when something other than cyclic data arrives or is due.
    acyclic: bool,
}

const fn closed_by_peer(status: Status) -> (DownCause, Status) {
    (DownCause::ClosedByPeer, status)
}

impl Device {
    /// Creates a device that starts now. It allocates its memory here, and a Connect allocates the memory of its AR;
    /// nothing else allocates.
    #[must_use]
    pub fn new(config: DeviceConfig, start: Instant) -> Self {
        let DeviceConfig { mac, station_name, permanent, address, mask, description, controllers } = config;
        let stored = permanent.as_ref().and_then(|permanent| permanent.address);
        let ip = address.map(|address| {
            let own = IpSuite { address, mask, gateway: address };
            stored.filter(|stored| stored.address == address).unwrap_or(own)
        });
        let inputs = description.submodules();
        let inputs = inputs.map(|(slot, submodule)| (slot, submodule.subslot, submodule.input_len));
        let mut claim = AddressClaim::new(mac);
        if let Some(address) = address {
            claim.claim(start, address);
        }
        let core = Core {
            claim,
            impostor: None,
            probed: None,
            mac,
            start,
            description,
            controllers,
            station: Station::device(mac, description, &station_name, ip, permanent, start),
            answers: Answers::new(),
            reply: None,
            call: Message::new(),
            call_to: None,
            calls: 0,
            relation: None,
            final_error: None,
            inputs: Provided::new(inputs),
            events: VecDeque::with_capacity(MOST_EVENTS),
            foreign: ForeignRequests::default(),
            log_book: LogBook::default(),
            diagnosis: Vec::new(),
            last_connect: None,
            counters: Counters::default(),
            acyclic: true,
        };
        Self { requests: Requests::new(), core }
    }

    /// Returns the station name, which DCP may have changed.
    #[must_use]
    pub fn station_name(&self) -> &[u8] {
        self.core.station.name()
    }
}

impl Core {
    fn handle_ethernet(&mut self, now: Instant, frame: &[u8]) {
        let Ok((header, payload)) = EthernetHeader::parse(frame) else {
            self.counters.malformed += 1;
            return;
        };
        if header.ether_type == arp::ETHER_TYPE {
            return self.handle_arp(now, payload);
        }
        let is_ours = header.destination == self.mac || header.destination == dcp::IDENTIFY_MULTICAST;
        if header.ether_type != ETHER_TYPE || !is_ours {
            if let Err(refusal) = self.station.handle_other(now, &header, payload) {
                refusal.count(&mut self.counters);
            }
            return;
        }
        let Some(frame_id) = payload.first_chunk().map(|id| u16::from_be_bytes(*id)) else {
            self.counters.malformed += 1;
            return;
        };
        if dcp::FRAME_IDS.contains(&frame_id) {
            self.acyclic = true;
            match self.station.handle_frame(now, &header, payload, self.set_permission(header.source)) {
                Ok(effect) => self.report_effect(now, header.source, effect),
                Err(refusal) => refusal.count(&mut self.counters),
            }
            return;
        }
        let is_controller =
            self.relation.as_ref().is_some_and(|relation| relation.initiator_mac == header.source);
        if is_controller && header.destination == self.mac {
            self.handle_rt(now, Transport::Rt1, frame_id, payload);
        } else {
            self.counters.foreign += 1;
        }
    }

    /// Returns whether a station may change name and address by DCP: not while there is an AR, and only if it is one of the
    /// listed controllers.
    fn set_permission(&self, source: Mac) -> SetPermission {
        if self.relation.is_some() {
            SetPermission::InOperation
        } else if self.controllers.allows(Peer { mac: Some(source), ..Peer::default() }) {
            SetPermission::Allowed
        } else {
            SetPermission::NotListed
        }
    }

    fn handle_rt_datagram(&mut self, now: Instant, from: SocketAddrV4, payload: &[u8]) {
        let Some(frame_id) = payload.first_chunk().map(|id| u16::from_be_bytes(*id)) else {
            self.counters.malformed += 1;
            return;
        };
        let is_controller = self.relation.as_ref().is_some_and(|relation| relation.controller == *from.ip());
        if is_controller {
            self.handle_rt(now, Transport::Udp, frame_id, payload);
        } else {
            self.counters.foreign += 1;
        }
    }

    /// Handles a cyclic frame or an alarm from the controller, from the FrameID on.
    fn handle_rt(&mut self, now: Instant, transport: Transport, frame_id: u16, payload: &[u8]) {
        let Some(relation) = &mut self.relation else { return };
        if relation.consumes(transport, frame_id) {
            match relation.handle_cyclic(now, payload) {
                Received::New => self.report_up(),
                // The receiver counts those that are late.
                Received::Late | Received::Ignored => {}
                Received::Malformed => self.counters.malformed += 1,
            }
            return;
        }
        self.acyclic = true;
        let priority = match frame_id {
            FRAME_ID_HIGH => Priority::High,
            FRAME_ID_LOW => Priority::Low,
            _ => {
                self.counters.foreign += 1;
                return;
            }
        };
        match relation.alarms.handle_pdu(priority, payload.get(2..).unwrap_or_default()) {
            AlarmReceived::Handled => {}
            AlarmReceived::Late => self.counters.late += 1,
            AlarmReceived::Malformed => self.counters.malformed += 1,
            AlarmReceived::Foreign => self.counters.foreign += 1,
            AlarmReceived::Aborted(status) => self.end(now, closed_by_peer(status)),
        }
    }

    /// Reports once that data are exchanged.
    fn report_up(&mut self) {
        if self.relation.as_mut().is_some_and(Relation::take_up) {
            self.report(LinkEvent::Up);
        }
    }

    fn write_inputs(&mut self) {
        if let Some(relation) = &mut self.relation {
            relation.set_inputs(&self.inputs);
        }
    }

    /// Reports as events the changes that DCP made, and those that were refused.
    fn report_effect(&mut self, now: Instant, from: Mac, effect: Effect) {
        if let Some(what) = effect.refused {
            self.counters.foreign += 1;
            let owner = self.relation.as_ref().map(|relation| Sender::Mac(relation.initiator_mac));
            self.report_foreign(now, Sender::Mac(from), what, owner);
        }
        self.ask_owner(now, effect.step);
    }

    /// Ends the AR from this side; sends the reason to the controller and reports it as an event.
    fn abort(&mut self, now: Instant, violation: Violation) {
        let cause = match violation {
            Violation::ConsumerExpired | Violation::InitiatorTimeout => DownCause::Watchdog,
            Violation::ApplicationReadyTimeout => DownCause::NoAnswer,
            Violation::RpcClientError => DownCause::Refused,
            _ => DownCause::ClosedHere,
        };
        let status = violation.status(Service::Abort);
        if let Some(relation) = &self.relation {
            self.acyclic = true;
            self.final_error = Some(relation.alarms.final_error(status));
        }
        self.end(now, (cause, status));
    }

    /// Ends the AR: adds its counters to those of the device, and its end to the log book.
    fn end(&mut self, now: Instant, (cause, status): (DownCause, Status)) {
        if self.relation.is_none() {
            return;
        }
        self.counters = self.counters();
        if let Some(relation) = self.relation.take() {
            self.impostor = None;
            self.answers.forget(relation.controller);
            // What the controller wrote to the interface goes with the AR.
            self.set_naming(now, Naming::default());
            self.log_book.add(LogEntry { at: now, ar: relation.uuid, status });
        }
        self.call.clear();
        let text = if status.is_ok() { "the controller released the connection" } else { status.text() };
        self.report(LinkEvent::Down(Down { cause, code: status.0, text }));
    }

    fn counters(&self) -> Counters {
        let mut counters = self.counters;
        if let Some(relation) = &self.relation {
            counters.sent += relation.sender.sent();
            counters.skipped += relation.sender.skipped();
            counters.received += relation.receiver.received();
            counters.lost += relation.receiver.lost();
            counters.late += relation.receiver.late();
        }
        counters
    }

    /// Reports as an event a request that was refused because its sender is not the controller, or is not in the list of
    /// controllers.
    fn report_foreign(&mut self, now: Instant, from: Sender, what: Requested, owner: Option<Sender>) {
        if let Some(report) = self.foreign.refuse(now, from, what, owner) {
            self.report(LinkEvent::Foreign(report));
        }
    }

    fn report(&mut self, event: LinkEvent) {
        if self.events.len() < MOST_EVENTS {
            self.events.push_back(event);
        }
    }

    /// Writes the next frame that is not cyclic.
    fn poll_acyclic(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if let Some(transmit) = self.final_error.take().and_then(|final_error| final_error.emit(buf).ok()) {
            return Some(transmit);
        }
        if let Some(transmit) =
            self.relation.as_mut().and_then(|relation| relation.alarms.poll_transmit(now, buf))
        {
            return Some(transmit);
        }
        let of_station = self.claim.poll_frame(now, buf).or_else(|| self.station.poll_transmit(now, buf));
        if let Some(len) = of_station {
            return Some(Transmit { port: Port::Ethernet, to: None, len });
        }
        self.poll_reply(buf).or_else(|| self.answers.poll_transmit(buf)).or_else(|| self.poll_call(buf))
    }

    fn poll_call(&mut self, buf: &mut [u8]) -> Option<Transmit> {
        let to = self.call_to?;
        let len = self.call.poll(buf)?;
        Some(Transmit { port: Port::Udp(RPC_PORT), to: Some(to), len })
    }
}

impl Machine for Device {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        super::PORTS
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match (from.port, from.peer) {
            (Port::Ethernet, _) => self.core.handle_ethernet(now, frame),
            (Port::Udp(RPC_PORT), Some(peer)) => self.handle_rpc(now, peer, frame),
            (Port::Udp(UDP_PORT), Some(peer)) => self.core.handle_rt_datagram(now, peer, frame),
            _ => self.core.counters.foreign += 1,
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        let core = &mut self.core;
        core.acyclic |= core.station.poll_timeout() <= now;
        core.station.handle_timeout(now);
        core.handle_claim_timeout(now);
        let Some(relation) = &mut core.relation else { return };
        if let Some(violation) = relation.expired(now) {
            core.abort(now, violation);
            return;
        }
        if relation.alarms.poll_timeout().is_some_and(|due| due <= now) {
            core.acyclic = true;
            if !relation.alarms.handle_timeout(now) {
                core.abort(now, Violation::AlarmSendTimeout);
                return;
            }
        }
        relation.sender.handle_timeout(now);
        if relation.must_repeat(now) {
            core.acyclic = true;
            core.call.repeat();
        }
    }

    fn pending(&self, _now: Instant) -> Pending {
        let Core { relation, acyclic, events, .. } = &self.core;
        let is_due = relation.as_ref().is_some_and(|relation| relation.sender.is_due());
        Pending { frame: is_due || *acyclic, request: false, event: !events.is_empty() }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let core = &mut self.core;
        if let Some(transmit) = core.relation.as_mut().and_then(|relation| relation.sender.poll_transmit(buf))
        {
            return Some(transmit);
        }
        let transmit = if core.acyclic { core.poll_acyclic(now, buf) } else { None };
        core.acyclic = transmit.is_some();
        transmit
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.core.events.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let relation = self.core.relation.as_ref().map(Relation::poll_timeout);
        let own = Instant::earlier(self.core.claim.poll_timeout(), Some(self.core.station.poll_timeout()));
        Instant::earlier(relation, own)
    }
}
