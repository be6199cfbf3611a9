//! A TCP connection of a client and the encapsulation session on it.

use core::net::SocketAddrV4;

use machine::{Instant, StreamId};

/// A TCP connection.
#[derive(Debug)]
pub(super) struct Session {
    pub(super) stream: StreamId,
    pub(super) peer: SocketAddrV4,
    /// The handle that RegisterSession gave out, 0 before it.
    pub(super) handle: u32,
    pub(super) last_heard: Instant,
}
