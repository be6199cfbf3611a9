//! The datagrams of a frame, one after another (ETG.1000.4).
//!
//! ```text
//! 0       command
//! 1       index
//! 2..4    position or station address; all of 2..6 is a logical address
//! 4..6    register
//! 6..8    length of the data in bits 0 to 10; bit 15: another datagram follows
//! 8..10   event requests
//! 10..    data, then the working counter, u16
//! ```

use crate::ETHER_TYPE;

/// EtherType of an 802.1Q tag.
const TAG: [u8; 2] = [0x81, 0x00];

/// Type in the EtherCAT header of frames with datagrams.
const DATAGRAMS: u16 = 1;

const LENGTH: u16 = 0x07FF;
const MORE: u16 = 0x8000;

/// A datagram, as far as a MainDevice looks into those that it did not make itself.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Datagram<'a> {
    pub(crate) command: u8,
    /// Position or station address.
    pub(crate) device: u16,
    pub(crate) register: u16,
    pub(crate) data: &'a [u8],
    pub(crate) working_counter: u16,
}

/// The datagrams of a frame. It ends at the first one that is cut off.
#[derive(Clone, Debug)]
pub(crate) struct Datagrams<'a>(&'a [u8]);

impl<'a> Datagrams<'a> {
    /// Returns the datagrams of an Ethernet frame; none of a frame without datagrams.
    pub(crate) fn of(frame: &'a [u8]) -> Self {
        let header = ethercat(frame).and_then(<[u8]>::split_first_chunk);
        Self(match header {
            Some((header, rest)) if u16::from_le_bytes(*header) >> 12 == DATAGRAMS => rest,
            _ => &[],
        })
    }
}

impl<'a> Iterator for Datagrams<'a> {
    type Item = Datagram<'a>;

    fn next(&mut self) -> Option<Datagram<'a>> {
        let (header, rest) = std::mem::take(&mut self.0).split_first_chunk::<10>()?;
        let [command, _, a, b, c, d, low, high, _, _] = *header;
        let len = u16::from_le_bytes([low, high]);
        let (data, rest) = rest.split_at_checked(usize::from(len & LENGTH))?;
        let (working_counter, rest) = rest.split_first_chunk()?;
        if len & MORE != 0 {
            self.0 = rest;
        }
        let (device, register) = (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]));
        Some(Datagram {
            command,
            device,
            register,
            data,
            working_counter: u16::from_le_bytes(*working_counter),
        })
    }
}

/// Returns the EtherCAT header of a frame and what follows it; `None` for a frame of another protocol.
pub(crate) fn ethercat(frame: &[u8]) -> Option<&[u8]> {
    let (mut ether_type, mut rest) = frame.get(12..)?.split_first_chunk::<2>()?;
    if *ether_type == TAG {
        (ether_type, rest) = rest.get(2..)?.split_first_chunk()?;
    }
    (*ether_type == ETHER_TYPE.to_be_bytes()).then_some(rest)
}
