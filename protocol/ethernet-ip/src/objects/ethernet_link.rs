//! Ethernet Link, class F6 (volume 2, 5-5).

use super::super::Writer;
use super::super::cip::Violation;
use super::{Device, Object, write_short_string};

/// Speed that the interface reports, in Mbit/s.
const SPEED_MBIT_S: u16 = 100;

/// Flags: link up, full duplex, settings negotiated.
const FLAGS: u32 = 1 | 1 << 1 | 3 << 2;

pub(super) struct EthernetLink;

impl Object for EthernetLink {
    const REVISION: u16 = 4;
    /// Attributes 4 and 5, the counters of the interface and of its medium, are left out: they belong to the
    /// operating system, which also counts other programs' frames, and zeros would claim that nothing was ever sent.
    const ATTRIBUTES: &'static [u16] = &[1, 2, 3, 6, 7, 8, 9, 10, 11];
    const ALL: &'static [u16] = &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];

    fn get(
        device: &Device,
        _instance: u32,
        attribute: u16,
        writer: &mut Writer<'_>,
    ) -> Result<(), Violation> {
        match attribute {
            1 => writer.u32(SPEED_MBIT_S.into()),
            2 => writer.u32(FLAGS),
            3 => writer.bytes(&device.network.mac),
            // Values of the missing attributes in Get_Attributes_All.
            4 => writer.zeros(11 * 4),
            5 => writer.zeros(12 * 4),
            // Interface control: negotiation on, no forced speed.
            6 => {
                writer.u16(1);
                writer.u16(0);
            }
            // Twisted pair; enabled; enabled by its administrator.
            7 => writer.u8(2),
            8 | 9 => writer.u8(1),
            10 => write_short_string(writer, "EtherNet/IP"),
            11 => {
                // Capability: auto-negotiation; one speed, full duplex.
                writer.u32(1 << 1);
                writer.u8(1);
                writer.u16(SPEED_MBIT_S);
                writer.u8(1);
            }
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }
}
