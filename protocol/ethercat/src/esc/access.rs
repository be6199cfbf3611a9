//! What an access of the MainDevice to an address does. It counts in the working counter if at least one
//! byte could be read or written.

use core::mem;
use core::ops::Range;

use machine::Instant;

use super::registers::{self, FMMU, FMMU_LEN, SYNC_MANAGER, SYNC_MANAGER_LEN, UNITS};
use super::{EVENT_AL_STATUS, EVENT_DL_STATUS, Esc, Fmmu};

/// The addresses of an access.
#[derive(Clone, Copy)]
struct Span {
    start: u32,
    end: u32,
}

impl Span {
    fn new(address: u16, len: usize) -> Self {
        let start = u32::from(address);
        Self { start, end: start + u32::try_from(len).unwrap_or(0) }
    }

    fn touches(self, register: u16, len: u16) -> bool {
        self.start < u32::from(register) + u32::from(len) && u32::from(register) < self.end
    }
}

impl Esc {
    /// Reads memory into `data`; bytes that cannot be read stay as they are. Returns whether one could.
    pub(super) fn read(&mut self, now: Instant, address: u16, data: &mut [u8]) -> bool {
        let (registers, ram) = split(address, data.len());
        let Some((registers, ram)) =
            data.split_at_mut_checked(registers).filter(|(_, rest)| rest.len() == ram)
        else {
            return false;
        };
        let read = !registers.is_empty() && self.read_registers(now, address, registers);
        let ram_start = address.saturating_add(registers.len() as u16);
        (!ram.is_empty() && self.read_ram(ram_start, ram)) || read
    }

    /// Writes `data` to memory, where that is allowed. Returns whether one byte was.
    pub(super) fn write(&mut self, address: u16, data: &[u8]) -> bool {
        let (registers, _) = split(address, data.len());
        let Some((registers, ram)) = data.split_at_checked(registers) else { return false };
        let written = !registers.is_empty() && self.write_registers(address, registers);
        let ram_start = address.saturating_add(registers.len() as u16);
        (!ram.is_empty() && self.write_ram(ram_start, ram)) || written
    }

    fn read_registers(&mut self, now: Instant, address: u16, data: &mut [u8]) -> bool {
        let span = Span::new(address, data.len());
        if span.touches(registers::EVENTS, 2) {
            let events = self.events();
            self.memory.set(registers::EVENTS, &events.to_le_bytes());
        }
        if let Some(clock) = self.clock.as_ref().filter(|_| span.touches(registers::SYSTEM_TIME, 0x90)) {
            clock.refresh(now, &mut self.memory);
        }
        let mut read = false;
        for (address, byte) in (address..).zip(data) {
            if self.map.writable(address).is_some() {
                *byte = self.memory.u8(address);
                read = true;
            }
        }
        if span.touches(registers::AL_STATUS, 2) {
            self.events &= !EVENT_AL_STATUS;
        }
        if span.touches(registers::DL_STATUS, 2) {
            self.events &= !EVENT_DL_STATUS;
        }
        read
    }

    /// Returns whether a write by the MainDevice changes a register now.
    fn accepts(&self, address: u16) -> bool {
        let blocked = match address {
            registers::SII_CONTROL..registers::SII_END => !self.sii.is_free(&self.memory),
            registers::SYNC_ACTIVATION | registers::SYNC_START..registers::SYNC_END => {
                self.memory.u8(registers::CYCLIC_CONTROL) & 1 != 0
            }
            _ => self.is_locked_configuration(address),
        };
        !blocked && self.map.writable(address).is_some_and(|bits| bits != 0)
    }

    /// Keeps what is written to registers until the whole frame has passed, as a chip does.
    fn write_registers(&mut self, address: u16, data: &[u8]) -> bool {
        let accepts = |address| self.accepts(address);
        let written = (address..).zip(data).any(|(address, _)| accepts(address));
        if written {
            self.shadow.extend_from_slice(&address.to_le_bytes());
            self.shadow.extend_from_slice(&(data.len() as u16).to_le_bytes());
            self.shadow.extend_from_slice(data);
        }
        written
    }

