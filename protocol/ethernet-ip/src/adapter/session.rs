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
    /// When it was accepted.
    pub(super) since: Instant,
    /// When bytes of it came last.
    pub(super) last_heard: Instant,
    /// When its last request came, or when it was accepted. A NOP is not a request.
    pub(super) last_request: Instant,
}

/// Connections that a client opened over its TCP connection and that are still open.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum Carried {
    /// None.
    Nothing,
    /// Connections of class 1 alone: their frames go by UDP, so they outlive the TCP connection.
    Cyclic,
    /// Also connections of class 3: they end with the TCP connection.
    Explicit,
}
