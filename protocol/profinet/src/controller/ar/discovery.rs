//! Finds the device by its name and sets its address, by DCP.

use alloc::boxed::Box;

use super::Refusal;
use crate::ETHER_TYPE;
use crate::dcp::{
    self, Block, BlockError, Code, Content, IDENTIFY_MULTICAST, IpSuite, Pdu, Service, Station,
};
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Duration, Instant};

/// Pause between repetitions of a request that was not answered.
const REPEAT_AFTER: Duration = Duration::from_millis(200);
/// Set requests to one station before the search starts again.
const SET_ATTEMPTS: u8 = 5;

const WRONG_IDENTITY: &str = "the station of this name is another device than described (the status is its \
     VendorID and DeviceID): check the name and the description";
const NAME_TWICE: &str =
    "two stations answer to the device's name: give one of them another name, by DCP or its own tool";
const ADDRESS_REFUSED: &str = "the device refused the IP address that was set by DCP (the status is its BlockError): \
     look whether another controller or DHCP holds its address";

/// Device to find, and the address to give it.
#[derive(Debug)]
pub(super) struct WantedStation {
    pub(super) own_mac: Mac,
    pub(super) name: Box<[u8]>,
    /// VendorID and DeviceID.
    pub(super) identity: (u16, u16),
    /// MAC address, if it is known.
    pub(super) mac: Option<Mac>,
    pub(super) address: IpSuite,
}

/// Result of a DCP answer.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Progress {
    /// Nothing yet.
    Pending,
    /// It does not belong to this search.
    Foreign,
    /// The station is there and has its address.
    Found(Mac),
    /// The station is there but cannot be used.
    Refused(Refusal),
}

/// Searches for the device until it is found and has its address.
#[derive(Debug)]
pub(super) struct Discovery {
    wanted: WantedStation,
    xid: u32,
    device: Option<Mac>,
    /// DeviceInstance of the station, if it reports one.
    instance: Option<u16>,
    /// Whether the station reports that another one has its address.
    has_conflict: bool,
    step: Step,
    send: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Step {
    Idle,
    Identify { repeat_at: Instant },
    SetAddress { repeat_at: Instant, attempt: u8 },
}

impl Discovery {
    pub(super) const fn new(wanted: WantedStation) -> Self {
        Self {
            wanted,
            xid: 0,
            device: None,
            instance: None,
            has_conflict: false,
            step: Step::Idle,
            send: false,
        }
    }

    /// Starts to search. `xid` must not have been used lately, so that old answers are not accepted for new ones.
    pub(super) fn begin(&mut self, now: Instant, xid: u32) {
        self.xid = xid;
        self.device = None;
        self.instance = None;
        self.has_conflict = false;
        self.step = Step::Identify { repeat_at: now + REPEAT_AFTER };
        self.send = true;
    }

    /// Returns the first station that answered to the name.
    pub(super) const fn device(&self) -> Option<Mac> {
        self.device
    }

    /// Returns whether the station reported that another one has its address.
    pub(super) const fn has_conflict(&self) -> bool {
        self.has_conflict
    }

    /// Returns the instance that the station reports of itself.
    pub(super) const fn instance(&self) -> Option<u16> {
        self.instance
    }

    /// Returns whether a station answered to the name.
    pub(super) const fn has_found(&self) -> bool {
        self.device.is_some()
    }

    /// Stops the search.
    pub(super) const fn stop(&mut self) {
        self.step = Step::Idle;
        self.send = false;
    }

    pub(super) fn handle(&mut self, now: Instant, from: Mac, pdu: &Pdu<'_>) -> Progress {
        if self.wanted.mac.is_some_and(|mac| mac != from) {
            return Progress::Foreign;
        }
        match pdu.service {
            Service::IdentifyResponse if pdu.xid == self.xid => self.identified(now, from, pdu),
            Service::SetResponse if pdu.xid == self.xid.wrapping_add(1) => self.address_set(from, pdu),
            _ => Progress::Foreign,
        }
    }

