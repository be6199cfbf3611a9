//! Reading and writing bytes without panics.
//!
//! A [`Reader`] refuses to read past its end. A [`Writer`] without room left remembers that and reports it once, in
//! [`Writer::finish`], so that an `emit` reads like the standard's table. The byte order is a type.

use core::marker::PhantomData;

/// The largest frame on any port, in bytes: a tagged Ethernet frame of 1522 bytes, rounded up; an EtherNet/IP or
/// RPC message over TCP or in IP fragments stays below it as well.
pub const FRAME_CAPACITY: usize = 4096;

/// A byte order as a type.
pub trait ByteOrder: Copy + core::fmt::Debug + Send + 'static {
    /// Reads a 16-bit number.
    fn u16(bytes: [u8; 2]) -> u16;
    /// Reads a 32-bit number.
    fn u32(bytes: [u8; 4]) -> u32;
    /// Reads a 64-bit number.
    fn u64(bytes: [u8; 8]) -> u64;
    /// Writes a 16-bit number.
    fn from_u16(value: u16) -> [u8; 2];
    /// Writes a 32-bit number.
    fn from_u32(value: u32) -> [u8; 4];
    /// Writes a 64-bit number.
    fn from_u64(value: u64) -> [u8; 8];
}

/// Most significant byte first: PROFINET, IP.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct BigEndian;

/// Least significant byte first: EtherNet/IP, EtherCAT.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct LittleEndian;

macro_rules! byte_order {
    ($order:ty, $from:ident, $to:ident) => {
        impl ByteOrder for $order {
            #[inline]
            fn u16(bytes: [u8; 2]) -> u16 {
                u16::$from(bytes)
            }
            #[inline]
            fn u32(bytes: [u8; 4]) -> u32 {
                u32::$from(bytes)
            }
            #[inline]
            fn u64(bytes: [u8; 8]) -> u64 {
                u64::$from(bytes)
            }
            #[inline]
            fn from_u16(value: u16) -> [u8; 2] {
                value.$to()
            }
            #[inline]
            fn from_u32(value: u32) -> [u8; 4] {
                value.$to()
            }
            #[inline]
            fn from_u64(value: u64) -> [u8; 8] {
                value.$to()
            }
        }
    };
}
byte_order!(BigEndian, from_be_bytes, to_be_bytes);
byte_order!(LittleEndian, from_le_bytes, to_le_bytes);

/// The bytes end before the field does.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{wanted} bytes are needed at offset {offset}, but only {left} are left")]
pub struct Truncated {
    /// Where the field starts, in bytes from the reader's start.
    pub offset: usize,
    /// The field's length in bytes.
    pub wanted: usize,
    /// The bytes that remain.
    pub left: usize,
}

/// The buffer is too small for what is to be written.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("a buffer of {capacity} bytes is too small for the data to write")]
pub struct Overflow {
    /// The buffer's length in bytes.
    pub capacity: usize,
}

/// Reads fields one after another from bytes that may be too short.
#[derive(Clone, Copy, Debug)]
pub struct Reader<'a, O> {
    bytes: &'a [u8],
    offset: usize,
    order: PhantomData<O>,
}

