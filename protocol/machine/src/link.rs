//! What an endpoint of a cyclic connection reports to its owner, for every bus.

use core::fmt;
use core::net::Ipv4Addr;

use crate::arp::AddressConflict;
use crate::ethernet::Mac;
use crate::{ForeignRequest, OwnerReport};

/// An event of the connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum LinkEvent {
    /// The connection is up: images are exchanged in both directions.
    Up,
    /// The connection is down, or could not be established.
    Down(Down),
    /// The peer assigned this station an address. The owner sets it on the interface and reports the result by
    /// `address_set` of the endpoint.
    SetAddress {
        /// The station's own address.
        address: Ipv4Addr,
        /// Its subnet mask.
        mask: Ipv4Addr,
        /// Its gateway, or its own address if there is none.
        gateway: Ipv4Addr,
    },
    /// The peer set something of this station permanently, as its name or address, or removed what was stored. The owner stores
    /// what `to_store` of the endpoint returns, so that it survives a restart, and reports the result by `stored` of the
    /// endpoint.
    Store,
    /// Somebody else requested what only the owner of the connection may, and was refused. The connection stays as it is.
    Foreign(ForeignRequest),
    /// Somebody opened the connection to this station. [`LinkEvent::Up`] follows when data are exchanged, which may be never.
    Owner(OwnerReport),
    /// Another station has what only one may have. If the connection cannot go on, [`LinkEvent::Down`] follows.
    Conflict(StationConflict),
    /// The health that the peer reports of itself has changed; the endpoint's remark names what is wrong, or is empty again.
    Health,
}

/// Two stations have what only one may have.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum StationConflict {
    /// Another station has an IP address.
    Address(AddressConflict),
    /// Another station has the name of the device. It is ignored: the MAC address of the right one is configured, or it came
    /// when data were exchanged.
    Name {
        /// MAC address of the device.
        device: Mac,
        /// MAC address of the other station.
        ignored: Mac,
    },
}

impl fmt::Display for StationConflict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Address(conflict) => write!(f, "{conflict}; give one of them another address"),
            Self::Name { device, ignored } => write!(
                f,
                "another station has the device's name: {ignored} is ignored, {device} is the device; rename one of them"
            ),
        }
    }
}

/// Why a connection is down.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Down {
    /// What happened.
    pub cause: DownCause,
    /// The status code that was sent or received, 0 if none was.
    pub code: u32,
    /// Meaning of that code, or what to check.
    pub text: &'static str,
}

/// What ended a connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum DownCause {
    /// The peer did not answer, or there is no such station.
    NoAnswer,
    /// The peer refused the connection.
    Refused,
    /// The peer sent nothing for longer than the watchdog time.
    Watchdog,
    /// The peer closed the connection.
    ClosedByPeer,
    /// The connection is open and the peer says that it is idle: its data do not count.
    PeerIdle,
    /// This side closed the connection.
    ClosedHere,
}

impl fmt::Display for Down {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.cause {
            DownCause::NoAnswer => "no answer from the peer",
            DownCause::Refused => "the peer refused the connection",
            DownCause::Watchdog => "the watchdog expired: no frame from the peer in time",
            DownCause::ClosedByPeer => "the peer ended the connection",
            DownCause::PeerIdle => "the peer is connected and idle",
            DownCause::ClosedHere => "the connection was ended on this side",
        })?;
        if self.code != 0 {
            write!(f, " (status 0x{:08X})", self.code)?;
        }
        if !self.text.is_empty() {
            write!(f, ": {}", self.text)?;
        }
        Ok(())
    }
}

/// Frame counters of a bus endpoint since its start.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Counters {
    /// Cyclic frames sent.
    pub sent: u64,
    /// Cyclic frames received and accepted.
    pub received: u64,
    /// Own cycles without a frame, because the driver woke too late to send it.
    pub skipped: u64,
    /// Cycles of the peer whose frame did not arrive, by the peer's cycle counter. A lost frame and one that the peer
    /// skipped look the same here; the peer's own `skipped` tells them apart.
    pub lost: u64,
    /// Cyclic frames dropped because they were out of order or duplicates.
    pub late: u64,
    /// Malformed frames.
    pub malformed: u64,
    /// Well-formed frames of another connection.
    pub foreign: u64,
}

impl core::ops::Add for Counters {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            sent: self.sent + other.sent,
            received: self.received + other.received,
            skipped: self.skipped + other.skipped,
            lost: self.lost + other.lost,
            late: self.late + other.late,
            malformed: self.malformed + other.malformed,
            foreign: self.foreign + other.foreign,
        }
    }
}

impl Counters {
    /// Returns what was counted since `before`, an earlier state of the same endpoint.
    #[must_use]
    pub const fn since(&self, before: &Self) -> Self {
        Self {
            sent: self.sent.saturating_sub(before.sent),
            received: self.received.saturating_sub(before.received),
            skipped: self.skipped.saturating_sub(before.skipped),
            lost: self.lost.saturating_sub(before.lost),
            late: self.late.saturating_sub(before.late),
            malformed: self.malformed.saturating_sub(before.malformed),
            foreign: self.foreign.saturating_sub(before.foreign),
        }
    }
}
