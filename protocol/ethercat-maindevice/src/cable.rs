//! The cable of several devices that are driven each on its own: their frames share Ethernet frames.
//!
//! ```text
//! Ethernet  EtherCAT  NOP with a number  datagrams of one device  datagrams of the next one  ...
//! ```
//!
//! No device takes a NOP. It comes back with its number, by which the frame is found again: the index of a datagram has 8
//! bits only, and a late reply must not be taken for a new one.

use machine::ethernet::MIN_FRAME_LEN;

use crate::frames::LONGEST;
use crate::slot::{HEADER, Slot};

/// Frames that may be on their way at a time.
const UNDER_WAY: usize = 256;

/// Ethernet header without tag.
const ETHERNET: usize = 14;

/// Ethernet and EtherCAT header.
const HEADERS: usize = ETHERNET + 2;

/// The NOP with its header, four bytes and a working counter.
const NOP: usize = HEADER + 4 + 2;

/// In the length of a datagram: another one follows.
const MORE: u16 = 0x8000;
const LENGTH: u16 = 0x07FF;

/// Type in the EtherCAT header of frames with datagrams (ETG.1000.4).
const DATAGRAMS: u16 = 1 << 12;

/// What a frame on its way consists of.
#[derive(Clone, Default, Debug)]
pub(crate) struct UnderWay {
    number: u32,
    is_open: bool,
    parts: Vec<Part>,
    /// The headers of all datagrams as ethercrab made them, without the event requests.
    headers: Vec<[u8; 8]>,
}

/// The datagrams of one device in a frame.
#[derive(Clone, Copy, Debug)]
struct Part {
    slot: Slot,
    datagrams: u16,
    /// Length in bytes.
    len: usize,
}

/// What a received frame is.
#[derive(Debug)]
pub(crate) enum Reply {
    /// The reply to a frame on its way, in this place.
    Of(usize),
    /// A reply that came too late, twice or damaged.
    Late,
    /// Not sent by this cable.
    Unknown,
}

/// Frames on their way, and the one that is being filled.
#[derive(Default, Debug)]
pub(crate) struct Cable {
    number: u32,
    under_way: Vec<UnderWay>,
    /// A device's reply, as ethercrab expects it.
    part: Vec<u8>,
    /// Number of devices that the last datagram by position passed.
    passed: Option<u16>,
}

impl Cable {
    /// Creates a cable for this number of devices.
    pub(crate) fn new(devices: usize) -> Self {
        let room = (LONGEST - HEADERS - NOP) / (HEADER + 3);
        let slot = || UnderWay {
            parts: Vec::with_capacity(devices.min(room)),
            headers: Vec::with_capacity(room),
            ..UnderWay::default()
        };
        Self {
            number: 0,
            under_way: std::iter::repeat_with(slot).take(UNDER_WAY).collect(),
            part: vec![0; LONGEST],
            passed: None,
        }
    }

    /// Returns the number of devices on the cable, as the last datagram by position counted them: each device adds 1 to its
    /// position (ETG.1000.4).
    pub(crate) const fn devices(&self) -> Option<u16> {
        self.passed
    }

    fn place(number: u32) -> usize {
        number as usize % UNDER_WAY
    }

    /// Begins a frame in `buf` for the datagrams of `first`, which has the Ethernet header. Returns its length in bytes.
    pub(crate) fn begin(&mut self, first: &[u8], buf: &mut [u8]) -> Option<usize> {
        self.number = self.number.wrapping_add(1);
        let under_way = self.under_way.get_mut(Self::place(self.number))?;
        under_way.parts.clear();
        under_way.headers.clear();
        (under_way.number, under_way.is_open) = (self.number, true);
        buf.get_mut(..ETHERNET)?.copy_from_slice(first.get(..ETHERNET)?);
        let nop = buf.get_mut(HEADERS..HEADERS + NOP)?;
        nop.fill(0);
        nop.get_mut(6..8)?.copy_from_slice(&(4 | MORE).to_le_bytes());
        nop.get_mut(HEADER..HEADER + 4)?.copy_from_slice(&self.number.to_le_bytes());
        Some(HEADERS + NOP)
    }

