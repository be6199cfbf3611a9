//! The packet intervals that a target would take: what follows extended status 0x0112 (volume 1, table 3-5.29).
//!
//! ```text
//! 0      kind of limit O→T  u8  0 the interval is acceptable, 1 unspecified, 2 least, 3 most, 4 the only one
//! 1      kind of limit T→O  u8
//! 2..6   O→T                u32, µs; does not count where the interval is acceptable
//! 6..10  T→O                u32, µs
//! ```

use core::fmt;
use core::ops::RangeInclusive;

use super::super::{Reader, Writer};
use machine::wire::Truncated;

/// What a target would take instead of the requested packet interval of one direction.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum IntervalLimit {
    /// The requested interval.
    Acceptable,
    /// This interval, in µs; it does not say whether it is the least or the most.
    Unspecified(u32),
    /// At least this interval, in µs.
    AtLeast(u32),
    /// At most this interval, in µs.
    AtMost(u32),
    /// This interval alone, in µs: that of a multicast that runs.
    Only(u32),
}

impl IntervalLimit {
    /// Returns the limit that `interval` does not keep, in µs.
    #[must_use]
    pub const fn of(interval: u32, served: &RangeInclusive<u32>) -> Self {
        if interval < *served.start() {
            Self::AtLeast(*served.start())
        } else if interval > *served.end() {
            Self::AtMost(*served.end())
        } else {
            Self::Acceptable
        }
    }

    const fn of_kind(kind: u8, interval: u32) -> Self {
        match kind {
            0 => Self::Acceptable,
            2 => Self::AtLeast(interval),
            3 => Self::AtMost(interval),
            4 => Self::Only(interval),
            _ => Self::Unspecified(interval),
        }
    }

    const fn kind_and_interval(self) -> (u8, u32) {
        match self {
            Self::Acceptable => (0, 0),
            Self::Unspecified(interval) => (1, interval),
            Self::AtLeast(interval) => (2, interval),
            Self::AtMost(interval) => (3, interval),
            Self::Only(interval) => (4, interval),
        }
    }
}

impl fmt::Display for IntervalLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Acceptable => f.write_str("this interval"),
            Self::Unspecified(interval) => write!(f, "{interval} µs"),
            Self::AtLeast(interval) => write!(f, "at least {interval} µs"),
            Self::AtMost(interval) => write!(f, "at most {interval} µs"),
            Self::Only(interval) => write!(f, "only {interval} µs"),
        }
    }
}

/// What a target would take instead of the requested packet intervals.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct AcceptableIntervals {
    /// O→T.
    pub o_t: IntervalLimit,
    /// T→O.
    pub t_o: IntervalLimit,
}

impl AcceptableIntervals {
    /// Length on the wire, in words.
    pub(super) const WORDS: u8 = 5;

    /// Parses what follows the extended status.
    pub fn parse(reader: &mut Reader<'_>) -> Result<Self, Truncated> {
        let (o_t, t_o) = (reader.u8()?, reader.u8()?);
        Ok(Self {
            o_t: IntervalLimit::of_kind(o_t, reader.u32()?),
            t_o: IntervalLimit::of_kind(t_o, reader.u32()?),
        })
    }

    pub(super) fn emit(self, writer: &mut Writer<'_>) {
        let [o_t, t_o] = [self.o_t, self.t_o].map(IntervalLimit::kind_and_interval);
        writer.bytes(&[o_t.0, t_o.0]);
        writer.u32(o_t.1);
        writer.u32(t_o.1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_limit_is_written_and_read_by_its_number_and_an_unknown_one_is_unspecified() {
        use IntervalLimit::{Acceptable, AtLeast, AtMost, Only, Unspecified};
        let limits = [Acceptable, Unspecified(7), AtLeast(7), AtMost(7), Only(7)];
        for (kind, limit) in (0..).zip(limits) {
            let intervals = AcceptableIntervals { o_t: limit, t_o: AtMost(0x0403_0201) };
            let mut buf = [0xFF; 10];
            let mut writer = Writer::new(&mut buf);
            intervals.emit(&mut writer);
            assert_eq!(writer.finish(), Ok(10));
            assert_eq!(buf, [kind, 3, if kind == 0 { 0 } else { 7 }, 0, 0, 0, 1, 2, 3, 4]);
            assert_eq!(AcceptableIntervals::parse(&mut Reader::new(&buf)), Ok(intervals));
            assert!((0..10).all(|cut| AcceptableIntervals::parse(&mut Reader::new(&buf[..cut])).is_err()));
        }
        assert_eq!(IntervalLimit::of_kind(5, 7), Unspecified(7));
    }

    #[test]
    fn the_ends_of_the_served_range_are_served() {
        let of = |interval| IntervalLimit::of(interval, &(500..=9_000));
        assert_eq!([500, 9_000].map(of), [IntervalLimit::Acceptable; 2]);
        assert_eq!([499, 9_001].map(of), [IntervalLimit::AtLeast(500), IntervalLimit::AtMost(9_000)]);
    }
}
