//! The device's IP address on the network (RFC 5227): it is probed before the owner sets it, announced afterwards, and
//! defended while it is used.

use super::super::dcp::IpSuite;
use super::super::station::OwnerStep;
use super::Core;
use machine::arp::{AddressConflict, ArpPacket, ClaimEvent};
use machine::{Instant, LinkEvent, Machine as _, StationConflict};

impl Core {
    /// Handles an ARP packet. Its host answers those that ask for the address.
    pub(super) fn handle_arp(&mut self, now: Instant, payload: &[u8]) {
        let Ok(packet) = ArpPacket::parse(payload) else {
            self.counters.malformed += 1;
            return;
        };
        self.claim.handle(now, &packet);
        self.take_claim_event(now);
        self.watch_controller(&packet);
    }

    /// Reports a station that claims the IP address of the controller, once for each: answers to the controller may go there.
    fn watch_controller(&mut self, packet: &ArpPacket) {
        let Some(relation) = &self.relation else { return };
        let address = relation.controller;
        let Some(mac) = packet.claimant(address).filter(|mac| *mac != relation.initiator_mac) else { return };
        if self.impostor.replace(mac) != Some(mac) {
            self.report(LinkEvent::Conflict(StationConflict::Address(AddressConflict { address, mac })));
        }
    }

    pub(super) fn handle_claim_timeout(&mut self, now: Instant) {
        if self.claim.poll_timeout().is_some_and(|due| due <= now) {
            self.claim.handle_timeout(now);
            self.take_claim_event(now);
            self.acyclic = true;
        }
    }

    /// Prepares an address that DCP sets: the owner sets it once no other station answers for it.
    pub(super) fn prepare_address(&mut self, now: Instant, suite: IpSuite) {
        if suite.address.is_unspecified() || suite.address == self.station.ip().address {
            return self.report_address(suite);
        }
        self.probed = Some(suite);
        self.claim.probe(now, suite.address);
        self.acyclic = true;
    }

    /// Announces the address of the station and defends it from now on.
    pub(super) fn claim_address(&mut self, now: Instant) {
        self.claim.claim(now, self.station.ip().address);
        self.acyclic = true;
    }

    fn report_address(&mut self, IpSuite { address, mask, gateway }: IpSuite) {
        self.report(LinkEvent::SetAddress { address, mask, gateway });
    }

    fn take_claim_event(&mut self, now: Instant) {
        let Some(event) = self.claim.poll_event() else { return };
        self.acyclic = true;
        match event {
            ClaimEvent::Free(_) => {
                if let Some(suite) = self.probed.take() {
                    self.report_address(suite);
                }
            }
            ClaimEvent::Taken(conflict) => {
                self.probed = None;
                self.report(LinkEvent::Conflict(StationConflict::Address(conflict)));
                self.station.set_conflict(true);
                let (_, step) = self.station.address_set(now, false);
                // The address that the station has keeps its claim.
                self.claim_address(now);
                self.ask_owner(now, step);
            }
            ClaimEvent::Conflict(conflict) => {
                self.station.set_conflict(true);
                self.report(LinkEvent::Conflict(StationConflict::Address(conflict)));
            }
        }
    }

    /// Reports as an event what the owner has to do for a Set.
    pub(super) fn ask_owner(&mut self, now: Instant, step: Option<OwnerStep>) {
        match step {
            Some(OwnerStep::SetAddress(suite)) => self.prepare_address(now, suite),
            Some(OwnerStep::Store) => self.ask_to_store(),
            None => {}
        }
    }
}
