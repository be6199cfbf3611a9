//! The memory of the chip as bytes: registers, then process data RAM. Numbers are little-endian.

use alloc::boxed::Box;
use alloc::vec;

use super::registers;
use crate::layout::{LONGEST_RAM, RAM_LEN, RAM_START};

/// The bytes. An access beyond them has no effect.
#[derive(Debug)]
pub(crate) struct Memory(Box<[u8]>);

impl Memory {
    /// Creates a memory whose process data RAM has this many bytes, [`RAM_LEN`] at least.
    pub(crate) fn new(ram: u16) -> Self {
        let ram = ram.clamp(RAM_LEN, LONGEST_RAM);
        Self(vec![0; usize::from(RAM_START) + usize::from(ram)].into_boxed_slice())
    }

    /// Sets what is there after power-on.
    pub(crate) fn reset(&mut self) {
        self.0.fill(0);
        for (address, bytes) in registers::POWER_ON {
            self.set(*address, bytes);
        }
        // In KiB.
        let ram = self.0.len().saturating_sub(usize::from(RAM_START)) >> 10;
        self.set(registers::RAM_SIZE, &[ram as u8]);
    }

    /// Returns the length in bytes.
    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// Returns `len` bytes from an address; none if they are not all there.
    pub(crate) fn get(&self, address: u16, len: usize) -> &[u8] {
        let start = usize::from(address);
        self.0.get(start..start.saturating_add(len)).unwrap_or_default()
    }

    pub(crate) fn get_mut(&mut self, address: u16, len: usize) -> &mut [u8] {
        let start = usize::from(address);
        self.0.get_mut(start..start.saturating_add(len)).unwrap_or_default()
    }

    /// Copies bytes to an address, if there is room for all of them.
    pub(crate) fn set(&mut self, address: u16, bytes: &[u8]) {
        let room = self.get_mut(address, bytes.len());
        if room.len() == bytes.len() {
            room.copy_from_slice(bytes);
        }
    }

    /// Copies bytes within the memory.
    pub(crate) fn copy(&mut self, from: u16, to: u16, len: usize) {
        let (from, to) = (usize::from(from), usize::from(to));
        if from.max(to).saturating_add(len) <= self.0.len() {
            self.0.copy_within(from..from + len, to);
        }
    }

    fn array<const N: usize>(&self, address: u16) -> [u8; N] {
        self.get(address, N).first_chunk().copied().unwrap_or([0; N])
    }

    pub(crate) fn u8(&self, address: u16) -> u8 {
        u8::from_le_bytes(self.array(address))
    }

    pub(crate) fn u16(&self, address: u16) -> u16 {
        u16::from_le_bytes(self.array(address))
    }

    pub(crate) fn u32(&self, address: u16) -> u32 {
        u32::from_le_bytes(self.array(address))
    }

    pub(crate) fn u64(&self, address: u16) -> u64 {
        u64::from_le_bytes(self.array(address))
    }

    /// Changes a byte.
    pub(crate) fn change(&mut self, address: u16, change: impl FnOnce(u8) -> u8) {
        if let [byte] = self.get_mut(address, 1) {
            *byte = change(*byte);
        }
    }
}
