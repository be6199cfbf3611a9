//! The claim of either role to its own address (RFC 5227): it is probed, then announced and defended; while another station
//! has it, it is probed again and again.

use core::net::Ipv4Addr;

use machine::arp::{AddressClaim, AddressConflict, ArpPacket, ClaimEvent};
use machine::ethernet::Mac;
use machine::{Duration, Instant, Machine as _};

/// Time after which the address is probed again, if another station has it.
const PROBE_AGAIN: Duration = Duration::from_secs(1);

/// What became of the address.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Change {
    /// No other station has it.
    Free,
    /// Another station had it first.
    Taken(AddressConflict),
    /// Another station uses it, too.
    Conflict(AddressConflict),
}

/// A station's address.
#[derive(Debug)]
pub(super) struct OwnAddress {
    pub(super) mac: Mac,
    address: Ipv4Addr,
    claim: AddressClaim,
    probe_at: Option<Instant>,
}

impl OwnAddress {
    pub(super) const fn new(mac: Mac, address: Ipv4Addr, start: Instant) -> Self {
        Self { mac, address, claim: AddressClaim::new(mac), probe_at: Some(start) }
    }

    /// Returns whether it is not used yet.
    pub(super) const fn is_probing(&self) -> bool {
        self.claim.is_probing()
    }

    pub(super) fn handle(&mut self, now: Instant, packet: &ArpPacket) -> Option<Change> {
        self.claim.handle(now, packet);
        self.change(now)
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) -> Option<Change> {
        if self.probe_at.is_some_and(|at| now >= at) {
            self.probe_at = None;
            self.claim.probe(now, self.address);
        }
        self.claim.handle_timeout(now);
        self.change(now)
    }

    fn change(&mut self, now: Instant) -> Option<Change> {
        Some(match self.claim.poll_event()? {
            ClaimEvent::Free(address) => {
                self.claim.claim(now, address);
                Change::Free
            }
            ClaimEvent::Taken(conflict) => {
                self.probe_at = Some(now + PROBE_AGAIN);
                Change::Taken(conflict)
            }
            ClaimEvent::Conflict(conflict) => Change::Conflict(conflict),
        })
    }

    pub(super) const fn may_send(&self) -> bool {
        self.claim.may_send()
    }

    /// Writes the next frame; returns its length in bytes.
    pub(super) fn poll_frame(&mut self, now: Instant, buf: &mut [u8]) -> Option<usize> {
        self.claim.poll_frame(now, buf)
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        Instant::earlier(self.probe_at, self.claim.poll_timeout())
    }
}
