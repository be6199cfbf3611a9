//! The EtherCAT SubDevice Controller: the chip that reads and changes frames while they pass.
//!
//! | module | what |
//! |---|---|
//! | `access` | what an access of the MainDevice to an address does |
//! | `local` | the device's own side: states, ports, buffers, what runs by itself |
//! | `registers`, `memory` | which addresses there are, and their bytes |
//! | `fmmu`, `sync_manager` | mapping of the logical image; buffers and mailboxes |
//! | `sii` | the EEPROM's interface |
//! | `watchdog`, `clock` | what runs by itself |

mod access;
mod clock;
mod fmmu;
mod local;
mod memory;
pub(crate) mod registers;
mod sii;
mod sync_manager;
mod watchdog;

use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;
use core::mem;

use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant};

use crate::datagram::{Addressing, Datagram, MAX_DATA_LEN, Operation, decode};
use clock::Clock;
pub use clock::LocalClock;
pub(crate) use clock::Sync;
use fmmu::Fmmu;
pub(crate) use fmmu::copy_bits;
use memory::Memory;
use registers::RegisterMap;
use sii::Sii;
pub use sii::checksum;
use sync_manager::SyncManager;
use watchdog::Watchdog;

/// What frames changed, for the device's application.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Changes {
    /// AL control was written.
    pub(crate) al_control: bool,
    /// Sync managers whose buffer the MainDevice wrote to its end, one bit for each.
    pub(crate) written: u8,
    /// Sync managers whose buffer the MainDevice read to its end.
    pub(crate) read: u8,
    /// A sync manager's registers were written.
    pub(crate) sync_managers: bool,
    /// The MainDevice reset the chip.
    pub(crate) reset: bool,
}

/// A chip.
#[derive(Debug)]
pub(crate) struct Esc {
    memory: Memory,
    map: RegisterMap,
    fmmus: [Fmmu; registers::UNITS as usize],
    sync_managers: [SyncManager; registers::UNITS as usize],
    sii: Sii,
    watchdog: Watchdog,
    clock: Option<Clock>,
    local_clock: LocalClock,
    changes: Changes,
    /// Port descriptor: the ports that there are.
    ports: u8,
    /// Ports with a link.
    linked: [bool; 4],
    /// Letters of the reset sequence seen so far, and the one in this frame.
    reset_letters: u8,
    reset_letter: Option<u8>,
    /// This frame contains a command that latches the receive times of the ports, if it writes to them.
    latches_ports: bool,
    /// Ports that stay closed although their link is back, as loop control "auto close" requires.
    waiting: [bool; 4],
    /// What this frame writes to registers: address, length and data of each write.
    shadow: Vec<u8>,
    /// AL status and DL status changed since they were read.
    events: u16,
    /// Room for the data of a datagram as it came, and for memory that is mapped bit by bit.
    scratch: Box<[u8]>,
}

/// Bits of the event request.
const EVENT_DL_STATUS: u16 = 0x0004;
const EVENT_AL_STATUS: u16 = 0x0008;

impl Esc {
    pub(crate) fn new(image: Vec<u8>, sii_delay: Duration, clock: Option<LocalClock>, ram: u16) -> Self {
        let mut esc = Self {
            memory: Memory::new(ram),
            map: RegisterMap::new(clock.is_some()),
            fmmus: Default::default(),
            sync_managers: Default::default(),
            sii: Sii::new(image, sii_delay),
            watchdog: Watchdog::default(),
            clock: clock.map(|local| Clock::new(Instant::ZERO, local)),
            local_clock: clock.unwrap_or_default(),
            changes: Changes::default(),
            // Ports 0 and 1 are MII.
            ports: 0x0F,
            linked: [false; 4],
            waiting: [false; 4],
            shadow: Vec::with_capacity(2 * FRAME_CAPACITY),
            reset_letters: 0,
            reset_letter: None,
            latches_ports: false,
            events: 0,
            scratch: vec![0; 2 * MAX_DATA_LEN.next_power_of_two()].into_boxed_slice(),
        };
        esc.reset(Instant::ZERO);
        esc
    }

