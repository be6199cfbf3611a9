//! Finds the device by its name, checks by ARP that nobody else has its address, and sets the address by DCP.
//!
//! ```text
//! Identify ──window──▶ (Set ──▶) Resolve ──the device itself answers by ARP──▶ Found
//!     │ 200 ms, in which every answer counts, and questions by ARP from the first answer on
//!     └─▶ Refused: two stations have the name, or the address
//! ```
//!
//! Everything after the search goes to an IP address, and the network decides who gets that. So the search ends only when
//! the station that DCP found is the one that answers for the address.

mod answer;

use alloc::boxed::Box;
use core::net::Ipv4Addr;

use super::obstacle::Obstacle;
use super::{Refusal, down_reasons};
use crate::ETHER_TYPE;
use crate::dcp::{self, BlockError, Code, Content, IDENTIFY_MULTICAST, IpSuite, Pdu, Service, Station};
use answer::Answer;
use machine::arp::{ArpPacket, Holders};
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Duration, Instant};

/// Pause between repetitions of a request that was not answered, and the time in which every station answers an Identify.
const REPEAT_AFTER: Duration = Duration::from_millis(200);
/// Set requests to one station before the search starts again.
const SET_ATTEMPTS: u8 = 5;
/// Time in which a device must answer ARP for the address that it has or was given.
const RESOLVED_WITHIN: Duration = Duration::from_secs(3);
/// Identify windows with one answer after which a name that two stations had counts as that of one: an answer may be lost.
const WINDOWS_ALONE: u8 = 3;
/// Stations of the device's name that are remembered as reported.
const MOST_IGNORED: usize = 4;

/// Device to find, and the address to give it.
#[derive(Debug)]
pub(super) struct WantedStation {
    pub(super) own_mac: Mac,
    /// IP address of the controller.
    pub(super) own_address: Ipv4Addr,
    pub(super) name: Box<[u8]>,
    /// VendorID and DeviceID.
    pub(super) identity: (u16, u16),
    /// MAC address, if it is known.
    pub(super) mac: Option<Mac>,
    pub(super) address: IpSuite,
}

/// Result of a DCP answer, an ARP packet or a timeout.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Progress {
    /// Nothing yet.
    Pending,
    /// It does not belong to this search.
    Foreign,
    /// The station is there and has its address.
    Found(Mac),
    /// Another station of the name answered for the first time; the MAC address of the right one is configured.
    Ignored(Mac),
    /// The station is there but cannot be used.
    Refused(Refusal),
    /// Another station is in the way.
    Obstructed(Obstacle),
    /// The station does not answer for its address.
    Unresolved,
}

/// Searches for the device until it is found and has its address.
#[derive(Debug)]
pub(super) struct Discovery {
    wanted: WantedStation,
    xid: u32,
    /// The first answer of this search.
    answer: Option<Answer>,
    /// Another station that answered in this search.
    twin: Option<Mac>,
    /// Windows with one answer since two stations answered; `None` if they never did.
    windows_alone: Option<u8>,
    ignored: [Option<Mac>; MOST_IGNORED],
    /// Who has the device's address.
    holders: Holders,
    /// Who else has the controller's own address.
    own: Holders,
    step: Step,
    send: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Step {
    Idle,
    Identify { until: Instant },
    SetAddress { repeat_at: Instant, attempt: u8 },
    Resolve { until: Instant },
}

impl Discovery {
    pub(super) const fn new(wanted: WantedStation) -> Self {
        Self {
            holders: Holders::new(wanted.own_mac),
            own: Holders::new(wanted.own_mac),
            wanted,
            xid: 0,
            answer: None,
            twin: None,
            windows_alone: None,
            ignored: [None; MOST_IGNORED],
            step: Step::Idle,
            send: false,
        }
    }

    /// Starts to search. `xid` must not have been used lately, so that old answers are not accepted for new ones.
    pub(super) fn begin(&mut self, now: Instant, xid: u32) {
        self.xid = xid;
        self.answer = None;
        self.twin = None;
        self.stop();
        self.identify(now);
    }

    /// Returns the transaction of the search.
    pub(super) const fn xid(&self) -> u32 {
        self.xid
    }

    fn identify(&mut self, now: Instant) {
        self.step = Step::Identify { until: now + REPEAT_AFTER };
        self.send = true;
    }

    /// Returns the first station that answered to the name.
    pub(super) fn device(&self) -> Option<Mac> {
        self.answer.map(|answer| answer.mac)
    }

    /// Returns the name to which the station answered.
    pub(super) fn name(&self) -> &[u8] {
        &self.wanted.name
    }

    /// Returns the VendorID and the DeviceID that the station reported, if it did.
    pub(super) fn identity(&self) -> Option<(u16, u16)> {
        self.answer?.identity
    }

    /// Returns whether the station reported that another one has its address.
    pub(super) fn has_conflict(&self) -> bool {
        self.answer.is_some_and(|answer| answer.has_conflict)
    }

