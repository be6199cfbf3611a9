//! Datagrams within a frame, read and changed in place, as a frame is changed while it passes a device (ETG.1000.4).
//!
//! ```text
//! 0..2        EtherCAT header: length of the datagrams in bits 0..11, type 1 in bits 12..16
//! datagram:
//! 0           command
//! 1           index, by which the MainDevice recognises its datagrams
//! 2..6        address: position or station (2..4) and offset (4..6), or logical address
//! 6..8        length of the data in bits 0..11, circulating bit 14, more follow bit 15
//! 8..10       event requests of the devices
//! 10..        data
//! ..+2        working counter
//! ```

/// Length in bytes of the EtherCAT header.
pub const HEADER_LEN: usize = 2;

/// Length in bytes of a datagram's header.
pub const DATAGRAM_HEADER_LEN: usize = 10;

/// Length in bytes of the working counter.
pub const WORKING_COUNTER_LEN: usize = 2;

/// Longest data of a datagram in a frame of 1518 bytes.
pub const MAX_DATA_LEN: usize = 1486;

/// In the high byte of a datagram's length: it has passed a closed port 0.
const CIRCULATING: u8 = 0x40;

/// Type in the EtherCAT header of frames with datagrams.
const TYPE_DATAGRAMS: u16 = 1;

/// How a command finds its devices.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Addressing {
    /// By position in the ring: each device adds one; the datagram is for the device that finds zero.
    Position,
    /// By station address or alias.
    Station,
    /// All devices.
    Broadcast,
    /// By the FMMUs.
    Logical,
}

/// What a command does at a device that it addresses.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Operation {
    /// Copies memory to the datagram.
    Read,
    /// Copies the datagram to memory.
    Write,
    /// Exchanges memory and datagram.
    ReadWrite,
    /// Reads at the addressed device and writes at all others.
    ReadMultipleWrite,
}

/// Returns how a command finds its devices and what it does there; `None` for NOP and unknown commands.
#[must_use]
pub const fn decode(command: u8) -> Option<(Addressing, Operation)> {
    use Addressing::{Broadcast, Logical, Position, Station};
    use Operation::{Read, ReadMultipleWrite, ReadWrite, Write};
    Some(match command {
        1 => (Position, Read),
        2 => (Position, Write),
        3 => (Position, ReadWrite),
        4 => (Station, Read),
        5 => (Station, Write),
        6 => (Station, ReadWrite),
        7 => (Broadcast, Read),
        8 => (Broadcast, Write),
        9 => (Broadcast, ReadWrite),
        10 => (Logical, Read),
        11 => (Logical, Write),
        12 => (Logical, ReadWrite),
        13 => (Position, ReadMultipleWrite),
        14 => (Station, ReadMultipleWrite),
        _ => return None,
    })
}

/// One datagram of a frame.
#[derive(Debug)]
pub struct Datagram<'a> {
    header: &'a mut [u8; DATAGRAM_HEADER_LEN],
    /// Its data.
    pub data: &'a mut [u8],
    working_counter: &'a mut [u8; WORKING_COUNTER_LEN],
}

impl Datagram<'_> {
    /// Returns the command's code.
    #[must_use]
    pub const fn command(&self) -> u8 {
        let [command, ..] = *self.header;
        command
    }

    /// Returns position or station address, and offset.
    #[must_use]
    pub const fn address(&self) -> (u16, u16) {
        let [_, _, a, b, c, d, ..] = *self.header;
        (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]))
    }

    /// Returns the logical address.
    #[must_use]
    pub const fn logical_address(&self) -> u32 {
        let [_, _, a, b, c, d, ..] = *self.header;
        u32::from_le_bytes([a, b, c, d])
    }

    /// Replaces position or station address.
    pub const fn set_position(&mut self, position: u16) {
        let [_, _, low, high, ..] = self.header;
        [*low, *high] = position.to_le_bytes();
    }

    /// Adds event requests of a device to those of the devices before it.
    pub const fn add_events(&mut self, events: u16) {
        let [.., low, high] = self.header;
        [*low, *high] = (u16::from_le_bytes([*low, *high]) | events).to_le_bytes();
    }

    /// Marks it as circulating. Returns whether it was so before.
    pub const fn set_circulating(&mut self) -> bool {
        let [.., high, _, _] = self.header;
        let was = *high & CIRCULATING != 0;
        *high |= CIRCULATING;
        was
    }

    /// Returns the working counter.
    #[must_use]
    pub const fn working_counter(&self) -> u16 {
        u16::from_le_bytes(*self.working_counter)
    }

    /// Adds to the working counter.
    pub const fn count(&mut self, increment: u16) {
        *self.working_counter = self.working_counter().wrapping_add(increment).to_le_bytes();
    }
}