    /// Sets everything to its value after power-on.
    pub(crate) fn reset(&mut self, now: Instant) {
        self.memory.reset();
        let features = registers::features(self.clock.is_some());
        self.memory.set(registers::PORT_DESCRIPTOR, &[self.ports]);
        self.memory.set(0x0008, &features.to_le_bytes());
        // The watchdog of the device's own side does not expire.
        self.memory.set(registers::DL_STATUS, &[0x02]);
        self.sii.load(&mut self.memory);
        self.fmmus = Default::default();
        self.sync_managers = Default::default();
        (0..self.sync_managers.len()).for_each(|index| SyncManager::reset(&mut self.memory, index));
        self.watchdog = Watchdog::default();
        self.clock = self.clock.is_some().then(|| Clock::new(now, self.local_clock));
        self.changes = Changes::default();
        self.waiting = [false; 4];
        self.shadow.clear();
        self.set_ports(self.linked);
        (self.reset_letters, self.reset_letter, self.latches_ports, self.events) = (0, None, false, 0);
    }

    /// Returns what changed since the last call.
    pub(crate) fn take_changes(&mut self) -> Changes {
        mem::take(&mut self.changes)
    }

    /// Returns the content of the EEPROM, which counts from the next power-on.
    pub(crate) fn eeprom_mut(&mut self) -> &mut [u8] {
        self.sii.image_mut()
    }

    /// Begins a frame.
    pub(crate) const fn begin_frame(&mut self) {
        if let Some(clock) = &mut self.clock {
            clock.end_latch();
        }
    }

    /// Notes that the frame arrives at a port, on its way from the MainDevice or back.
    pub(crate) fn frame_arrives(&mut self, now: Instant, port: usize) {
        if let Some(clock) = &mut self.clock {
            clock.arrive(port, now, &mut self.memory);
        }
    }

    /// Lets a datagram pass the processing unit.
    pub(crate) fn process(&mut self, now: Instant, datagram: &mut Datagram<'_>) {
        let Some((addressing, operation)) = decode(datagram.command()) else { return };
        self.sii.refresh(now, &mut self.memory);
        let (position, offset) = datagram.address();
        let meant = match addressing {
            Addressing::Position | Addressing::Broadcast => {
                datagram.set_position(position.wrapping_add(1));
                position == 0 || addressing == Addressing::Broadcast
            }
            Addressing::Station => self.has_address(position),
            Addressing::Logical => true,
        };
        // The other commands that write latch the time of the processing unit alone (ESC datasheet section II, 0x0900).
        self.latches_ports |= meant
            && operation == Operation::Write
            && matches!(addressing, Addressing::Broadcast | Addressing::Station);
        // `scratch` is put back below; nothing in between needs it.
        let mut scratch = mem::take(&mut self.scratch);
        let (read, written) = match (addressing, operation, meant) {
            (Addressing::Logical, operation, _) => self.logical(now, operation, datagram, &mut scratch),
            (_, Operation::ReadMultipleWrite, false) => (false, self.write(offset, datagram.data)),
            (_, _, false) => (false, false),
            (Addressing::Broadcast, operation, _) => {
                self.broadcast(now, operation, offset, datagram.data, &mut scratch)
            }
            (_, operation, _) => self.physical(now, operation, offset, datagram.data, &mut scratch),
        };
        self.scratch = scratch;
        let write_counts = if operation == Operation::ReadWrite { 2 } else { 1 };
        datagram.count(u16::from(read) + if written { write_counts } else { 0 });
        let events = self.events();
        datagram.add_events(events & self.memory.u16(registers::EVENT_MASK));
    }

    fn has_address(&self, address: u16) -> bool {
        address == self.memory.u16(registers::STATION_ADDRESS)
            || (self.memory.u8(registers::DL_ALIAS) & 1 != 0
                && address == self.memory.u16(registers::STATION_ALIAS))
    }

