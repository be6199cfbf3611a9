//! Everything in flight on the cable, in order of arrival.

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec;
use core::net::SocketAddrV4;

use super::tap::Label;
use crate::Side;
use machine::wire::FRAME_CAPACITY;
use machine::{Instant, Port, StreamId};

/// What arrives at one end of the cable.
#[derive(Debug)]
pub(super) struct InFlight {
    pub(super) arrives: Instant,
    pub(super) to: Side,
    pub(super) delivery: Delivery,
}

#[derive(Debug)]
pub(super) enum Delivery {
    /// A frame: the first `len` bytes of a buffer.
    Frame {
        port: Port,
        peer: Option<SocketAddrV4>,
        label: Label,
        buf: Box<[u8]>,
        len: usize,
    },
    /// To the side that connects: its connection is up. To the other one: this peer connected.
    Opened(StreamId, SocketAddrV4),
    Closed(StreamId),
    /// Both ends give up a stream whose bytes did not get through.
    StreamTimeout(StreamId),
}

/// Everything in flight. Of two arrivals at one instant, the one sent first comes first.
///
/// A queue, not a heap: a cable keeps the order except for frames that are held back, so that nearly all are appended
/// at the end.
#[derive(Debug, Default)]
pub(super) struct InFlights(VecDeque<InFlight>);

impl InFlights {
    pub(super) fn push(&mut self, arrives: Instant, to: Side, delivery: Delivery) {
        let passing = InFlight { arrives, to, delivery };
        match self.0.iter().rev().take_while(|other| other.arrives > arrives).count() {
            0 => self.0.push_back(passing),
            later => self.0.insert(self.0.len() - later, passing),
        }
    }

    pub(super) fn pop(&mut self) -> Option<InFlight> {
        self.0.pop_front()
    }

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
