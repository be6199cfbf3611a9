//! What devices report to their owner.

use alloc::collections::VecDeque;

use crate::al::{AlState, AlStatusCode};

/// A SubDevice of a [`Segment`](crate::Segment), numbered from 0 in the order in which they were added.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct DeviceId(pub usize);

/// What happened at a device.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Event {
    /// It entered a state, or indicates an error, or the MainDevice acknowledged one.
    StateChanged {
        /// The state that it is in.
        state: AlState,
        /// The error that it indicates.
        code: AlStatusCode,
    },
    /// The MainDevice wrote an object by SDO.
    ObjectWritten {
        /// Its index.
        index: u16,
        /// Subindex of the entry, or of the first one of a complete access.
        subindex: u8,
    },
    /// The MainDevice wrote the file by FoE.
    FileWritten {
        /// Its length in bytes.
        len: usize,
    },
    /// Its SYNC0 signal came.
    Sync0 {
        /// When, by the device's copy of the system time, in nanoseconds.
        system_time_ns: u64,
    },
    /// Its SYNC1 signal came.
    Sync1 {
        /// When, by the device's copy of the system time, in nanoseconds.
        system_time_ns: u64,
    },
}

/// Where a device puts its events.
pub(crate) struct Sink<'a> {
    pub(crate) id: DeviceId,
    pub(crate) events: &'a mut VecDeque<(DeviceId, Event)>,
}

impl Sink<'_> {
    pub(crate) fn push(&mut self, event: Event) {
        self.events.push_back((self.id, event));
    }
}
