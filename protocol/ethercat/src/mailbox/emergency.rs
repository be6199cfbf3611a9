//! Emergencies: errors that a device reports by itself (ETG.1000.6, 5.6.4).

use super::{Outbox, coe};

/// Largest number of emergencies that wait.
const CAPACITY: usize = 8;

/// An error that a device reports by itself.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Emergency {
    /// Error code, as the device profile defines it.
    pub code: u16,
    /// Error register, object 0x1001.
    pub register: u8,
    /// Bytes whose meaning the vendor defines.
    pub data: [u8; 5],
}

/// Emergencies that wait for the mailbox.
#[derive(Default, Debug)]
pub(super) struct Emergencies {
    waiting: [Emergency; CAPACITY],
    first: usize,
    count: usize,
}

impl Emergencies {
    /// Appends one. Returns whether there was room.
    pub(super) fn push(&mut self, emergency: Emergency) -> bool {
        let free = self.count < CAPACITY;
        if let Some(slot) = self.waiting.get_mut((self.first + self.count) % CAPACITY).filter(|_| free) {
            *slot = emergency;
            self.count += 1;
        }
        free
    }

    /// Writes the first one as the next message. Returns whether there was one.
    pub(super) fn write(&mut self, outbox: &mut Outbox) -> bool {
        let Some(emergency) = self.waiting.get(self.first).filter(|_| self.count > 0) else { return false };
        coe::write(outbox, coe::EMERGENCY, |writer| {
            writer.u16(emergency.code);
            writer.u8(emergency.register);
            writer.bytes(&emergency.data);
        });
        self.first = (self.first + 1) % CAPACITY;
        self.count -= 1;
        true
    }
}
