//! The device's own side of the chip, as its application and its ports use it.

use machine::{Duration, Instant};

use super::clock::{Clock, Sync};
use super::registers;
use super::sync_manager::SyncManager;
use super::{EVENT_AL_STATUS, EVENT_DL_STATUS, Esc};

/// Loop control of a port; 0 is automatic.
const AUTO_CLOSE: u8 = 1;
const ALWAYS_OPEN: u8 = 2;
const ALWAYS_CLOSED: u8 = 3;

impl Esc {
    /// Returns whether the configuration in the EEPROM was loaded.
    pub(crate) fn is_loaded(&self) -> bool {
        self.memory.u8(registers::DL_STATUS) & 1 != 0
    }

    pub(crate) fn al_control(&self) -> u16 {
        self.memory.u16(registers::AL_CONTROL)
    }

    pub(crate) fn set_al_status(&mut self, status: u8, code: u16) {
        self.memory.set(registers::AL_STATUS, &[status]);
        self.memory.set(registers::AL_STATUS_CODE, &code.to_le_bytes());
        self.events |= EVENT_AL_STATUS;
    }

    /// Gives the chip another port, which is MII as well.
    pub(crate) fn add_port(&mut self, port: usize) {
        self.ports |= 0x03_u8.checked_shl(2 * port as u32).unwrap_or(0);
        self.memory.set(registers::PORT_DESCRIPTOR, &[self.ports]);
    }

    /// Shows which ports have a link, and which of them are closed.
    pub(crate) fn set_ports(&mut self, linked: [bool; 4]) {
        self.linked = linked;
        let mut status = self.memory.u16(registers::DL_STATUS) & 0x000F;
        for (port, linked) in (0..).zip(linked) {
            let before = self.memory.u16(registers::DL_STATUS) & (0x0010 << port) != 0;
            if before && !linked {
                // Counted at a loop that is open and closes by itself.
                let counts = !self.is_loop_closed_at(port, true) && self.loop_control(port) <= AUTO_CLOSE;
                if counts {
                    self.memory.change(registers::LOST_LINKS + port, |lost| lost.saturating_add(1));
                }
                let waits = self.loop_control(port) == AUTO_CLOSE;
                if let Some(waiting) = self.waiting.get_mut(usize::from(port)) {
                    *waiting = waits;
                }
            }
            status |= u16::from(linked) << (4 + port);
            status |= u16::from(self.is_loop_closed(port)) << (8 + 2 * port);
            status |= u16::from(linked) << (9 + 2 * port);
        }
        self.memory.set(registers::DL_STATUS, &status.to_le_bytes());
        self.events |= EVENT_DL_STATUS;
    }

    fn loop_control(&self, port: u16) -> u8 {
        self.memory.u8(registers::DL_CONTROL + 1) >> (2 * port) & 3
    }

    /// Follows a write to loop control, which opens the loops that waited for such a write.
    pub(super) fn open_loops(&mut self) {
        self.waiting = [false; 4];
        self.set_ports(self.linked);
    }

    /// Returns whether a loop is closed, as DL status shows it.
    fn is_loop_closed(&self, port: u16) -> bool {
        self.is_loop_closed_at(port, self.linked.get(usize::from(port)).copied().unwrap_or(false))
    }

    /// Returns whether the loop of a port with or without link is closed.
    fn is_loop_closed_at(&self, port: u16, linked: bool) -> bool {
        match self.loop_control(port) {
            ALWAYS_OPEN => false,
            ALWAYS_CLOSED => true,
            _ => !linked || self.waiting.get(usize::from(port)).copied().unwrap_or(false),
        }
    }

    /// Returns whether frames pass a port. If all are closed, port 0 stays open, so that the MainDevice can open
    /// the others again.
    pub(crate) fn is_open(&self, port: usize) -> bool {
        !self.is_loop_closed(port as u16) || (port == 0 && (1..4).all(|port| self.is_loop_closed(port)))
    }

    pub(crate) fn sync_manager(&self, index: usize) -> SyncManager {
        self.sync_managers.get(index).copied().unwrap_or_default()
    }

    /// Returns the control register of a sync manager.
    pub(crate) fn sync_manager_control(&self, index: usize) -> u8 {
        self.memory.u8(registers::SYNC_MANAGER + index as u16 * registers::SYNC_MANAGER_LEN + 4)
    }

    /// Returns what the MainDevice wrote last through a sync manager; a mailbox becomes empty.
    pub(crate) fn take(&mut self, index: usize) -> Option<&[u8]> {
        self.sync_managers.get(index)?.take(&mut self.memory, index)
    }

    /// Passes data to the MainDevice through a sync manager. Returns whether there was room.
    pub(crate) fn put(&mut self, index: usize, data: &[u8]) -> bool {
        self.sync_managers.get(index).is_some_and(|unit| unit.put(&mut self.memory, index, data))
    }

    pub(crate) fn lock(&mut self, index: usize, locked: bool) {
        if let Some(sync_manager) = self.sync_managers.get_mut(index) {
            sync_manager.lock(&mut self.memory, index, locked);
        }
    }

    /// Shows the bit of the request for a repetition that was served last.
    pub(crate) fn acknowledge_repeat(&mut self, index: usize, bit: bool) {
        SyncManager::acknowledge_repeat(&mut self.memory, index, bit);
    }

    pub(crate) fn start_watchdog(&mut self, now: Instant) {
        self.watchdog.trigger(now, &mut self.memory);
    }

    /// Returns whether the watchdog has just expired.
    pub(crate) fn watchdog_expires(&mut self, now: Instant) -> bool {
        self.watchdog.expire(now, &mut self.memory)
    }

    /// Returns the next SYNC signal that is due, with its system time in nanoseconds.
    pub(crate) fn pulse(&mut self, now: Instant) -> Option<(Sync, u64)> {
        self.clock.as_mut()?.pulse(now, &self.memory)
    }

    /// Returns whether the MainDevice requests SYNC signals, and whether the clock makes them.
    pub(crate) fn sync_signals(&self) -> (bool, bool) {
        let wanted = self.memory.u8(registers::SYNC_ACTIVATION) & 0x07;
        (wanted & 1 != 0 && wanted & 6 != 0, self.clock.as_ref().is_some_and(Clock::makes_pulses))
    }

    /// Returns the time from one SYNC signal to the next, if the clock makes some.
    pub(crate) fn sync_period(&self) -> Option<Duration> {
        self.clock.as_ref().and_then(Clock::period)
    }

    /// Returns when the next SYNC signal is due.
    pub(crate) fn next_pulse(&self) -> Option<Instant> {
        self.clock.as_ref().and_then(|clock| clock.deadline(&self.memory))
    }

    /// Returns the local copy of the system time in nanoseconds.
    pub(crate) fn system_time(&self, now: Instant) -> Option<u64> {
        Some(self.clock.as_ref()?.system(now, &self.memory))
    }

    /// Returns when watchdog or clock need attention.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        Instant::earlier(self.next_pulse(), self.watchdog.deadline(&self.memory))
    }
}