    /// Returns whether a Hello is that of the device: it has come up, and can be searched for.
    pub(super) fn is_hello(&self, from: Mac, pdu: &Pdu<'_>) -> bool {
        let is_named = |station: Station<'_>| station.name.eq_ignore_ascii_case(&self.wanted.name);
        pdu.service == Service::Hello
            && self.wanted.mac.is_none_or(|mac| mac == from)
            && Station::from_pdu(pdu).is_ok_and(is_named)
    }

    fn identified(&mut self, now: Instant, from: Mac, pdu: &Pdu<'_>) -> Progress {
        let Ok(station) = Station::from_pdu(pdu) else { return Progress::Foreign };
        if !station.name.eq_ignore_ascii_case(&self.wanted.name) {
            return Progress::Foreign;
        }
        match self.device {
            Some(device) if device == from => return Progress::Pending,
            Some(_) => return self.refuse(0, NAME_TWICE),
            // The search was given up, or has not begun.
            None if self.step == Step::Idle => return Progress::Foreign,
            None => self.device = Some(from),
        }
        for block in pdu.blocks().flatten() {
            match block.content {
                Content::DeviceInstance(instance) => self.instance = Some(instance),
                Content::Ip(_) => self.has_conflict = block.qualifier & Block::ADDRESS_CONFLICT != 0,
                _ => {}
            }
        }
        if let Some((vendor, device)) = station.identity.filter(|found| *found != self.wanted.identity) {
            return self.refuse(u32::from(vendor) << 16 | u32::from(device), WRONG_IDENTITY);
        }
        let IpSuite { address, mask, .. } = self.wanted.address;
        let has_address = station.ip.is_some_and(|has| has.address == address && has.mask == mask);
        // A station does not use an address that another one has. If that one is gone, a new Set makes it look again.
        if has_address && !self.has_conflict {
            self.stop();
            return Progress::Found(from);
        }
        self.step = Step::SetAddress { repeat_at: now + REPEAT_AFTER, attempt: 1 };
        self.send = true;
        Progress::Pending
    }

    fn address_set(&mut self, from: Mac, pdu: &Pdu<'_>) -> Progress {
        if self.device != Some(from) || !matches!(self.step, Step::SetAddress { .. }) {
            return Progress::Foreign;
        }
        let result = pdu.blocks().find_map(|block| match block.ok()?.content {
            Content::Response { code: Code::IP, error } => Some(error),
            _ => None,
        });
        match result {
            Some(BlockError::None) => {
                self.stop();
                Progress::Found(from)
            }
            Some(error) => self.refuse(u32::from(u8::from(error)), ADDRESS_REFUSED),
            None => Progress::Foreign,
        }
    }

    const fn refuse(&mut self, code: u32, text: &'static str) -> Progress {
        self.stop();
        Progress::Refused(Refusal { code, text })
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        match self.step {
            Step::Identify { repeat_at } if now >= repeat_at => {
                self.step = Step::Identify { repeat_at: now + REPEAT_AFTER };
                self.send = true;
            }
            Step::SetAddress { repeat_at, attempt } if now >= repeat_at => {
                if attempt < SET_ATTEMPTS {
                    self.step = Step::SetAddress { repeat_at: now + REPEAT_AFTER, attempt: attempt + 1 };
                    self.send = true;
                } else {
                    self.begin(now, self.xid.wrapping_add(2));
                }
            }
            _ => {}
        }
    }

    pub(super) fn poll_transmit(&mut self, buf: &mut [u8]) -> Option<usize> {
        if !core::mem::take(&mut self.send) {
            return None;
        }
        let header = |destination| EthernetHeader {
            destination,
            source: self.wanted.own_mac,
            tag: None,
            ether_type: ETHER_TYPE,
        };
        match (self.step, self.device) {
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

    pub(super) const fn poll_timeout(&self) -> Option<Instant> {
        match self.step {
            Step::Idle => None,
            Step::Identify { repeat_at } | Step::SetAddress { repeat_at, .. } => Some(repeat_at),
        }
    }
}

#[cfg(test)]
mod tests;
