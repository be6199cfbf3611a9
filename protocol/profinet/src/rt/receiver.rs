//! The consumer of an IOCR: takes frames in order, counts those that are missing, watches the time between them.

use alloc::vec;
use alloc::vec::Vec;

use super::{CycleTime, CyclicFrame, DataStatus};
use machine::{Duration, Instant};

/// How far a cycle counter may be ahead of the last one, in counts: 1.92 s. What is further "ahead" comes from the
/// 128 ms before it and is late.
const NEWER_WINDOW: u16 = 61_440;

/// What became of a frame with this receiver's FrameID.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Received {
    /// It is the newest; its data are taken over.
    New,
    /// It is as old as one that was taken over already, or older.
    Late,
    /// Its DataStatus says to ignore it.
    Ignored,
    /// It is too short, or its TransferStatus says that it was damaged.
    Malformed,
}

/// Receives one IOCR's frames and watches that they keep coming.
#[derive(Debug)]
pub struct CyclicReceiver {
    frame_id: u16,
    counts: u16,
    hold: Duration,
    deadline: Instant,
    c_sdu: Vec<u8>,
    data_status: DataStatus,
    last: Option<u16>,
    received: u64,
    late: u64,
    lost: u64,
}

impl CyclicReceiver {
    /// A receiver of frames with `c_sdu_len` bytes of data, that expires `hold` after `now` or after the last frame.
    #[must_use]
    pub fn new(frame_id: u16, time: CycleTime, c_sdu_len: usize, hold: Duration, now: Instant) -> Self {
        Self {
            frame_id,
            counts: u16::try_from(time.counts()).unwrap_or(u16::MAX).max(1),
            hold,
            deadline: now + hold,
            c_sdu: vec![0; c_sdu_len],
            data_status: DataStatus(0),
            last: None,
            received: 0,
            late: 0,
            lost: 0,
        }
    }

    /// The FrameID of the frames that are for this receiver.
    #[must_use]
    pub const fn frame_id(&self) -> u16 {
        self.frame_id
    }

    /// Takes a frame, from the FrameID on. The caller has looked at FrameID and sender.
    pub fn handle_frame(&mut self, now: Instant, payload: &[u8]) -> Received {
        let frame = match CyclicFrame::parse(payload, self.c_sdu.len()) {
            Ok(frame) if frame.transfer_status == 0 => frame,
            _ => return Received::Malformed,
        };
        if frame.data_status.contains(DataStatus::IGNORE) {
            return Received::Ignored;
        }
        if let Some(last) = self.last {
            let ahead = frame.cycle_counter.wrapping_sub(last);
            if ahead == 0 || ahead > NEWER_WINDOW {
                self.late += 1;
                return Received::Late;
            }
            // Nearly always it is the next one, and a division takes as long as all the rest here.
            if ahead != self.counts {
                // Half a cycle of jitter in the provider's grid is not a lost frame.
                let cycles = (u32::from(ahead) + u32::from(self.counts) / 2) / u32::from(self.counts);
                self.lost += u64::from(cycles.saturating_sub(1));
            }
        }
        self.last = Some(frame.cycle_counter);
        self.c_sdu.copy_from_slice(frame.c_sdu);
        self.data_status = frame.data_status;
        self.deadline = now + self.hold;
        self.received += 1;
        Received::New
    }

    /// The data of the newest frame, if one came and says that they may be acted on. They stay until the owner asks
    /// [`is_expired`](Self::is_expired).
    #[must_use]
    pub fn usable(&self) -> Option<&[u8]> {
        (self.last.is_some() && self.data_status.is_usable()).then_some(&self.c_sdu[..])
    }

    /// The data of the newest frame, whatever its status; none before the first one.
    #[must_use]
    pub fn c_sdu(&self) -> Option<&[u8]> {
        self.last.is_some().then_some(&self.c_sdu[..])
    }

    /// DataStatus of the newest frame; 0 before the first one.
    #[must_use]
    pub const fn data_status(&self) -> DataStatus {
        self.data_status
    }

    /// Starts the watchdog anew, as if a frame had come.
    pub fn rearm(&mut self, now: Instant) {
        self.deadline = now + self.hold;
    }

    /// Whether no frame came in time.
    #[must_use]
    pub fn is_expired(&self, now: Instant) -> bool {
        now >= self.deadline
    }

    /// When the receiver expires unless a frame comes.
    #[must_use]
    pub const fn poll_timeout(&self) -> Instant {
        self.deadline
    }

    /// Frames taken over.
    #[must_use]
    pub const fn received(&self) -> u64 {
        self.received
    }

    /// Frames that were late or came twice.
    #[must_use]
    pub const fn late(&self) -> u64 {
        self.late
    }

    /// Cycles of the provider for which no frame came, by its counter; those that it skipped itself are among them.
    /// A frame that is late was counted as lost before.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }
}
