//! Which station has the adapter's address: asked before each attempt, and followed while the connection is up.

use core::net::Ipv4Addr;

use machine::arp::{AddressConflict, ArpPacket};
use machine::ethernet::Mac;
use machine::{Instant, LinkEvent, StationConflict};

use super::super::conflict::Conflict;
use super::{Connection, Step};

impl Connection {
    pub(in crate::scanner) fn stop_conflict_detection(&mut self) {
        self.target = None;
    }

    /// Begins an attempt.
    pub(super) fn begin(&mut self, now: Instant) {
        let Some(target) = &mut self.target else { return self.connect(now) };
        target.ask(now);
        self.step = Step::Asking;
        self.deadline = None;
    }

    /// Goes on once the answers are there.
    pub(super) fn follow_question(&mut self, now: Instant) {
        let Some(target) = &mut self.target else { return };
        target.holders.handle_timeout(now);
        if self.step == Step::Asking && target.holders.is_done() {
            match target.conflict() {
                Some(conflict) => self.refuse(now, conflict),
                None => self.connect(now),
            }
        }
    }

    /// Ends the attempt: two stations have an address that only one may have.
    pub(in crate::scanner) fn refuse(&mut self, now: Instant, conflict: Conflict) {
        if self.leaving {
            return;
        }
        if self.conflict.replace(conflict) != Some(conflict) {
            // Other stations than those reported before.
            self.reported = None;
        }
        self.refusal = None;
        self.fail(now, conflict.down());
    }

    pub(in crate::scanner) fn report(&mut self, conflict: AddressConflict) {
        self.events.push_back(LinkEvent::Conflict(StationConflict::Address(conflict)));
    }

    pub(in crate::scanner) fn handle_arp(&mut self, now: Instant, packet: &ArpPacket) {
        let Some(target) = &mut self.target else { return };
        let Some(other) = target.handle(now, packet) else { return };
        let conflict = target.conflict();
        match (self.step, conflict) {
            (Step::Running, _) => self.report(other),
            (Step::Idle | Step::Asking | Step::Closing, _) | (_, None) => {}
            (_, Some(conflict)) => self.refuse(now, conflict),
        }
    }

    pub(in crate::scanner) fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        self.target.as_ref().filter(|_| !matches!(self.step, Step::Idle | Step::Asking))?.station(address)
    }

    /// Handles that the host would send to another station than the one that was found.
    pub(in crate::scanner) fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        if let Some(station) = self.neighbour(address) {
            self.refuse(now, Conflict::Adapter { address, macs: [station, found] });
        }
    }
}
