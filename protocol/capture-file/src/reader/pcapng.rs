//! The format pcapng (draft-ietf-opsawg-pcapng): blocks, each with its type, its length before and after, and options.
//!
//! ```text
//! any        0..4 type  4..8 length  8..  body  last 4 length again
//! section    body 0..4 byte-order magic  …
//! interface  body 0..2 link type  4..8 snapshot length  8.. options
//! packet     body 0..4 interface  4..12 time, high word first  12..16 captured  16..20 original length  20.. data
//! option     0..2 code  2..4 length  4.. value, padded to 4 bytes
//! ```

use std::io::Read;

use super::source::CountedInput;
use super::{CaptureError, MAX_BLOCK_LEN, PacketPlace};

/// Block types. A section's is the same in both byte orders.
const SECTION: [u8; 4] = [0x0A, 0x0D, 0x0D, 0x0A];
const INTERFACE: u32 = 1;
/// The packet block of before 2004, and the one without a time.
const OBSOLETE_PACKET: u32 = 2;
const SIMPLE_PACKET: u32 = 3;
const ENHANCED_PACKET: u32 = 6;

const BYTE_ORDER_MAGIC: u32 = 0x1A2B_3C4D;

/// Options of an interface: resolution of its times, and seconds to add to them.
const IF_TSRESOL: u16 = 9;
const IF_TSOFFSET: u16 = 14;

/// Type and both lengths of a block, in bytes.
const FRAME_LEN: usize = 12;

/// Bytes of a packet block before its data.
const PACKET_HEAD_LEN: usize = 20;

/// Largest number of interfaces of a section.
const MAX_INTERFACES: usize = 1024;

/// Returns whether a file or a block that begins so is a section.
pub(super) fn is_section(first: [u8; 4]) -> bool {
    first == SECTION
}

/// Resolution of an interface's times.
#[derive(Clone, Copy, Debug)]
enum Resolution {
    /// 10 to the power of minus this number, in seconds.
    Decimal(u32),
    /// 2 to the power of minus this number.
    Binary(u32),
}

#[derive(Clone, Copy, Debug)]
struct Interface {
    link_type: u32,
    resolution: Resolution,
    offset_seconds: i64,
}

impl Interface {
    fn nanos(&self, ticks: u64) -> u64 {
        const SECOND: i128 = 1_000_000_000;
        let ticks = i128::from(ticks);
        let nanos = match self.resolution {
            Resolution::Decimal(power) if power <= 9 => ticks * 10_i128.pow(9 - power),
            // No more than 38 digits: a finer unit gives no whole nanosecond at all.
            Resolution::Decimal(power) => 10_i128.checked_pow(power - 9).map_or(0, |divisor| ticks / divisor),
            Resolution::Binary(power) => (ticks * SECOND) >> power,
        };
        let nanos = nanos + i128::from(self.offset_seconds) * SECOND;
        u64::try_from(nanos.max(0)).unwrap_or(u64::MAX)
    }
}

/// A section: byte order and interfaces.
#[derive(Debug)]
pub(super) struct PcapngSection {
    is_big_endian: bool,
    interfaces: Vec<Interface>,
    untimed: u64,
}

impl PcapngSection {
    /// Reads the head of a section, whose type was read already; the one before it gives what was counted.
    pub(super) fn read<R: Read>(
        source: &mut CountedInput<R>,
        before: Option<&Self>,
    ) -> Result<Self, CaptureError> {
        let offset = source.offset();
        let (mut length, mut magic) = ([0; 4], [0; 4]);
        source.fill(&mut length)?;
        source.fill(&mut magic)?;
        let is_big_endian = match (u32::from_be_bytes(magic), u32::from_le_bytes(magic)) {
            (BYTE_ORDER_MAGIC, _) => true,
            (_, BYTE_ORDER_MAGIC) => false,
            _ => return Err(CaptureError::Damaged { offset, found: "a section has no byte order" }),
        };
        let untimed = before.map_or(0, |before| before.untimed);
        let section = Self { is_big_endian, interfaces: Vec::new(), untimed };
        let length = section.u32(length) as usize;
        // Type, length and magic were read.
        match length.checked_sub(FRAME_LEN) {
            Some(rest) if length.is_multiple_of(4) => source.skip(rest as u64)?,
            _ => return Err(CaptureError::Damaged { offset, found: "a section is too short" }),
        }
        Ok(section)
    }

    /// Returns the number of packets without a time.
    pub(super) const fn untimed(&self) -> u64 {
        self.untimed
    }

