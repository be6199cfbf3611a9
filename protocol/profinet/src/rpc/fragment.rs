//! Fragmentation of messages longer than a datagram.

use alloc::boxed::Box;
use alloc::vec;

use super::{BODY_CAPACITY, DataRepresentation, FRAGMENT_LEN, HEADER_LEN, Header, Kind, flags};
use crate::Uuid;
use machine::wire::Overflow;

/// A stored message, which can be sent repeatedly.
#[derive(Debug)]
pub struct Message {
    header: Option<Header>,
    body: Box<[u8]>,
    len: usize,
    /// Number of the fragment to send next; `None` once all are sent.
    next: Option<u16>,
}

impl Message {
    /// Creates an empty message. Its memory is allocated here; nothing later allocates.
    #[must_use]
    pub fn new() -> Self {
        Self::with_capacity(BODY_CAPACITY)
    }

    /// Creates an empty message for bodies of at most this number of bytes.
    #[must_use]
    pub fn with_capacity(capacity: usize) -> Self {
        Self { header: None, body: vec![0; capacity].into_boxed_slice(), len: 0, next: None }
    }

    /// Replaces the message by what `write` puts into the body, and queues it. Nothing is queued if it overflows.
    pub fn set(
        &mut self,
        header: Header,
        write: impl FnOnce(&mut [u8]) -> Result<usize, Overflow>,
    ) -> Result<(), Overflow> {
        self.clear();
        self.len = write(&mut self.body)?.min(self.body.len());
        self.header = Some(header);
        self.next = Some(0);
        Ok(())
    }

    /// Returns the largest number of bytes of a body.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.body.len()
    }

    /// Returns the header of the message, if there is one.
    #[must_use]
    pub const fn header(&self) -> Option<&Header> {
        self.header.as_ref()
    }

    /// Queues the message again from its first fragment.
    pub fn repeat(&mut self) {
        if let Some(header) = &mut self.header {
            header.serial = header.serial.wrapping_add(1);
            self.next = Some(0);
        }
    }

    /// Removes the message.
    pub const fn clear(&mut self) {
        self.header = None;
        self.next = None;
    }

    /// Writes the next datagram and returns its length; `None` once all are written.
    pub fn poll(&mut self, datagram: &mut [u8]) -> Option<usize> {
        let (fragment, header) = (self.next?, self.header.as_ref()?);
        let body = self.body.get(..self.len)?;
        let mut header = *header;
        if self.len <= FRAGMENT_LEN {
            self.next = None;
            return header.emit(body, datagram).ok();
        }
        let start = usize::from(fragment).saturating_mul(FRAGMENT_LEN);
        let end = (start + FRAGMENT_LEN).min(self.len);
        let part = body.get(start..end)?;
        header.fragment = fragment;
        header.serial = header.serial.wrapping_add(fragment);
        header.flags |= flags::FRAGMENT | flags::NO_FRAGMENT_ACK;
        let last = end == self.len;
        if last {
            header.flags |= flags::LAST_FRAGMENT;
        }
        self.next = if last { None } else { fragment.checked_add(1) };
        header.emit(part, datagram).ok()
    }
}

impl Default for Message {
    fn default() -> Self {
        Self::new()
    }
}

/// Result of receiving a PDU that may be a fragment.
#[derive(Debug)]
pub enum Received<'a> {
    /// The body is complete.
    Whole(&'a [u8]),
    /// More fragments follow.
    Part,
    /// The fragment does not follow the previous one: the call is dropped until the caller repeats it.
    Refused,
    /// The body is longer than there is room: the call is dropped, and its repetition will not fit either.
    TooLong,
}

/// Reassembles the fragments of one call, in their order. A new call replaces an unfinished one.
///
/// A caller whose answer was lost repeats only what was not acknowledged, the last fragment: the body is then complete again.
#[derive(Debug)]
pub struct Reassembly {
    body: Box<[u8]>,
    len: usize,
    call: Option<Call>,
    /// The call that was completed last, while its body is still here.
    complete: Option<Call>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Call {
    kind: Kind,
    activity: Uuid,
    sequence: u32,
    order: DataRepresentation,
    next: u16,
}

impl Reassembly {
    /// Creates an empty reassembly. The memory is allocated here; nothing later allocates.
    #[must_use]
    pub fn new() -> Self {
        Self::with_capacity(BODY_CAPACITY)
    }

    /// Creates an empty reassembly of bodies of at most this number of bytes.
    #[must_use]
    pub fn with_capacity(capacity: usize) -> Self {
        Self { body: vec![0; capacity].into_boxed_slice(), len: 0, call: None, complete: None }
    }

    /// Drops the call.
    pub const fn clear(&mut self) {
        self.call = None;
        self.complete = None;
    }

    /// Handles a PDU. A PDU that is not a fragment is complete. A first fragment begins its call anew, also a repeated one.
    pub fn take<'a>(&'a mut self, header: &Header, body: &'a [u8]) -> Received<'a> {
        if !header.is_fragment() {
            return Received::Whole(body);
        }
        let Header { kind, activity, sequence, order, fragment, .. } = *header;
        let same = self
            .call
            .is_some_and(|call| (call.kind, call.activity, call.sequence) == (kind, activity, sequence));
        let mut call = match self.call {
            Some(call) if same && fragment > 0 => call,
            None if self.is_last_of_complete(header, body) => {
                return self.body.get(..self.len).map_or(Received::Refused, Received::Whole);
            }
            _ if fragment == 0 => {
                self.len = 0;
                self.complete = None;
                Call { kind, activity, sequence, order, next: 0 }
            }
            _ => return Received::Refused,
        };
        if fragment < call.next {
            return Received::Part;
        }
        let end = self.len.saturating_add(body.len());
        let room = self.body.get_mut(self.len..end);
        let room = match room {
            _ if fragment != call.next || order != call.order => Err(Received::Refused),
            room => room.ok_or(Received::TooLong),
        };
        let room = match room {
            Ok(room) => room,
            Err(received) => {
                self.call = None;
                return received;
            }
        };
        room.copy_from_slice(body);
        self.len = end;
        call.next = call.next.saturating_add(1);
        self.call = Some(call);
        if header.flags & flags::LAST_FRAGMENT == 0 {
            return Received::Part;
        }
        self.complete = self.call.take();
        self.body.get(..self.len).map_or(Received::Refused, Received::Whole)
    }

    /// Returns whether a fragment is the last one of the call that was completed last.
    fn is_last_of_complete(&self, header: &Header, body: &[u8]) -> bool {
        let Header { kind, activity, sequence, order, fragment, .. } = *header;
        let next = fragment.saturating_add(1);
        fragment > 0
            && self.complete == Some(Call { kind, activity, sequence, order, next })
            && self.body.get(..self.len).is_some_and(|complete| complete.ends_with(body))
    }
}

impl Default for Reassembly {
    fn default() -> Self {
        Self::new()
    }
}

const _: () = assert!(HEADER_LEN + FRAGMENT_LEN <= 1400);
