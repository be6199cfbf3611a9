//! The older format of libpcap (draft-ietf-opsawg-pcap).
//!
//! ```text
//! file    0..4 magic  4..8 version  8..16 unused  16..20 snapshot length  20..24 link type, FCS length in the top bits
//! packet  0..4 seconds  4..8 µs or ns  8..12 captured length  12..16 original length  16.. data
//! ```

use std::io::Read;

use super::source::CountedInput;
use super::{CaptureError, MAX_BLOCK_LEN, PacketPlace};

const MICROSECONDS: u32 = 0xA1B2_C3D4;
const NANOSECONDS: u32 = 0xA1B2_3C4D;

/// Length of a packet's head in bytes.
const PACKET_HEAD_LEN: usize = 16;

/// The head of a file.
#[derive(Clone, Copy, Debug)]
pub(super) struct FileHeader {
    is_big_endian: bool,
    link_type: u32,
    /// Nanoseconds in the unit of the packets' second field.
    unit: u64,
}

impl FileHeader {
    /// Reads the rest of a head after its magic number; `None` if that is another one.
    pub(super) fn read<R: Read>(
        magic: [u8; 4],
        source: &mut CountedInput<R>,
    ) -> Result<Option<Self>, CaptureError> {
        let (is_big_endian, unit) = match (u32::from_be_bytes(magic), u32::from_le_bytes(magic)) {
            (MICROSECONDS, _) => (true, 1_000),
            (NANOSECONDS, _) => (true, 1),
            (_, MICROSECONDS) => (false, 1_000),
            (_, NANOSECONDS) => (false, 1),
            _ => return Ok(None),
        };
        let mut rest = [0; 20];
        source.fill(&mut rest)?;
        let [.., a, b, c, d] = rest;
        let mut header = Self { is_big_endian, link_type: 0, unit };
        // Bits 28 to 31 give the length of the FCS, 27 and below the link type.
        header.link_type = header.number([a, b, c, d]) & 0x0FFF_FFFF;
        Ok(Some(header))
    }

    const fn number(self, bytes: [u8; 4]) -> u32 {
        if self.is_big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }

    /// Reads the next packet into the buffer.
    pub(super) fn read_packet<R: Read>(
        self,
        source: &mut CountedInput<R>,
        buffer: &mut Vec<u8>,
    ) -> Result<Option<PacketPlace>, CaptureError> {
        let offset = source.offset();
        let mut head = [0; PACKET_HEAD_LEN];
        if !source.fill_or_end(&mut head)? {
            return Ok(None);
        }
        let mut numbers = head.as_chunks::<4>().0.iter().map(|bytes| self.number(*bytes));
        let mut next = || numbers.next().unwrap_or_default();
        let (seconds, fraction, captured, original_len) = (next(), next(), next(), next());
        let captured = captured as usize;
        if captured > MAX_BLOCK_LEN {
            return Err(CaptureError::Damaged { offset, found: "a packet is longer than 1 MiB" });
        }
        source.take(captured, buffer)?;
        let nanos = u64::from(seconds)
            .saturating_mul(1_000_000_000)
            .saturating_add(u64::from(fraction).saturating_mul(self.unit));
        let link_type = self.link_type;
        Ok(Some(PacketPlace { interface: 0, link_type, nanos, original_len, data: 0..captured }))
    }
}