    /// Appends the datagrams of a device's frame to the frame of `len` bytes in `buf`. Returns the new length, or `None` if
    /// there is no room.
    pub(crate) fn append(&mut self, slot: Slot, frame: &[u8], buf: &mut [u8], len: usize) -> Option<usize> {
        let under_way = self.under_way.get_mut(Self::place(self.number))?;
        let header = u16::from_le_bytes(*frame.get(ETHERNET..)?.first_chunk()?);
        let datagrams = frame.get(HEADERS..)?.get(..usize::from(header & LENGTH))?;
        let end = len + datagrams.len();
        if end > LONGEST {
            return None;
        }
        let room = buf.get_mut(len..end)?;
        room.copy_from_slice(datagrams);
        let (mut at, mut count) = (0, 0);
        while let Some(datagram) = room.get_mut(at..).filter(|rest| rest.len() > HEADER) {
            let original = *datagram.first_chunk::<8>()?;
            let [.., low, high] = original;
            let size = HEADER + usize::from(u16::from_le_bytes([low, high]) & LENGTH) + 2;
            let datagram = datagram.get_mut(..size)?;
            slot.place(datagram);
            // Another one always follows, until the frame is finished.
            *datagram.get_mut(7)? |= (MORE >> 8) as u8;
            under_way.headers.push(original);
            (at, count) = (at + size, count + 1);
        }
        under_way.parts.push(Part { slot, datagrams: count, len: datagrams.len() });
        Some(end)
    }

    /// Finishes the frame of `len` bytes in `buf`. Returns its length with padding.
    pub(crate) fn finish(&mut self, buf: &mut [u8], len: usize) -> Option<usize> {
        let under_way = self.under_way.get(Self::place(self.number))?;
        let [.., low, high] = *under_way.headers.last()?;
        let last = len.checked_sub(HEADER + usize::from(u16::from_le_bytes([low, high]) & LENGTH) + 2)?;
        *buf.get_mut(last + 7)? &= !((MORE >> 8) as u8);
        let header = u16::try_from(len - HEADERS).ok()? | DATAGRAMS;
        buf.get_mut(ETHERNET..HEADERS)?.copy_from_slice(&header.to_le_bytes());
        if let Some(padding) = buf.get_mut(len..MIN_FRAME_LEN) {
            padding.fill(0);
        }
        Some(len.max(MIN_FRAME_LEN))
    }

    /// Finds the frame to which a received one is the reply.
    pub(crate) fn find(&mut self, frame: &[u8]) -> Reply {
        let Some(number) = Self::number_of(frame) else { return Reply::Unknown };
        let place = Self::place(number);
        let len = frame.get(ETHERNET..HEADERS).and_then(|bytes| bytes.first_chunk().copied());
        let len = len.map_or(0, |bytes| usize::from(u16::from_le_bytes(bytes) & LENGTH));
        match self.under_way.get_mut(place) {
            Some(under_way) if under_way.is_open && under_way.number == number => {
                under_way.is_open = false;
                let sent: usize = under_way.parts.iter().map(|part| part.len).sum();
                if len == NOP + sent && frame.len() >= HEADERS + len { Reply::Of(place) } else { Reply::Late }
            }
            _ => Reply::Late,
        }
    }

    /// Returns the number in a frame's first datagram, if that is a NOP as this cable makes it.
    fn number_of(frame: &[u8]) -> Option<u32> {
        let nop = frame.get(HEADERS..HEADERS + NOP)?;
        let (header, rest) = nop.split_first_chunk::<HEADER>()?;
        let [0, 0, 0, 0, 0, 0, low, high, ..] = *header else { return None };
        let is_nop = u16::from_le_bytes([low, high]) & LENGTH == 4;
        is_nop.then(|| rest.first_chunk().copied().map(u32::from_le_bytes))?
    }

    /// Returns part `part` of the reply in this place: the device among the driven ones, and its reply as ethercrab expects it.
    pub(crate) fn part(&mut self, place: usize, part: usize, frame: &[u8]) -> Option<(u16, &[u8])> {
        let UnderWay { parts, headers, .. } = self.under_way.get(place)?;
        let Part { slot, datagrams, len } = *parts.get(part)?;
        let before = parts.get(..part)?;
        let (at, first) = before.iter().fold((HEADERS + NOP, 0), |(at, first), part| {
            (at + part.len, first + usize::from(part.datagrams))
        });
        let end = HEADERS + len;
        self.part.get_mut(..ETHERNET)?.copy_from_slice(frame.get(..ETHERNET)?);
        let header = u16::try_from(len).ok()? | DATAGRAMS;
        self.part.get_mut(ETHERNET..HEADERS)?.copy_from_slice(&header.to_le_bytes());
        self.part.get_mut(HEADERS..end)?.copy_from_slice(frame.get(at..at + len)?);
        let mut at = HEADERS;
        for header in headers.get(first..)?.iter().take(datagrams.into()) {
            let [.., low, high] = *header;
            let received = self.part.get_mut(at..at + header.len())?;
            if let (Some(sent), [_, _, a, b, ..]) = (slot.sent_position(header), &*received) {
                self.passed = Some(u16::from_le_bytes([*a, *b]).wrapping_sub(sent));
            }
            received.copy_from_slice(header);
            at += HEADER + usize::from(u16::from_le_bytes([low, high]) & LENGTH) + 2;
        }
        self.part.get(..end).map(|part| (slot.driven, part))
    }
}