impl<'a, O: ByteOrder> Reader<'a, O> {
    /// Creates a reader at the start of `bytes`.
    #[must_use]
    #[inline]
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, offset: 0, order: PhantomData }
    }

    /// Reads the next `N` bytes.
    #[inline]
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], Truncated> {
        match self.bytes.get(self.offset..).and_then(|rest| rest.first_chunk::<N>()) {
            Some(chunk) => {
                self.offset += N;
                Ok(*chunk)
            }
            None => Err(self.truncated(N)),
        }
    }

    /// Reads the next byte.
    #[inline]
    pub fn u8(&mut self) -> Result<u8, Truncated> {
        self.array::<1>().map(|[byte]| byte)
    }

    /// Reads the next 16-bit number.
    #[inline]
    pub fn u16(&mut self) -> Result<u16, Truncated> {
        self.array().map(O::u16)
    }

    /// Reads the next 32-bit number.
    #[inline]
    pub fn u32(&mut self) -> Result<u32, Truncated> {
        self.array().map(O::u32)
    }

    /// Reads the next 64-bit number.
    #[inline]
    pub fn u64(&mut self) -> Result<u64, Truncated> {
        self.array().map(O::u64)
    }

    /// Reads the next single-precision number; NaN and infinities are allowed.
    #[inline]
    pub fn f32(&mut self) -> Result<f32, Truncated> {
        self.u32().map(f32::from_bits)
    }

    /// Reads the next `len` bytes.
    #[inline]
    pub fn bytes(&mut self, len: usize) -> Result<&'a [u8], Truncated> {
        let taken = self.offset.checked_add(len).and_then(|end| self.bytes.get(self.offset..end));
        match taken {
            Some(taken) => {
                self.offset += len;
                Ok(taken)
            }
            None => Err(self.truncated(len)),
        }
    }

    /// Returns a reader over the next `len` bytes only, and skips them here.
    #[inline]
    pub fn sub(&mut self, len: usize) -> Result<Self, Truncated> {
        self.bytes(len).map(Self::new)
    }

    /// Skips `len` bytes.
    #[inline]
    pub fn skip(&mut self, len: usize) -> Result<(), Truncated> {
        self.bytes(len).map(|_| ())
    }

    /// Skips bytes until the offset is a multiple of `alignment`, at most to the end.
    pub fn align(&mut self, alignment: usize) {
        self.offset = self.offset.next_multiple_of(alignment.max(1)).min(self.bytes.len());
    }

    /// Returns all remaining bytes.
    #[must_use]
    #[inline]
    pub fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.offset..).unwrap_or_default()
    }

    /// Returns the number of remaining bytes.
    #[must_use]
    #[inline]
    pub fn left(&self) -> usize {
        self.bytes.len().saturating_sub(self.offset)
    }

    /// Returns whether all bytes are read.
    #[must_use]
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.left() == 0
    }

    /// Returns the number of bytes read.
    #[must_use]
    #[inline]
    pub const fn offset(&self) -> usize {
        self.offset
    }

    /// Returns a reader at the same position with another byte order.
    #[must_use]
    pub const fn in_order<P: ByteOrder>(self) -> Reader<'a, P> {
        Reader { bytes: self.bytes, offset: self.offset, order: PhantomData }
    }

    fn truncated(&self, wanted: usize) -> Truncated {
        Truncated { offset: self.offset, wanted, left: self.left() }
    }
}

/// Writes fields one after another into a buffer that may be too small.
#[derive(Debug)]
pub struct Writer<'a, O> {
    buf: &'a mut [u8],
    len: usize,
    overflow: bool,
    order: PhantomData<O>,
}

impl<'a, O: ByteOrder> Writer<'a, O> {
    /// Creates a writer at the start of `buf`.
    #[must_use]
    #[inline]
    pub const fn new(buf: &'a mut [u8]) -> Self {
        Self { buf, len: 0, overflow: false, order: PhantomData }
    }

    /// Writes `bytes`.
    #[inline]
    pub fn bytes(&mut self, bytes: &[u8]) {
        if let Some(room) = self.room(bytes.len()) {
            room.copy_from_slice(bytes);
        }
    }

    /// Writes `len` zero bytes.
    #[inline]
    pub fn zeros(&mut self, len: usize) {
        if let Some(room) = self.room(len) {
            room.fill(0);
        }
    }

    /// Writes a byte.
    #[inline]
    pub fn u8(&mut self, value: u8) {
        self.bytes(&[value]);
    }

    /// Writes a 16-bit number.
    #[inline]
    pub fn u16(&mut self, value: u16) {
        self.bytes(&O::from_u16(value));
    }

    /// Writes a 32-bit number.
    #[inline]
    pub fn u32(&mut self, value: u32) {
        self.bytes(&O::from_u32(value));
    }

    /// Writes a 64-bit number.
    #[inline]
    pub fn u64(&mut self, value: u64) {
        self.bytes(&O::from_u64(value));
    }

    /// Writes a single-precision number.
    #[inline]
    pub fn f32(&mut self, value: f32) {
        self.u32(value.to_bits());
    }

