//! The IO-Controller: one station with many application relations (ARs), one for each IO-Device that it drives.
//!
//! ```text
//! Ethernet 0x8892 ─┬─ DCP requests ──────────── station
//!                  ├─ DCP answers ───────────── each AR, until one of them accepts it
//!                  └─ cyclic data, alarms ───── the ARs with the sender's MAC address     (RT_CLASS_1)
//! Ethernet 0x88CC ─── LLDP ─────────────────── station
//! Ethernet 0x0806 ─── ARP ──────────────────── each AR, the claim to the own address
//! UDP 34962 ───────── cyclic data, alarms ───── the ARs with the sender's IP address      (RT_CLASS_UDP)
//! UDP 34964 ───────┬─ calls ─────────────────── responder: ApplicationReady of an AR, endpoint mapper
//!                  └─ answers to calls ──────── the ARs with the sender's IP address
//! ```

mod ar;
mod config;
mod responder;

pub use ar::Ar;
pub use config::{ArConfig, ConfigError, ControllerConfig, Parameter};

use alloc::vec::Vec;
use core::iter::Flatten;
use core::net::{Ipv4Addr, SocketAddrV4};
use core::slice::IterMut;

use machine::arp::{self, AddressClaim, ArpPacket, ClaimEvent};
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Counters, Instant, LinkEvent, Machine, Port, PortRequest, Source, Transmit};

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
    ars: Vec<Option<Ar>>,
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
            ars: Vec::new(),
            counters: Counters::default(),
            has_answers: false,
            config,
        })
    }

    /// Adds an AR that starts to search for its device at `start`.
    pub fn connect(&mut self, config: ArConfig, start: Instant) -> Result<ArId, ConfigError> {
        let free = self.ars.iter().position(Option::is_none).unwrap_or(self.ars.len());
        let number = u16::try_from(free).ok().filter(|_| free < MOST_ARS);
        let number = number.ok_or(ConfigError::TooManyArs(MOST_ARS))?;
        let ar = Ar::new(&self.config, config, number, start)?;
        if self.claim.address().is_none() {
            self.claim.claim(start, self.config.address);
        }
        match self.ars.get_mut(free) {
            Some(place) => *place = Some(ar),
            None => self.ars.push(Some(ar)),
        }
        Ok(ArId(number))
    }

    /// Returns an AR; `None` once it was removed.
    #[must_use]
    pub fn ar(&self, ar: ArId) -> Option<&Ar> {
        self.ars.get(usize::from(ar.0))?.as_ref()
    }

    /// Returns an AR, for commands; `None` once it was removed. Poll the controller afterwards.
    pub fn ar_mut(&mut self, ar: ArId) -> Option<&mut Ar> {
        self.ars.get_mut(usize::from(ar.0))?.as_mut()
    }

    /// Returns every AR that was not removed.
    pub fn ars(&self) -> impl Iterator<Item = (ArId, &Ar)> {
        self.ars.iter().zip(0..).filter_map(|(ar, number)| Some((ArId(number), ar.as_ref()?)))
    }

    /// Removes an AR at once. A device that is still connected notices this by its watchdog: [`Ar::disconnect`] first, and
    /// wait for [`LinkEvent::Down`].
    pub fn remove(&mut self, ar: ArId) -> Option<Ar> {
        self.ars.get_mut(usize::from(ar.0))?.take()
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

    fn all(&mut self) -> Flatten<IterMut<'_, Option<Ar>>> {
        self.ars.iter_mut().flatten()
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
        let mut ars =
            self.all().filter(|ar| ar.transport() == Transport::Rt1 && ar.device() == Some(header.source));
        if !ars.any(|ar| ar.handle_rt(now, frame_id, payload)) {
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
            self.all().for_each(|ar| ar.own_address_taken(now, conflict));
        }
        self.all().for_each(|ar| ar.handle_arp(now, &packet));
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
                if !self.all().any(|ar| ar.handle_dcp(now, header.source, &pdu)) {
                    self.counters.foreign += 1;
                }
            }
            Err(_) => self.counters.malformed += 1,
        }
    }

    fn handle_rt_datagram(&mut self, now: Instant, from: SocketAddrV4, payload: &[u8]) {
        let mut ars = self
            .ars
            .iter_mut()
            .flatten()
            .filter(|ar| ar.transport() == Transport::Udp && ar.address() == *from.ip())
            .peekable();
        match payload.first_chunk().copied().map(u16::from_be_bytes) {
            None if ars.peek().is_some() => self.counters.malformed += 1,
            Some(frame_id) if ars.any(|ar| ar.handle_rt(now, frame_id, payload)) => {}
            _ => self.counters.foreign += 1,
        }
    }

    fn handle_rpc(&mut self, now: Instant, from: SocketAddrV4, datagram: &[u8]) {
        let is_its = |ar: &&Ar| ar.address() == *from.ip();
        let is_known = self.ars.iter().flatten().any(|ar| is_its(&ar));
        let Ok((header, body)) = Header::parse(datagram) else {
            let counter = if is_known { &mut self.counters.malformed } else { &mut self.counters.foreign };
            *counter += 1;
            return;
        };
        let is_call = matches!(header.kind, Kind::Request | Kind::Ping);
        // Engineering systems and diagnostic tools ask the endpoint mapper, too.
        let is_lookup = is_call && header.interface == ENDPOINT_MAPPER_INTERFACE;
        if !is_known && !is_lookup {
            self.counters.foreign += 1;
            return;
        }
        if !is_call {
            let mut ars = self.ars.iter_mut().flatten().filter(|ar| ar.address() == *from.ip());
            if !ars.any(|ar| ar.handle_answer(now, &header, body)) {
                self.counters.foreign += 1;
            }
            return;
        }
        self.has_answers = true;
        let body = match self.requests.take(*from.ip(), None, &header, body) {
            Received::Whole(body) => body,
            Received::Part if header.flags & flags::NO_FRAGMENT_ACK == 0 => {
                return self.responder.acknowledge(from, &header);
            }
            Received::Part => return,
            Received::Refused => {
                self.counters.malformed += 1;
                return;
            }
        };
        let ars = &self.ars;
        let session = |uuid| {
            let expecting = ars.iter().flatten().filter(is_its).filter_map(Ar::expects_call);
            expecting.into_iter().find_map(|(ar, session)| (ar == uuid).then_some(session))
        };
        let endpoint = Endpoint::of(CONTROLLER_INTERFACE, &self.config.description, self.config.address);
        match self.responder.handle(from, &header, body, &endpoint, session) {
            RequestOutcome::Ready(uuid) => {
                let is_it = |ar: &&mut Ar| ar.expects_call().is_some_and(|(ar, _)| ar == uuid);
                if let Some(ar) = self.ars.iter_mut().flatten().find(is_it) {
                    ar.application_ready(
                        now,
                        RequestArgs::parse(&header, body).map_or(&[], |args| args.blocks),
                    );
                }
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
        match (from.port, from.peer) {
            (Port::Ethernet, _) => self.handle_ethernet(now, frame),
            (Port::Udp(RPC_PORT), Some(peer)) => self.handle_rpc(now, peer, frame),
            (Port::Udp(UDP_PORT), Some(peer)) => self.handle_rt_datagram(now, peer, frame),
            _ => self.counters.foreign += 1,
        }
    }

    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        self.ars.iter().flatten().find_map(|ar| ar.neighbour(address))
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        self.all().filter(|ar| ar.address() == address).for_each(|ar| ar.wrong_neighbour(now, found));
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.has_answers |= self.station.poll_timeout() <= now;
        self.station.handle_timeout(now);
        if self.claim.poll_timeout().is_some_and(|due| due <= now) {
            self.claim.handle_timeout(now);
            self.has_answers = true;
        }
        self.all().for_each(|ar| ar.handle_timeout(now));
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        // The cyclic frames of all ARs go before all other frames.
        if let Some(transmit) = self.all().find_map(|ar| ar.poll_cyclic(buf)) {
            return Some(transmit);
        }
        if let Some(transmit) = self.all().find_map(|ar| ar.poll_acyclic(now, buf)) {
            return Some(transmit);
        }
        let transmit = if self.has_answers { self.poll_answer(now, buf) } else { None };
        self.has_answers = transmit.is_some();
        transmit
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        self.ars.iter_mut().zip(0..).find_map(|(ar, number)| Some((ArId(number), ar.as_mut()?.poll_event()?)))
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let ars = self.ars.iter().flatten().map(Ar::poll_timeout);
        let own = Instant::earlier(Some(self.station.poll_timeout()), self.claim.poll_timeout());
        ars.fold(own, Instant::earlier)
    }
}
