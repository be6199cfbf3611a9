//! FMMUs: which bits of the logical process image are which bits of the memory.

use core::ops::Range;

use super::memory::Memory;
use super::registers;

/// A Fieldbus Memory Management Unit (ETG.1000.4, 6.6).
///
/// ```text
/// 0..4   logical start address     6  logical start bit
/// 4..6   length in bytes           7  logical end bit
/// 8..10  physical start address   10  physical start bit
/// 11     bit 0 reads, bit 1 writes
/// 12     bit 0 is active
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(crate) struct Fmmu {
    active: bool,
    logical_start: u32,
    /// Bytes of the logical image that it touches.
    len: u16,
    start_bit: u8,
    end_bit: u8,
    physical_start: u16,
    physical_bit: u8,
    pub(crate) reads: bool,
    pub(crate) writes: bool,
}

/// A part of a datagram that an FMMU maps.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Mapped {
    /// Bits of the datagram's data, counted from the lowest bit of the first byte.
    pub(crate) bits: Range<usize>,
    /// Physical address of the byte with the first of them.
    pub(crate) address: u16,
    /// Number of that bit in that byte.
    pub(crate) bit: u8,
}

impl Mapped {
    /// Returns the bytes of the datagram if it maps whole bytes to whole bytes.
    pub(crate) fn bytes(&self) -> Option<Range<usize>> {
        let whole = self.bit == 0 && self.bits.start.is_multiple_of(8) && self.bits.end.is_multiple_of(8);
        whole.then_some(self.bits.start / 8..self.bits.end / 8)
    }

    /// Returns the number of bytes of memory that it touches.
    pub(crate) fn physical_len(&self) -> usize {
        (usize::from(self.bit) + self.bits.len()).div_ceil(8)
    }
}

impl Fmmu {
    /// Reads the registers of FMMU `index`.
    pub(crate) fn read(memory: &Memory, index: u8) -> Self {
        let at = registers::FMMU + u16::from(index) * registers::FMMU_LEN;
        let directions = memory.u8(at + 11);
        Self {
            active: memory.u8(at + 12) & 1 != 0,
            logical_start: memory.u32(at),
            len: memory.u16(at + 4),
            start_bit: memory.u8(at + 6) & 7,
            end_bit: memory.u8(at + 7) & 7,
            physical_start: memory.u16(at + 8),
            physical_bit: memory.u8(at + 10) & 7,
            reads: directions & 1 != 0,
            writes: directions & 2 != 0,
        }
    }

    /// Returns which part of a datagram at a logical address with `len` bytes of data it maps.
    pub(crate) fn map(&self, logical_address: u32, len: usize) -> Option<Mapped> {
        if !self.active || self.len == 0 {
            return None;
        }
        // All in bits of the logical address space.
        let first = u64::from(self.logical_start) * 8 + u64::from(self.start_bit);
        let last = (u64::from(self.logical_start) + u64::from(self.len) - 1) * 8 + u64::from(self.end_bit);
        let start = u64::from(logical_address) * 8;
        let end = start + len as u64 * 8;
        let from = first.max(start);
        let to = (last + 1).min(end);
        if from >= to {
            return None;
        }
        let physical = u64::from(self.physical_start) * 8 + u64::from(self.physical_bit) + (from - first);
        Some(Mapped {
            bits: (from - start) as usize..(to - start) as usize,
            address: u16::try_from(physical / 8).ok()?,
            bit: (physical % 8) as u8,
        })
    }
}

/// Copies `count` bits from bit `from` of `source` to bit `to` of `target`; bits beyond their ends stay as they are.
pub(crate) fn copy_bits(source: &[u8], from: usize, target: &mut [u8], to: usize, count: usize) {
    for index in 0..count {
        let (from, to) = (from + index, to + index);
        if let (Some(source), Some(target)) = (source.get(from / 8), target.get_mut(to / 8)) {
            let mask = 1 << (to % 8);
            *target = if source >> (from % 8) & 1 != 0 { *target | mask } else { *target & !mask };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fmmu(bytes: [u8; 16]) -> Fmmu {
        let mut memory = Memory::new(0);
        memory.set(registers::FMMU, &bytes);
        Fmmu::read(&memory, 0)
    }

    #[test]
    fn whole_bytes_are_mapped_where_datagram_and_fmmu_overlap() {
        // 0x10000, 4 bytes, all bits, to 0x1100, read
        let fmmu = fmmu([0, 0, 1, 0, 4, 0, 0, 7, 0x00, 0x11, 0, 1, 1, 0, 0, 0]);
        let mapped = fmmu.map(0xFFFE, 4).unwrap();
        assert_eq!((mapped.bytes(), mapped.address), (Some(2..4), 0x1100));
        let mapped = fmmu.map(0x1_0001, 100).unwrap();
        assert_eq!((mapped.bytes(), mapped.address), (Some(0..3), 0x1101));
        assert_eq!(fmmu.map(0x1_0004, 100), None);
        assert_eq!(fmmu.map(0xFFFC, 4), None);
        assert_eq!(fmmu.map(u32::MAX, 2), None);
    }

    #[test]
    fn only_whole_bytes_that_lie_on_whole_bytes_are_copied_as_bytes() {
        for (bits, bit, bytes, touched) in [
            (0..16, 0, Some(0..2), 2),
            (8..16, 0, Some(1..2), 1),
            (5..6, 0, None, 1),
            (4..8, 0, None, 1),
            (0..4, 0, None, 1),
            (7..8, 3, None, 1),
            (0..8, 3, None, 2),
            (6..10, 6, None, 2),
            (0..24, 1, None, 4),
        ] {
            let mapped = Mapped { bits: bits.clone(), address: 0x1000, bit };
            assert_eq!((mapped.bytes(), mapped.physical_len()), (bytes, touched), "{bits:?} to bit {bit}");
        }
    }

    #[test]
    fn an_fmmu_that_is_not_active_or_has_no_length_maps_nothing() {
        let all = [0, 0, 0, 0, 4, 0, 0, 7, 0x00, 0x11, 0, 3, 1, 0, 0, 0];
        assert!(fmmu(all).map(0, 4).is_some());
        let (mut off, mut empty) = (all, all);
        off[12] = 0;
        empty[4] = 0;
        assert_eq!((fmmu(off).map(0, 4), fmmu(empty).map(0, 4)), (None, None));
    }

    #[test]
    fn four_bits_across_a_byte_are_mapped_to_four_bits_within_one() {
        // The example of the datasheet's chapter on FMMUs, its sides exchanged: logical bits 6..10, physical bits 1..5.
        let fmmu = fmmu([0, 0, 0, 0, 2, 0, 6, 1, 0x00, 0x11, 1, 2, 1, 0, 0, 0]);
        let mapped = fmmu.map(0, 2).unwrap();
        assert_eq!(mapped, Mapped { bits: 6..10, address: 0x1100, bit: 1 });
        assert_eq!((mapped.bytes(), mapped.physical_len()), (None, 1));
        let mut memory = [0b1111_1111];
        copy_bits(&[0b0100_0000, 0b0000_0010], 6, &mut memory, 1, 4);
        assert_eq!(memory, [0b1111_0011]);
    }
}