    /// Returns the instance that the station reports of itself.
    pub(super) fn instance(&self) -> Option<u16> {
        self.answer.and_then(|answer| answer.instance)
    }

    /// Returns whether a station answered to the name.
    pub(super) const fn has_found(&self) -> bool {
        self.answer.is_some()
    }

    /// Returns whether a station has its address but does not answer for it.
    pub(super) const fn is_resolving(&self) -> bool {
        matches!(self.step, Step::Resolve { .. })
    }

    /// Stops the search.
    pub(super) const fn stop(&mut self) {
        self.step = Step::Idle;
        self.send = false;
        self.holders.stop();
        self.own.stop();
    }

    pub(super) fn handle(&mut self, now: Instant, from: Mac, pdu: &Pdu<'_>) -> Progress {
        match pdu.service {
            Service::IdentifyResponse if pdu.xid == self.xid => self.identified(now, from, pdu),
            Service::SetResponse if pdu.xid == self.xid.wrapping_add(1) => self.address_set(now, from, pdu),
            _ => Progress::Foreign,
        }
    }

    /// Returns whether a Hello names the device's name.
    pub(super) fn is_hello(&self, pdu: &Pdu<'_>) -> bool {
        let is_named = |station: Station<'_>| station.name.eq_ignore_ascii_case(&self.wanted.name);
        pdu.service == Service::Hello && Station::from_pdu(pdu).is_ok_and(is_named)
    }

    /// Returns whether a station cannot be the device, by its MAC address.
    pub(super) fn is_excluded(&self, from: Mac) -> bool {
        self.wanted.mac.is_some_and(|mac| mac != from)
    }

    /// Remembers a station of the device's name. Returns whether it was unknown.
    pub(super) fn ignore(&mut self, mac: Mac) -> bool {
        let is_known = self.ignored.contains(&Some(mac));
        match self.ignored.iter_mut().find(|place| place.is_none()) {
            Some(place) if !is_known => {
                *place = Some(mac);
                true
            }
            _ => false,
        }
    }

    fn identified(&mut self, now: Instant, from: Mac, pdu: &Pdu<'_>) -> Progress {
        let Some(answer) = Answer::parse(from, pdu).filter(|answer| answer.names(&self.wanted.name, pdu))
        else {
            return Progress::Foreign;
        };
        if self.is_excluded(from) {
            return if self.ignore(from) { Progress::Ignored(from) } else { Progress::Foreign };
        }
        match self.answer {
            Some(first) if first.mac == from => return Progress::Pending,
            // Once it is addressed, nothing is sent to it any more.
            Some(first) if !matches!(self.step, Step::Identify { .. }) => return self.twins(first.mac, from),
            Some(_) => self.twin = self.twin.or(Some(from)),
            // The search was given up, or has not begun.
            None if self.step == Step::Idle => return Progress::Foreign,
            None => {
                self.answer = Some(answer);
                self.holders.ask(now, self.wanted.own_address, self.wanted.address.address);
                self.own.probe(now, self.wanted.own_address);
                if self.wanted.mac.is_some() {
                    self.step = Step::Identify { until: now };
                }
            }
        }
        Progress::Pending
    }

    /// Ends the search: two stations have the name.
    fn twins(&mut self, first: Mac, second: Mac) -> Progress {
        self.windows_alone = Some(0);
        self.stop();
        Progress::Obstructed(Obstacle::Twins([first, second]))
    }

    /// Judges the answers of a window that is over.
    fn judge(&mut self, now: Instant) -> Progress {
        let Some(Answer { mac, identity, has_conflict, ip, .. }) = self.answer else {
            self.identify(now);
            return Progress::Pending;
        };
        if let Some(twin) = self.twin {
            return self.twins(mac, twin);
        }
        if let Some(windows) = self.windows_alone.filter(|_| self.wanted.mac.is_none()) {
            self.windows_alone = (windows + 1 < WINDOWS_ALONE).then_some(windows + 1);
            if self.windows_alone.is_some() {
                self.begin(now, self.xid.wrapping_add(2));
                return Progress::Pending;
            }
        }
        if let Some((vendor, device)) = identity.filter(|found| *found != self.wanted.identity) {
            let code = u32::from(vendor) << 16 | u32::from(device);
            return self.refuse(code, down_reasons::WRONG_IDENTITY);
        }
        if let Some(other) = self.own.other_than(None) {
            self.stop();
            let address = self.wanted.own_address;
            return Progress::Obstructed(Obstacle::OwnAddress { address, other });
        }
        if let Some(obstacle) = self.holder_of_address(mac) {
            return obstacle;
        }
        let IpSuite { address, mask, .. } = self.wanted.address;
        let has_address = ip.is_some_and(|has| has.address == address && has.mask == mask);
        // A station does not use an address that another one has. If that one is gone, a new Set makes it look again.
        if !has_address || has_conflict {
            self.step = Step::SetAddress { repeat_at: now + REPEAT_AFTER, attempt: 1 };
            self.send = true;
            Progress::Pending
        } else if self.holders.found().any(|found| found == mac) {
            self.found(mac)
        } else {
            self.resolve(now, now + RESOLVED_WITHIN)
        }
    }

