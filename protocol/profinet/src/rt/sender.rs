//! The provider of an IOCR: one frame at every point of its grid.

use alloc::vec;
use alloc::vec::Vec;
use core::net::SocketAddrV4;

use super::{CycleTime, CyclicFrame, DataStatus, UDP_PORT, cycle_counter};
use crate::ETHER_TYPE;
use crate::tag;
use machine::ethernet::{EthernetHeader, Mac};
use machine::wire::{BigEndian, Writer};
use machine::{Cycle, Instant, Port, Transmit};

/// Transport and addresses of a cyclic frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Route {
    /// RT_CLASS_1.
    Ethernet {
        /// The sending station.
        source: Mac,
        /// The receiving station.
        destination: Mac,
    },
    /// RT_CLASS_UDP, to this address.
    Udp(SocketAddrV4),
}

/// Sends one IOCR's frames on an absolute grid. A sender that is late skips cycles and never sends a burst.
#[derive(Debug)]
pub struct CyclicSender {
    route: Route,
    frame_id: u16,
    cycle: Cycle,
    c_sdu: Vec<u8>,
    data_status: DataStatus,
    due: Option<Instant>,
    sent: u64,
    skipped: u64,
}

impl CyclicSender {
    /// Creates a sender whose C_SDU is `c_sdu_len` zero bytes until it is written, with its first frame at `first`.
    #[must_use]
    pub fn new(route: Route, frame_id: u16, time: CycleTime, c_sdu_len: usize, first: Instant) -> Self {
        Self {
            route,
            frame_id,
            cycle: Cycle::new(first, time.period()),
            c_sdu: vec![0; c_sdu_len],
            data_status: DataStatus::RUNNING,
            due: None,
            sent: 0,
            skipped: 0,
        }
    }

    /// Returns the data of the next and all later frames, to write it.
    pub fn c_sdu_mut(&mut self) -> &mut [u8] {
        &mut self.c_sdu
    }

    /// Returns the data of the next frame.
    #[must_use]
    pub fn c_sdu(&self) -> &[u8] {
        &self.c_sdu
    }

    /// Sets the DataStatus of the next and all later frames.
    pub const fn set_data_status(&mut self, data_status: DataStatus) {
        self.data_status = data_status;
    }

    /// Returns the CycleCounter and the DataStatus of the last frame; 0 before the first one.
    #[must_use]
    pub fn last(&self) -> (u16, DataStatus) {
        if self.sent == 0 {
            return (0, DataStatus(0));
        }
        (cycle_counter(self.cycle.next() - self.cycle.period()), self.data_status)
    }

    /// Returns the number of frames sent.
    #[must_use]
    pub const fn sent(&self) -> u64 {
        self.sent
    }

    /// Returns the number of cycles without a frame because the sender was called too late.
    #[must_use]
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Returns when the next frame is due.
    #[must_use]
    pub const fn poll_timeout(&self) -> Instant {
        self.cycle.next()
    }

    /// Returns whether a frame is due.
    #[must_use]
    pub const fn is_due(&self) -> bool {
        self.due.is_some()
    }

    /// Handles a timeout. A frame that is due now is sent by the next [`poll_transmit`](Self::poll_transmit).
    pub fn handle_timeout(&mut self, now: Instant) {
        if let Some(tick) = self.cycle.tick(now) {
            // The cycle counter of the last grid point, so that a late frame does not look old.
            self.due = Some(self.cycle.next() - self.cycle.period());
            self.skipped += tick.skipped;
        }
    }

    /// Writes the frame that is due, if one is.
    pub fn poll_transmit(&mut self, buf: &mut [u8]) -> Option<Transmit> {
        let due = self.due.take()?;
        let frame = CyclicFrame {
            frame_id: self.frame_id,
            c_sdu: &self.c_sdu,
            cycle_counter: cycle_counter(due),
            data_status: self.data_status,
            transfer_status: 0,
        };
        let (port, to, len) = match self.route {
            Route::Ethernet { source, destination } => {
                let header =
                    EthernetHeader { destination, source, tag: Some(tag::RT), ether_type: ETHER_TYPE };
                (Port::Ethernet, None, header.emit(buf, |writer| frame.emit(writer)).ok()?)
            }
            Route::Udp(to) => {
                let mut writer = Writer::<BigEndian>::new(buf);
                frame.emit(&mut writer);
                (Port::Udp(UDP_PORT), Some(to), writer.finish().ok()?)
            }
        };
        self.sent += 1;
        Some(Transmit { port, to, len })
    }
}
