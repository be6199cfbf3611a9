//! What the device hears from its neighbour, and how it is named to it.

use super::Core;
use crate::lldp::{self, Naming};
use crate::station::Refusal;
use machine::Instant;
use machine::ethernet::EthernetHeader;

impl Core {
    /// Handles a frame that is not one of PROFINET for this station: an LLDPDU, or it is foreign.
    pub(super) fn handle_other(&mut self, now: Instant, header: &EthernetHeader, payload: &[u8]) {
        let handled = match header.ether_type {
            lldp::ETHER_TYPE => self.station.handle_lldp(now, header, payload),
            _ => Err(Refusal::Foreign),
        };
        if let Err(refusal) = handled {
            self.count(refusal);
        }
    }

    pub(super) const fn count(&mut self, refusal: Refusal) {
        match refusal {
            Refusal::Malformed => self.counters.malformed += 1,
            Refusal::Foreign => self.counters.foreign += 1,
        }
    }

    /// Sets how the station is named to its neighbour.
    pub(super) fn set_naming(&mut self, now: Instant, naming: Naming) {
        self.station.set_naming(now, naming);
        self.acyclic = true;
    }
}
