//! The ARs of a controller: which of them a frame, a deadline or a turn to send concerns. Nothing here walks over all ARs.

use alloc::boxed::Box;
use alloc::collections::BTreeMap;
use alloc::vec::Vec;
use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Deadlines, Directory, Instant, LinkEvent, Numbers, Transmit, Turns};

use super::MOST_ARS;
use super::ar::Ar;
use super::config::ConfigError;
use crate::dcp::{Pdu, Service, Station};

/// The ARs, by number.
#[derive(Default, Debug)]
pub(super) struct Roster {
    slots: Vec<Slot>,
    /// Numbers without an AR, to use again.
    free: Vec<u16>,
    /// By the IP address of the device.
    by_address: Directory<u32>,
    /// ARs of RT_CLASS_1 that are connected, by the MAC address of the device.
    by_mac: Directory<u64>,
    /// By the transaction of the search for the device.
    by_xid: Directory<u32>,
    by_name: BTreeMap<Box<[u8]>, u16>,
    deadlines: Deadlines,
    /// ARs whose deadline is over.
    due: Numbers,
    /// ARs that the owner may have changed.
    touched: Turns,
    /// ARs that may have a cyclic frame to send, another frame, an event.
    cyclic: Turns,
    acyclic: Turns,
    reporting: Turns,
    /// ARs whose cyclic data have arrived since the owner last asked.
    received: Turns,
}

#[derive(Default, Debug)]
struct Slot {
    ar: Option<Ar>,
    /// The keys by which it is found at the moment.
    mac: Option<u64>,
    xid: Option<u32>,
}

impl Roster {
    /// Returns the number for another AR.
    pub(super) fn next_number(&self) -> Result<u16, ConfigError> {
        let number = self.free.last().map_or(self.slots.len(), |free| usize::from(*free));
        let number = u16::try_from(number).ok().filter(|_| number < MOST_ARS);
        number.ok_or(ConfigError::TooManyArs(MOST_ARS))
    }

    /// Checks that no AR has this name or this address.
    pub(super) fn check(&self, name: &str, address: Ipv4Addr) -> Result<(), ConfigError> {
        if self.by_name.contains_key(name.as_bytes()) {
            return Err(ConfigError::SameName(name.into()));
        }
        match self.by_address.next(address.to_bits(), None).and_then(|number| self.get(number)) {
            Some(other) => {
                let other = other.station_name().into();
                Err(ConfigError::SameAddress { address, name: name.into(), other })
            }
            None => Ok(()),
        }
    }

    /// Adds an AR at the number that [`next_number`](Self::next_number) returned.
    pub(super) fn add(&mut self, number: u16, ar: Ar) {
        self.by_address.insert(ar.address().to_bits(), number);
        self.by_name.insert(ar.station_name().as_bytes().into(), number);
        let slot = Slot { ar: Some(ar), ..Slot::default() };
        match self.slots.get_mut(usize::from(number)) {
            Some(place) => {
                self.free.pop();
                *place = slot;
            }
            None => self.slots.push(slot),
        }
        let numbers = self.slots.len();
        let Self { touched, cyclic, acyclic, reporting, received, .. } = self;
        for turns in [touched, cyclic, acyclic, reporting, received] {
            turns.reserve(numbers);
        }
        self.due.reserve(numbers);
        self.note(number);
    }

    /// Removes an AR.
    pub(super) fn remove(&mut self, number: u16) -> Option<Ar> {
        let slot = self.slots.get_mut(usize::from(number))?;
        let ar = slot.ar.take()?;
        let Slot { mac, xid, .. } = core::mem::take(slot);
        self.by_address.remove(ar.address().to_bits(), number);
        self.by_mac.replace(number, mac, None);
        self.by_xid.replace(number, xid, None);
        self.by_name.remove(ar.station_name().as_bytes());
        self.deadlines.set(number, None);
        self.free.push(number);
        Some(ar)
    }

    pub(super) fn get(&self, number: u16) -> Option<&Ar> {
        self.slots.get(usize::from(number))?.ar.as_ref()
    }

    /// Returns an AR, for its owner.
    pub(super) fn get_mut(&mut self, number: u16) -> Option<&mut Ar> {
        let ar = self.slots.get_mut(usize::from(number))?.ar.as_mut()?;
        self.touched.push(number);
        Some(ar)
    }

    /// Sets the output data of an AR: they change neither its deadline nor what it has to send or to report.
    pub(super) fn set_outputs(&mut self, number: u16, write: impl FnMut(u16, u16, &mut [u8])) {
        let slot = self.slots.get_mut(usize::from(number));
        if let Some(ar) = slot.and_then(|slot| slot.ar.as_mut()) {
            ar.set_outputs(write);
        }
    }