    /// Applies what takes effect once a frame has passed: registers get their values, and buffers go to the other side.
    pub(crate) fn end_frame(&mut self, now: Instant) {
        let shadow = mem::take(&mut self.shadow);
        let mut rest = &shadow[..];
        while let Some((&[a, b, c, d], behind)) = rest.split_first_chunk() {
            let len = usize::from(u16::from_le_bytes([c, d]));
            let Some((data, behind)) = behind.split_at_checked(len) else { break };
            self.apply(now, u16::from_le_bytes([a, b]), data);
            rest = behind;
        }
        self.shadow = shadow;
        self.shadow.clear();
        self.advance_reset();
        self.latches_ports = false;
        for index in 0..self.sync_managers.len() {
            self.end_buffer(now, index);
        }
    }

    fn apply(&mut self, now: Instant, address: u16, data: &[u8]) {
        let span = Span::new(address, data.len());
        let starts_command =
            self.accepts(registers::SII_CONTROL + 1) && span.touches(registers::SII_CONTROL, 2);
        for (address, byte) in (address..).zip(data) {
            // What is written to the receive times is not stored.
            if self.accepts(address)
                && address != registers::RECEIVE_TIMES
                && let Some(bits) = self.map.writable(address)
            {
                self.memory.change(address, |old| old & !bits | byte & bits);
            }
        }
        if starts_command {
            self.sii.execute(now, &mut self.memory);
        }
        self.after_write(now, span, data);
    }

    /// Gives a buffer to the other side if the frame reached its end.
    fn end_buffer(&mut self, now: Instant, index: usize) {
        let Some(sync_manager) = self.sync_managers.get_mut(index) else { return };
        if !sync_manager.end_frame(&mut self.memory, index) {
            return;
        }
        if sync_manager.is_written_by_main_device() {
            self.changes.written |= 1 << index;
            if sync_manager.triggers_watchdog {
                self.watchdog.trigger(now, &mut self.memory);
            }
        } else {
            self.changes.read |= 1 << index;
        }
    }

    /// Returns whether this is the configuration of an active sync manager, which cannot be changed.
    fn is_locked_configuration(&self, address: u16) -> bool {
        let Some(offset) = address.checked_sub(SYNC_MANAGER) else { return false };
        let (index, register) = (offset / SYNC_MANAGER_LEN, offset % SYNC_MANAGER_LEN);
        index < u16::from(UNITS)
            && register < 5
            && self.memory.u8(SYNC_MANAGER + index * SYNC_MANAGER_LEN + 6) & 1 != 0
    }

    /// Does what a write to a register starts.
    fn after_write(&mut self, now: Instant, span: Span, data: &[u8]) {
        if span.touches(registers::RESET, 1) {
            self.reset_letter = Some(data.first().copied().unwrap_or(0));
        }
        if span.touches(registers::WATCHDOG_TIME, 2) {
            self.watchdog.change_time(&mut self.memory);
        }
        if span.touches(registers::DL_CONTROL + 1, 1) {
            self.open_loops();
        }
        self.changes.al_control |= span.touches(registers::AL_CONTROL, 1);
        // A write to one counter of a group clears the whole group.
        for (start, len) in [
            (registers::ERROR_COUNTERS, 0x0C),
            (registers::PROCESSING_ERRORS, 1),
            (registers::PDI_ERRORS, 1),
            (registers::LOST_LINKS, 4),
            (registers::WATCHDOG_COUNTER, 2),
        ] {
            if span.touches(start, len) {
                self.memory.get_mut(start, usize::from(len)).fill(0);
            }
        }
        let units = u16::from(UNITS);
        if span.touches(FMMU, units * FMMU_LEN) {
            for (index, fmmu) in (0..).zip(&mut self.fmmus) {
                *fmmu = Fmmu::read(&self.memory, index);
            }
        }
        if span.touches(SYNC_MANAGER, units * SYNC_MANAGER_LEN) {
            for (index, sync_manager) in self.sync_managers.iter_mut().enumerate() {
                sync_manager.update(&mut self.memory, index);
            }
            self.changes.sync_managers = true;
        }
        self.after_clock_write(now, span);
    }