/// The datagrams of a frame, one after another.
#[derive(Debug)]
pub struct Datagrams<'a> {
    rest: Option<&'a mut [u8]>,
}

impl<'a> Datagrams<'a> {
    /// Begins at the first datagram of an EtherCAT payload, without its Ethernet header. `None` if it contains no
    /// datagrams, or fewer bytes than it says.
    #[must_use]
    pub fn of(payload: &'a mut [u8]) -> Option<Self> {
        let (header, rest) = payload.split_first_chunk_mut::<HEADER_LEN>()?;
        let header = u16::from_le_bytes(*header);
        if header >> 12 != TYPE_DATAGRAMS {
            return None;
        }
        Some(Self { rest: Some(rest.get_mut(..usize::from(header & 0x07FF))?) })
    }
}

impl<'a> Iterator for Datagrams<'a> {
    type Item = Datagram<'a>;

    /// Returns the next datagram. A truncated datagram ends the frame: it has no working counter for the devices.
    fn next(&mut self) -> Option<Datagram<'a>> {
        let (header, rest) = self.rest.take()?.split_first_chunk_mut::<DATAGRAM_HEADER_LEN>()?;
        let [.., low, high, _, _] = *header;
        let length = u16::from_le_bytes([low, high]);
        let (data, rest) = rest.split_at_mut_checked(usize::from(length & 0x07FF))?;
        let (working_counter, rest) = rest.split_first_chunk_mut::<WORKING_COUNTER_LEN>()?;
        if length & 0x8000 != 0 {
            self.rest = Some(rest);
        }
        Some(Datagram { header, data, working_counter })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns two datagrams as SOEM sends them in its search for devices: BRD of the type, and APRD of the AL status.
    fn payload() -> Vec<u8> {
        let mut payload = vec![0x1C, 0x10];
        payload.extend([0x07, 0x01, 0, 0, 0, 0, 0x02, 0x80, 0, 0, 0, 0, 0, 0]);
        payload.extend([0x01, 0x02, 0xFF, 0xFF, 0x30, 0x01, 0x02, 0x00, 0, 0, 0, 0, 0, 0]);
        payload
    }

    #[test]
    fn datagrams_are_found_one_after_another_and_counted_in_place() {
        let mut payload = payload();
        for datagram in Datagrams::of(&mut payload).unwrap() {
            let mut datagram = datagram;
            datagram.count(1);
            datagram.add_events(4);
            datagram.data.fill(9);
        }
        let seen: Vec<_> = Datagrams::of(&mut payload)
            .unwrap()
            .map(|datagram| (datagram.command(), datagram.address(), datagram.working_counter()))
            .collect();
        assert_eq!(seen, [(7, (0, 0), 1), (1, (0xFFFF, 0x0130), 1)]);
        assert_eq!(payload[10..16], [4, 0, 9, 9, 1, 0]);
    }

    #[test]
    fn the_last_datagram_ends_the_frame_whatever_follows_it() {
        let mut payload = payload();
        payload[9] = 0; // no more follow the first one
        assert_eq!(Datagrams::of(&mut payload).unwrap().count(), 1);
    }

    #[test]
    fn an_event_request_of_two_devices_stays_one() {
        let mut payload = payload();
        let mut datagram = Datagrams::of(&mut payload).unwrap().next().unwrap();
        datagram.add_events(0x0104);
        datagram.add_events(0x0014);
        assert_eq!(payload[10..12], [0x14, 0x01]);
    }

    #[test]
    fn a_frame_that_says_it_is_longer_than_it_is_has_no_datagrams() {
        let mut payload = payload();
        payload.pop();
        assert!(Datagrams::of(&mut payload).is_none());
    }

    #[test]
    fn a_datagram_that_says_it_is_longer_than_its_frame_ends_the_frame() {
        let mut payload = payload();
        payload[8] = 0x20; // 32 bytes of data in the first one
        assert_eq!(Datagrams::of(&mut payload).unwrap().count(), 0);
    }
}
