//! Address conflicts as the scanner sees them (RFC 5227): of its own address, and of the adapters' addresses.
//!
//! Before each attempt to connect, the scanner asks who has the adapter's address. If two stations have it, the host's table of
//! neighbours alone would decide which of them gets the connection.

use core::fmt;
use core::net::Ipv4Addr;

use machine::arp::{AddressConflict, ArpPacket, Holders};
use machine::ethernet::Mac;
use machine::{Down, DownCause, Duration, Instant};

/// Shortest time between two reports about one adapter.
const REPORT_EVERY: Duration = Duration::from_secs(10);

/// The scanner's own address, by which it asks for others.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asker {
    pub(super) mac: Mac,
    pub(super) address: Ipv4Addr,
    pub(super) mask: Ipv4Addr,
}

/// Two stations that have one address.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Conflict {
    /// The adapter's address.
    Adapter { address: Ipv4Addr, macs: [Mac; 2] },
    /// The scanner's own address.
    Own { mac: Mac, other: AddressConflict },
}

impl Conflict {
    pub(super) const fn down(&self) -> Down {
        let text = match self {
            Self::Adapter { .. } => {
                "two stations have the adapter's IP address; give one of them another address"
            }
            Self::Own { .. } => {
                "another station has this scanner's IP address; give one of them another address"
            }
        };
        Down { cause: DownCause::Refused, code: 0, text }
    }
}

impl fmt::Display for Conflict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Adapter { address, macs: [first, second] } => write!(
                f,
                "two stations have the adapter's IP address {address}: {first} and {second}; give one of them another address"
            ),
            Self::Own { mac, other: AddressConflict { address, mac: other } } => write!(
                f,
                "another station, {other}, has the IP address {address} of this scanner, {mac}; give one of them another address"
            ),
        }
    }
}

/// The stations that have the address of one adapter.
#[derive(Debug)]
pub(super) struct Target {
    own: Asker,
    address: Ipv4Addr,
    pub(super) holders: Holders,
    silent_until: Option<Instant>,
}

impl Target {
    /// Returns `None` for an adapter in another subnet, which ARP does not reach.
    pub(super) fn new(own: Asker, address: Ipv4Addr) -> Option<Self> {
        let is_local = (own.address.to_bits() ^ address.to_bits()) & own.mask.to_bits() == 0;
        is_local.then(|| Self { own, address, holders: Holders::new(own.mac), silent_until: None })
    }

    pub(super) const fn ask(&mut self, now: Instant) {
        self.holders.ask(now, self.own.address, self.address);
    }

    /// Returns the conflict, if two stations have the address.
    pub(super) fn conflict(&self) -> Option<Conflict> {
        let mut found = self.holders.found();
        let macs = [found.next()?, found.next()?];
        Some(Conflict::Adapter { address: self.address, macs })
    }

    /// Returns the station to which this address belongs, if it is the adapter's.
    pub(super) fn station(&self, address: Ipv4Addr) -> Option<Mac> {
        // The first one had it when the connection was made.
        self.holders.found().next().filter(|_| address == self.address)
    }

    /// Handles a packet. Returns a station other than the adapter that has its address, if it is to be reported.
    pub(super) fn handle(&mut self, now: Instant, packet: &ArpPacket) -> Option<AddressConflict> {
        let first = self.holders.found().next();
        let is_other = self.holders.handle(packet) && first.is_some_and(|first| first != packet.sender_mac);
        if !is_other || self.silent_until.is_some_and(|until| now < until) {
            return None;
        }
        self.silent_until = Some(now + REPORT_EVERY);
        Some(AddressConflict { address: self.address, mac: packet.sender_mac })
    }
}
