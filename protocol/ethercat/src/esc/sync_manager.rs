//! Sync managers: buffers of process data and mailboxes in the RAM, each written from one side and read from the other
//! (ESC datasheet section I, SyncManager).
//!
//! In three-buffer mode the MainDevice sees the first of three areas of the same length; the chip exchanges buffers
//! behind it. Here the second area holds the newest complete data, copied when a side completes a buffer or opens one:
//! the same bytes at the same accesses.

use super::memory::Memory;
use super::registers;

/// Status bits.
const INTERRUPT_WRITE: u8 = 0x01;
const INTERRUPT_READ: u8 = 0x02;
const MAILBOX_FULL: u8 = 0x08;
const BUFFER_MASK: u8 = 0x30;
const NO_BUFFER_WRITTEN: u8 = 0x30;

/// A sync manager's registers, and which side has opened its buffer.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(crate) struct SyncManager {
    active: bool,
    /// Locked by the device's application.
    locked: bool,
    mailbox: bool,
    /// The MainDevice writes, the device reads.
    written_by_main_device: bool,
    pub(crate) triggers_watchdog: bool,
    pub(crate) start: u16,
    pub(crate) len: u16,
    /// The MainDevice has begun with the first byte.
    open: bool,
    /// The MainDevice has reached the last byte in this frame.
    ended: bool,
    repeat_request: bool,
}

/// Returns the address of a register of sync manager `index`.
const fn register(index: usize, offset: u16) -> u16 {
    registers::SYNC_MANAGER + (index as u16) * registers::SYNC_MANAGER_LEN + offset
}

impl SyncManager {
    /// Reads the registers after one of them was written. A sync manager that becomes active starts empty; one that is
    /// switched off has its status of power-on again.
    pub(crate) fn update(&mut self, memory: &mut Memory, index: usize) {
        let control = memory.u8(register(index, 4));
        let activation = memory.u8(register(index, 6));
        let was_active = self.is_active();
        self.active = activation & 1 != 0;
        self.repeat_request = activation & 2 != 0;
        self.locked = memory.u8(register(index, 7)) & 1 != 0;
        self.mailbox = control & 3 == 2;
        self.written_by_main_device = control & 0x0C == 0x04;
        self.triggers_watchdog = control & 0x40 != 0;
        self.start = memory.u16(register(index, 0));
        self.len = memory.u16(register(index, 2));
        if self.is_active() != was_active {
            (self.open, self.ended) = (false, false);
            let is_mailbox = self.mailbox && self.is_active();
            memory.set(register(index, 5), &[if is_mailbox { 0 } else { NO_BUFFER_WRITTEN }]);
        }
    }

    /// Sets the status after power-on.
    pub(crate) fn reset(memory: &mut Memory, index: usize) {
        memory.set(register(index, 5), &[NO_BUFFER_WRITTEN]);
    }

    pub(crate) const fn is_active(&self) -> bool {
        self.active && !self.locked
    }

    /// Returns whether it guards memory; a locked one does so, too.
    pub(crate) const fn guards(&self) -> bool {
        self.active && self.len > 0
    }

    /// Returns the end of the memory that it guards.
    pub(crate) const fn end(&self) -> u32 {
        let buffers = if self.mailbox || self.is_single() { 1 } else { 3 };
        self.start as u32 + self.len as u32 * buffers
    }

    pub(crate) const fn is_written_by_main_device(&self) -> bool {
        self.written_by_main_device
    }

    /// Returns whether the MainDevice asks for the last message once more: the bit changes with every request.
    pub(crate) const fn repeat_request(&self) -> bool {
        self.repeat_request
    }

    /// Returns whether it is a mailbox with a message in it.
    pub(crate) fn is_full(&self, memory: &Memory, index: usize) -> bool {
        self.is_active() && self.mailbox && memory.u8(register(index, 5)) & MAILBOX_FULL != 0
    }

    /// Returns whether it is one byte long, which needs no buffers: every access passes.
    const fn is_single(&self) -> bool {
        self.len == 1
    }

    /// Prepares an access of the MainDevice to `len` bytes from `address`, which is within what it guards. Returns whether
    /// the access may take place.
    pub(crate) fn access(
        &mut self,
        memory: &mut Memory,
        index: usize,
        write: bool,
        address: u16,
        len: usize,
    ) -> bool {
        let own_direction = write == self.written_by_main_device;
        if self.is_single() && !self.locked {
            self.ended |= own_direction;
            return true;
        }
        let offset = usize::from(address.saturating_sub(self.start));
        let status = memory.u8(register(index, 5));
        let ready = match (self.mailbox, write) {
            (true, write) => (status & MAILBOX_FULL != 0) != write,
            (false, true) => true,
            // The device has to write a buffer before one can be read.
            (false, false) => status & BUFFER_MASK != NO_BUFFER_WRITTEN,
        };
        let within = offset.saturating_add(len) <= usize::from(self.len);
        if !self.is_active() || !own_direction || !within || !ready || self.ended {
            return false;
        }
        if offset == 0 {
            self.open = true;
            if !write && !self.mailbox {
                memory.copy(self.newest(), self.start, usize::from(self.len));
            }
        }
        let open = self.open;
        if open && offset + len == usize::from(self.len) {
            (self.open, self.ended) = (false, true);
        }
        open
    }

