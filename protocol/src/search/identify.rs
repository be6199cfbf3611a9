//! Search on PROFINET: DCP Identify of every station (IEC 61158-6-10, 4.3).

use alloc::boxed::Box;

use super::Gathered;
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Duration, Port, Transmit};
use profinet::ETHER_TYPE;
use profinet::dcp::{self, Content, IDENTIFY_MULTICAST, IpSuite, MAX_DELAY_FACTOR, Pdu, Service, Station};

/// Configuration of a search on PROFINET.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ProfinetQuestion {
    /// The MAC address of this host.
    pub mac: Mac,
    /// Xid of the first request; later ones count up. Choose one that was not used lately, so that late answers to
    /// earlier searches are ignored.
    pub first_xid: u32,
}

/// A PROFINET station that answered.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ProfinetStation {
    /// Its MAC address, which identifies it: every station has one.
    pub mac: Mac,
    /// Its name; empty if none is set. Lower-case ASCII if the station follows the standard.
    pub name: Box<[u8]>,
    /// Its type of station, as named by the vendor.
    pub type_of_station: Box<[u8]>,
    /// Its VendorID and DeviceID.
    pub identity: Option<(u16, u16)>,
    /// Its IP address, subnet mask and gateway; 0.0.0.0 if not set.
    pub ip: Option<IpSuite>,
    /// Its roles as bits: 1 IO-Device, 2 IO-Controller, 4 IO-Multidevice, 8 IO-Supervisor.
    pub roles: u8,
}

#[derive(Debug)]
pub(super) struct ProfinetSearch {
    question: ProfinetQuestion,
    delay_factor: u16,
    asked: u32,
    send: bool,
    gathered: Gathered<ProfinetStation>,
}

impl ProfinetSearch {
    pub(super) fn new(question: ProfinetQuestion, spread: Duration) -> Self {
        let steps = u16::try_from(spread.as_millis() / 10).unwrap_or(u16::MAX);
        let delay_factor = steps.clamp(1, MAX_DELAY_FACTOR);
        Self { question, delay_factor, asked: 0, send: false, gathered: Gathered::new() }
    }

    pub(super) const fn gathered(&self) -> &Gathered<ProfinetStation> {
        &self.gathered
    }

    pub(super) const fn ask(&mut self) {
        self.asked = self.asked.saturating_add(1);
        self.send = true;
    }

    pub(super) fn poll_transmit(&mut self, buf: &mut [u8]) -> Option<Transmit> {
        if !core::mem::take(&mut self.send) {
            return None;
        }
        let header = EthernetHeader {
            destination: IDENTIFY_MULTICAST,
            source: self.question.mac,
            tag: None,
            ether_type: ETHER_TYPE,
        };
        let xid = self.question.first_xid.wrapping_add(self.asked.saturating_sub(1));
        let written = header.emit(buf, |writer| {
            dcp::emit(writer, Service::IdentifyRequest, xid, self.delay_factor, [Content::All.into()]);
        });
        Some(Transmit { port: Port::Ethernet, to: None, len: written.ok()? })
    }

    /// Handles a frame; ignores everything but DCP answers, such as other stations' cyclic data and alarms.
    pub(super) fn handle_frame(&mut self, frame: &[u8]) {
        let Ok((header, payload)) = EthernetHeader::parse(frame) else { return };
        if header.ether_type != ETHER_TYPE || payload.first_chunk() != Some(&dcp::IDENTIFY_RESPONSE_ID) {
            return;
        }
        match self.station(&header, payload) {
            Some(station) => self.gathered.keep(station, |one, other| one.mac == other.mac),
            None => self.gathered.tally.ignored += 1,
        }
    }

    /// Parses the answer of a station to one of our requests.
    fn station(&self, header: &EthernetHeader, payload: &[u8]) -> Option<ProfinetStation> {
        let pdu = Pdu::parse(payload).ok()?;
        let ours = pdu.service == Service::IdentifyResponse
            && pdu.xid.wrapping_sub(self.question.first_xid) < self.asked
            && header.destination == self.question.mac
            && !header.source.is_group();
        if !ours {
            return None;
        }
        let Station { name, type_of_station, identity, ip, roles } = Station::from_pdu(&pdu).ok()?;
        Some(ProfinetStation {
            mac: header.source,
            name: name.into(),
            type_of_station: type_of_station.into(),
            identity,
            ip,
            roles,
        })
    }
}
