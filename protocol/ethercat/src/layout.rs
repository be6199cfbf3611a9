//! Where a device's sync managers are in its memory. The MainDevice reads this from the EEPROM and configures them accordingly.

use alloc::vec::Vec;
use core::ops::Range;

use crate::description::{Description, Pdo, PdoEntry, process_data_len};

/// First address of the process data RAM.
pub(crate) const RAM_START: u16 = 0x1000;

/// Bytes of process data RAM: as much as the ET1100 has and twice 256 bytes in three buffers need.
pub(crate) const RAM_LEN: u16 = 0x2000;

/// Bytes of the longest process data RAM: that of an FPGA with the whole address space (ESC datasheet section II, 0x0006).
pub(crate) const LONGEST_RAM: u16 = 0xF000;

/// Sync managers of the chip.
const UNITS: usize = 8;

/// What a sync manager is for (ETG.1000.6, SII category 41).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Usage {
    /// Messages from the MainDevice.
    MailboxReceive = 1,
    /// Messages to the MainDevice.
    MailboxSend = 2,
    /// Process data from the MainDevice.
    Outputs = 3,
    /// Process data to the MainDevice.
    Inputs = 4,
}

impl Description {
    /// Returns the length in bytes of the longest outputs or inputs that the MainDevice may map.
    pub(crate) fn room(&self, usage: Usage) -> u16 {
        let (pdos, optional) = self.mappable(usage);
        let bits = |entries: &[PdoEntry]| entries.iter().map(|entry| u32::from(entry.bits)).sum::<u32>();
        let all = pdos.iter().map(|pdo| bits(pdo.entries)).sum::<u32>() + bits(optional);
        u16::try_from(all.div_ceil(8)).unwrap_or(u16::MAX)
    }

    /// Returns the process data of a direction, and the entries besides those that the MainDevice may map.
    pub(crate) const fn mappable(&self, usage: Usage) -> (&'static [Pdo], &'static [PdoEntry]) {
        match usage {
            Usage::Outputs => (self.outputs, self.optional_outputs),
            _ => (self.inputs, self.optional_inputs),
        }
    }
}

/// How a sync manager has to be configured.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SyncManagerLayout {
    /// What it is for.
    pub usage: Usage,
    /// First address of its buffer.
    pub start: u16,
    /// Length in bytes of its buffer; process data have three, one behind the other.
    pub len: u16,
    /// Control register: mode, direction, interrupts, watchdog trigger.
    pub control: u8,
}

/// Returns the sync managers of a device with this description, in the order of their numbers.
#[must_use]
pub fn sync_managers(description: &Description) -> Vec<SyncManagerLayout> {
    Layout::new(description, &[]).iter().collect()
}

/// The sync managers of a device, by their numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    sync_managers: [Option<SyncManagerLayout>; UNITS],
}

impl Layout {
    /// Places the sync managers where `given` has them, if it has any.
    pub(crate) fn new(description: &Description, given: &[SyncManagerLayout]) -> Self {
        if !given.is_empty() {
            let mut sync_managers = [None; UNITS];
            sync_managers.iter_mut().zip(given).for_each(|(place, layout)| *place = Some(*layout));
            return Self { sync_managers };
        }
        let mut start = RAM_START;
        let mut place = |usage, len: u16, buffers: u16, control| {
            let placed = SyncManagerLayout { usage, start, len, control };
            let room = if buffers > 1 { description.room(usage) } else { len };
            // Each on a boundary of 128 bytes, which makes captures readable.
            start = start.saturating_add(room.saturating_mul(buffers)).next_multiple_of(0x80);
            Some(placed)
        };
        let outputs = process_data_len(description.outputs);
        let inputs = process_data_len(description.inputs);
        let placed = match description.mailbox {
            Some(mailbox) => [
                place(Usage::MailboxReceive, mailbox.len, 1, 0x26),
                place(Usage::MailboxSend, mailbox.len, 1, 0x22),
                place(Usage::Outputs, outputs, 3, 0x64),
                place(Usage::Inputs, inputs, 3, 0x20),
            ],
            // Without a mailbox there are sync managers only for the data that there are, as in terminals on the market.
            None => [
                if outputs > 0 { place(Usage::Outputs, outputs, 3, 0x64) } else { None },
                if inputs > 0 { place(Usage::Inputs, inputs, 3, 0x20) } else { None },
                None,
                None,
            ],
        };
        let mut sync_managers = [None; UNITS];
        sync_managers.iter_mut().zip(placed).for_each(|(place, layout)| *place = layout);
        Self { sync_managers }
    }

    /// Changes the length of process data; their buffer stays where it is.
    pub(crate) fn set_len(&mut self, usage: Usage, len: u16) {
        let found = self.sync_managers.iter_mut().flatten().find(|layout| layout.usage == usage);
        if let Some(layout) = found {
            layout.len = len;
        }
    }

    /// Returns the sync managers in the order of their numbers.
    pub(crate) fn iter(&self) -> impl Iterator<Item = SyncManagerLayout> + '_ {
        self.sync_managers.iter().flatten().copied()
    }

    /// Returns the sync managers of a direction by their numbers, each with the range of its data among those of the direction: one
    /// after another.
    pub(crate) fn parts(&self, usage: Usage) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
        let mut at = 0;
        self.iter().enumerate().filter(move |(_, layout)| layout.usage == usage).map(
            move |(index, layout)| {
                let start = at;
                at += usize::from(layout.len);
                (index, start..at)
            },
        )
    }

    /// Returns the bytes of process data RAM that the sync managers need, in whole KiB. Process data may have three buffers.
    pub(crate) fn ram(&self) -> u16 {
        let end = |layout: SyncManagerLayout| u32::from(layout.start) + 3 * u32::from(layout.len);
        let end = self.iter().map(end).max().unwrap_or(0);
        let ram = end.saturating_sub(RAM_START.into()).next_multiple_of(0x400);
        u16::try_from(ram).unwrap_or(LONGEST_RAM)
    }

    /// Returns the bytes of a direction.
    pub(crate) fn len(&self, usage: Usage) -> usize {
        self.parts(usage).last().map_or(0, |(_, range)| range.end)
    }

    /// Returns the sync manager for this use, the first of several, and its number.
    pub(crate) fn find(&self, usage: Usage) -> Option<(usize, SyncManagerLayout)> {
        self.iter().enumerate().find(|(_, layout)| layout.usage == usage)
    }
}