    /// Ends a frame: if the MainDevice reached the last byte, the buffer goes to the other side. Returns whether it did.
    pub(crate) fn end_frame(&mut self, memory: &mut Memory, index: usize) -> bool {
        let ended = core::mem::take(&mut self.ended);
        if ended && self.is_active() {
            self.complete(memory, index);
        }
        ended && self.is_active()
    }

    /// Marks the buffer as complete, after the MainDevice wrote or read its last byte.
    fn complete(&self, memory: &mut Memory, index: usize) {
        if self.written_by_main_device && !self.mailbox {
            memory.copy(self.start, self.newest(), usize::from(self.len));
        }
        let (mailbox, write) = (self.mailbox, self.written_by_main_device);
        memory.change(register(index, 5), |status| match (mailbox, write) {
            (true, true) => status & !INTERRUPT_READ | INTERRUPT_WRITE | MAILBOX_FULL,
            (true, false) => status & !(INTERRUPT_WRITE | MAILBOX_FULL) | INTERRUPT_READ,
            (false, true) => next_buffer(status) & !INTERRUPT_READ | INTERRUPT_WRITE,
            (false, false) => status & !INTERRUPT_WRITE | INTERRUPT_READ,
        });
    }

    /// Returns the data that the MainDevice completed last, for the device, or `None` before the first; a mailbox
    /// becomes empty.
    pub(crate) fn take<'a>(&self, memory: &'a mut Memory, index: usize) -> Option<&'a [u8]> {
        let status = memory.u8(register(index, 5));
        if !self.is_active() || !self.written_by_main_device {
            return None;
        }
        if self.mailbox {
            if status & MAILBOX_FULL == 0 {
                return None;
            }
            let taken = status & !(INTERRUPT_WRITE | MAILBOX_FULL) | INTERRUPT_READ;
            memory.set(register(index, 5), &[taken]);
            return Some(memory.get(self.start, usize::from(self.len)));
        }
        if status & BUFFER_MASK == NO_BUFFER_WRITTEN {
            return None;
        }
        memory.set(register(index, 5), &[status & !INTERRUPT_WRITE | INTERRUPT_READ]);
        Some(memory.get(self.newest(), usize::from(self.len)))
    }

    /// Passes data of the device to the MainDevice. Returns whether there was room: a mailbox may still be full.
    pub(crate) fn put(&self, memory: &mut Memory, index: usize, data: &[u8]) -> bool {
        let status = memory.u8(register(index, 5));
        let len = usize::from(self.len);
        if !self.is_active() || self.written_by_main_device || data.len() > len {
            return false;
        }
        if self.mailbox {
            if status & MAILBOX_FULL != 0 {
                return false;
            }
            let room = memory.get_mut(self.start, len);
            if let Some((message, rest)) = room.split_at_mut_checked(data.len()) {
                message.copy_from_slice(data);
                rest.fill(0);
            }
            memory.set(register(index, 5), &[status & !INTERRUPT_READ | INTERRUPT_WRITE | MAILBOX_FULL]);
        } else {
            memory.set(self.newest(), data);
            memory.set(register(index, 5), &[next_buffer(status) & !INTERRUPT_READ | INTERRUPT_WRITE]);
        }
        true
    }

    /// Locks or frees the memory, as the device's application does.
    pub(crate) fn lock(&mut self, memory: &mut Memory, index: usize, locked: bool) {
        memory.change(register(index, 7), |control| control & !1 | u8::from(locked));
        self.update(memory, index);
    }

    /// Confirms to the MainDevice that its request for a repetition was served.
    pub(crate) fn acknowledge_repeat(memory: &mut Memory, index: usize, bit: bool) {
        memory.change(register(index, 7), |control| control & !2 | u8::from(bit) << 1);
    }

    /// Returns the address of the newest complete data in three-buffer mode.
    const fn newest(&self) -> u16 {
        if self.is_single() { self.start } else { self.start.saturating_add(self.len) }
    }
}

/// Returns the status with the next of the buffers 0, 1, 2 as the one written last.
const fn next_buffer(status: u8) -> u8 {
    let written = (status & BUFFER_MASK) >> 4;
    let next = if written >= 2 { 0 } else { written + 1 };
    status & !BUFFER_MASK | next << 4
}