    fn after_clock_write(&mut self, now: Instant, span: Span) {
        let Some(clock) = &mut self.clock else { return };
        let memory = &mut self.memory;
        if span.touches(registers::RECEIVE_TIMES, 1) {
            clock.latch(now, self.latches_ports, memory);
        }
        if span.touches(registers::SYSTEM_TIME, 1) {
            let received = memory.u32(registers::SYSTEM_TIME);
            clock.compare(now, received, memory);
        }
        if span.touches(registers::SPEED_COUNTER_START, 2) {
            clock.reset_loop(now, memory);
        }
        if span.touches(registers::SYNC_ACTIVATION, 1) {
            clock.activate(now, memory);
        }
    }

    /// Resets the chip once R, E and S are written by three frames one after another, and shows how many there were.
    fn advance_reset(&mut self) {
        self.reset_letters = match (self.reset_letters, self.reset_letter.take()) {
            (_, Some(b'R')) => 1,
            (1, Some(b'E')) => 2,
            (2, Some(b'S')) => {
                self.changes.reset = true;
                0
            }
            _ => 0,
        };
        self.memory.set(registers::RESET, &[self.reset_letters]);
    }

    /// Returns the sync manager that guards an address of the RAM, and where the memory that it guards ends, or the next
    /// guarded one begins.
    fn guard(&self, address: u32, end: u32) -> (Option<usize>, u32) {
        let mut until = end;
        for (index, sync_manager) in self.sync_managers.iter().enumerate().filter(|(_, unit)| unit.guards()) {
            let start = u32::from(sync_manager.start);
            if (start..sync_manager.end()).contains(&address) {
                // A piece ends with the first buffer: the two buffers behind it are for the device alone.
                let first = start + u32::from(sync_manager.len);
                let until = if address < first { first } else { sync_manager.end() };
                return (Some(index), until.min(end));
            }
            if start > address {
                until = until.min(start);
            }
        }
        (None, until)
    }

    fn read_ram(&mut self, address: u16, data: &mut [u8]) -> bool {
        let mut read = false;
        self.each_part(address, data.len(), |esc, guard, address, part| {
            let len = part.len();
            if guard.is_some_and(|index| !esc.access(index, false, address, len)) {
                return;
            }
            let memory = esc.memory.get(address, len);
            let Some(data) = data.get_mut(part).filter(|data| data.len() == memory.len()) else { return };
            data.copy_from_slice(memory);
            read = true;
        });
        read
    }

    fn write_ram(&mut self, address: u16, data: &[u8]) -> bool {
        let mut written = false;
        self.each_part(address, data.len(), |esc, guard, address, part| {
            let len = part.len();
            if guard.is_some_and(|index| !esc.access(index, true, address, len)) {
                return;
            }
            let memory = esc.memory.get_mut(address, len);
            let Some(data) = data.get(part).filter(|data| data.len() == memory.len()) else { return };
            memory.copy_from_slice(data);
            written = true;
        });
        written
    }

    /// Calls `part` with each piece of the memory that one sync manager guards, or none: the sync manager, the address,
    /// and where the piece is in the data.
    fn each_part(
        &mut self,
        address: u16,
        len: usize,
        mut part: impl FnMut(&mut Self, Option<usize>, u16, Range<usize>),
    ) {
        // Without its configuration, the chip gives no access to the RAM.
        if !self.is_loaded() {
            return;
        }
        let Span { start, end } = Span::new(address, len);
        let end = end.min(self.memory.len() as u32);
        let mut at = start;
        while at < end {
            let (guard, until) = self.guard(at, end);
            part(self, guard, at as u16, (at - start) as usize..(until - start) as usize);
            at = until;
        }
    }

    /// Returns whether a sync manager lets an access pass.
    fn access(&mut self, index: usize, write: bool, address: u16, len: usize) -> bool {
        let sync_manager = self.sync_managers.get_mut(index);
        sync_manager.is_some_and(|unit| unit.access(&mut self.memory, index, write, address, len))
    }
}

/// Returns how many bytes of an access are registers, and how many are RAM. A sync manager of a terminal with digital outputs
/// guards their register, as if it were RAM (ET1100, register 0x0F00).
fn split(address: u16, len: usize) -> (usize, usize) {
    let is_digital = registers::DIGITAL_OUTPUTS.contains(&address) && len <= registers::DIGITAL_OUTPUTS.len();
    let registers = if is_digital { 0 } else { usize::from(registers::END.saturating_sub(address)).min(len) };
    (registers, len - registers)
}
