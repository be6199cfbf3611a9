//! The IO-Controller: one station with many application relations (ARs), one for each IO-Device that it drives.
//!
//! ```text
//! Ethernet 0x8892 ─┬─ DCP requests ──────────── station
//!                  ├─ DCP answers, Hello ────── the AR with that transaction, or with that name
//!                  └─ cyclic data, alarms ───── the AR with the sender's MAC address      (RT_CLASS_1)
//! Ethernet 0x88CC ─── LLDP ─────────────────── station
//! Ethernet 0x0806 ─── ARP ──────────────────── the AR with the sender's IP address, the claim to the own address
//! UDP 34962 ───────── cyclic data, alarms ───── the AR with the sender's IP address       (RT_CLASS_UDP)
//! UDP 34964 ───────┬─ calls ─────────────────── responder: ApplicationReady of an AR, endpoint mapper
//!                  └─ answers to calls ──────── the AR with the sender's IP address
//! ```

mod ar;
mod config;
mod responder;
mod roster;

pub use ar::{Ar, ReceivedAlarm, RecordError};
pub use config::{ArConfig, ConfigError, ControllerConfig, Parameter};

use core::net::{Ipv4Addr, SocketAddrV4};

use machine::arp::{self, AddressClaim, ArpPacket, ClaimEvent};
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Counters, Instant, LinkEvent, Machine, Pending, Port, PortRequest, Source, Transmit};

use super::dcp::{self, IpSuite, Pdu};
use super::lldp::Neighbour;
use super::requests::Requests;
use super::rpc::{
    CONTROLLER_INTERFACE, ENDPOINT_MAPPER_INTERFACE, Endpoint, Header, Kind, Received, RequestArgs, flags,
};
use super::rt::{Transport, UDP_PORT};
use super::station::{self, Station};
use super::{ETHER_TYPE, PORTS, RPC_PORT};
use responder::{RequestOutcome, Responder};
use roster::Roster;

/// Largest number of ARs: each needs two FrameIDs of its own, and RT_CLASS_1 has 15,360.
const MOST_ARS: usize = 4096;

/// An AR of a [`Controller`], as long as it is not removed.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct ArId(u16);

/// An IO-Controller.
#[derive(Debug)]
pub struct Controller {
    config: ControllerConfig,
    station: Station,
    requests: Requests,
    responder: Responder,
    /// The claim to its own IP address, from the first AR on.
    claim: AddressClaim,
    ars: Roster,
    /// Frames that belong to no AR.
    counters: Counters,
    /// Whether the station or the responder may have frames to send.
    has_answers: bool,
}

impl Controller {
    /// Creates a controller without ARs.
    pub fn new(config: ControllerConfig) -> Result<Self, ConfigError> {
        config::check_name(&config.station_name)?;
        let ip = IpSuite { address: config.address, mask: config.mask, gateway: config.address };
        Ok(Self {
            station: Station::controller(config.mac, config.description, config.station_name.as_bytes(), ip),
            requests: Requests::new(),
            responder: Responder::new(),
            claim: AddressClaim::new(config.mac),
            ars: Roster::default(),
            counters: Counters::default(),
            has_answers: false,
            config,
        })
    }

    /// Adds an AR that starts to search for its device at `start`. No two ARs have one station name or one address.
    pub fn connect(&mut self, config: ArConfig, start: Instant) -> Result<ArId, ConfigError> {
        let number = self.ars.next_number()?;
        if config.address == self.config.address {
            return Err(ConfigError::OwnAddress { address: config.address, name: config.station_name });
        }
        self.ars.check(&config.station_name, config.address)?;
        let ar = Ar::new(&self.config, config, number, start)?;
        if self.claim.address().is_none() {
            self.claim.claim(start, self.config.address);
        }
        self.ars.add(number, ar);
        Ok(ArId(number))
    }

    /// Returns an AR; `None` once it was removed.
    #[must_use]
    pub fn ar(&self, ar: ArId) -> Option<&Ar> {
        self.ars.get(ar.0)
    }

    /// Returns an AR, for commands; `None` once it was removed. Poll the controller afterwards.
    pub fn ar_mut(&mut self, ar: ArId) -> Option<&mut Ar> {
        self.ars.get_mut(ar.0)
    }

    /// Sets the output data of all submodules of an AR like [`Ar::set_outputs`]. Data alone change nothing that the controller is polled
    /// for, so it need not be polled afterwards.
    pub fn set_outputs(&mut self, ar: ArId, write: impl FnMut(u16, u16, &mut [u8])) {
        self.ars.set_outputs(ar.0, write);
    }

