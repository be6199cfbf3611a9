//! A station's claim to its own address (RFC 5227): probes before it is used, announcements, and its defence.
//!
//! ```text
//! Idle ──probe──▶ Probing ──free──▶ Idle, Free ──claim──▶ Using ──conflict──▶ Using, Conflict, defended
//!                    └────taken───▶ Idle, Taken
//! ```
//!
//! The owner puts the address on the interface between `Free` and `claim`. An address that was on the interface before is
//! claimed without probes.

use core::fmt;
use core::net::Ipv4Addr;

use super::{ArpPacket, ETHERNET, Holders, PROBE_INTERVAL};
use crate::ethernet::Mac;
use crate::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};

/// Announcements of an address (RFC 5227, 1.1, ANNOUNCE_NUM).
const ANNOUNCEMENTS: u8 = 2;

/// Shortest time between two defences, so that two stations do not answer each other for ever (RFC 5227, 1.1,
/// DEFEND_INTERVAL).
const DEFEND_INTERVAL: Duration = Duration::from_secs(10);

/// Another station that has or wants an address.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct AddressConflict {
    /// The address.
    pub address: Ipv4Addr,
    /// MAC address of the other station.
    pub mac: Mac,
}

impl fmt::Display for AddressConflict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "another station has the IP address {}: its MAC address is {}", self.address, self.mac)
    }
}

/// What a claim reports.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ClaimEvent {
    /// No station answered the probes: the address may be used.
    Free(Ipv4Addr),
    /// Another station has the address, or probes it at the same time: it must not be used.
    Taken(AddressConflict),
    /// Another station uses the address, too. Reported once for each station, and again after 10 s.
    Conflict(AddressConflict),
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum State {
    Idle,
    Probing,
    Using(Ipv4Addr),
}

/// A station's claim to one address. It is a machine of its own, for a check before a node starts; a stack that contains one
/// calls the same methods, and passes the packets that it receives to [`handle`](Self::handle).
#[derive(Clone, Debug)]
pub struct AddressClaim {
    mac: Mac,
    state: State,
    probes: Holders,
    /// Announcements to send, and when.
    announcements: u8,
    announce_at: Option<Instant>,
    send: bool,
    /// When the address was defended last.
    defended: Option<Instant>,
    /// The other station that was reported last.
    reported: Option<Mac>,
    event: Option<ClaimEvent>,
}

impl AddressClaim {
    /// Creates the claim of the station `mac`, without an address.
    #[must_use]
    pub const fn new(mac: Mac) -> Self {
        Self {
            mac,
            state: State::Idle,
            probes: Holders::new(mac),
            announcements: 0,
            announce_at: None,
            send: false,
            defended: None,
            reported: None,
            event: None,
        }
    }

    /// Probes an address that is to be used. [`ClaimEvent::Free`] or [`ClaimEvent::Taken`] follows within
    /// [`super::PROBE_TIME`].
    pub const fn probe(&mut self, now: Instant, address: Ipv4Addr) {
        *self = Self::new(self.mac);
        self.state = State::Probing;
        self.probes.probe(now, address);
    }

    /// Announces an address that is on the interface, and defends it from now on.
    pub const fn claim(&mut self, now: Instant, address: Ipv4Addr) {
        *self = Self::new(self.mac);
        if !address.is_unspecified() {
            self.state = State::Using(address);
            self.announcements = ANNOUNCEMENTS;
            self.announce_at = Some(now);
            self.send = true;
        }
    }

    /// Gives the address up.
    pub const fn release(&mut self) {
        *self = Self::new(self.mac);
    }

    /// Returns the address that is defended.
    #[must_use]
    pub const fn address(&self) -> Option<Ipv4Addr> {
        match self.state {
            State::Using(address) => Some(address),
            State::Idle | State::Probing => None,
        }
    }

    /// Returns whether an address is being probed.
    #[must_use]
    pub const fn is_probing(&self) -> bool {
        matches!(self.state, State::Probing)
    }

    /// Handles a received packet. A packet of this station is not a conflict, and neither is a question for its address.
    pub fn handle(&mut self, now: Instant, packet: &ArpPacket) {
        if packet.sender_mac == self.mac {
            return;
        }
        match self.state {
            State::Idle => {}
            State::Probing => {
                let address = self.probes.address();
                // RFC 5227, 2.1.1: another station has it, or wants it at the same time.
                let wants = packet.is_probe() && packet.target_address == address;
                if wants || packet.claimant(address).is_some() {
                    self.release();
                    self.event = Some(ClaimEvent::Taken(AddressConflict { address, mac: packet.sender_mac }));
                }
            }
            State::Using(address) => {
                if let Some(mac) = packet.claimant(address) {
                    self.defend(now, AddressConflict { address, mac });
                }
            }
        }
    }

    /// Defends the address as a station that must keep it does (RFC 5227, 2.4, c): one announcement in an interval.
    fn defend(&mut self, now: Instant, conflict: AddressConflict) {
        let is_due = self.defended.is_none_or(|last| now >= last + DEFEND_INTERVAL);
        if is_due {
            self.defended = Some(now);
            self.announcements = self.announcements.max(1);
            self.announce_at = Some(now);
            self.send = true;
        }
        if is_due || self.reported != Some(conflict.mac) {
            self.reported = Some(conflict.mac);
            self.event = Some(ClaimEvent::Conflict(conflict));
        }
    }

    fn announce(&mut self, now: Instant, buf: &mut [u8]) -> Option<usize> {
        let State::Using(address) = self.state else { return None };
        if !core::mem::take(&mut self.send) {
            return None;
        }
        self.announcements = self.announcements.saturating_sub(1);
        self.announce_at = (self.announcements > 0).then_some(now + PROBE_INTERVAL);
        ArpPacket::announcement(self.mac, address).emit_frame(buf).ok()
    }

    /// Returns whether there may be a frame for [`poll_frame`](Self::poll_frame).
    #[must_use]
    pub const fn may_send(&self) -> bool {
        self.send || self.is_probing()
    }

    /// Writes the next frame; returns its length in bytes. For a stack that contains the claim.
    pub fn poll_frame(&mut self, now: Instant, buf: &mut [u8]) -> Option<usize> {
        self.announce(now, buf).or_else(|| self.probes.poll_transmit(now, buf))
    }
}

impl Machine for AddressClaim {
    type Event = ClaimEvent;

    fn ports(&self) -> &[PortRequest] {
        &[ETHERNET]
    }

    fn handle_frame(&mut self, now: Instant, _from: Source, frame: &[u8]) {
        if let Some(Ok(packet)) = ArpPacket::from_frame(frame) {
            self.handle(now, &packet);
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.send |= self.announce_at.is_some_and(|at| now >= at);
        self.probes.handle_timeout(now);
        if self.state == State::Probing && self.probes.is_done() {
            let address = self.probes.address();
            self.release();
            self.event = Some(ClaimEvent::Free(address));
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let len = self.poll_frame(now, buf)?;
        Some(Transmit { port: Port::Ethernet, to: None, len })
    }

    fn poll_event(&mut self) -> Option<ClaimEvent> {
        self.event.take()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Instant::earlier(self.announce_at, self.probes.poll_timeout())
    }
}