    /// Reads and writes at a physical address; returns which of the two succeeded.
    fn physical(
        &mut self,
        now: Instant,
        operation: Operation,
        address: u16,
        data: &mut [u8],
        scratch: &mut [u8],
    ) -> (bool, bool) {
        match operation {
            Operation::Read | Operation::ReadMultipleWrite => (self.read(now, address, data), false),
            Operation::Write => (false, self.write(address, data)),
            Operation::ReadWrite => {
                let Some(incoming) = copied(scratch, data) else { return (false, false) };
                (self.read(now, address, data), self.write(self.write_address(address), incoming))
            }
        }
    }

    /// Returns the address that a command writes which reads at `address`.
    fn write_address(&self, address: u16) -> u16 {
        address.wrapping_add(self.memory.u16(registers::READ_WRITE_OFFSET))
    }

    /// Executes a broadcast: the data read is combined with that of the devices before.
    fn broadcast(
        &mut self,
        now: Instant,
        operation: Operation,
        address: u16,
        data: &mut [u8],
        scratch: &mut [u8],
    ) -> (bool, bool) {
        if operation == Operation::Write {
            return (false, self.write(address, data));
        }
        let Some(own) = scratch.get_mut(..data.len()) else { return (false, false) };
        own.fill(0);
        let read = self.read(now, address, own);
        let written = operation == Operation::ReadWrite && self.write(self.write_address(address), data);
        data.iter_mut().zip(own).for_each(|(data, own)| *data |= *own);
        (read, written)
    }

    /// Reads and writes what the FMMUs map.
    fn logical(
        &mut self,
        now: Instant,
        operation: Operation,
        datagram: &mut Datagram<'_>,
        scratch: &mut [u8],
    ) -> (bool, bool) {
        let address = datagram.logical_address();
        let half = scratch.len() / 2;
        let Some((incoming, bits)) = scratch.split_at_mut_checked(half) else { return (false, false) };
        let Some(incoming) = copied(incoming, datagram.data) else { return (false, false) };
        let (mut read, mut written) = (false, false);
        for fmmu in self.fmmus {
            let Some(mapped) = fmmu.map(address, incoming.len()) else { continue };
            let reads = fmmu.reads && operation != Operation::Write;
            let writes = fmmu.writes && operation != Operation::Read;
            if let Some(bytes) = mapped.bytes() {
                if reads && let Some(data) = datagram.data.get_mut(bytes.clone()) {
                    read |= self.read(now, mapped.address, data);
                }
                if writes && let Some(data) = incoming.get(bytes) {
                    written |= self.write(mapped.address, data);
                }
                continue;
            }
            let Some(bits) = bits.get_mut(..mapped.physical_len()) else { continue };
            let (bit, count) = (usize::from(mapped.bit), mapped.bits.len());
            if reads {
                // What cannot be read leaves the datagram as it is.
                copy_bits(datagram.data, mapped.bits.start, bits, bit, count);
                if self.read(now, mapped.address, bits) {
                    copy_bits(bits, bit, datagram.data, mapped.bits.start, count);
                    read = true;
                }
            }
            if writes {
                // The chip writes whole bytes; what it writes beside the mapped bits is undefined. Ours writes zeros.
                bits.fill(0);
                copy_bits(incoming, mapped.bits.start, bits, bit, count);
                written |= self.write(mapped.address, bits);
            }
        }
        (read, written)
    }

    /// Returns the requests to the MainDevice: status changes, and a bit for each mailbox that has a message for it.
    fn events(&self) -> u16 {
        let mut events = self.events;
        for (index, sync_manager) in self.sync_managers.iter().enumerate() {
            let full = !sync_manager.is_written_by_main_device() && sync_manager.is_full(&self.memory, index);
            events |= u16::from(full) << (4 + index);
        }
        events
    }
}

/// Copies data to the start of a buffer.
fn copied<'a>(buffer: &'a mut [u8], data: &[u8]) -> Option<&'a [u8]> {
    let room = buffer.get_mut(..data.len())?;
    room.copy_from_slice(data);
    Some(room)
}
