//! The consumer of an IOCR: accepts frames in order, counts missing ones, and monitors the time between them.

use alloc::vec;
use alloc::vec::Vec;

use super::{CycleTime, CyclicFrame, DataStatus};
use machine::{Duration, Instant, Numbering, Sequence};

/// Largest difference by which a cycle counter counts as newer than the last one, in counts: 1.92 s. The remaining 128 ms
/// of the counter's range count as older: such a frame is late.
pub(super) const NEWER_WINDOW: u32 = 61_440;

/// Largest difference that is accepted whatever the time since the last frame, in counts: 128 ms, as much as a late frame
/// may be older.
const SLACK: u32 = 4_096;

/// Result of receiving a frame with this receiver's FrameID.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Received {
    /// It is the newest; its data was accepted.
    New,
    /// It is not newer than an accepted one, or further ahead than time allows.
    Late,
    /// Its DataStatus says that it is to be ignored.
    Ignored,
    /// It is too short, or its TransferStatus reports damage.
    Malformed,
}

/// Receives one IOCR's frames and monitors that they keep coming.
#[derive(Debug)]
pub struct CyclicReceiver {
    frame_id: u16,
    counts: u32,
    hold: Duration,
    deadline: Instant,
    c_sdu: Vec<u8>,
    data_status: DataStatus,
    sequence: Sequence,
    received: u64,
    late: u64,
    lost: u64,
}

impl CyclicReceiver {
    /// Creates a receiver of frames with `c_sdu_len` bytes of data. It expires `hold` after `now` or after the last
    /// frame.
    #[must_use]
    pub fn new(frame_id: u16, time: CycleTime, c_sdu_len: usize, hold: Duration, now: Instant) -> Self {
        let counts = time.counts().clamp(1, 0xFFFF);
        let slack = SLACK.max(counts.saturating_mul(2)).min(NEWER_WINDOW);
        let cycle = time.period();
        let numbering = Numbering { mask: 0xFFFF, newer: NEWER_WINDOW, slack, step: counts, cycle };
        Self {
            frame_id,
            counts,
            hold,
            deadline: now + hold,
            c_sdu: vec![0; c_sdu_len],
            data_status: DataStatus(0),
            sequence: Sequence::new(numbering),
            received: 0,
            late: 0,
            lost: 0,
        }
    }

    /// Returns the FrameID of this receiver's frames.
    #[must_use]
    pub const fn frame_id(&self) -> u16 {
        self.frame_id
    }

    /// Handles a frame, from the FrameID on. The caller has checked FrameID and sender.
    pub fn handle_frame(&mut self, now: Instant, payload: &[u8]) -> Received {
        let frame = match CyclicFrame::parse(payload, self.c_sdu.len()) {
            Ok(frame) if frame.transfer_status == 0 => frame,
            _ => return Received::Malformed,
        };
        if frame.data_status.contains(DataStatus::IGNORE) {
            return Received::Ignored;
        }
        let Some(ahead) = self.sequence.accept(now, frame.cycle_counter.into()) else {
            self.late += 1;
            return Received::Late;
        };
        // Nearly always it is the next frame. Avoid the division then, which takes as long as the rest of this function.
        if ahead != self.counts {
            // Half a cycle of jitter in the provider's grid is not a lost frame.
            let cycles = (ahead + self.counts / 2) / self.counts;
            self.lost += u64::from(cycles.saturating_sub(1));
        }
        self.c_sdu.copy_from_slice(frame.c_sdu);
        self.data_status = frame.data_status;
        self.deadline = now + self.hold;
        self.received += 1;
        Received::New
    }

    /// Returns the data of the newest frame, if its status allows to use it. The data stays even after the watchdog
    /// time; check [`is_expired`](Self::is_expired).
    #[must_use]
    pub fn usable_data(&self) -> Option<&[u8]> {
        (self.sequence.has_started() && self.data_status.is_usable()).then_some(&self.c_sdu[..])
    }

    /// Returns the data of the newest frame, whatever its status; `None` before the first one.
    #[must_use]
    pub fn c_sdu(&self) -> Option<&[u8]> {
        self.sequence.has_started().then_some(&self.c_sdu[..])
    }

    /// Returns the CycleCounter of the newest frame; 0 before the first one.
    #[must_use]
    pub fn cycle_counter(&self) -> u16 {
        self.sequence.last().map_or(0, |number| number as u16)
    }

    /// Returns the DataStatus of the newest frame; 0 before the first one.
    #[must_use]
    pub const fn data_status(&self) -> DataStatus {
        self.data_status
    }

    /// Restarts the watchdog, as if a frame had arrived.
    pub fn restart_watchdog(&mut self, now: Instant) {
        self.deadline = now + self.hold;
    }

    /// Returns whether the watchdog time has passed without a frame.
    #[must_use]
    pub fn is_expired(&self, now: Instant) -> bool {
        now >= self.deadline
    }

    /// Returns when the receiver expires unless a frame arrives.
    #[must_use]
    pub const fn poll_timeout(&self) -> Instant {
        self.deadline
    }

    /// Returns the number of accepted frames.
    #[must_use]
    pub const fn received(&self) -> u64 {
        self.received
    }

    /// Returns the number of late or duplicate frames.
    #[must_use]
    pub const fn late(&self) -> u64 {
        self.late
    }

    /// Returns the number of the provider's cycles without a received frame, by its counter; cycles that the provider
    /// skipped are included. A late frame was counted as lost before.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }
}
