//! The five 32-bit NDR numbers between an RPC header and the blocks, in the header's byte order.
//!
//! ```text
//! request   ArgsMaximum · ArgsLength · MaximumCount · Offset (0) · ActualCount (= ArgsLength) · blocks
//! response  PNIOStatus  · ArgsLength · MaximumCount · Offset (0) · ActualCount (= ArgsLength) · blocks
//! ```

use super::{ARGS_LEN, DataRepresentation, Header};
use crate::status::{Status, Violation};
use machine::wire::{BigEndian, ByteOrder, LittleEndian, Overflow, Reader, Writer};

/// The NDR numbers before the blocks of a request.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct RequestArgs<'a> {
    /// ArgsMaximum: the longest answer, in bytes of blocks, that the caller accepts.
    pub maximum: u32,
    /// The blocks.
    pub blocks: &'a [u8],
}

impl<'a> RequestArgs<'a> {
    /// Parses a request's body.
    pub fn parse(header: &Header, body: &'a [u8]) -> Result<Self, Violation> {
        let (first, blocks) = split_args(header, body).ok_or(Violation::ArgsLength)?;
        Ok(Self { maximum: first, blocks })
    }

    /// Writes a request's body, big-endian: the NDR numbers and what `blocks` writes. Returns its length.
    pub fn emit(
        maximum: u32,
        body: &mut [u8],
        blocks: impl FnOnce(&mut Writer<'_, BigEndian>),
    ) -> Result<usize, Overflow> {
        emit_args(maximum, None, body, blocks)
    }
}

/// The NDR numbers before the blocks of a response.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ResponseArgs<'a> {
    /// PNIOStatus.
    pub status: Status,
    /// The blocks; usually none if the status is not OK.
    pub blocks: &'a [u8],
}

impl<'a> ResponseArgs<'a> {
    /// Parses a response's body.
    pub fn parse(header: &Header, body: &'a [u8]) -> Result<Self, Violation> {
        let (first, blocks) = split_args(header, body).ok_or(Violation::ArgsLength)?;
        Ok(Self { status: Status(first), blocks })
    }

    /// Writes a response's body, big-endian. `maximum` is the request's ArgsMaximum. Returns its length.
    pub fn emit(
        status: Status,
        maximum: u32,
        body: &mut [u8],
        blocks: impl FnOnce(&mut Writer<'_, BigEndian>),
    ) -> Result<usize, Overflow> {
        emit_args(status.0, Some(maximum), body, blocks)
    }
}

fn split_args<'a>(header: &Header, body: &'a [u8]) -> Option<(u32, &'a [u8])> {
    fn split<O: ByteOrder>(body: &[u8]) -> Option<(u32, &[u8])> {
        let mut reader = Reader::<O>::new(body);
        let first = reader.u32().ok()?;
        let args_len = reader.u32().ok()?;
        let _maximum_count = reader.u32().ok()?;
        let offset = reader.u32().ok()?;
        let actual_count = reader.u32().ok()?;
        let blocks = reader.rest();
        let whole = usize::try_from(args_len).is_ok_and(|len| len == blocks.len());
        (whole && args_len == actual_count && offset == 0).then_some((first, blocks))
    }
    match header.order {
        DataRepresentation::BigEndian => split::<BigEndian>(body),
        DataRepresentation::LittleEndian => split::<LittleEndian>(body),
    }
}

fn emit_args(
    first: u32,
    maximum_count: Option<u32>,
    body: &mut [u8],
    blocks: impl FnOnce(&mut Writer<'_, BigEndian>),
) -> Result<usize, Overflow> {
    let mut writer = Writer::<BigEndian>::new(body);
    writer.u32(first);
    writer.zeros(ARGS_LEN - 4);
    blocks(&mut writer);
    let length = u32::try_from(writer.len().saturating_sub(ARGS_LEN)).unwrap_or(u32::MAX);
    writer.patch_u32(4, length);
    // An array has no more elements than its maximum says, even for a caller whose ArgsMaximum is too small.
    writer.patch_u32(8, maximum_count.map_or(first, |maximum| maximum.max(length)));
    writer.patch_u32(16, length);
    writer.finish()
}