    const fn u32(&self, bytes: [u8; 4]) -> u32 {
        if self.is_big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }

    const fn u16(&self, bytes: [u8; 2]) -> u16 {
        if self.is_big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
    }

    fn word(&self, bytes: &[u8], at: usize) -> Option<u32> {
        Some(self.u32(bytes.get(at..)?.first_chunk().copied()?))
    }

    fn half(&self, bytes: &[u8], at: usize) -> Option<u16> {
        Some(self.u16(bytes.get(at..)?.first_chunk().copied()?))
    }

    /// Reads blocks up to the next packet.
    pub(super) fn read_packet<R: Read>(
        &mut self,
        source: &mut CountedInput<R>,
        buffer: &mut Vec<u8>,
    ) -> Result<Option<PacketPlace>, CaptureError> {
        loop {
            let offset = source.offset();
            let damaged = |found| CaptureError::Damaged { offset, found };
            let (mut kind, mut length) = ([0; 4], [0; 4]);
            if !source.fill_or_end(&mut kind)? {
                return Ok(None);
            }
            if is_section(kind) {
                *self = Self::read(source, Some(self))?;
                continue;
            }
            source.fill(&mut length)?;
            let length = self.u32(length) as usize;
            let body = length.checked_sub(FRAME_LEN).filter(|_| length.is_multiple_of(4));
            let body = body.ok_or_else(|| damaged("a block has an impossible length"))?;
            let kind = self.u32(kind);
            if !matches!(kind, INTERFACE | ENHANCED_PACKET) {
                self.untimed += u64::from(matches!(kind, OBSOLETE_PACKET | SIMPLE_PACKET));
                source.skip(body as u64 + 4)?;
                continue;
            }
            if body > MAX_BLOCK_LEN {
                return Err(damaged("a packet is longer than 1 MiB"));
            }
            source.take(body, buffer)?;
            let mut again = [0; 4];
            source.fill(&mut again)?;
            if self.u32(again) as usize != length {
                return Err(damaged("the two lengths of a block differ"));
            }
            if kind == INTERFACE {
                let interface = self.interface(buffer).ok_or_else(|| damaged("an interface is too short"))?;
                if self.interfaces.len() >= MAX_INTERFACES {
                    return Err(damaged("there are more than 1024 interfaces"));
                }
                self.interfaces.push(interface);
                continue;
            }
            return self.packet(buffer).map(Some).map_err(damaged);
        }
    }

    fn interface(&self, body: &[u8]) -> Option<Interface> {
        let link_type = self.half(body, 0)?.into();
        let mut interface = Interface { link_type, resolution: Resolution::Decimal(6), offset_seconds: 0 };
        let mut options = body.get(8..)?;
        while let (Some(code), Some(length)) = (self.half(options, 0), self.half(options, 2)) {
            let length = usize::from(length);
            let Some(value) = options.get(4..4 + length) else { break };
            match (code, value) {
                (IF_TSRESOL, [exponent]) => {
                    let power = u32::from(exponent & 0x7F);
                    let is_binary = exponent & 0x80 != 0;
                    interface.resolution =
                        if is_binary { Resolution::Binary(power) } else { Resolution::Decimal(power) };
                }
                (IF_TSOFFSET, value) => {
                    if let Some(bytes) = value.first_chunk::<8>() {
                        interface.offset_seconds = match self.is_big_endian {
                            true => i64::from_be_bytes(*bytes),
                            false => i64::from_le_bytes(*bytes),
                        };
                    }
                }
                _ => {}
            }
            options = options.get(4 + length.next_multiple_of(4)..).unwrap_or_default();
        }
        Some(interface)
    }

    fn packet(&self, body: &[u8]) -> Result<PacketPlace, &'static str> {
        let word = |at| self.word(body, at).ok_or("a packet is too short");
        let (number, high, low) = (word(0)?, word(4)?, word(8)?);
        let (captured, original_len) = (word(12)? as usize, word(16)?);
        let interface = self.interfaces.get(number as usize).ok_or("a packet has an unknown interface")?;
        if captured > body.len().saturating_sub(PACKET_HEAD_LEN) {
            return Err("a packet is longer than its block");
        }
        Ok(PacketPlace {
            interface: number,
            link_type: interface.link_type,
            nanos: interface.nanos(u64::from(high) << 32 | u64::from(low)),
            original_len,
            data: PACKET_HEAD_LEN..PACKET_HEAD_LEN + captured,
        })
    }
}
