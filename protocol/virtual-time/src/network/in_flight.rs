//! Everything in flight on the cables, in order of arrival.

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec;
use core::net::SocketAddrV4;

use super::ids::CableId;
use super::tap::Label;
use crate::side::Side;
use machine::ethernet::Mac;
use machine::wire::FRAME_CAPACITY;
use machine::{Instant, Port, StreamId};

/// What arrives somewhere, and when.
#[derive(Debug)]
pub(super) struct InFlight {
    pub(super) arrives: Instant,
    pub(super) arrival: FrameArrival,
}

#[derive(Debug)]
pub(super) enum FrameArrival {
    /// A frame at this end of a cable.
    Frame { cable: CableId, to: Side, frame: Frame },
    /// A part of a stream at one of its ends.
    Part { stream: StreamId, to: Role, part: Part },
    /// Both ends give up a stream whose bytes did not get through.
    StreamTimeout(StreamId),
}

/// A frame on a cable: the first `len` bytes of a buffer.
#[derive(Debug)]
pub(super) struct Frame {
    pub(super) port: Port,
    pub(super) peer: Option<SocketAddrV4>,
    pub(super) label: Label,
    /// MAC addresses of a datagram's sender and receiver; `None` on a cable without a switch.
    pub(super) hop: Option<[Mac; 2]>,
    pub(super) buf: Box<[u8]>,
    pub(super) len: usize,
}

/// A part of a TCP stream.
#[derive(Debug)]
pub(super) enum Part {
    /// The first `len` bytes of a buffer.
    Bytes {
        label: Label,
        buf: Box<[u8]>,
        len: usize,
    },
    /// To the end that connects: its connection is up. To the other one: this peer connected.
    Opened(SocketAddrV4),
    Closed,
}

/// An end of a TCP stream.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Role {
    /// The end that asked for the connection.
    Connector,
    /// The end that was asked.
    Acceptor,
}

impl Role {
    pub(super) const fn other(self) -> Self {
        match self {
            Self::Connector => Self::Acceptor,
            Self::Acceptor => Self::Connector,
        }
    }
}

/// Everything in flight. Of two arrivals at one instant, the one sent first comes first.
///
/// A queue, not a heap: cables keep the order except for frames that are held back, so that nearly all are appended
/// at the end.
#[derive(Debug, Default)]
pub(super) struct InFlights(VecDeque<InFlight>);

impl InFlights {
    #[inline]
    pub(super) fn push(&mut self, arrives: Instant, arrival: FrameArrival) {
        let passing = InFlight { arrives, arrival };
        match self.0.iter().rev().take_while(|other| other.arrives > arrives).count() {
            0 => self.0.push_back(passing),
            later => self.0.insert(self.0.len() - later, passing),
        }
    }

    #[inline]
    pub(super) fn pop(&mut self) -> Option<InFlight> {
        self.0.pop_front()
    }

    #[inline]
    pub(super) fn next_arrival(&self) -> Option<Instant> {
        self.0.front().map(|first| first.arrives)
    }

    /// Removes and returns everything, in order.
    pub(super) fn take(&mut self) -> VecDeque<InFlight> {
        core::mem::take(&mut self.0)
    }
}

/// Returns a buffer for one frame.
pub(super) fn new_buf() -> Box<[u8]> {
    vec![0; FRAME_CAPACITY].into_boxed_slice()
}

/// Returns a buffer that begins with these bytes: a spare one, or a new one.
pub(super) fn holding(spare: Option<Box<[u8]>>, bytes: Option<&[u8]>) -> Box<[u8]> {
    let mut buf = spare.unwrap_or_else(new_buf);
    let bytes = bytes.unwrap_or_default();
    if let Some(start) = buf.get_mut(..bytes.len()) {
        start.copy_from_slice(bytes);
    }
    buf
}