    /// Writes zero bytes up to a multiple of `alignment`, counted from the buffer's start.
    pub fn align(&mut self, alignment: usize) {
        self.zeros(self.len.next_multiple_of(alignment.max(1)) - self.len);
    }

    /// Writes zero bytes until `len` bytes are written in total.
    #[inline]
    pub fn pad_to(&mut self, len: usize) {
        self.zeros(len.saturating_sub(self.len));
    }

    /// Overwrites an already written 16-bit number at `offset`: a length that is known only later.
    pub fn patch_u16(&mut self, offset: usize, value: u16) {
        self.patch(offset, &O::from_u16(value));
    }

    /// Overwrites an already written 32-bit number at `offset`.
    pub fn patch_u32(&mut self, offset: usize, value: u32) {
        self.patch(offset, &O::from_u32(value));
    }

    /// Returns the number of bytes written.
    #[must_use]
    #[inline]
    pub const fn len(&self) -> usize {
        self.len
    }

    /// Returns whether nothing is written.
    #[must_use]
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Runs `write` with another byte order at this position.
    pub fn in_order<P: ByteOrder>(&mut self, write: impl FnOnce(&mut Writer<'_, P>)) {
        let mut inner =
            Writer::<P> { buf: self.buf, len: self.len, overflow: self.overflow, order: PhantomData };
        write(&mut inner);
        (self.len, self.overflow) = (inner.len, inner.overflow);
    }

    /// Returns the number of bytes written if all of them fitted.
    #[inline]
    pub const fn finish(self) -> Result<usize, Overflow> {
        if self.overflow { Err(Overflow { capacity: self.buf.len() }) } else { Ok(self.len) }
    }

    #[inline]
    fn room(&mut self, len: usize) -> Option<&mut [u8]> {
        let end = self.len.checked_add(len).filter(|end| !self.overflow && *end <= self.buf.len());
        match end {
            Some(end) => {
                let start = core::mem::replace(&mut self.len, end);
                self.buf.get_mut(start..end)
            }
            None => {
                self.overflow = true;
                None
            }
        }
    }

    fn patch(&mut self, offset: usize, bytes: &[u8]) {
        let end = offset.saturating_add(bytes.len());
        match self.buf.get_mut(offset..end) {
            Some(place) if end <= self.len => place.copy_from_slice(bytes),
            _ => self.overflow = true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_refuses_to_read_past_the_end_and_stays_where_it_was() {
        let mut reader = Reader::<BigEndian>::new(&[1, 2, 3]);
        assert_eq!(reader.u16(), Ok(0x0102));
        assert_eq!(reader.u16(), Err(Truncated { offset: 2, wanted: 2, left: 1 }));
        assert_eq!(reader.bytes(usize::MAX), Err(Truncated { offset: 2, wanted: usize::MAX, left: 1 }));
        assert_eq!(reader.u8(), Ok(3));
        assert!(reader.is_empty());
    }

    #[test]
    fn a_writer_without_enough_room_reports_it_at_the_end() {
        let mut buf = [0; 3];
        let mut writer = Writer::<LittleEndian>::new(&mut buf);
        writer.u16(0x0201);
        writer.u16(0x0403);
        writer.u8(9);
        assert_eq!(writer.finish(), Err(Overflow { capacity: 3 }));
        assert_eq!(buf, [1, 2, 0]);
    }

    #[test]
    fn a_length_is_patched_only_within_the_written_bytes() {
        let mut buf = [0; 8];
        let mut writer = Writer::<BigEndian>::new(&mut buf);
        writer.u16(0);
        writer.bytes(b"abc");
        writer.patch_u16(0, 3);
        writer.in_order::<LittleEndian>(|w| w.u16(0x0102));
        assert_eq!(writer.finish(), Ok(7));
        assert_eq!(&buf[..7], b"\x00\x03abc\x02\x01");

        let mut writer = Writer::<BigEndian>::new(&mut buf);
        writer.u16(0);
        writer.patch_u16(1, 3);
        assert!(writer.finish().is_err());
    }
}
