//! Finds the stations that have an address, by asking all.

use core::net::Ipv4Addr;

use super::{ArpPacket, PROBE_INTERVAL, PROBES};
use crate::Instant;
use crate::ethernet::Mac;

/// Largest number of stations that are remembered for one address; two are already a conflict.
pub const MOST_HOLDERS: usize = 4;

/// Asks [`PROBES`] times, [`super::PROBE_INTERVAL`] apart, who has an address, and keeps who says so.
///
/// It goes on listening until it is stopped or begins anew.
#[derive(Clone, Debug)]
pub struct Holders {
    mac: Mac,
    address: Ipv4Addr,
    /// The sender's address in a question; unspecified in a probe.
    own: Ipv4Addr,
    found: [Option<Mac>; MOST_HOLDERS],
    /// Questions that are still to be sent.
    left: u8,
    /// When the next question is sent, or after the last one when its answer should have come.
    due: Option<Instant>,
    send: bool,
}

impl Holders {
    /// Creates a search for the station `mac`; it asks nothing yet.
    #[must_use]
    pub const fn new(mac: Mac) -> Self {
        Self {
            mac,
            address: Ipv4Addr::UNSPECIFIED,
            own: Ipv4Addr::UNSPECIFIED,
            found: [None; MOST_HOLDERS],
            left: 0,
            due: None,
            send: false,
        }
    }

    /// Probes an address: asks who has it, without using an address.
    pub const fn probe(&mut self, now: Instant, address: Ipv4Addr) {
        self.ask(now, Ipv4Addr::UNSPECIFIED, address);
    }

    /// Asks who has an address, from the address `own`, which this station uses.
    pub const fn ask(&mut self, now: Instant, own: Ipv4Addr, address: Ipv4Addr) {
        *self = Self { address, own, left: PROBES, due: Some(now), ..Self::new(self.mac) };
        self.send = true;
    }

    /// Stops asking and listening.
    pub const fn stop(&mut self) {
        *self = Self::new(self.mac);
    }

    /// Returns the address that is asked for, the unspecified one if none is.
    #[must_use]
    pub const fn address(&self) -> Ipv4Addr {
        self.address
    }

    /// Returns whether all questions were sent and their answers should have come.
    #[must_use]
    pub const fn is_done(&self) -> bool {
        self.due.is_none() && !self.send
    }

    /// Returns the stations that said that they have the address, the first one first.
    pub fn found(&self) -> impl Iterator<Item = Mac> {
        self.found.into_iter().flatten()
    }

    /// Returns the first station besides `expected` that has the address.
    #[must_use]
    pub fn other_than(&self, expected: Option<Mac>) -> Option<Mac> {
        self.found().find(|found| Some(*found) != expected)
    }

    /// Handles a received packet. Returns whether it shows a station that has the address.
    pub fn handle(&mut self, packet: &ArpPacket) -> bool {
        let Some(mac) = packet.claimant(self.address).filter(|mac| *mac != self.mac) else { return false };
        let known = self.found.contains(&Some(mac));
        if let Some(free) = self.found.iter_mut().find(|found| found.is_none()).filter(|_| !known) {
            *free = Some(mac);
        }
        true
    }

    /// Sends the next question if it is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.due.is_none_or(|due| now < due) || self.send {
            return;
        }
        match self.left {
            0 => self.due = None,
            _ => self.send = true,
        }
    }

    /// Writes the question that is due as an Ethernet frame; returns its length in bytes.
    pub fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<usize> {
        if !core::mem::take(&mut self.send) {
            return None;
        }
        self.left = self.left.saturating_sub(1);
        self.due = Some(now + PROBE_INTERVAL);
        ArpPacket::question(self.mac, self.own, self.address).emit_frame(buf).ok()
    }

    /// Returns when [`handle_timeout`](Self::handle_timeout) is due.
    #[must_use]
    pub const fn poll_timeout(&self) -> Option<Instant> {
        self.due
    }
}