    /// Returns every AR that was not removed.
    pub fn ars(&self) -> impl Iterator<Item = (ArId, &Ar)> {
        self.ars.iter().map(|(number, ar)| (ArId(number), ar))
    }

    /// Removes an AR at once. A device that is still connected notices this by its watchdog: [`Ar::disconnect`] first, and
    /// wait for [`LinkEvent::Down`].
    pub fn remove(&mut self, ar: ArId) -> Option<Ar> {
        self.ars.remove(ar.0)
    }

    /// Returns the next AR whose cyclic data have arrived since it was last returned here.
    pub fn poll_received(&mut self) -> Option<ArId> {
        self.ars.poll_received().map(ArId)
    }

    /// Returns the numbers of frames that belong to no AR, since the start.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Returns the station at the other end of the cable; `None` if none announced itself by LLDP, or not for a while.
    #[must_use]
    pub fn neighbour(&self) -> Option<&Neighbour> {
        self.station.neighbour()
    }

    fn handle_ethernet(&mut self, now: Instant, frame: &[u8]) {
        let Ok((header, payload)) = EthernetHeader::parse(frame) else {
            self.counters.malformed += 1;
            return;
        };
        if header.ether_type == arp::ETHER_TYPE {
            return self.handle_arp(now, payload);
        }
        let for_us = header.destination == self.config.mac || header.destination.is_group();
        if header.ether_type != ETHER_TYPE || !for_us {
            if let Err(refusal) = self.station.handle_other(now, &header, payload) {
                refusal.count(&mut self.counters);
            }
            return;
        }
        let Some(frame_id) = payload.first_chunk().copied().map(u16::from_be_bytes) else {
            self.counters.malformed += 1;
            return;
        };
        if dcp::FRAME_IDS.contains(&frame_id) {
            return self.handle_dcp(now, &header, payload);
        }
        if !self.ars.serve_rt(header.source, frame_id, |ar| ar.handle_rt(now, frame_id, payload)) {
            self.counters.foreign += 1;
        }
    }

    fn handle_arp(&mut self, now: Instant, payload: &[u8]) {
        // Hosts answer ARP, machines only read it: what is about others is not counted.
        let Ok(packet) = ArpPacket::parse(payload) else {
            self.counters.malformed += 1;
            return;
        };
        self.claim.handle(now, &packet);
        self.has_answers = true;
        if let Some(ClaimEvent::Conflict(conflict)) = self.claim.poll_event() {
            self.ars.serve_all(|ar| ar.own_address_taken(now, conflict));
        }
        if packet.sender_address == self.config.address {
            // Another station uses the controller's own address, which concerns every AR.
            self.ars.serve_all(|ar| ar.handle_arp(now, &packet));
        } else if let Some(ar) = self.ars.with_address(packet.sender_address) {
            self.ars.serve(ar, |ar| ar.handle_arp(now, &packet));
        }
    }

    fn handle_dcp(&mut self, now: Instant, header: &EthernetHeader, payload: &[u8]) {
        match Pdu::parse(payload) {
            // Others look for this station, as an engineering system does.
            Ok(pdu) if pdu.service.is_request() => {
                self.has_answers = true;
                let permission = station::SetPermission::Allowed;
                if let Err(refusal) = self.station.handle_frame(now, header, payload, permission) {
                    refusal.count(&mut self.counters);
                }
            }
            Ok(pdu) => {
                let ar = self.ars.with_dcp(&pdu);
                let is_its =
                    ar.and_then(|ar| self.ars.serve(ar, |ar| ar.handle_dcp(now, header.source, &pdu)));
                self.counters.foreign += u64::from(is_its != Some(true));
            }
            Err(_) => self.counters.malformed += 1,
        }
    }

    fn handle_rt_datagram(&mut self, now: Instant, from: SocketAddrV4, payload: &[u8]) {
        let its = self.ars.with_address(*from.ip());
        let its = its.filter(|ar| self.ars.get(*ar).is_some_and(|ar| ar.transport() == Transport::Udp));
        let Some(ar) = its else {
            self.counters.foreign += 1;
            return;
        };
        let Some(frame_id) = payload.first_chunk().copied().map(u16::from_be_bytes) else {
            self.counters.malformed += 1;
            return;
        };
        if !self.ars.serve_data(ar, |ar| ar.handle_rt(now, frame_id, payload)) {
            self.counters.foreign += 1;
        }
    }

