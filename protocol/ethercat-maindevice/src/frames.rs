//! Frames between a machine and ethercrab.

use std::cell::RefCell;

use ethercrab::{PduRx, PduTx};
use machine::Instant;
use machine::ethernet::{MIN_FRAME_LEN, Mac};

use crate::al::ErrorBits;
use crate::foreign::{self, Foreign};
use crate::lend::Place;

/// Largest number of frames that ethercrab has under way at a time.
pub(crate) const IN_FLIGHT: usize = 8;

/// Longest frame in bytes: an Ethernet frame without tag.
pub(crate) const LONGEST: usize = 1514;

/// Source address of ethercrab's frames. It ignores frames with this address.
const ETHERCRAB: Mac = Mac([0x10; 6]);

/// Place of the source address in a frame.
const SOURCE: std::ops::Range<usize> = 6..12;

thread_local! {
    /// The frames of the machine that runs at the moment.
    pub(crate) static FRAMES: RefCell<Frames> = const { RefCell::new(Frames::none()) };
}

/// Static place of the frames.
pub(crate) const PLACE: &Place<Frames> = &FRAMES;

/// Frames that were received, and that are to be sent.
#[derive(Debug)]
pub(crate) struct Frames {
    /// A frame that ethercrab has not seen; empty if there is none.
    received: Vec<u8>,
    /// A ring of frames to send: `waiting` of them from `first` on. Frames are long, so they are written where they stay.
    ring: Vec<Frame>,
    first: usize,
    waiting: usize,
    /// Received frames that ethercrab could not use.
    refused: u64,
    /// Source address of the frames to send.
    source: Mac,
    /// Received replies to frames with that address.
    pub(crate) own: u64,
    /// What came with other addresses. ethercrab distinguishes frames only by an index of 8 bits, so it must not get these.
    pub(crate) foreign: Foreign,
    /// The devices that indicate an error.
    pub(crate) error_bits: ErrorBits,
}

#[derive(Clone, Debug)]
struct Frame {
    bytes: [u8; LONGEST],
    len: usize,
}

impl Frames {
    /// Creates a store without room: a thread has this one while no machine runs.
    const fn none() -> Self {
        Self {
            received: Vec::new(),
            ring: Vec::new(),
            first: 0,
            waiting: 0,
            refused: 0,
            source: ETHERCRAB,
            own: 0,
            foreign: Foreign::none(),
            error_bits: ErrorBits::none(),
        }
    }

    /// Creates a store for a MainDevice on the interface with this address.
    pub(crate) fn new(interface: Option<Mac>) -> Self {
        let ring = vec![Frame { bytes: [0; LONGEST], len: 0 }; IN_FLIGHT];
        let source = interface.map_or(ETHERCRAB, foreign::source_address);
        Self { received: Vec::with_capacity(LONGEST), ring, source, ..Self::none() }
    }

    /// Keeps a frame for ethercrab's next poll, unless it is another MainDevice's.
    pub(crate) fn receive(&mut self, now: Instant, frame: &[u8]) {
        if let Some(source) = foreign::source(frame) {
            if !foreign::is_same(source, self.source) {
                self.foreign.hear(now, source, frame);
                return;
            }
            self.own += 1;
        }
        self.error_bits.note(frame);
        if frame.len() > LONGEST {
            self.refused += 1;
            return;
        }
        self.received.clear();
        self.received.extend_from_slice(frame);
        if let Some([first, rest @ ..]) = self.received.get_mut(SOURCE) {
            let Mac([own, own_rest @ ..]) = ETHERCRAB;
            *first = own | *first & foreign::PASSED;
            rest.copy_from_slice(&own_rest);
        }
    }

    /// Gives ethercrab the received frame.
    pub(crate) fn give(&mut self, rx: &mut PduRx<'_>) {
        if self.received.is_empty() {
            return;
        }
        // ethercrab reports a late or duplicated frame as an error; that is ignored.
        self.refused += u64::from(rx.receive_frame(&self.received).is_err());
        self.received.clear();
    }

    /// Takes what ethercrab has to send. Returns whether that was all.
    pub(crate) fn take(&mut self, tx: &mut PduTx<'_>) -> bool {
        while self.waiting < self.ring.len() {
            let Some(frame) = tx.next_sendable_frame() else { return true };
            let place = (self.first + self.waiting) % self.ring.len();
            let Some(Frame { bytes, len }) = self.ring.get_mut(place) else { return true };
            let sent = frame.send_blocking(|frame| {
                let room = bytes.get_mut(..frame.len()).ok_or(ethercrab::error::Error::SendFrame)?;
                room.copy_from_slice(frame);
                *len = frame.len();
                Ok(frame.len())
            });
            if sent.is_err() {
                return false;
            }
            if let Some(source) = bytes.get_mut(SOURCE) {
                source.copy_from_slice(&self.source.0);
            }
            if let Some(padding) = bytes.get_mut(*len..MIN_FRAME_LEN) {
                padding.fill(0);
                *len = MIN_FRAME_LEN;
            }
            self.waiting += 1;
        }
        false
    }

    /// Writes the next frame to send into `buf`. Returns its length in bytes.
    pub(crate) fn send(&mut self, buf: &mut [u8]) -> Option<usize> {
        let frame = self.next()?;
        let len = frame.len();
        let room = buf.get_mut(..len);
        let is_sent = room.map(|room| room.copy_from_slice(frame)).is_some();
        self.drop_next();
        is_sent.then_some(len)
    }

    /// Returns the next frame to send, which stays.
    pub(crate) fn next(&self) -> Option<&[u8]> {
        let Frame { bytes, len } = self.ring.get(self.first).filter(|_| self.waiting > 0)?;
        bytes.get(..*len)
    }

    /// Removes the next frame to send.
    pub(crate) const fn drop_next(&mut self) {
        if self.waiting > 0 {
            self.waiting -= 1;
            self.first = (self.first + 1) % IN_FLIGHT;
        }
    }

    pub(crate) const fn refused(&self) -> u64 {
        self.refused
    }
}
