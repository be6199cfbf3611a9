//! The place of a device that is driven on its own, among the devices of one cable.
//!
//! Each such device has an ethercrab of its own, which knows a cable with this device only. The frames on the cable address
//! the device at its real place: position, station address and logical addresses are moved by the slot. A broadcast, by which
//! ethercrab resets all devices, becomes an access to this device alone, so that the others go on undisturbed.

use std::fmt;

use machine::Instant;

/// Station address of the first device in ethercrab's numbering.
const FIRST_STATION: u16 = 0x1000;

/// Logical addresses of one device: more than its largest process data.
const LOGICAL_SPACE: u32 = 0x1000;

/// Commands (ETG.1000.4).
const APRD: u8 = 1;
const APWR: u8 = 2;
const APRW: u8 = 3;
const FPRD: u8 = 4;
const FPRW: u8 = 6;
const BRD: u8 = 7;
const BWR: u8 = 8;
const BRW: u8 = 9;
const LRD: u8 = 10;
const LRW: u8 = 12;
const ARMW: u8 = 13;
const FRMW: u8 = 14;

/// Registers: station address, and the FMMUs with 16 bytes each.
const STATION_ADDRESS: u16 = 0x0010;
const FMMUS: std::ops::Range<u16> = 0x0600..0x0700;

/// An FMMU's activation, in its 16 bytes; its logical start address is in the first four.
const FMMU_ACTIVE: usize = 12;

/// Bytes of a datagram's header.
pub(crate) const HEADER: usize = 10;

/// The place of a device among the driven devices of a cable.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Slot {
    /// Its position, from 0.
    pub(crate) index: u16,
    /// Its number among the driven devices, from 0.
    pub(crate) driven: u16,
    /// Positions of the first and the last driven device, from 0.
    pub(crate) range: (u16, u16),
    /// An instant of the grid on which all devices exchange process data.
    pub(crate) grid: Instant,
}

impl Slot {
    /// Returns the number of the device, from 1.
    pub(crate) fn number(self) -> usize {
        usize::from(self.index) + 1
    }

    /// Returns the number of the device that has this station address, if it is another one from the first to the last driven
    /// one of this cable.
    pub(crate) fn other_with_station(self, station: u16) -> Option<usize> {
        let index = station.checked_sub(FIRST_STATION)?;
        let (first, last) = self.range;
        ((first..=last).contains(&index) && index != self.index).then(|| usize::from(index) + 1)
    }

    /// Writes that the device is missing, and where to look.
    pub(crate) fn explain_missing(self, words: &mut dyn fmt::Write) -> fmt::Result {
        let number = self.number();
        write!(words, "device {number} is missing: check its power and the cable between ")?;
        match self.index {
            0 => write!(words, "the MainDevice and device 1"),
            before => write!(words, "devices {before} and {number}"),
        }
    }

    /// Moves a datagram of ethercrab's to the device: its header, and addresses in the data that it writes.
    pub(crate) fn place(self, datagram: &mut [u8]) {
        let Some(([command, _, a, b, c, d, ..], rest)) = datagram.split_first_chunk_mut::<HEADER>() else {
            return;
        };
        let address = u16::from_le_bytes([*a, *b]);
        let register = u16::from_le_bytes([*c, *d]);
        // Each device that a datagram passes adds 1 to the position; it is for the one that finds 0.
        let position = 0_u16.wrapping_sub(self.index).to_le_bytes();
        match *command {
            APRD..=APRW | ARMW => [*a, *b] = address.wrapping_sub(self.index).to_le_bytes(),
            BRD => (*command, [*a, *b]) = (APRD, position),
            BWR => (*command, [*a, *b]) = (APWR, position),
            BRW => (*command, [*a, *b]) = (APRW, position),
            FPRD..=FPRW => [*a, *b] = address.wrapping_add(self.index).to_le_bytes(),
            // The other devices must not take the value.
            FRMW => (*command, [*a, *b]) = (FPRD, address.wrapping_add(self.index).to_le_bytes()),
            LRD..=LRW => {
                let logical = self.logical([*a, *b, *c, *d]);
                [*a, *b, *c, *d] = logical;
                return;
            }
            _ => return,
        }
        if *command == APWR && register == STATION_ADDRESS {
            if let Some([low, high, ..]) = rest.first_chunk_mut::<2>() {
                let station = u16::from_le_bytes([*low, *high]).wrapping_add(self.index);
                [*low, *high] = station.to_le_bytes();
            }
        } else if FMMUS.contains(&register)
            && rest.get(FMMU_ACTIVE) == Some(&1)
            && let Some(start) = rest.first_chunk_mut::<4>()
        {
            *start = self.logical(*start);
        }
    }

    /// Returns the position with which a datagram of this header goes out; `None` if it does not go by position.
    pub(crate) const fn sent_position(self, header: &[u8; 8]) -> Option<u16> {
        let [command, _, a, b, ..] = *header;
        match command {
            APRD..=APRW | ARMW => Some(u16::from_le_bytes([a, b]).wrapping_sub(self.index)),
            // See `place`.
            BRD..=BRW => Some(0_u16.wrapping_sub(self.index)),
            _ => None,
        }
    }

    fn logical(self, address: [u8; 4]) -> [u8; 4] {
        let moved = u32::from_le_bytes(address).wrapping_add(u32::from(self.index) * LOGICAL_SPACE);
        moved.to_le_bytes()
    }
}