    /// Ends the search if another station than the device has its address.
    fn holder_of_address(&mut self, device: Mac) -> Option<Progress> {
        let other = self.holders.other_than(Some(device))?;
        self.stop();
        let address = self.wanted.address.address;
        Some(Progress::Obstructed(Obstacle::Address { address, device, other }))
    }

    const fn found(&mut self, device: Mac) -> Progress {
        self.stop();
        Progress::Found(device)
    }

    /// Asks for the device's address until the device answers.
    const fn resolve(&mut self, now: Instant, until: Instant) -> Progress {
        self.step = Step::Resolve { until };
        self.holders.ask(now, self.wanted.own_address, self.wanted.address.address);
        Progress::Pending
    }

    fn address_set(&mut self, now: Instant, from: Mac, pdu: &Pdu<'_>) -> Progress {
        if self.device() != Some(from) || !matches!(self.step, Step::SetAddress { .. }) {
            return Progress::Foreign;
        }
        let result = pdu.blocks().find_map(|block| match block.ok()?.content {
            Content::Response { code: Code::IP, error } => Some(error),
            _ => None,
        });
        match result {
            Some(BlockError::None) => self.resolve(now, now + RESOLVED_WITHIN),
            Some(error) => self.refuse(u32::from(u8::from(error)), down_reasons::ADDRESS_REFUSED),
            None => Progress::Foreign,
        }
    }

    const fn refuse(&mut self, code: u32, text: &'static str) -> Progress {
        self.stop();
        Progress::Refused(Refusal { code, text })
    }

    /// Handles an ARP packet during the search.
    pub(super) fn handle_arp(&mut self, packet: &ArpPacket) -> Progress {
        self.own.handle(packet);
        if !self.holders.handle(packet) {
            return Progress::Foreign;
        }
        let (Step::Resolve { .. }, Some(device)) = (self.step, self.device()) else {
            return Progress::Pending;
        };
        self.holder_of_address(device).unwrap_or_else(|| self.found(device))
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) -> Progress {
        self.holders.handle_timeout(now);
        self.own.handle_timeout(now);
        match self.step {
            Step::Identify { until } if now >= until && self.holders.is_done() && self.own.is_done() => {
                return self.judge(now);
            }
            Step::SetAddress { repeat_at, attempt } if now >= repeat_at => {
                if attempt < SET_ATTEMPTS {
                    self.step = Step::SetAddress { repeat_at: now + REPEAT_AFTER, attempt: attempt + 1 };
                    self.send = true;
                } else {
                    self.begin(now, self.xid.wrapping_add(2));
                }
            }
            Step::Resolve { until } if self.holders.is_done() => {
                if now >= until {
                    self.stop();
                    return Progress::Unresolved;
                }
                return self.resolve(now, until);
            }
            _ => {}
        }
        Progress::Pending
    }

    pub(super) fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<usize> {
        if let Some(len) = self.poll_dcp(buf) {
            return Some(len);
        }
        self.holders.poll_transmit(now, buf).or_else(|| self.own.poll_transmit(now, buf))
    }

    fn poll_dcp(&mut self, buf: &mut [u8]) -> Option<usize> {
        if !core::mem::take(&mut self.send) {
            return None;
        }
        let header = |destination| EthernetHeader {
            destination,
            source: self.wanted.own_mac,
            tag: None,
            ether_type: ETHER_TYPE,
        };
        match (self.step, self.device()) {
            (Step::Identify { .. }, _) => header(IDENTIFY_MULTICAST).emit(buf, |writer| {
                let name = Content::NameOfStation(&self.wanted.name);
                dcp::emit(writer, Service::IdentifyRequest, self.xid, 1, [name.into()]);
            }),
            (Step::SetAddress { .. }, Some(device)) => header(device).emit(buf, |writer| {
                let address = Content::Ip(self.wanted.address);
                dcp::emit(writer, Service::SetRequest, self.xid.wrapping_add(1), 0, [address.into()]);
            }),
            _ => return None,
        }
        .ok()
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let asks = Instant::earlier(self.holders.poll_timeout(), self.own.poll_timeout());
        match self.step {
            // The window goes on until the questions by ARP are over, too.
            Step::Identify { until } if asks.is_none() => Some(until),
            Step::SetAddress { repeat_at, .. } => Instant::earlier(asks, Some(repeat_at)),
            Step::Idle => None,
            Step::Identify { .. } | Step::Resolve { .. } => asks,
        }
    }
}

#[cfg(test)]
mod tests;
