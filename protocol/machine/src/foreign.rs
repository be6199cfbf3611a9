//! Requests that only the owner of a connection may make, sent by somebody else: they are refused and reported.

use core::fmt;
use core::net::Ipv4Addr;

use crate::ethernet::Mac;
use crate::{Duration, Instant};

/// Shortest time between two reports. A flood of requests must not become a flood of reports.
const REPORT_EVERY: Duration = Duration::from_secs(10);

/// A request that was refused because it did not come from the owner of the connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ForeignRequest {
    /// Sender of the request, as far as the network tells: both addresses can be forged.
    pub from: Sender,
    /// Requested change.
    pub what: Requested,
    /// Owner of the connection; `None` if the sender is not one of those that may connect.
    pub owner: Option<Sender>,
    /// Number of foreign requests since the last report, besides this one.
    pub more: u32,
}

/// Address that a frame came from.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Sender {
    /// MAC address, of a frame on Ethernet.
    Mac(Mac),
    /// IP address, of a datagram or a TCP connection.
    Ip(Ipv4Addr),
}

/// What a foreign request asked for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Requested {
    /// A connection: PROFINET Connect, CIP Forward_Open.
    Connection,
    /// The end of the owner's connection: PROFINET Release, CIP Forward_Close.
    End,
    /// Another step of the owner's connection: PROFINET PrmEnd, PrmBegin and ApplicationReady.
    Step,
    /// A record or an attribute written.
    Write,
    /// A record read that needs the right of the owner's connection.
    Read,
    /// Another station name.
    Name,
    /// Another IP address.
    Address,
    /// A reset.
    Reset,
}

impl fmt::Display for Sender {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mac(mac) => mac.fmt(f),
            Self::Ip(address) => address.fmt(f),
        }
    }
}

impl fmt::Display for ForeignRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match self.what {
            Requested::Connection => "a connection",
            Requested::End => "the end of the connection",
            Requested::Step => "a step of the connection",
            Requested::Write => "a write",
            Requested::Read => "a read by the connection's right",
            Requested::Name => "another station name",
            Requested::Address => "another IP address",
            Requested::Reset => "a reset",
        };
        write!(f, "{} requested {what} and was refused: ", self.from)?;
        match self.owner {
            Some(owner) => write!(f, "{owner} owns the connection")?,
            None => f.write_str("it is not in the list of those that may connect")?,
        }
        if self.more > 0 { write!(f, " (and {} requests before)", self.more) } else { Ok(()) }
    }
}

/// Decides which foreign requests are reported: the first one, then at most one in ten seconds.
#[derive(Clone, Copy, Default, Debug)]
pub struct ForeignRequests {
    silent_until: Option<Instant>,
    more: u32,
}

impl ForeignRequests {
    /// Counts a request, and returns the report if one is due.
    pub fn refuse(
        &mut self,
        now: Instant,
        from: Sender,
        what: Requested,
        owner: Option<Sender>,
    ) -> Option<ForeignRequest> {
        if self.silent_until.is_some_and(|until| now < until) {
            self.more = self.more.saturating_add(1);
            return None;
        }
        self.silent_until = Some(now + REPORT_EVERY);
        Some(ForeignRequest { from, what, owner, more: core::mem::take(&mut self.more) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_request_is_reported_at_once_and_a_flood_once_in_ten_seconds_with_its_number() {
        let [from, owner] = [9, 8].map(|host| Sender::Ip(Ipv4Addr::new(10, 0, 0, host)));
        let mut requests = ForeignRequests::default();
        let mut reports = Vec::new();
        for millis in 0..25_000 {
            reports.extend(requests.refuse(Instant::from_millis(millis), from, Requested::End, Some(owner)));
        }
        let more: Vec<_> = reports.iter().map(|report| report.more).collect();
        assert_eq!(more, [0, 9_999, 9_999]);
        assert_eq!(
            reports[1].to_string(),
            "10.0.0.9 requested the end of the connection and was refused: 10.0.0.8 owns the connection (and 9999 requests \
             before)"
        );
        let unlisted = ForeignRequest { owner: None, more: 0, ..reports[1] };
        assert_eq!(
            unlisted.to_string(),
            "10.0.0.9 requested the end of the connection and was refused: it is not in the list of those that may connect"
        );
    }
}
