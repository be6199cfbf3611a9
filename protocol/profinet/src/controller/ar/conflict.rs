//! Another station in the device's place, or in the controller's: how the AR finds it, ends, and names it.

use core::fmt;
use core::net::Ipv4Addr;

use super::acyclic::Acyclic;
use super::discovery::Progress;
use super::obstacle::Obstacle;
use super::{Ar, ArPhase, PAUSE, Refusal, down_reasons};
use machine::arp::{AddressConflict, ArpPacket};
use machine::ethernet::Mac;
use machine::{Down, DownCause, Instant, LinkEvent, StationConflict};

impl Ar {
    /// Writes which station is in the way, if one ended the last attempt.
    pub fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.obstacle.map_or(Ok(()), |obstacle| write!(words, "{obstacle}"))
    }

    /// Returns the MAC address at which datagrams to the device must arrive.
    pub(in super::super) fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        self.discovery.device().filter(|_| self.config.address == address)
    }

    /// Ends the attempt or the connection, since another station is in the way.
    pub(super) fn obstruct(&mut self, now: Instant, obstacle: Obstacle) {
        // What ends the attempt may be over soon: the next one comes as after the first failure.
        self.pause = PAUSE;
        let was_new = self.obstacle != Some(obstacle);
        if let Obstacle::Address { address, other: mac, .. } | Obstacle::OwnAddress { address, other: mac } =
            obstacle
            && was_new
            && self.up
        {
            self.report_conflict(StationConflict::Address(AddressConflict { address, mac }));
        }
        self.refuse(now, Refusal { code: 0, text: obstacle.text() });
        self.obstacle = Some(obstacle);
    }

    pub(super) fn report_conflict(&mut self, conflict: StationConflict) {
        self.events.push_back(LinkEvent::Conflict(conflict));
    }

    /// Reports a station of the device's name that is not used.
    pub(super) fn report_ignored(&mut self, ignored: Mac) {
        if let Some(device) = self.config.mac.or_else(|| self.discovery.device()) {
            self.report_conflict(StationConflict::Name { device, ignored });
        }
    }

    /// Handles an ARP packet.
    pub(in super::super) fn handle_arp(&mut self, now: Instant, packet: &ArpPacket) {
        let Some(other) = packet.claimant(self.config.address).filter(|mac| *mac != self.own) else {
            if self.phase == ArPhase::Searching {
                self.acyclic = Acyclic::Active;
                let progress = self.discovery.handle_arp(packet);
                self.progress(now, progress);
            }
            return;
        };
        self.acyclic = Acyclic::Active;
        match self.phase {
            ArPhase::Stopped | ArPhase::Releasing { .. } => {}
            ArPhase::Searching => {
                let progress = self.discovery.handle_arp(packet);
                self.progress(now, progress);
            }
            // A station has come up with the address; however many come, a pause is not shorter than the first one.
            ArPhase::Pausing { until } => {
                self.phase = ArPhase::Pausing { until: until.min(now + PAUSE) };
            }
            _ => {
                // RFC 5227, 2.4: the sender claims the address. The host may send to it from now on.
                if let Some(device) = self.discovery.device().filter(|device| *device != other) {
                    let address = self.config.address;
                    self.obstruct(now, Obstacle::Address { address, device, other });
                }
            }
        }
    }

    /// Handles that the host would send what is for the device to `other`.
    pub(in super::super) fn wrong_neighbour(&mut self, now: Instant, other: Mac) {
        if let (Some(device), false) = (self.discovery.device(), self.is_idle()) {
            let address = self.config.address;
            self.obstruct(now, Obstacle::Neighbour { address, device, other });
        }
    }

    /// Handles that another station has the controller's IP address.
    pub(in super::super) fn own_address_taken(&mut self, now: Instant, conflict: AddressConflict) {
        let AddressConflict { address, mac: other } = conflict;
        if self.phase != ArPhase::Searching && !self.is_idle() {
            self.obstruct(now, Obstacle::OwnAddress { address, other });
        }
    }

    const fn is_idle(&self) -> bool {
        matches!(self.phase, ArPhase::Stopped | ArPhase::Releasing { .. } | ArPhase::Pausing { .. })
    }

    /// Takes the next step of the search. Returns whether what was received belongs to it.
    pub(super) fn progress(&mut self, now: Instant, progress: Progress) -> bool {
        match progress {
            Progress::Found(_) if self.phase == ArPhase::Searching => self.connect(now),
            Progress::Refused(refusal) if self.phase == ArPhase::Searching => self.refuse(now, refusal),
            Progress::Pending | Progress::Found(_) => {}
            Progress::Ignored(mac) => {
                self.report_ignored(mac);
                return false;
            }
            Progress::Unresolved => {
                let down = Down { cause: DownCause::NoAnswer, code: 0, text: down_reasons::NO_ARP };
                self.fail(now, down, None);
            }
            // Data are exchanged with the station that was found: another one of its name is only named.
            Progress::Obstructed(Obstacle::Twins([_, other])) if self.phase == ArPhase::Exchanging => {
                if self.discovery.ignore(other) {
                    self.report_ignored(other);
                }
                return false;
            }
            Progress::Obstructed(obstacle) if !self.is_idle() => self.obstruct(now, obstacle),
            Progress::Obstructed(_) | Progress::Refused(_) | Progress::Foreign => return false,
        }
        true
    }

    /// Ends the attempt, since the station that answered the Connect is not the one that was found.
    pub(super) fn refuse_responder(&mut self, now: Instant, other: Mac) {
        if let Some(device) = self.discovery.device() {
            let address = self.config.address;
            self.obstruct(now, Obstacle::Address { address, device, other });
        }
    }
}