    fn handle_rpc(&mut self, now: Instant, from: SocketAddrV4, datagram: &[u8]) {
        let its = self.ars.with_address(*from.ip());
        let Ok((header, body)) = Header::parse(datagram) else {
            let counter =
                if its.is_some() { &mut self.counters.malformed } else { &mut self.counters.foreign };
            *counter += 1;
            return;
        };
        let is_call = matches!(header.kind, Kind::Request | Kind::Ping);
        // Engineering systems and diagnostic tools ask the endpoint mapper, too.
        let is_lookup = is_call && header.interface == ENDPOINT_MAPPER_INTERFACE;
        if its.is_none() && !is_lookup {
            self.counters.foreign += 1;
            return;
        }
        if !is_call {
            let is_its = its.and_then(|ar| self.ars.serve(ar, |ar| ar.handle_answer(now, &header, body)));
            self.counters.foreign += u64::from(is_its != Some(true));
            return;
        }
        self.has_answers = true;
        let body = match self.requests.take(*from.ip(), None, &header, body) {
            Received::Whole(body) => body,
            Received::Part if header.flags & flags::NO_FRAGMENT_ACK == 0 => {
                return self.responder.acknowledge(from, &header);
            }
            Received::Part => return,
            Received::Refused | Received::TooLong => {
                self.counters.malformed += 1;
                return;
            }
        };
        let expected = its.and_then(|ar| self.ars.get(ar)?.expects_call());
        let session = |uuid| expected.and_then(|(ar, session)| (ar == uuid).then_some(session));
        let endpoint = Endpoint::of(CONTROLLER_INTERFACE, &self.config.description, self.config.address);
        match self.responder.handle(from, &header, body, &endpoint, session) {
            RequestOutcome::Ready(_) => {
                let blocks = RequestArgs::parse(&header, body).map_or(&[][..], |args| args.blocks);
                its.and_then(|ar| self.ars.serve(ar, |ar| ar.application_ready(now, blocks)));
            }
            RequestOutcome::Answered => {}
            RequestOutcome::Foreign => self.counters.foreign += 1,
            RequestOutcome::Malformed => self.counters.malformed += 1,
        }
    }

    /// Writes the next answer of this station to DCP and to calls.
    fn poll_answer(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if let Some((to, len)) = self.responder.poll_transmit(buf) {
            return Some(Transmit { port: Port::Udp(RPC_PORT), to: Some(to), len });
        }
        let len = self.claim.poll_frame(now, buf).or_else(|| self.station.poll_transmit(now, buf))?;
        Some(Transmit { port: Port::Ethernet, to: None, len })
    }
}

impl Machine for Controller {
    type Event = (ArId, LinkEvent);

    fn ports(&self) -> &[PortRequest] {
        PORTS
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.ars.settle();
        match (from.port, from.peer) {
            (Port::Ethernet, _) => self.handle_ethernet(now, frame),
            (Port::Udp(RPC_PORT), Some(peer)) => self.handle_rpc(now, peer, frame),
            (Port::Udp(UDP_PORT), Some(peer)) => self.handle_rt_datagram(now, peer, frame),
            _ => self.counters.foreign += 1,
        }
    }

    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        self.ars.get(self.ars.with_address(address)?)?.neighbour(address)
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        self.ars.settle();
        if let Some(ar) = self.ars.with_address(address) {
            self.ars.serve(ar, |ar| ar.wrong_neighbour(now, found));
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.ars.settle();
        self.has_answers |= self.station.poll_timeout() <= now;
        self.station.handle_timeout(now);
        if self.claim.poll_timeout().is_some_and(|due| due <= now) {
            self.claim.handle_timeout(now);
            self.has_answers = true;
        }
        self.ars.handle_timeout(now);
    }

    fn pending(&self, _now: Instant) -> Pending {
        let (frame, event) = (self.has_answers || self.ars.may_send(), self.ars.may_report());
        Pending { frame, request: false, event }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.ars.settle();
        if let Some(transmit) = self.ars.poll_transmit(now, buf) {
            return Some(transmit);
        }
        let transmit = if self.has_answers { self.poll_answer(now, buf) } else { None };
        self.has_answers = transmit.is_some();
        transmit
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        self.ars.settle();
        self.ars.poll_event().map(|(number, event)| (ArId(number), event))
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let own = Instant::earlier(Some(self.station.poll_timeout()), self.claim.poll_timeout());
        Instant::earlier(own, self.ars.poll_timeout())
    }
}
