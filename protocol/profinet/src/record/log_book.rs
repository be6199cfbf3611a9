//! LogBookData: what ended or refused connections, the last of them.
//!
//! ```text
//! ActualLocalTimeStamp u64 · NumberOfLogEntries u16
//!   each: LocalTimeStamp u64 · ARUUID 16 · PNIOStatus u32 · EntryDetail u32          times in 31.25 µs
//! ```

use machine::Instant;

use crate::Uuid;
use crate::block::{self, BlockType, BlockWriter};
use crate::rt::COUNT_NANOS;
use crate::status::Status;

/// Number of entries that are kept.
const MOST_ENTRIES: usize = 16;

/// An entry of the log book.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct LogEntry {
    /// When it was made.
    pub at: Instant,
    /// The AR that it is about.
    pub ar: Uuid,
    /// What happened.
    pub status: Status,
}

/// The last entries, oldest first.
#[derive(Clone, Debug, Default)]
pub struct LogBook {
    entries: [Option<LogEntry>; MOST_ENTRIES],
}

impl LogBook {
    /// Adds an entry, in place of the oldest one if there is no room.
    pub fn add(&mut self, entry: LogEntry) {
        let free = self.entries.iter().position(Option::is_none);
        if free.is_none() {
            self.entries.rotate_left(1);
        }
        if let Some(place) = self.entries.get_mut(free.unwrap_or(MOST_ENTRIES - 1)) {
            *place = Some(entry);
        }
    }

    /// Writes the record.
    pub fn emit(&self, now: Instant, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::LogBook, |w| {
            put_time(now, w);
            let entries = self.entries.iter().flatten();
            w.u16(u16::try_from(entries.clone().count()).unwrap_or(u16::MAX));
            for entry in entries {
                put_time(entry.at, w);
                entry.ar.write(w);
                w.u32(entry.status.0);
                // EntryDetail is the vendor's.
                w.u32(0);
            }
        });
    }
}

fn put_time(at: Instant, writer: &mut BlockWriter<'_>) {
    writer.bytes(&(at.as_nanos() / COUNT_NANOS).to_be_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_entry_makes_room_for_the_newest() {
        let mut book = LogBook::default();
        for number in 0..20 {
            book.add(LogEntry {
                at: Instant::from_millis(number),
                ar: Uuid::NIL,
                status: Status(number as u32),
            });
        }
        let kept: Vec<_> = book.entries.iter().flatten().map(|entry| entry.status.0).collect();
        assert_eq!(kept, (4..20).collect::<Vec<_>>());
    }
}