    /// Returns all ARs with their numbers.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u16, &Ar)> {
        self.slots.iter().zip(0..).filter_map(|(slot, number)| Some((number, slot.ar.as_ref()?)))
    }

    /// Takes note of what the owner changed.
    pub(super) fn settle(&mut self) {
        while let Some(number) = self.touched.pop() {
            // New outputs alone change nothing here.
            if self.get(number).is_some_and(|ar| ar.has_acyclic() || ar.has_event()) {
                self.note(number);
            }
        }
    }

    /// Calls an AR and takes note of what that changed.
    pub(super) fn serve<R>(&mut self, number: u16, call: impl FnOnce(&mut Ar) -> R) -> Option<R> {
        let result = call(self.slots.get_mut(usize::from(number))?.ar.as_mut()?);
        self.note(number);
        Some(result)
    }

    /// Calls an AR for a frame that may have cyclic data, and takes note of what that changed and of data that arrived.
    pub(super) fn serve_data(&mut self, number: u16, call: impl FnOnce(&mut Ar) -> bool) -> bool {
        let result = self.serve(number, |ar| {
            let before = ar.received();
            (call(ar), ar.received() != before)
        });
        let (is_its, has_arrived) = result.unwrap_or_default();
        if has_arrived {
            self.received.push(number);
        }
        is_its
    }

    /// Calls every AR, for what concerns them all.
    pub(super) fn serve_all(&mut self, mut call: impl FnMut(&mut Ar)) {
        for number in 0..self.slots.len() as u16 {
            self.serve(number, &mut call);
        }
    }

    fn note(&mut self, number: u16) {
        let Some(Slot { ar: Some(ar), mac, xid }) = self.slots.get_mut(usize::from(number)) else { return };
        // Only then can its keys have changed.
        if ar.has_acyclic() {
            let now = ar.rt1_device().map(key);
            self.by_mac.replace(number, core::mem::replace(mac, now), now);
            let now = Some(ar.xid());
            self.by_xid.replace(number, core::mem::replace(xid, now), now);
            self.acyclic.push(number);
        }
        if ar.has_cyclic() {
            self.cyclic.push(number);
        }
        if ar.has_event() {
            self.reporting.push(number);
        }
        self.deadlines.set(number, ar.poll_timeout());
    }

    /// Calls the AR that a frame of RT_CLASS_1 is for. Returns whether one took it.
    pub(super) fn serve_rt(
        &mut self,
        source: Mac,
        frame_id: u16,
        mut call: impl FnMut(&mut Ar) -> bool,
    ) -> bool {
        // The FrameID of cyclic data has the number of the AR; alarms have two FrameIDs for all.
        let number = Ar::number_of(frame_id);
        let is_its = self.get(number).is_some_and(|ar| ar.rt1_device() == Some(source));
        if is_its && self.serve_data(number, &mut call) {
            return true;
        }
        self.serve_mac(source, call)
    }

    /// Calls the ARs that are connected to this MAC address, until one takes the frame. Returns whether one did.
    fn serve_mac(&mut self, mac: Mac, mut call: impl FnMut(&mut Ar) -> bool) -> bool {
        let mut last = None;
        while let Some(number) = self.by_mac.next(key(mac), last) {
            if self.serve_data(number, &mut call) {
                return true;
            }
            last = Some(number);
        }
        false
    }

    /// Returns the AR whose device has this address.
    pub(super) fn with_address(&self, address: Ipv4Addr) -> Option<u16> {
        self.by_address.next(address.to_bits(), None)
    }

    /// Returns the AR that an answer to DCP, or a Hello, is for.
    pub(super) fn with_dcp(&self, pdu: &Pdu<'_>) -> Option<u16> {
        match pdu.service {
            Service::Hello => {
                let station = Station::from_pdu(pdu).ok()?;
                self.by_name.get(&*station.name.to_ascii_lowercase()).copied()
            }
            Service::SetResponse => self.by_xid.next(pdu.xid.wrapping_sub(1), None),
            _ => self.by_xid.next(pdu.xid, None),
        }
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        while let Some(number) = self.deadlines.take_due(now) {
            self.due.insert(number);
        }
        while let Some(number) = self.due.take_first() {
            self.serve(number, |ar| ar.handle_timeout(now));
        }
    }

    /// Returns whether an AR may have a frame to send.
    pub(super) fn may_send(&self) -> bool {
        !(self.cyclic.is_empty() && self.acyclic.is_empty()) || self.has_changed(Ar::has_acyclic)
    }

    /// Returns whether an AR may have an event.
    pub(super) fn may_report(&self) -> bool {
        !self.reporting.is_empty() || self.has_changed(Ar::has_event)
    }

    /// Returns whether this holds for an AR that the owner may have changed.
    fn has_changed(&self, holds: impl Fn(&Ar) -> bool) -> bool {
        self.touched.iter().any(|number| self.get(number).is_some_and(&holds))
    }

    /// Writes the next frame. The cyclic frames of all ARs go before all other frames.
    pub(super) fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        while let Some(number) = self.cyclic.pop() {
            let ar = self.slots.get_mut(usize::from(number)).and_then(|slot| slot.ar.as_mut());
            if let Some(transmit) = ar.and_then(|ar| ar.poll_cyclic(buf)) {
                return Some(transmit);
            }
        }
        while let Some(number) = self.acyclic.first() {
            if let Some(Some(transmit)) = self.serve(number, |ar| ar.poll_acyclic(now, buf)) {
                return Some(transmit);
            }
            self.acyclic.pop();
        }
        None
    }

    pub(super) fn poll_event(&mut self) -> Option<(u16, LinkEvent)> {
        while let Some(number) = self.reporting.first() {
            let ar = self.slots.get_mut(usize::from(number)).and_then(|slot| slot.ar.as_mut());
            if let Some(event) = ar.and_then(Ar::poll_event) {
                return Some((number, event));
            }
            self.reporting.pop();
        }
        None
    }

    /// Returns the next AR whose cyclic data have arrived.
    pub(super) fn poll_received(&mut self) -> Option<u16> {
        self.received.pop()
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        if self.touched.is_empty() {
            return self.deadlines.first();
        }
        // The owner changed ARs and has not polled the controller since.
        let settled = self.deadlines.iter().filter(|(number, _)| !self.touched.contains(*number));
        let touched = self.touched.iter().filter_map(|number| self.get(number)?.poll_timeout());
        settled.map(|(_, at)| at).chain(touched).min()
    }
}

/// Returns a MAC address as a number, which is compared at once.
fn key(Mac([a, b, c, d, e, f]): Mac) -> u64 {
    u64::from_be_bytes([0, 0, a, b, c, d, e, f])
}
