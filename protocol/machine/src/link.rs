//! What an endpoint of a cyclic connection tells its owner, whichever the bus is.

use core::fmt;
use core::net::Ipv4Addr;

/// News of the connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum LinkEvent {
    /// Images are exchanged, both ways.
    Up,
    /// No images are exchanged any more, or no connection came about.
    Down(Down),
    /// The peer gave this station an address, which the owner is to put on the interface and then to report by
    /// [`Fieldbus::address_set`].
    SetAddress {
        /// The station's own address.
        address: Ipv4Addr,
        /// Its subnet mask.
        mask: Ipv4Addr,
        /// Its gateway, or its own address where there is none.
        gateway: Ipv4Addr,
    },
}

/// Why a connection is not there.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Down {
    /// What happened.
    pub cause: DownCause,
    /// The status code that went over the wire, 0 where none did.
    pub code: u32,
    /// What that code says, or what to look at.
    pub text: &'static str,
}

/// What ended a connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum DownCause {
    /// The peer did not answer, or no such station is there.
    NoAnswer,
    /// The peer refused the connection.
    Refused,
    /// The peer sent nothing for as long as the watchdog allows.
    Watchdog,
    /// The peer ended the connection.
    ClosedByPeer,
    /// This side ended the connection.
    ClosedHere,
}

impl fmt::Display for Down {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.cause {
            DownCause::NoAnswer => "no answer from the peer",
            DownCause::Refused => "the peer refused the connection",
            DownCause::Watchdog => "the watchdog expired: no frame from the peer in time",
            DownCause::ClosedByPeer => "the peer ended the connection",
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

/// Frames of a bus endpoint since its start.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Counters {
    /// Cyclic frames sent.
    pub sent: u64,
    /// Cyclic frames received and taken over.
    pub received: u64,
    /// Cycles that passed here without a frame, because the driver came too late to send it.
    pub skipped: u64,
    /// Cycles of the peer for which no frame came, by its counter. The wire does not tell a frame that was lost
    /// from one that the peer skipped; the peer's own `skipped` does.
    pub lost: u64,
    /// Cyclic frames that came out of order or twice, and were dropped.
    pub late: u64,
    /// Frames that broke the format.
    pub malformed: u64,
    /// Frames in good format that are not for this connection.
    pub foreign: u64,
}
