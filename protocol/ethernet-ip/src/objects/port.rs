//! Port, class F4: the ports by which a message can leave the device (volume 1, 3-7). There is one.

use super::super::Writer;
use super::super::cip::{Violation, class};
use super::{Device, Object, write_instance_path, write_short_string};
use core::fmt::Write as _;
use core::net::Ipv4Addr;

/// Port type: EtherNet/IP (volume 1, table 3-7.7).
const ETHERNET_IP: u16 = 4;

/// Number of the port. 1 is for a backplane, which this device does not have.
pub const PORT_NUMBER: u16 = 2;

pub(super) struct Port;

/// An IPv4 address as text.
struct Dotted {
    text: [u8; 15],
    len: usize,
}

impl Dotted {
    fn new(address: Ipv4Addr) -> Self {
        let mut dotted = Self { text: [0; 15], len: 0 };
        // Every address fits into 15 characters.
        let _ = write!(dotted, "{address}");
        dotted
    }

    fn as_bytes(&self) -> &[u8] {
        self.text.get(..self.len).unwrap_or_default()
    }
}

impl core::fmt::Write for Dotted {
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        let place = self.text.get_mut(self.len..self.len + text.len()).ok_or(core::fmt::Error)?;
        place.copy_from_slice(text.as_bytes());
        self.len += text.len();
        Ok(())
    }
}

impl Object for Port {
    const REVISION: u16 = 2;
    const ATTRIBUTES: &'static [u16] = &[1, 2, 3, 4, 7];
    const CLASS_ATTRIBUTES: &'static [u16] = &[1, 2, 3, 8, 9];

    fn get(
        device: &Device,
        _instance: u32,
        attribute: u16,
        writer: &mut Writer<'_>,
    ) -> Result<(), Violation> {
        match attribute {
            1 => writer.u16(ETHERNET_IP),
            2 => writer.u16(PORT_NUMBER),
            3 => write_instance_path(writer, class::TCP_IP_INTERFACE),
            4 => write_short_string(writer, "EtherNet/IP"),
            7 => {
                // A port segment, followed by the device's own address.
                let address = Dotted::new(device.network.address);
                let link = address.as_bytes();
                writer.bytes(&[0x10 | PORT_NUMBER as u8, link.len() as u8]);
                writer.bytes(link);
                writer.zeros(link.len() % 2);
            }
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }

    fn get_of_class(_device: &Device, attribute: u16, writer: &mut Writer<'_>) -> Result<(), Violation> {
        match attribute {
            1 => writer.u16(Self::REVISION),
            2 | 3 => writer.u16(1),
            // Entry port: the one by which the request arrived.
            8 => writer.u16(1),
            // Type and number of each port, beginning with an undefined instance 0.
            9 => [0, 0, ETHERNET_IP, PORT_NUMBER].iter().for_each(|number| writer.u16(*number)),
            6 => writer.u16(9),
            7 => writer.u16(7),
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }
}
