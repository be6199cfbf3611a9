//! Finding every station on the cable, by DCP Identify (IEC 61158-6-10, 4.3).

use alloc::boxed::Box;

use machine::ethernet::{EthernetHeader, Mac};
use machine::search::{Answers, Due, Schedule, SearchEnded};
use machine::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};

use crate::dcp::{self, Content, IDENTIFY_MULTICAST, IpSuite, MAX_DELAY_FACTOR, Pdu, Service, Station};
use crate::{ETHER_TYPE, ETHERNET};

/// Configuration of a search.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SearchConfig {
    /// The own MAC address.
    pub mac: Mac,
    /// Xid of the first request; the following ones count up. Choose one that was not used lately, so that old answers are
    /// not accepted.
    pub first_xid: u32,
    /// Time from the first request to the end.
    pub length: Duration,
}

/// A station that answered.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct FoundStation {
    /// Its MAC address, which identifies the station: every station has one.
    pub mac: Mac,
    /// Its name; empty if none is set. Lower-case ASCII unless the station breaks the rules.
    pub name: Box<[u8]>,
    /// Type of the station, as its maker calls it.
    pub type_of_station: Box<[u8]>,
    /// Its VendorID and DeviceID.
    pub identity: Option<(u16, u16)>,
    /// Its IP address, mask and gateway; 0.0.0.0 if none is set.
    pub ip: Option<IpSuite>,
    /// Its roles as bits: 1 IO-Device, 2 IO-Controller, 4 IO-Multidevice, 8 IO-Supervisor.
    pub roles: u8,
}

/// Sends Identify requests to all stations and collects the answers. It reports [`SearchEnded`].
#[derive(Debug)]
pub struct Search {
    config: SearchConfig,
    schedule: Schedule,
    asked: u32,
    send: bool,
    answers: Answers<FoundStation>,
}

impl Search {
    /// Creates a search that sends its first request at `start`.
    #[must_use]
    pub fn new(config: SearchConfig, start: Instant) -> Self {
        let schedule = Schedule::new(start, config.length);
        Self { config, schedule, asked: 0, send: false, answers: Answers::default() }
    }

    /// Returns the stations that answered.
    #[must_use]
    pub const fn answers(&self) -> &Answers<FoundStation> {
        &self.answers
    }

    /// Returns the station that answers one of our requests.
    fn station(&self, header: &EthernetHeader, payload: &[u8]) -> Option<FoundStation> {
        let pdu = Pdu::parse(payload).ok()?;
        let ours = pdu.service == Service::IdentifyResponse
            && pdu.xid.wrapping_sub(self.config.first_xid) < self.asked
            && header.destination == self.config.mac
            && !header.source.is_group();
        if !ours {
            return None;
        }
        let Station { name, type_of_station, identity, ip, roles } = Station::from_pdu(&pdu).ok()?;
        Some(FoundStation {
            mac: header.source,
            name: name.into(),
            type_of_station: type_of_station.into(),
            identity,
            ip,
            roles,
        })
    }
}

impl Machine for Search {
    type Event = SearchEnded;

    fn ports(&self) -> &[PortRequest] {
        &[ETHERNET]
    }

    /// Ignores frames that are not DCP answers: other stations' cyclic data and alarms may be on the cable too.
    fn handle_frame(&mut self, _now: Instant, from: Source, frame: &[u8]) {
        let Ok((header, payload)) = EthernetHeader::parse(frame) else { return };
        let is_answer = header.ether_type == ETHER_TYPE
            && payload.first_chunk() == Some(&dcp::IDENTIFY_RESPONSE_ID)
            && from.port == Port::Ethernet;
        if !is_answer || self.schedule.has_ended() {
            return;
        }
        match self.station(&header, payload) {
            Some(station) => self.answers.keep(station, |one, other| one.mac == other.mac),
            None => self.answers.ignore(),
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.schedule.handle_timeout(now) == Due::Request {
            self.asked = self.asked.saturating_add(1);
            self.send = true;
        }
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if !core::mem::take(&mut self.send) {
            return None;
        }
        let header = EthernetHeader {
            destination: IDENTIFY_MULTICAST,
            source: self.config.mac,
            tag: None,
            ether_type: ETHER_TYPE,
        };
        let xid = self.config.first_xid.wrapping_add(self.asked.saturating_sub(1));
        let steps = u16::try_from(self.schedule.spread().as_millis() / 10).unwrap_or(u16::MAX);
        let delay_factor = steps.clamp(1, MAX_DELAY_FACTOR);
        let written = header.emit(buf, |writer| {
            dcp::emit(writer, Service::IdentifyRequest, xid, delay_factor, [Content::All.into()]);
        });
        Some(Transmit { port: Port::Ethernet, to: None, len: written.ok()? })
    }

    fn poll_event(&mut self) -> Option<SearchEnded> {
        self.schedule.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.schedule.poll_timeout()
    }
}
