//! What a driver and the owner of its machine exchange.

use std::ops::ControlFlow;

use machine::{Instant, Lateness, Multihomed};
use rustix::io::Errno;

use crate::stream::StreamStatistics;

/// Owner of a machine: passes commands in and events out. It runs on the cyclic thread, so it must not block,
/// allocate, lock or log.
pub trait Owner<M: Multihomed> {
    /// Passes commands to the machine. The driver calls it before its thread sleeps. `Break` ends the loop.
    fn wake(&mut self, now: Instant, machine: &mut M, statistics: &Statistics) -> ControlFlow<()>;

    /// Handles an event of the machine. `Break` ends the loop once everything is sent.
    fn event(&mut self, now: Instant, machine: &mut M, event: M::Event) -> ControlFlow<()>;

    /// Returns the latest time for the next [`wake`](Self::wake), apart from the machine's own deadlines.
    fn deadline(&self) -> Option<Instant> {
        None
    }
}

/// Counters of the driver since its start.
#[derive(Clone, Default, Debug)]
pub struct Statistics {
    /// How often the thread woke: at a deadline, for a frame, or since it was notified.
    pub wakeups: u64,
    /// Lateness of the thread at the machine's deadlines.
    pub lateness: Lateness,
    /// Frames given to the machine.
    pub received: u64,
    /// Frames discarded: for other stations, or too long.
    pub discarded: u64,
    /// Frames given to the kernel.
    pub sent: u64,
    /// Frames that the kernel refused to send.
    pub send_errors: u64,
    /// Datagrams that were not sent, since the host would have sent them to another station than the machine found.
    pub misdirected: u64,
    /// Reads of a port that failed.
    pub receive_errors: u64,
    /// The kernel's last error on sending a frame.
    pub last_send_error: Option<Errno>,
    /// Counters of TCP connections.
    pub streams: StreamStatistics,
    /// Allocations of the thread from the first wake to the end; `None` if the program does not count them, see
    /// [`allocation`](crate::allocation). While the loop runs, [`allocation::count`](crate::allocation::count) has the count
    /// so far.
    pub allocations: Option<u64>,
}

impl Statistics {
    /// Returns the number of frames that the thread took from the kernel.
    pub(crate) const fn taken(&self) -> u64 {
        self.received + self.discarded
    }
}
