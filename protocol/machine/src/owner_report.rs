//! Reports of who opened a connection, so that a station that holds it and sends nothing has a name.

use core::fmt;

use crate::{Duration, Instant, Sender};

/// Time in which at most [`MOST_REPORTS`] are made. Connections that open and close again and again must not become a flood of
/// reports.
const WINDOW: Duration = Duration::from_secs(10);

/// Largest number of reports in a [`WINDOW`].
const MOST_REPORTS: u8 = 8;

/// The owner of a connection that has just been opened. Whether it sends data is not known yet.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OwnerReport {
    /// Its address; the sender of a frame can forge it.
    pub from: Sender,
    /// Its serial number, as EtherNet/IP tells it.
    pub serial_number: Option<u32>,
    /// Time between two of its frames.
    pub interval: Duration,
    /// Time without a frame after which the connection ends.
    pub timeout: Duration,
}

/// A duration in words: in s from one second on.
struct InWords(Duration);

impl fmt::Display for InWords {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.0.as_secs_f64();
        if seconds >= 1.0 { write!(f, "{seconds} s") } else { write!(f, "{} ms", seconds * 1_000.0) }
    }
}

impl OwnerReport {
    /// Writes its address, and its serial number if it is known.
    pub fn write_name(&self, f: &mut dyn fmt::Write) -> fmt::Result {
        write!(f, "{}", self.from)?;
        self.serial_number.map_or(Ok(()), |serial| write!(f, " (serial number 0x{serial:08X})"))
    }
}

impl fmt::Display for OwnerReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_name(f)?;
        let (interval, timeout) = (InWords(self.interval), InWords(self.timeout));
        write!(f, " opened the connection: a frame every {interval}; it ends {timeout} after its last frame")
    }
}

/// Decides which owners are reported: at most eight in ten seconds, and not the same one again.
#[derive(Clone, Copy, Default, Debug)]
pub struct OwnerReports {
    since: Option<Instant>,
    made: u8,
    last: Option<OwnerReport>,
}

impl OwnerReports {
    /// Takes note of an owner. Returns whether it is to be reported.
    pub fn open(&mut self, now: Instant, owner: OwnerReport) -> bool {
        if self.since.is_none_or(|since| now.since(since) >= WINDOW) {
            *self = Self { since: Some(now), made: 0, last: None };
        }
        if self.made == MOST_REPORTS || self.last.replace(owner) == Some(owner) {
            return false;
        }
        self.made += 1;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::net::Ipv4Addr;

    fn owner(host: u8) -> OwnerReport {
        OwnerReport {
            from: Sender::Ip(Ipv4Addr::new(10, 0, 0, host)),
            serial_number: Some(0x0BAD_CAFE),
            interval: Duration::from_secs(10),
            timeout: Duration::from_secs(5_120),
        }
    }

    #[test]
    fn an_owner_is_named_with_its_interval_and_its_timeout() {
        assert_eq!(
            owner(66).to_string(),
            "10.0.0.66 (serial number 0x0BADCAFE) opened the connection: a frame every 10 s; it ends 5120 s after its last frame"
        );
        let fast = OwnerReport {
            serial_number: None,
            interval: Duration::from_micros(1_500),
            timeout: Duration::from_millis(6),
            ..owner(7)
        };
        assert_eq!(
            fast.to_string(),
            "10.0.0.7 opened the connection: a frame every 1.5 ms; it ends 6 ms after its last frame"
        );
    }

    #[test]
    fn the_same_owner_is_reported_once_in_ten_seconds_and_a_flood_of_others_eight_times() {
        let mut reports = OwnerReports::default();
        let at = Instant::from_millis;
        assert!(reports.open(at(0), owner(1)));
        assert!(!reports.open(at(9_999), owner(1)), "the same one");
        assert!(reports.open(at(10_000), owner(1)));
        let others = (0..1_000).filter(|number| reports.open(at(10_001 + number), owner(*number as u8)));
        assert_eq!(others.count(), 7);
    }
}
